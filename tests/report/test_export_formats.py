"""Each format is read back by its program's own formula: a free tool reads zero, or is off by what the file states."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from contactwrench.errors import InputError
from contactwrench.report.export.exported import TARGETS, Exported, exported
from contactwrench.report.export.target import Setup
from tests.support import oracles
from tests.support.calibrations import exact_calibration
from tests.support.exports import unwrapped
from tests.support.oracles import Contact
from tests.support.world import Array, Rig, random_rig, random_rotations, readings, tilted_down

SENSOR_AT = np.array([0.02, -0.01, 0.07])
SETUP = Setup(sensor_offset=SENSOR_AT)
SEEDS = range(2)
CLOSE = 1e-6


def tared(text: str, rig: Rig) -> Contact:
    """The sensor zeroed, and the controller told, in one pose."""
    controller = oracles.CartesianForceController(text)
    pose = random_rotations(1, np.random.default_rng(9))
    controller.signal_taring(pose[0])
    zero = readings(rig, pose)[0]
    return lambda raw, R: controller.contact(raw - zero, R)


JUDGES: dict[str, Callable[[Exported, Rig, float], Contact]] = {
    "admittance_controller": lambda done, rig, g: oracles.admittance_controller(done.text),
    "force_torque_sensor_broadcaster": lambda done, rig, g: oracles.force_torque_sensor_broadcaster(done.text),
    "force_torque_tools": lambda done, rig, g: oracles.force_torque_tools(done.text, g * rig.down),
    "ft_tools_ros2": lambda done, rig, g: oracles.ft_tools_ros2(done.text),
    "cartesian_controllers": lambda done, rig, g: tared(done.text, rig),
    "mc_rtc": lambda done, rig, g: oracles.mc_rtc(done.text, SENSOR_AT),
    "hrpsys": lambda done, rig, g: oracles.hrpsys(done.text, "\n".join(done.notes)),
    "yarp": lambda done, rig, g: oracles.yarp(done.text),
    "rh20t": lambda done, rig, g: oracles.rh20t(done.text),
}
TAKES_A_LEAN = ("force_torque_sensor_broadcaster", "force_torque_tools", "cartesian_controllers", "yarp", "rh20t")
WITHOUT_BIAS = ("admittance_controller",)
TAKES_REACTION = ("force_torque_sensor_broadcaster", "force_torque_tools", "yarp")


def example(seed: int, lean: bool) -> tuple[Rig, float, Array]:
    """A random rig, on a base that leans anyhow or not at all; the local gravity, m/s^2; orientations."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    if lean:
        rig = replace(rig, down=tilted_down(rng.uniform(0.0, np.pi), rng))
    return rig, float(rng.uniform(9.78, 9.83)), random_rotations(100, rng)


def stated(text: str, before: str = "with these parameters") -> tuple[float, float]:
    """The largest error of force and torque that a file states; none where it says nothing."""
    found = re.search(
        before + r" the contact force is off by up to (\S+) N and the torque by up to (\S+) N m", unwrapped(text)
    )
    return (float(found.group(1)), float(found.group(2))) if found else (0.0, 0.0)


def largest(rig: Rig, contact: Contact, R: Array) -> tuple[float, float]:
    """The largest norm of force and of torque that is left of a free tool over all orientations: of many, and of a
    search from the best of them.
    """

    def left(orientation: Array) -> Array:
        wrench = contact(readings(rig, orientation[None])[0], orientation)
        norms: Array = np.linalg.norm(wrench.reshape(2, 3), axis=1)
        return norms

    def searched(part: int) -> float:
        best = R[int(np.argmax([left(each)[part] for each in R]))]
        options = {"xatol": 1e-4, "fatol": 1e-6}

        def lost(turn: Array) -> float:
            return -float(left(best @ Rotation.from_rotvec(turn).as_matrix())[part])

        return -float(minimize(lost, np.zeros(3), method="Nelder-Mead", options=options).fun)

    return searched(0), searched(1)


def test_every_format_is_judged() -> None:
    assert set(JUDGES) <= set(TARGETS)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", [name for name in JUDGES if name not in WITHOUT_BIAS])
def test_a_free_tool_on_an_upright_base_reads_zero(name: str, seed: int) -> None:
    rig, g, R = example(seed, lean=False)
    done = exported(TARGETS[name], exact_calibration(rig, g=g), SETUP, "tool.json")
    contact = JUDGES[name](done, rig, g)
    assert stated(done.text) == (0.0, 0.0)
    for raw, each in zip(readings(rig, R), R, strict=True):
        assert np.abs(contact(raw, each)).max() < CLOSE


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", TAKES_A_LEAN)
def test_a_free_tool_on_a_base_that_leans_reads_zero(name: str, seed: int) -> None:
    rig, g, R = example(seed, lean=True)
    done = exported(TARGETS[name], exact_calibration(rig, g=g), SETUP, "tool.json")
    contact = JUDGES[name](done, rig, g)
    assert "with these parameters" not in done.text
    assert done.notes == ()
    for raw, each in zip(readings(rig, R), R, strict=True):
        assert np.abs(contact(raw, each)).max() < CLOSE


