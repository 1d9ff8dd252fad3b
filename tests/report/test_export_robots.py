"""A payload as robots are told it: their own units and frames give the weight that hangs on the flange."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import BEFORE, InputError, shortened
from contactwrench.geometry.wrench import STANDARD_GRAVITY
from contactwrench.report.export.exported import TARGETS, exported
from contactwrench.report.export.payload import principal_axes
from contactwrench.report.export.target import Setup
from contactwrench.statistics import three_digits, two_digits
from tests.support.controllers import READERS, Load
from tests.support.exports import unwrapped
from tests.support.rigs import noise_free, noisy
from tests.support.world import Array, Rig, random_rig, random_rotations, tilted_down, with_down

G = STANDARD_GRAVITY
STATED = Setup(
    sensor_mass=0.347, sensor_com=np.array([0.004, -0.003, 0.021]), sensor_offset=np.array([0.011, -0.007, 0.043])
)
SEEDS = range(5)
EVERY_ROBOT = pytest.mark.parametrize("name", READERS)


@cache
def calibrated(seed: int, tilt: float = 0.05) -> tuple[Rig, cw.Calibration]:
    """A tool of any weight and mounting on a base that is tilted by so much (rad), and its calibration."""
    rng = np.random.default_rng(seed)
    rig = with_down(random_rig(rng), tilted_down(tilt, rng))
    model = "mount+base" if tilt else "mount"
    return rig, cw.calibrate(noise_free(rig, random_rotations(20, rng)), model=model)


def written(name: str, calibration: cw.Calibration, setup: Setup = STATED) -> tuple[str, str]:
    """The whole file for a robot, and its remarks one a line."""
    target = TARGETS[name]
    parameters = target.parameters(calibration, setup)
    assert parameters.B is None
    assert parameters.gravity_direction is None
    said = "\n".join([*parameters.cautions, *parameters.remarks])
    return exported(target, calibration, setup, "cal.json").text, said


def hanging(rig: Rig, setup: Setup, R_base_flange: Array) -> Array:
    """What tool and sensor exert on the flange (n, 6), flange axes, about its origin: formed in base axes."""
    assert setup.sensor_mass is not None
    assert setup.sensor_com is not None
    assert setup.sensor_offset is not None
    R_base_sensor = R_base_flange @ rig.R_flange_sensor
    force, torque = np.zeros((2, len(R_base_flange), 3))
    arms = (R_base_flange @ setup.sensor_offset + R_base_sensor @ rig.com, R_base_flange @ setup.sensor_com)
    for arm, weight in zip(arms, (rig.weight, setup.sensor_mass * G), strict=True):
        force += weight * rig.down
        torque += np.cross(arm, weight * rig.down)
    return np.concatenate([(R_base_flange.transpose(0, 2, 1) @ part[..., None])[..., 0] for part in (force, torque)], 1)


@EVERY_ROBOT
def test_a_robot_computes_the_weight_that_hangs_on_its_flange(name: str) -> None:
    for seed in SEEDS:
        rig, calibration = calibrated(seed)
        load = READERS[name](written(name, calibration)[0])
        R = random_rotations(40, np.random.default_rng(seed + 100))
        assert np.abs(load.wrench(R, rig.down, G) - hanging(rig, STATED, R)).max() < 1e-6
        assert not load.inertia.any()


def test_the_mass_is_the_weight_over_the_gravity_that_was_stated() -> None:
    rig, _ = calibrated(3, 0.0)
    R = random_rotations(20, np.random.default_rng(8))
    at_the_pole = cw.calibrate(noise_free(rig, R), model="mount", g=9.832)
    setup = replace(STATED, sensor_mass=0.0)
    assert abs(READERS["abb"](written("abb", at_the_pole, setup)[0]).mass - rig.weight / 9.832) < 1e-7
    weighed = replace(setup, tool_mass=2.5)
    assert abs(READERS["abb"](written("abb", at_the_pole, weighed)[0]).mass - 2.5) < 1e-7


@EVERY_ROBOT
def test_a_sensor_inside_the_robot_weighs_nothing_and_has_no_centre(name: str) -> None:
    rig, calibration = calibrated(1)
    inside = Setup(sensor_mass=0.0, sensor_offset=np.zeros(3))
    load = READERS[name](written(name, calibration, inside)[0])
    assert abs(load.mass - rig.weight / G) < 1e-7
    assert np.abs(load.com - rig.R_flange_sensor @ rig.com).max() < 1e-8


@EVERY_ROBOT
def test_the_remarks_are_comments_and_say_what_is_not_there(name: str) -> None:
    text, remarks = written(name, calibrated(0)[1])
    mark = {"kuka": "; ", "abb": "! "}.get(name, "# ")
    comments = [line for line in text.splitlines() if line.startswith(mark)]
    assert text.startswith("\n".join(comments))
    assert {f"{mark}{remark}" for remark in remarks.splitlines()} <= set(unwrapped(text).splitlines())
    assert "moments of inertia" in remarks
    assert "written as 0, a point mass" in remarks or name in ("xarm", "fairino")
    assert "from the readings of a sensor outside nothing is subtracted, and its bias is not in here" in remarks
    assert max(map(len, text.splitlines())) < 471  # what KRL takes in a line


def stated_error(remarks: str) -> tuple[float, float]:
    found = re.search(r"is off by up to (\S+) N in the identified weight and (\S+) N m in its torque", remarks)
    assert found
    return float(found.group(1)), float(found.group(2))


@EVERY_ROBOT
def test_a_robot_that_was_not_told_of_the_tilt_is_off_by_what_the_file_says(name: str) -> None:
    rig, calibration = calibrated(2)
    _, remarks = written(name, calibration)
    R = random_rotations(20_000, np.random.default_rng(7))
    tool = Load(rig.weight / G, rig.com)  # on the sensor
    R_base_sensor = R @ rig.R_flange_sensor
    error = tool.wrench(R_base_sensor, np.array([0.0, 0.0, -1.0]), G) - tool.wrench(R_base_sensor, rig.down, G)
    for stated, part in zip(stated_error(remarks), (error[:, :3], error[:, 3:]), strict=True):
        largest = np.linalg.norm(part, axis=1).max()
        assert 0.97 * stated < largest < 1.005 * stated  # three digits are written


def test_an_upright_base_leaves_no_error_to_state() -> None:
    for name in READERS:
        assert "off by up to" not in written(name, calibrated(3, 0.0)[1])[1]


def test_the_commands_for_a_tilted_base_point_the_way_their_manuals_say() -> None:
    rig, calibration = calibrated(4)
    acceleration = re.search(r"set_gravity\((\[.+?\])\)", written("ur", calibration)[1])
    direction = re.search(r"set_gravity_direction\((\[.+?\])\)", written("xarm", calibration)[1])
    assert acceleration
    assert direction
    # UR: (0, 0, 9.82) on an upright base; xArm: (0, 0, -1)
    assert np.allclose(ast.literal_eval(acceleration.group(1)), -G * rig.down, atol=1e-5)
    assert np.allclose(ast.literal_eval(direction.group(1)), rig.down, atol=1e-8)


def test_gravity_of_a_universal_robot_is_in_its_controllers_base() -> None:
    """Half a turn about z from what ROS calls base_link, in which a bag may have the orientations."""
    rig, calibration = calibrated(4)
    for frame, sign in (("base_link", -1.0), ("base", 1.0), ("ur5e base", 1.0)):
        named = replace(calibration, provenance={**calibration.provenance, "base_frame": frame})
        acceleration = re.search(r"set_gravity\((\[.+?\])\)", written("ur", named)[1])
        assert acceleration
        assert np.allclose(ast.literal_eval(acceleration.group(1)), -G * rig.down * [sign, sign, 1.0], atol=1e-5)


def test_a_weighed_tool_takes_the_place_of_the_identified_one() -> None:
    rig, calibration = calibrated(3, 0.0)
    assert calibration.mass is not None
    setup = replace(STATED, tool_mass=calibration.mass + 0.05)
    text, remarks = written("ur", calibration, setup)
    R = random_rotations(40, np.random.default_rng(1))
    heavier = replace(rig, weight=rig.weight + 0.05 * G)
    assert np.abs(READERS["ur"](text).wrench(R, rig.down, G) - hanging(heavier, STATED, R)).max() < 1e-6
    found = re.search(r"weight changes by (\S+) N, its torque about the sensor by up to (\S+) N m", unwrapped(text))
    assert found
    force, torque = map(float, found.groups())
    assert "leans" not in remarks
    assert abs(force - 0.05 * G) < 0.005 * force
    assert abs(torque - 0.05 * G * np.linalg.norm(rig.com)) < 0.005 * torque


@EVERY_ROBOT
def test_what_the_lean_and_the_stated_mass_do_is_told_apart(name: str) -> None:
    rig, calibration = calibrated(2)
    assert calibration.mass is not None
    text, remarks = written(name, calibration, replace(STATED, tool_mass=1.02 * calibration.mass))
    assert stated_error(remarks) == stated_error(written(name, calibration)[1])
    assert f"its weight changes by {three_digits(0.02 * rig.weight)} N, its torque" in unwrapped(text)


@EVERY_ROBOT
def test_a_lean_is_said_where_it_is_more_than_the_calibration_s_own_error(name: str) -> None:
    rng = np.random.default_rng(4)
    for tilt, told in ((0.05, True), (1e-5, False)):
        rig = with_down(random_rig(rng), tilted_down(tilt, rng))
        done = exported(TARGETS[name], cw.calibrate(noisy(rig, random_rotations(20, rng), rng), "mount+base"), STATED,
                        "cal.json")  # fmt: skip
        assert ("leans" in unwrapped(done.text)) == told
        assert any("tells it how the base leans" in note for note in done.notes) == told


def test_tool_and_sensor_are_joined_as_the_makers_of_sensors_join_them() -> None:
    """SCHUNK Software Module for URCap, 1369443, p. 18, for the FT-AXIA80: kg, mm, tool from the sensing origin; and
    xArm-Python-SDK xarm/x3/ft_sensor.py, set_ft_sensor_load_offset, with its sum in mm throughout.
    """
    rig, _ = calibrated(3, 0.0)
    straight = cw.calibrate(
        noise_free(replace(rig, R_flange_sensor=np.eye(3)), random_rotations(20, np.random.default_rng(0))),
        model="mount",
    )
    m, (x, y, z) = rig.weight / G, (1e3 * rig.com).tolist()
    axia = Setup(
        sensor_mass=0.558,
        sensor_com=np.array([0.0, 0.0, 1e-3 * 12.7224 / 0.558]),
        sensor_offset=np.array([0.0, 0.0, 0.0464]),
    )
    of_schunk = np.array([m * x, m * y, 12.7224 + m * (z + 46.4)]) / (0.558 + m)
    load = READERS["ur"](written("ur", straight, axia)[0])
    assert abs(load.mass - 0.558 - m) < 1e-7
    assert np.abs(1e3 * load.com - of_schunk).max() < 1e-5

    ufactory = Setup(
        sensor_mass=0.270, sensor_com=np.array([-0.017, 0.009, 0.0118]), sensor_offset=np.array([0.0, 0.0, 0.032])
    )
    weight = m + 0.270
    of_sdk = [(0.270 * -17 + m * x) / weight, (0.270 * 9 + m * y) / weight, (0.270 * 11.8 + m * (32 + z)) / weight]
    load = READERS["xarm"](written("xarm", straight, ufactory)[0])
    assert abs(load.mass - weight) < 1e-7
    assert np.abs(1e3 * load.com - of_sdk).max() < 1e-5


def test_what_else_can_be_pasted_says_the_same() -> None:
    _, calibration = calibrated(0)
    load = READERS["ur"](written("ur", calibration)[0])
    mm = (1e3 * load.com).tolist()

    def numbers(name: str, pattern: str) -> list[float]:
        found = re.search(pattern, written(name, calibration)[1])
        assert found
        return [float(number) for number in re.findall(r"-?\d+\.\d+", found.group(1))]

    x, y, z = mm
    on_the_pendant = f"{load.mass:.3f} kg, CX {x:.2f} mm, CY {y:.2f} mm, CZ {z:.2f} mm"
    assert f"PolyScope, Installation, Payload: {on_the_pendant}" in written("ur", calibration)[1]
    assert np.allclose(numbers("franka", r"setLoad\((.+?)\);"), [load.mass, *load.com, *np.zeros(9)], atol=1e-8)
    assert np.allclose(numbers("kuka", r"setMass(.+)"), [load.mass, *mm], atol=1e-5)
    assert np.allclose(numbers("fairino", r"takes robot.SetLoadWeight(.+)"), [load.mass], atol=1e-8)


@pytest.mark.parametrize(("sign", "turned"), [("pull", 1.0), ("reaction", -1.0)])
def test_a_sensor_of_the_robots_own_gets_the_tool_alone_in_its_axes(sign: str, turned: float) -> None:
    rig, calibration = calibrated(1)
    read = replace(calibration, provenance={**calibration.provenance, "sign": sign})
    alone = [rig.weight / G, *(1e3 * rig.com)]
    found = re.search(r"set_ft_sensor_load_offset\((\[.+?\])\)", written("xarm", read)[1])
    assert found
    assert np.allclose(ast.literal_eval(found.group(1)), [*alone, *(turned * rig.bias)], atol=1e-5)
    found = re.search(
        r"SetForceSensorPayload\((.+?)\), robot.SetForceSensorPayloadCog\((.+?)\)", written("fairino", read)[1]
    )
    assert found
    assert np.allclose(ast.literal_eval(f"[{', '.join(found.groups())}]"), alone, atol=1e-5)


OFFSET = "--sensor-offset X,Y,Z (its origin: drawing)"
MASS = "--sensor-mass KG (with adapter; 0 inside the robot)"
COM = "--sensor-com X,Y,Z (of that mass)"
SAYS = "counts with the sensor's own mass, expected"
GIVE = ": give it, in m from the flange's origin, flange axes"
GIVE_MASS = ": give it"


@pytest.mark.parametrize(
    ("setup", "message"),
    [
        (Setup(), f"{SAYS} {OFFSET} and {MASS} and {COM}"),
        (replace(STATED, sensor_offset=None), f"{SAYS} {OFFSET}"),
        (replace(STATED, sensor_mass=None), f"{SAYS} {MASS}"),
        (replace(STATED, sensor_com=None), f"{SAYS} {COM}"),
        (Setup(sensor_mass=0.0), f"{SAYS} {OFFSET}"),
    ],
)
@EVERY_ROBOT
def test_what_a_payload_needs_is_asked_for(name: str, setup: Setup, message: str) -> None:
    with pytest.raises(InputError) as refused:
        written(name, calibrated(0)[1], setup)
    assert (
        str(refused.value)
        == f"{name} {message}{GIVE_MASS if setup.sensor_com is not None and MASS in message else GIVE}"
    )
    assert shortened(f"{BEFORE}{refused.value}") == f"{BEFORE}{refused.value}"


@EVERY_ROBOT
def test_a_model_without_a_mass_is_no_payload(name: str) -> None:
    rig, _ = calibrated(0)
    affine = cw.calibrate(noise_free(rig, random_rotations(20, np.random.default_rng(3))), model="affine")
    with pytest.raises(InputError) as refused:
        written(name, affine)
    assert str(refused.value) == (
        f"{name} takes a mass and a centre of mass, found model affine, which has none: calibrate with --model auto, "
        "or export B itself with --to c, python or matlab"
    )


TOLD = ("ur", "franka", "kuka", "abb")


def with_particles(seed: int) -> tuple[cw.Calibration, Array]:
    """A calibration whose tool is six particles in any place, and the inertia (3, 3) of these and of the sensor, a
    seventh one, about all their centre of mass in flange axes: a sum over particles, with no theorem of parallel axes.
    """
    moving_tool = pytest.importorskip("tests.support.moving_tool")
    moving, calibration = moving_tool.known(seed, "mount")
    rng, w = np.random.default_rng(seed), moving.world
    places = 0.05 * rng.normal(size=(6, 3))
    places -= places.mean(axis=0)
    each = moving.mass / 6.0
    inertia = sum(each * (at @ at * np.eye(3) - np.outer(at, at)) for at in places)
    calibration = replace(calibration, dynamics=replace(calibration.dynamics, inertia=inertia))
    assert STATED.sensor_offset is not None
    assert STATED.sensor_com is not None
    assert STATED.sensor_mass is not None
    at = np.vstack([STATED.sensor_offset + (w.com + places) @ w.R_flange_sensor.T, STATED.sensor_com])
    masses = np.r_[np.full(6, each), STATED.sensor_mass]
    at -= masses @ at / masses.sum()
    return calibration, np.einsum("n,nij->ij", masses, np.sum(at**2, axis=1)[:, None, None] * np.eye(3)) - np.einsum(
        "n,ni,nj->ij", masses, at, at
    )


@pytest.mark.parametrize("name", TOLD)
def test_a_robot_is_told_the_inertia_of_all_that_hangs_on_its_flange(name: str) -> None:
    for seed in SEEDS:
        calibration, expected = with_particles(seed)
        text, remarks = written(name, calibration)
        assert READERS[name](text).inertia == pytest.approx(expected, abs=2e-8)
        assert "moments of inertia in kg m^2 about the centre of mass, " in remarks
        assert (
            f"(std up to {two_digits(float(calibration.std['inertia'].max()))} kg m^2), the sensor as a point"
            in remarks
        )


@pytest.mark.parametrize("name", [name for name in READERS if name not in TOLD])
def test_where_a_robot_takes_no_inertia_or_nobody_knows_about_which_point_none_is_written(name: str) -> None:
    text, remarks = written(name, with_particles(0)[0])
    assert not READERS[name](text).inertia.any()
    unsure = "written as 0, a point mass: sources differ on the point about which this screen counts them, and products"
    assert unsure in remarks or "moments of inertia are not in here: the command takes none" in remarks


@pytest.mark.parametrize(
    "moments", [[1.0, 2.0, 2.5], [3.0, 2.0, 2.5], [1.0, 1.0, 1.0], [2.0, 2.0, 1.0], [2.0, 0.0, 2.0]]
)
def test_principal_axes_are_a_rotation_near_to_none(moments: list[float]) -> None:
    for turn in (np.eye(3), *random_rotations(20, np.random.default_rng(3))):
        inertia = turn @ np.diag(moments) @ turn.T
        found, R = principal_axes(inertia)
        assert R @ np.diag(found) @ R.T == pytest.approx(inertia, abs=1e-12)
        assert np.abs(R.T @ R - np.eye(3)).max() < 1e-12
        assert np.linalg.det(R) == pytest.approx(1.0)
    assert np.abs(principal_axes(np.diag(moments))[1] - np.eye(3)).max() < 1e-12


def test_where_the_motion_told_the_sensors_place_nobody_needs_to_state_it() -> None:
    calibration, _ = with_particles(1)
    assert calibration.dynamics is not None
    found, target = calibration.dynamics.sensor_offset, TARGETS["mc_rtc"]
    told = exported(target, calibration, Setup(), "tool.json")
    stated = exported(target, calibration, Setup(sensor_offset=found), "tool.json")
    said = "the sensor's origin is where the motion told, ["
    assert said in " ".join(told.text.split())
    assert said not in " ".join(stated.text.split())
    unsure = replace(
        calibration, dynamics=replace(calibration.dynamics, covariance=100.0 * calibration.dynamics.covariance)
    )
    with pytest.raises(InputError, match="no reading tells where the sensor's origin is"):
        exported(target, unsure, Setup(), "tool.json")


def test_a_file_that_subtracts_no_inertia_says_so() -> None:
    calibration, _ = with_particles(1)
    assert calibration.dynamics is not None
    felt = replace(calibration.dynamics, static_rms=np.array([3.0, 0.0, 4.0, 1.0, 1.0, 1.0]))
    moving, still = (
        exported(TARGETS["python"], replace(calibration, dynamics=dynamics), Setup(), "tool.json").notes
        for dynamics in (felt, None)
    )
    said = [note for note in moving if note not in still]
    assert said == [
        "this file does not subtract what a moving tool exerts: 5 N RMS were felt of that in the motion of the "
        "calibration"
    ]
