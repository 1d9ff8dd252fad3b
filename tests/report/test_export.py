"""What all exports share: the header, the largest error, the numbers, what is asked for and refused."""

import json
import re
from dataclasses import replace
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
from contactwrench.report.export.exported import exported
from contactwrench.report.export.losses import largest_error
from contactwrench.report.export.target import Setup
from contactwrench.report.export.targets import TARGETS
from contactwrench.report.export.tool import number, roll_pitch_yaw
from tests.support.calibrations import exact_calibration
from tests.support.recordings import PANDA, rx, ry, rz
from tests.support.rigs import seeds
from tests.support.world import Array, random_rig, random_rotations

RIGID = ("admittance_controller", "force_torque_sensor_broadcaster", "force_torque_tools", "ft_tools_ros2",
         "cartesian_controllers", "mc_rtc", "hrpsys", "yarp", "rh20t")  # fmt: skip
SETUP = Setup(sensor_offset=np.zeros(3))


def calibration(seed: int = 0, sign: str = "pull") -> cw.Calibration:
    return exact_calibration(random_rig(np.random.default_rng(seed)), sign)


@settings(max_examples=8)
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
    head = [
        line
        for line in exported(TARGETS["ft_tools_ros2"], c, Setup(), "gripper.json").text.splitlines()
        if line[0] == "#"
    ]
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


@pytest.mark.parametrize("name", [name for name in RIGID if name != "hrpsys"])
def test_a_wrench_in_base_axes_is_to_be_turned_first(name: str) -> None:
    c = calibration()
    done = exported(TARGETS[name], replace(c, provenance={**c.provenance, "wrench_frame": "base"}), SETUP, "t.json")
    said = (
        "the recording's wrench was in base axes (--wrench-frame base): turn it into sensor axes before this program "
        "reads it"
    )
    assert said in done.notes
    assert said.replace("--", "- -" if name == "yarp" else "--") in done.text


@pytest.mark.parametrize("name", [name for name in RIGID if name not in ("mc_rtc", "rh20t")])
def test_names_are_those_that_are_stated(name: str) -> None:
    setup = Setup(sensor_name="wrist_ft", sensor_frame="wrist_frame", base_frame="world", sensor_offset=np.zeros(3))
    text = exported(TARGETS[name], calibration(), setup, "t.json").text
    named = re.search(r"wrist_ft|wrist_frame", text)
    assert named
    assert not re.search(r"ft_sensor\b(?!_ref_link|:)|ft_frame|base_link", text.replace("robot_base_link", ""))
