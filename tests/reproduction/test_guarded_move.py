"""The tasks with a sense of touch: what comes out with a perfect sense, and with one that is wrong in a known way."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")

from contactwrench.geometry.arrays import Array
from contactwrench.geometry.rotations import rotation_exp
from contactwrench.simulate.kinematics import flange_pose
from contactwrench.simulate.rig import Rig, build
from contactwrench.simulate.settings import Settings
from reproduction import guarded_move, peg, pushing
from reproduction.closed_loop import ToContact, servo_rig
from reproduction.scenes import PLATE, PROBE, TOOL, hole, peg_tool, tip_in_flange

SETTINGS = Settings(tool=TOOL)
SIDE = (np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.array([0.55, -0.1, 0.45]))
"""An upright face in reach of the arm."""


def perfect(settings: Settings, error: tuple[float, ...] = (0.0,) * 6) -> ToContact:
    """What the weight and the zero in the settings say, by hand; `error` (6,) is added to the wrench, sensor axes."""
    weight = settings.tool.mass * settings.gravity
    R_flange_sensor, com, bias = settings.R_flange_sensor, np.array(settings.tool.com), np.array(settings.sensor.bias)

    def to_contact(reading: Array, R_base_flange: Array) -> Array:
        gravity = weight * (R_base_flange @ R_flange_sensor).T @ settings.gravity_direction
        contact: Array = reading - bias - np.concatenate([gravity, np.cross(com, gravity)]) + error
        return contact

    return to_contact


@pytest.fixture(scope="module")
def probe() -> Rig:
    return servo_rig(SETTINGS, PROBE, PLATE)


@pytest.fixture(scope="module")
def peg_rig() -> Rig:
    return servo_rig(SETTINGS, peg_tool(), hole())


@pytest.fixture(scope="module")
def at_plate(probe: Rig) -> Array:
    return pushing.joints_at(probe, *SIDE)


@pytest.fixture(scope="module")
def over_hole(peg_rig: Rig) -> Array:
    return peg.joints_over(peg_rig, *SIDE)


@pytest.fixture(scope="module")
def begin(probe: Rig) -> Array:
    return guarded_move.approaches(probe, 12, np.random.default_rng(8))


def test_the_moves_begin_in_orientations_all_over(probe: Rig) -> None:
    joints = guarded_move.approaches(probe, 60, np.random.default_rng(1))
    ahead = np.array([guarded_move.tool_axis(probe, one) for one in joints])
    assert np.all(ahead.max(axis=0) > 0.6)
    assert np.all(ahead.min(axis=0) < -0.6)


def test_with_a_perfect_sense_every_move_stops_at_the_plate_near_five_newton(probe: Rig, begin: Array) -> None:
    for number, joints in enumerate(begin[:5]):
        move = guarded_move.guarded_move(probe, joints, perfect(SETTINGS), np.random.default_rng(number))
        assert move.ended == "contact"
        # at 200 N/s, a period of 8 ms, a row of delay and 3 ms of filter pass before the stop
        assert 4.8 < move.at_stop < 5.0 + 200.0 * 0.013
        assert move.largest < 5.0 + 200.0 * 0.025


def test_a_zero_that_is_off_by_six_newton_stops_in_free_air(probe: Rig, begin: Array) -> None:
    sense = perfect(SETTINGS, (0.0, 6.0, 0.0, 0.0, 0.0, 0.0))
    move = guarded_move.guarded_move(probe, begin[0], sense, np.random.default_rng(0))
    assert (move.ended, move.largest) == ("false stop", 0.0)


def test_who_feels_nothing_does_not_stop(probe: Rig, begin: Array) -> None:
    move = guarded_move.guarded_move(probe, begin[0], lambda reading, R: np.zeros(6), np.random.default_rng(0))
    assert move.ended == "missed"
    assert move.largest >= guarded_move.TOO_MUCH


def test_a_zero_that_is_off_against_the_push_stops_late_by_as_much(probe: Rig, begin: Array) -> None:
    """The contact force on the tool points back along the sensor's z."""
    at_stop = [
        guarded_move.guarded_move(probe, begin[0], sense, np.random.default_rng(5)).at_stop
        for sense in (perfect(SETTINGS), perfect(SETTINGS, (0.0, 0.0, 4.0, 0.0, 0.0, 0.0)))
    ]
    assert at_stop[1] - at_stop[0] == pytest.approx(4.0, abs=1.7)


@pytest.fixture(scope="module")
def run(probe: Rig, at_plate: Array) -> pushing.Pushing:
    return pushing.push(probe, *SIDE, at_plate, perfect(SETTINGS), np.random.default_rng(2))


