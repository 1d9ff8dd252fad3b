"""Any mixture of names, units and separators either reads the numbers that were written, in SI, or refuses in one line.

The spellings, units and factors here are this test's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import ContactWrenchError

TURN = Rotation.from_rotvec([0.3, -0.5, 0.7])
W = np.array([1.5, -2.25, 10.0, 0.125, -0.25, 0.5])
T, DECOY = 12.5, 77.0
POUND, INCH, G = 4.4482216152605, 0.0254, 9.80665

FORCE = {"": 1.0, "N": 1.0, "kN": 1e3, "mN": 1e-3, "MN": 1e6, "kgf": G, "lbf": POUND, "Newton": 1.0}
TORQUE = {
    "": 1.0,
    "Nm": 1.0,
    "N m": 1.0,
    "N.m": 1.0,
    "N·m": 1.0,
    "Nmm": 1e-3,
    "N mm": 1e-3,
    "Ncm": 1e-2,
    "mNm": 1e-3,
    "lbf in": POUND * INCH,
    "lbf-in": POUND * INCH,
    "lbs in": POUND * INCH,
    "inch pounds": POUND * INCH,
    "kgf cm": G * 1e-2,
    "kg-cm": G * 1e-2,
    "cm kgf": G * 1e-2,
}
TIME = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
ANGLE = {"deg": np.pi / 180.0, "°": np.pi / 180.0, "degrees": np.pi / 180.0, "rad": 1.0}
STRANGE = {"counts": 3.0, "V": 0.2, "dyn": 1e-5, "%": 0.01}
"""Units that nobody can be expected to know: refused, or left alone."""

FORCE_WORDS = ("F", "f", "Force", "force", "FORCE", "forces", "wrench.force", "wrench_force", "FT_F", "sensor force")
TORQUE_WORDS = ("T", "M", "t", "m", "Torque", "torque", "Moment", "moment", "wrench.torque", "tau", "FT_T", "ft_m")
BETWEEN = ("", "_", " ", ".", "/", "-")
WITH_UNIT = ("{} ({})", "{} [{}]", "{}_{}", "{}/{}", "{} in {}", "{}({})", "{} / {}")
AROUND = ("", "", "", "measured ", "actual_", "/ft/", "left_", "raw ", "sensor.")
TIMES = ("t", "time", "Time", "TIME", "timestamp", "elapsed time", "Time Stamp", "header.stamp")
QUATERNIONS = ("q{}", "q_{}", "Q{}", "quat_{}", "orientation_{}", "pose.orientation.{}", "current_orientation_{}")
ANGLES = {
    "xyz": (("roll", "pitch", "yaw"), ("Roll", "Pitch", "Yaw"), ("rpy_roll", "rpy_pitch", "rpy_yaw")),
    "ZYX": (("a", "b", "c"), ("A", "B", "C")),
}
DECOYS = (
    "fx_std",
    "target_force_x",
    "cmd_fx",
    "Fx_filtered",
    "contact_force_x",
    "joint_torque_1",
    "tau_1",
    "vx (m/s)",
    "ax",
    "gx",
    "temperature",
    "index",
    "qd_x",
    "force_magnitude",
    "torque",
    "F",
    "goal_orientation_x",
    "target_qx",
    "x",
    "position_y",
    "mx",
    "tx",
    "Fx2",
    "force_x",
    "Torque Z (Nmm)",
    "timestamp_sent",
    "frame_time",
    "seq",
    "stamp",
    "roll",
    "rx",
    "status (hex)",
)
LETTERS = "xyz"


@dataclass(frozen=True)
class Written:
    """A column: its header and the number in it."""

    name: str
    value: float


def in_case(name: str, case: str) -> str:
    """A name in other letters; MN stays itself, as mN is another unit."""
    if "MN" in name:
        return name
    return {"as it is": name, "upper": name.upper(), "lower": name.lower()}[case]


@st.composite
def quantities(
    draw: st.DrawFn, words: tuple[str, ...], units: dict[str, float], values: np.ndarray, mixed: bool
) -> list[Written]:
    """Three columns of a vector: one style, or each its own."""
    columns: list[Written] = []
    style: tuple[str, str, str, str, str, str] | None = None
    for axis, value in zip(LETTERS, values.tolist(), strict=True):
        if style is None or mixed:
            unit = draw(st.sampled_from([*units, *(STRANGE if mixed else ())]))
            form = draw(st.sampled_from(WITH_UNIT)) if unit else "{}"
            around = draw(st.sampled_from(AROUND)) if mixed else ""
            case = draw(st.sampled_from(["as it is", "upper", "lower"])) if mixed else "as it is"
            style = draw(st.sampled_from(words)), draw(st.sampled_from(BETWEEN)), unit, form, around, case
        word, between, unit, form, around, case = style
        text = around + word + between + (axis.upper() if word[0].isupper() and draw(st.booleans()) else axis)
        columns.append(Written(in_case(form.format(text, unit), case), value / {**units, **STRANGE}[unit]))
    return columns


@st.composite
def orientations(draw: st.DrawFn) -> list[Written]:
    if draw(st.booleans()):
        form = draw(st.sampled_from(QUATERNIONS))
        return [Written(form.format(axis), value) for axis, value in zip("xyzw", TURN.as_quat().tolist(), strict=True)]
    sequence = draw(st.sampled_from(list(ANGLES)))
    names, unit = draw(st.sampled_from(ANGLES[sequence])), draw(st.sampled_from(["", *ANGLE]))
    form = draw(st.sampled_from(["{} ({})", "{} [{}]", "{}_{}"])) if unit else "{}"
    per = ANGLE[unit or "deg"]
    angles = (TURN.as_euler(sequence) / per).tolist()
    return [Written(form.format(name, unit), value) for name, value in zip(names, angles, strict=True)]


@st.composite
def times(draw: st.DrawFn) -> list[Written]:
    if draw(st.integers(0, 4)) == 0:
        first, second = draw(st.sampled_from([("sec", "nanosec"), ("stamp.secs", "stamp.nsecs"), ("t_sec", "t_nsec")]))
        return [Written(first, 12.0), Written(second, 5e8)]
    unit = draw(st.sampled_from(list(TIME)))
    form = draw(st.sampled_from(["{} ({})", "{} [{}]", "{}_{}"])) if unit else "{}"
    return [Written(form.format(draw(st.sampled_from(TIMES)), unit), T / TIME[unit])]


def file(folder: Path, columns: list[Written]) -> Path:
    path = folder / "any.csv"
    names, cells = ",".join(c.name for c in columns), ",".join(repr(c.value) for c in columns)
    path.write_text(f"{names}\n{cells}\n", encoding="utf-8")
    return path


def read_or_complaint(path: Path) -> tuple[cw.Samples | None, str]:
    try:
        return cw.read(path), ""
    except ContactWrenchError as error:
        return None, str(error)


def assert_as_written(samples: cw.Samples) -> None:
    assert samples.wrench[0] == pytest.approx(W, rel=1e-9)
    assert samples.R_base_flange[0] == pytest.approx(TURN.as_matrix(), abs=1e-9)
    if samples.t is not None:
        assert samples.t[0] == pytest.approx(T, rel=1e-9)


HEALTH = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]


@given(data=st.data())
@settings(max_examples=75, suppress_health_check=HEALTH)
def test_any_header_is_read_as_it_was_written_or_refused_in_one_line(tmp_path: Path, data: st.DataObject) -> None:
    mixed = data.draw(st.booleans())
    columns = [
        *data.draw(quantities(FORCE_WORDS, FORCE, W[:3], mixed)),
        *data.draw(quantities(TORQUE_WORDS, TORQUE, W[3:], mixed)),
        *data.draw(orientations()),
        *data.draw(times()),
        *(Written(name, DECOY) for name in data.draw(st.lists(st.sampled_from(DECOYS), max_size=4, unique=True))),
    ]
    if data.draw(st.integers(0, 3)) == 0:  # a second set of forces, whose numbers nobody asked for
        columns += data.draw(quantities(FORCE_WORDS[2:], FORCE, np.full(3, DECOY), mixed))
    path = file(tmp_path, data.draw(st.permutations(columns)))
    samples, complaint = read_or_complaint(path)
    if samples is None:
        assert "\n" not in complaint
        assert complaint.startswith(f"{path}: ")
    else:
        assert_as_written(samples)


@given(data=st.data())
@settings(max_examples=50, suppress_health_check=HEALTH)
def test_a_header_in_one_style_with_nothing_beside_is_read(tmp_path: Path, data: st.DataObject) -> None:
    words = data.draw(st.sampled_from([("F", "M"), ("F", "T"), ("Force", "Torque"), ("wrench.force", "wrench.torque")]))
    force = data.draw(st.sampled_from([unit for unit in FORCE if unit and unit != "MN"]))
    torque = data.draw(st.sampled_from([unit for unit in TORQUE if unit]))
    between, form = data.draw(st.sampled_from(["_", " ", "."])), data.draw(st.sampled_from(["{} ({})", "{} [{}]"]))
    columns = [
        *(
            Written(form.format(f"{words[0]}{between}{a}", force), v / FORCE[force])
            for a, v in zip(LETTERS, W[:3].tolist(), strict=True)
        ),
        *(
            Written(form.format(f"{words[1]}{between}{a}", torque), v / TORQUE[torque])
            for a, v in zip(LETTERS, W[3:].tolist(), strict=True)
        ),
        *data.draw(orientations()),
        *data.draw(times()),
    ]
    samples = cw.read(file(tmp_path, data.draw(st.permutations(columns))))
    assert samples.t is not None
    assert_as_written(samples)
