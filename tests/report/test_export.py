"""What all exports share: the header, the largest error, the numbers, what is asked for and refused."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Finding, Kind
from contactwrench.errors import InputError
from contactwrench.report.export.exported import TARGETS, exported
from contactwrench.report.export.target import Setup, largest_error, number, roll_pitch_yaw
from tests.support.calibrations import exact_calibration
from tests.support.exports import unwrapped
from tests.support.recordings import PANDA, rx, ry, rz
from tests.support.rigs import seeds
from tests.support.world import Array, random_rig, random_rotations, readings

RIGID = ("admittance_controller", "force_torque_sensor_broadcaster", "force_torque_tools", "ft_tools_ros2",
         "cartesian_controllers", "mc_rtc", "hrpsys", "yarp", "rh20t")  # fmt: skip
SETUP = Setup(sensor_offset=np.zeros(3))
PAYLOADS = ("ur", "franka", "kuka", "abb", "fanuc", "xarm", "fairino")
STATED = Setup(sensor_mass=0.3, sensor_com=np.zeros(3), sensor_offset=np.zeros(3))


def calibration(seed: int = 0, sign: str = "pull") -> cw.Calibration:
    return exact_calibration(random_rig(np.random.default_rng(seed)), sign)


@settings(max_examples=4)
@given(seed=seeds)
def test_the_largest_error_is_the_largest(seed: int) -> None:
    """Against many orientations, and a search from the best of them, by the definition of the free wrench."""
    rng = np.random.default_rng(seed)
    right = calibration(seed)
    B = right.B + rng.normal(size=(6, 4)) * rng.choice([1e-3, 1.0, 10.0])
    d = rng.normal(size=3)
    d /= np.linalg.norm(d)
    R = random_rotations(2000, rng)

    def off(R: Array, part: slice) -> Array:
        wrong = R.transpose(0, 2, 1) @ d @ B[part, :3].T + B[part, 3]
        norms: Array = np.linalg.norm(wrong - right.predict(R)[:, part], axis=1)
        return norms

    for part, found in zip((slice(0, 3), slice(3, 6)), largest_error(right, B, d), strict=True):
        norms = off(R, part)
        assert norms.max() <= found * (1.0 + 1e-6)
        best = R[int(np.argmax(norms))]

        def lost(turn: Array, best: Array = best, part: slice = part) -> float:
            return -float(off((best @ Rotation.from_rotvec(turn).as_matrix())[None], part)[0])

        assert -minimize(lost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-5}).fun == pytest.approx(
            found, rel=2e-6
        )


def test_a_base_that_leans_is_off_by_the_chord_of_the_weight() -> None:
    right = calibration(2)
    d = np.array([np.sin(0.1), 0.0, -np.cos(0.1)])
    force, _ = largest_error(right, right.B, d)
    assert force == pytest.approx(2.0 * np.sin(0.05) * right.weight)
    assert largest_error(right, right.B, right.gravity_direction) == pytest.approx((0.0, 0.0))


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_reads_back_and_is_a_float_of_yaml_1_1(value: float) -> None:
    assert float(number(value)) == value
    assert re.fullmatch(r"-?[0-9]+\.[0-9]+(e[-+][0-9]+)?", number(value))


@given(st.tuples(*[st.floats(-np.pi, np.pi)] * 3))
def test_roll_pitch_yaw_make_the_rotation_again(angles: tuple[float, float, float]) -> None:
    R = rz(angles[2]) @ ry(angles[1]) @ rx(angles[0])
    roll, pitch, yaw = roll_pitch_yaw(R).tolist()
    assert np.abs(rz(yaw) @ ry(pitch) @ rx(roll) - R).max() < 1e-14


def test_the_header_says_who_made_it_of_what_and_what_it_is_worth() -> None:
    c = cw.calibrate(cw.read(PANDA))
    text = exported(TARGETS["ft_tools_ros2"], c, Setup(), "gripper.json").text
    assert max(map(len, text.splitlines())) <= 102
    head = [line for line in unwrapped(text).splitlines() if line[0] == "#"]
    assert head[0] == (
        f"# parameters of ft_tools_ros2's ft_estimation_node (ROS 2), made by contactwrench {cw.__version__} from "
        "gripper.json"
    )
    assert head[1] == f"# Calibration, model auto, 17 poses, of {PANDA}"
    assert head[2].startswith("# verdict doubtful; the model does not explain the readings")
    assert c.mass is not None
    assert c.com is not None
    for name, value, unit in (("mass", c.mass, "kg"), ("com_z", 1e3 * c.com[2], "mm"), ("bias_fz", c.bias[2], "N")):
        written, std = next(line.removeprefix(f"#   {name} ") for line in head if f" {name} " in line).split(" +- ")
        assert std.endswith(f" {unit}")
        assert abs(float(written) - value) < 0.1 * float(std.split()[0])
    force, torque = largest_error(c, c.B, np.array([0.0, 0.0, -1.0]))
    assert head[-1].startswith(
        f"# with these parameters the contact force is off by up to {force:.4g} N and the torque by up to {torque:.4g} "
        "N m over all orientations; the calibration's own std is up to 0.2"
    )


@pytest.mark.parametrize("name", RIGID)
def test_a_weak_calibration_is_noted_and_commented(name: str) -> None:
    finding = Finding.weak(Kind.POOR_FIT, 'nothing --fits-- this\ntool; "x" <y> -->')
    done = exported(TARGETS[name], replace(calibration(), findings=(finding,)), SETUP, "t.json")
    assert finding.text in done.notes
    assert (name == "hrpsys") == ("this tool" not in done.text)
    if name == "rh20t":
        assert list(json.loads(done.text)) == ["comment", "offset", "centroid", "gravity", "ts_rot"]
    if name == "yarp":
        ElementTree.fromstring(f"<device>{done.text}</device>")


@pytest.mark.parametrize("name", RIGID)
def test_a_model_without_a_mass_is_refused(name: str) -> None:
    affine = cw.calibrate(cw.read(PANDA), "affine")
    with pytest.raises(InputError) as raised:
        exported(TARGETS[name], affine, SETUP, "t.json")
    assert str(raised.value) == (
        f"{name} takes a mass and a centre of mass, found model affine, which has none: calibrate with --model auto, "
        "or export B itself with --to c, python or matlab"
    )


@pytest.mark.parametrize("name", ["c", "python", "matlab"])
def test_the_mass_of_a_model_without_one_cannot_be_stated(name: str) -> None:
    affine = cw.calibrate(cw.read(PANDA), "affine")
    with pytest.raises(InputError, match="with --to c, python or matlab, without --tool-mass"):
        exported(TARGETS[name], affine, Setup(tool_mass=1.0), "t.json")


@pytest.mark.parametrize("name", [name for name in RIGID if name != "hrpsys"])
def test_a_wrench_in_base_axes_is_to_be_turned_first(name: str) -> None:
    c = calibration()
    done = exported(TARGETS[name], replace(c, provenance={**c.provenance, "wrench_frame": "base"}), SETUP, "t.json")
    said = (
        "the recording's wrench was in base axes (--wrench-frame base): turn it into flange axes, by R_base_flange "
        "transposed, before this program reads it; what is called sensor axes here are the flange's"
    )
    assert said in done.notes
    assert said.replace("--", "- -" if name == "yarp" else "--") in unwrapped(done.text)


@pytest.mark.parametrize("name", [name for name in RIGID if name not in ("mc_rtc", "rh20t")])
def test_names_are_those_that_are_stated(name: str) -> None:
    setup = Setup(sensor_name="wrist_ft", sensor_frame="wrist_frame", base_frame="world", sensor_offset=np.zeros(3))
    text = exported(TARGETS[name], calibration(), setup, "t.json").text
    named = re.search(r"wrist_ft|wrist_frame", text)
    assert named
    assert not re.search(
        r"ft_sensor\b(?!_ref_link|:)|ft_frame|base_link", re.sub("robot_base_link|ft_sensor.name", "", text)
    )


@pytest.mark.parametrize("name", TARGETS)
def test_a_format_uses_of_the_setup_what_it_says(name: str) -> None:
    """Whatever else is stated changes nothing; what it uses does."""
    target, c = TARGETS[name], calibration()
    other: dict[str, Any] = {
        "sensor_mass": 0.4,
        "sensor_com": np.full(3, 0.02),
        "sensor_offset": np.full(3, 0.03),
        "sensor_name": "wrist_ft",
        "sensor_frame": "wrist_frame",
        "base_frame": "world",
    }

    def said(setup: Setup) -> tuple[object, ...]:
        parameters = target.parameters(c, setup)
        return parameters.body, parameters.remarks

    changing = {each for each, value in other.items() if said(replace(STATED, **{each: value})) != said(STATED)}
    assert changing == set(target.uses)


@pytest.mark.parametrize("name", TARGETS)
def test_a_stated_mass_that_is_far_from_the_identified_is_doubted(name: str) -> None:
    """By a fifth; or by a tenth and five standard deviations."""
    c = calibration()

    def doubted(share: float, of_std: float) -> bool:
        assert c.mass is not None
        std = abs(share - 1.0) * c.mass * c.g / of_std
        known = replace(c, covariance=c.covariance * (std / c.std["weight"]) ** 2)
        done = exported(TARGETS[name], known, replace(STATED, tool_mass=share * c.mass), "t.json")
        notes = [note for note in done.notes if "another tool, another unit" in note]
        assert all(note in unwrapped(done.text) or name in ("hrpsys", "yarp") for note in notes)
        return bool(notes)

    assert doubted(1.25, 2.0)
    assert doubted(0.85, 6.0)
    assert not doubted(0.85, 4.0)
    assert not doubted(1.05, 9.0)


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize(("delay", "said"), [
    (0.08, "stamped 80 ms later than the orientation: look the orientation up that much earlier, this file does not"),
    (-0.012, "stamped 12 ms earlier than the orientation: look the orientation up that much later, this file does not"),
])  # fmt: skip
def test_a_delay_is_for_the_program_to_make_up_for(name: str, delay: float, said: str) -> None:
    late = replace(calibration(), delay=delay, delay_std=0.001)
    done = exported(TARGETS[name], late, STATED, "t.json")
    assert any(said in note for note in done.notes) == (name not in PAYLOADS)
    assert "applied" not in done.text
    hardly = exported(TARGETS[name], replace(late, delay_std=0.1), STATED, "t.json")
    assert not any("stamped" in note for note in hardly.notes)


@pytest.mark.parametrize("name", ["c", "python", "matlab", "rh20t"])
def test_readings_in_base_axes_are_turned_into_flange_axes(name: str, tmp_path: Path) -> None:
    """Turned as the header says, a free tool reads zero with the parameters of any rig that was recorded so."""
    rng = np.random.default_rng(3)
    rig, R = random_rig(rng), random_rotations(24, rng)
    rig = replace(rig, bias=np.zeros(6))  # turned with the wrench it is no bias of the flange's axes
    in_base = np.concatenate([np.einsum("nij,nj->ni", R @ rig.R_flange_sensor, part) for part in
                              np.split(readings(rig, R), 2, axis=1)], axis=1)  # fmt: skip
    header = "fx,fy,fz,tx,ty,tz," + ",".join(f"r{i}{j}" for i in "123" for j in "123")
    path = tmp_path / "base.csv"
    np.savetxt(path, np.column_stack([in_base, R.reshape(-1, 9)]), delimiter=",", header=header, comments="")
    c = cw.calibrate(cw.read(path, wrench_frame="base"), "mount")
    done = exported(TARGETS[name], c, Setup(), "t.json")
    assert any("turn it into flange axes, by R_base_flange transposed, before" in note for note in done.notes)
    parameters = TARGETS[name].parameters(c, Setup())
    assert parameters.B is not None
    assert parameters.gravity_direction is not None
    r = np.einsum("nji,j->ni", R, parameters.gravity_direction)
    turned = np.concatenate([np.einsum("nji,nj->ni", R, part) for part in np.split(in_base, 2, axis=1)], axis=1)
    assert np.abs(turned - r @ parameters.B[:, :3].T - parameters.B[:, 3]).max() < 1e-6


@pytest.mark.parametrize(
    ("recorded", "stated", "expected"),
    [
        (None, None, "base_link"),
        ("/world", None, "world"),
        ("panda_link0", None, "panda_link0"),
        ("ur5e base", None, "base_link"),
        ("panda_link0", "table", "table"),
    ],
)
@pytest.mark.parametrize("name", ["admittance_controller", "force_torque_sensor_broadcaster"])
def test_the_base_is_the_recording_s(name: str, recorded: str | None, stated: str | None, expected: str) -> None:
    c = calibration()
    provenance = {**c.provenance, **({} if recorded is None else {"base_frame": recorded})}
    text = exported(TARGETS[name], replace(c, provenance=provenance), Setup(base_frame=stated), "t.json").text
    field = "world_frame: " if name.startswith("force") else "fixed_world_frame:\n      frame:\n        id: "
    assert f'{field}"{expected}"' in text