@pytest.mark.slow
def test_pushing_holds_the_force_with_a_perfect_sense_and_is_off_by_an_error_of_the_sense(
    probe: Rig, at_plate: Array, run: pushing.Pushing
) -> None:
    R, spot = SIDE
    assert not run.ended_early
    assert run.error < 0.15
    assert run.normal_force.mean() == pytest.approx(10.0, abs=0.03)

    def off_by_two(reading: Array, R_base_flange: Array) -> Array:
        wrench = perfect(SETTINGS)(reading, R_base_flange)
        wrench[:3] += (R_base_flange @ SETTINGS.R_flange_sensor).T @ (2.0 * R[:, 2])
        return wrench

    off = pushing.push(probe, R, spot, at_plate, off_by_two, np.random.default_rng(2))
    assert off.normal_force.mean() == pytest.approx(8.0, abs=0.03)


@pytest.mark.slow
def test_the_tool_leans_as_far_as_it_says(run: pushing.Pushing) -> None:
    tool = flange_pose(build(SETTINGS), run.trace.qpos[:, :7])[0][:, :, 2]
    assert np.arccos(np.clip(-tool @ SIDE[0][:, 2], -1.0, 1.0)).max() == pytest.approx(
        pushing.LEAN, abs=np.deg2rad(0.3)
    )


@pytest.mark.parametrize("upright", [True, False])
def test_with_a_perfect_sense_the_peg_goes_in_gently(peg_rig: Rig, over_hole: Array, upright: bool) -> None:
    (R, mouth), joints = SIDE, over_hole
    if not upright:
        R, mouth = rotation_exp(np.array([0.5, 0.3, 0.0])), np.array([0.55, 0.05, 0.3])
        joints = peg.joints_over(peg_rig, R, mouth)
    for number in range(2):
        one = peg.insert(peg_rig, R, mouth, joints, perfect(SETTINGS), np.random.default_rng(number))
        assert one.inserted
        assert one.largest_force < 15.0
        assert one.depth == pytest.approx(peg.DEEP, abs=5e-4)
        # from START to DEEP at the speed of the push over the damping
        assert one.seconds > (peg.START + peg.DEEP) / (peg.PUSH / peg.YIELDING.damping[2])


@pytest.mark.slow
@pytest.mark.parametrize(("pull", "ended"), [(8.0, "time"), (20.0, "lost")])
def test_a_peg_that_feels_a_pull_sideways_stays_at_the_mouth_or_is_lost(
    peg_rig: Rig, over_hole: Array, pull: float, ended: str
) -> None:
    sense = perfect(SETTINGS, (pull, 0.0, 0.0, 0.0, 0.0, 0.0))
    one = peg.insert(peg_rig, *SIDE, over_hole, sense, np.random.default_rng(0))
    assert one.ended == ended
    assert not one.inserted


def test_the_depth_is_that_below_the_face_of_the_block_where_its_springs_let_it_be(
    peg_rig: Rig, over_hole: Array
) -> None:
    """Pushed with 60 N too much the block sinks; the peg's end, less the block's travel, is `DEEP` below the face."""
    R, mouth = SIDE

    def pushes_too_hard(reading: Array, R_base_flange: Array) -> Array:
        wrench = perfect(SETTINGS)(reading, R_base_flange)
        wrench[:3] += (R_base_flange @ SETTINGS.R_flange_sensor).T @ (-60.0 * R[:, 2])
        return wrench

    one = peg.insert(peg_rig, R, mouth, over_hole, pushes_too_hard, np.random.default_rng(1))
    R_base_flange, position = flange_pose(build(SETTINGS), one.trace.qpos[-2:, :7])
    below_where_it_stood = -((position + R_base_flange @ tip_in_flange(peg_rig) - mouth) @ R)[:, 2]
    before, last = below_where_it_stood + one.trace.qpos[-2:, 9]
    assert one.ended == "in"
    assert one.trace.qpos[-1, 9] < -0.0004
    assert before < peg.DEEP
    assert one.depth == pytest.approx(last, abs=2e-4)


def test_a_try_without_time_ends_so(peg_rig: Rig, over_hole: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peg, "LONGEST", 0.1)
    one = peg.insert(peg_rig, *SIDE, over_hole, perfect(SETTINGS), np.random.default_rng(0))
    assert one.ended == "time"


def test_a_push_beyond_the_protective_stop_ends_so(
    peg_rig: Rig, over_hole: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peg, "TOO_MUCH", 5.0)
    one = peg.insert(peg_rig, *SIDE, over_hole, perfect(SETTINGS), np.random.default_rng(2))
    assert one.ended == "stop"
    assert not one.inserted


@pytest.mark.slow
def test_same_seed_same_work(probe: Rig, peg_rig: Rig, begin: Array, over_hole: Array) -> None:
    def once(seed: int) -> tuple[float, float]:
        rng = np.random.default_rng(seed)
        move = guarded_move.guarded_move(probe, begin[1], perfect(SETTINGS), rng)
        one = peg.insert(peg_rig, *SIDE, over_hole, perfect(SETTINGS), rng)
        return move.at_stop, one.largest_force

    assert once(4) == once(4)
    assert once(4) != once(5)