def test_gravity_is_written_in_the_base_that_is_named() -> None:
    """A controller of Universal Robots has its base half a turn about z from what ROS calls base_link."""
    rig, g, R = example(4, lean=True)
    calibration = exact_calibration(rig, g=g)
    calibration = replace(calibration, provenance={**calibration.provenance, "base_frame": "ur5e base"})
    done = exported(TARGETS["force_torque_sensor_broadcaster"], calibration, SETUP, "tool.json")
    contact = oracles.force_torque_sensor_broadcaster(done.text)
    assert "turned into base_link from the base of the recording's orientations, ur5e base" in done.text
    for raw, each in zip(readings(rig, R), np.diag([-1.0, -1.0, 1.0]) @ R, strict=True):
        assert np.abs(contact(raw, each)).max() < CLOSE


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", [name for name in JUDGES if name not in TAKES_A_LEAN])
def test_a_free_tool_is_off_by_what_the_file_states(name: str, seed: int) -> None:
    rig, g, R = example(seed, lean=True)
    done = exported(TARGETS[name], exact_calibration(rig, g=g), SETUP, "tool.json")
    contact = JUDGES[name](done, rig, g)
    assert largest(rig, contact, R) == pytest.approx(stated("\n".join([done.text, *done.notes])), rel=1e-3)
    assert any("with these parameters" in note for note in done.notes)


@pytest.mark.parametrize("name", JUDGES)
def test_a_mass_as_weighed_is_taken_and_what_it_changes_is_stated(name: str) -> None:
    rig, g, R = example(7, lean=False)
    calibration = exact_calibration(rig, g=g)
    assert calibration.mass is not None
    mass = 1.2 * calibration.mass
    done = exported(TARGETS[name], calibration, replace(SETUP, tool_mass=mass), "tool.json")
    contact = JUDGES[name](done, rig, g)
    said = stated("\n".join([done.text, *done.notes]))
    if name == "cartesian_controllers":  # taring takes part of it away, or doubles it
        assert said[0] == pytest.approx(0.2 * rig.weight, rel=1e-3)
        return
    assert largest(rig, contact, R) == pytest.approx(said, rel=1e-3)


@pytest.mark.parametrize("name", JUDGES)
def test_a_sensor_that_gives_the_reaction(name: str) -> None:
    """The programs that can be told take its readings as they are; for the others they have to be negated first."""
    rig, g, R = example(3, lean=False)
    done = exported(TARGETS[name], exact_calibration(rig, "reaction", g), SETUP, "tool.json")
    of_accelerometer = name == "force_torque_tools"
    contact = JUDGES[name](done, rig, -g if of_accelerometer else g)
    turned, back = -1.0 if name in TAKES_REACTION else 1.0, -1.0 if of_accelerometer else 1.0
    said = "the sensor gives the reaction (--sign reaction): negate force and torque before this program reads them"
    assert (said in done.notes) == (name not in TAKES_REACTION)
    if name in WITHOUT_BIAS:
        return
    push = np.array([3.0, -2.0, 1.0, 0.1, 0.3, -0.2])
    for raw, each in zip(readings(rig, R[:20]), R, strict=False):
        assert np.abs(contact(turned * (raw + push), each) - back * push).max() < CLOSE


def test_what_is_off_before_the_taring_is_stated() -> None:
    rig, g, R = example(2, lean=True)
    done = exported(TARGETS["cartesian_controllers"], exact_calibration(rig, g=g), SETUP, "tool.json")
    controller = oracles.CartesianForceController(done.text)
    assert largest(rig, controller.contact, R) == pytest.approx(stated(done.text, "before that"), rel=1e-3)


def test_the_lean_that_a_node_can_be_told() -> None:
    rig, g, R = example(1, lean=True)
    text = exported(TARGETS["ft_tools_ros2"], exact_calibration(rig, g=g), SETUP, "tool.json").text
    told = oracles.ft_tools_ros2(text, tuple(oracles.numbers_behind(text, "gravity_in_reference_frame: ")))
    assert max(np.abs(told(raw, each)).max() for raw, each in zip(readings(rig, R), R, strict=True)) < CLOSE


def test_the_bias_that_is_to_be_subtracted_first() -> None:
    rig, g, R = example(1, lean=False)
    text = exported(TARGETS["admittance_controller"], exact_calibration(rig, g=g), SETUP, "tool.json").text
    contact, bias = oracles.admittance_controller(text), np.array(oracles.numbers_behind(text, "subtract "))
    assert max(np.abs(contact(raw - bias, each)).max() for raw, each in zip(readings(rig, R), R, strict=True)) < CLOSE


@pytest.mark.parametrize("roll", [0.0, 0.7, -3.0])
@pytest.mark.parametrize("pitch", [0.5 * np.pi, -0.5 * np.pi, 0.5 * np.pi - 1e-9])
def test_a_mounting_on_its_side_is_exact_too(roll: float, pitch: float) -> None:
    rig, g, R = example(4, lean=False)
    rig = replace(rig, R_flange_sensor=Rotation.from_euler("xyz", [roll, pitch, 0.4]).as_matrix())
    for name in ("ft_tools_ros2", "mc_rtc"):
        done = exported(TARGETS[name], exact_calibration(rig, g=g), SETUP, "tool.json")
        contact = JUDGES[name](done, rig, g)
        assert max(np.abs(contact(readings(rig, each[None])[0], each)).max() for each in R[:20]) < CLOSE


def test_mc_rtc_asks_where_the_sensor_is() -> None:
    with pytest.raises(InputError) as raised:
        exported(TARGETS["mc_rtc"], exact_calibration(example(0, lean=False)[0]), Setup(), "tool.json")
    assert str(raised.value) == (
        "mc_rtc counts from the flange, and no reading tells where the sensor's origin is: give --sensor-offset X,Y,Z, "
        "m from the flange's origin, flange axes (data sheets of sensor and adapter, or the URDF)"
    )
