"""A calibration by an accelerometer, sample by sample: what it reads is given beside each reading."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("pinocchio", reason="Pinocchio has no build for this platform")

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import ContactWrenches, motion_of
from contactwrench.errors import InputError
from contactwrench.samples.accelerometer import Accelerometer
from contactwrench.samples.flange_motion import FlangeMotion
from tests.support.moving_tool import known
from tests.support.world import Array

RATE, DELAY, NOISE = 1000.0, 0.002, np.repeat([0.05, 0.002], 3)
"""Hz; s, by which the wrench is stamped later than the orientation; N and N m."""
T = np.arange(1500) / RATE


def _orientations(t: Array) -> Rotation:
    turn = np.stack([0.5 * np.sin(6.0 * t), 0.4 * np.sin(4.0 * t + 1.0), 0.6 * np.sin(5.0 * t + 2.0)], axis=1)
    return Rotation.from_rotvec(turn)


def _acceleration(t: Array) -> Array:
    """Of the accelerometer's place, base axes; up to 6 m/s^2."""
    return np.stack([4.0 * np.sin(9.0 * t), 3.0 * np.sin(7.0 * t + 0.5), 3.0 * np.cos(8.0 * t)], axis=1)


def _motion(t: Array, h: float = 1e-4) -> FlangeMotion:
    R = _orientations(t)
    before, after = (R.inv() * _orientations(t + late) for late in (-h, h))
    a, b = before.as_rotvec(), after.as_rotvec()
    acceleration = R.inv().apply(_acceleration(t))
    inside = np.ones(len(t), np.bool_)
    return FlangeMotion((b - a) / (2.0 * h), (a + b) / h**2, acceleration, R.as_matrix(), inside, of_accelerometer=True)


@dataclass(frozen=True, eq=False)
class Swing:
    """A free tool that swings, with readings of the sensor and of an accelerometer at the times T."""

    calibration: cw.Calibration
    wrench: Array
    felt: Array

    def run(self, felt: Array | None = None) -> ContactWrenches:
        """What is left, with what the accelerometer read, or with nothing of it."""
        R, given = _orientations(T).as_quat(), self.felt if felt is None else felt
        return self.compensator().run(self.wrench, R, T, acceleration=given)

    def compensator(self, fast: bool = True) -> cw.Compensator:
        return cw.Compensator(self.calibration, rate=RATE, delay=DELAY, noise=NOISE, fast=fast)


@lru_cache
def swing(late: float = 0.0) -> Swing:
    """Its accelerometer, in g and turned anyhow, is `late` s behind the wrench."""
    _, tool = known(1)
    axes = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix() / 9.80665
    sits = Accelerometer(axes, np.array([0.01, -0.02, 0.03]), 0.002, late)
    assert tool.dynamics is not None
    calibration = replace(tool, dynamics=replace(tool.dynamics, accelerometer=sits))
    motion, then = _motion(T - DELAY), T - DELAY - late
    wrench = calibration.predict(motion.R_base_flange) + motion.terms @ tool.dynamics.matrix.T
    specific_force = _orientations(then).inv().apply(_acceleration(then) - tool.g * tool.gravity_direction)
    return Swing(calibration, wrench, specific_force @ axes.T + sits.bias)


def _force(rows: ContactWrenches) -> float:
    """The largest, N, from the first poses on."""
    return float(np.linalg.norm(rows.wrench[20:, :3], axis=1).max())


@pytest.mark.parametrize("late", [0.0, -0.005])
def test_a_free_tool_in_any_motion_compensates_to_nothing(late: float) -> None:
    """But for differences of orientations, a thousandth of what the motion makes felt; also where it reads before the
    wrench is there.
    """
    moved = swing(late)
    standing = moved.compensator().run(moved.wrench, _orientations(T).as_quat(), T)
    assert _force(moved.run()) < 1e-3 * _force(standing)
    assert _force(standing) > 5.0


def test_one_that_is_late_leaves_what_its_std_says() -> None:
    """6 ms, in which it changes by a tenth of what it is; gravity in it is that of then."""
    found = swing(0.006).run()
    off = np.abs(found.wrench[20:, :3]) / np.hypot(found.std[20:, :3], 1e-3)
    assert 0.1 < float(np.sqrt(np.mean(off**2))) < 1.0
    assert _force(found) < 0.1 * _force(swing(0.006).run(felt=np.full((len(T), 3), np.nan)))
    assert not (found.contact == 1).any()


def test_where_the_arm_does_not_turn_nothing_at_all_is_left() -> None:
    calibration, rng = swing().calibration, np.random.default_rng(2)
    assert calibration.dynamics is not None
    assert calibration.dynamics.accelerometer is not None
    R, a = Rotation.from_rotvec([0.4, 1.0, -0.3]), rng.normal(size=(200, 3))
    matrix, sits = calibration.dynamics.matrix, calibration.dynamics.accelerometer
    in_flange = R.inv().apply(a)
    felt = (in_flange - calibration.g * calibration.gravity_direction @ R.as_matrix()) @ sits.matrix.T + sits.bias
    wrench, turns = calibration.predict(R.as_matrix()) + in_flange @ matrix[:, 9:].T, np.tile(R.as_quat(), (200, 1))
    found = swing().compensator(False).run(wrench, turns, T[:200], acceleration=felt)
    assert np.abs(found.wrench[1:]).max() < 1e-9


def test_calls_batches_plain_and_compiled_are_the_same_to_the_last_bit() -> None:
    """Also where it is silent for a while, stuck while the arm turns, or slower than the wrench."""
    moved, R, felt = swing(0.003), _orientations(T).as_quat()[:700], swing(0.003).felt[:700].copy()
    felt[200:280], felt[350:450] = np.nan, felt[349]
    felt[500:600] = felt[np.arange(500, 600) // 10 * 10]
    plain, compiled = (
        moved.compensator(fast).run(moved.wrench[:700], R, T[:700], acceleration=felt) for fast in (False, True)
    )
    one = moved.compensator(False)
    calls = [one(moved.wrench[k], R[k], float(T[k]), acceleration=felt[k]) for k in range(700)]
    for each in (compiled, _columns(calls)):
        assert np.array_equal(each.wrench, plain.wrench, equal_nan=True)
        assert np.array_equal(each.std, plain.std, equal_nan=True)
    assert np.array_equal(compiled.statistic, plain.statistic, equal_nan=True)
    assert compiled.reason == plain.reason == tuple(call.reason for call in calls)
    assert not plain.valid.all()


def _columns(calls: list[cw.ContactWrench]) -> ContactWrenches:
    """Results of calls as those of a batch."""
    wrench, std = (np.array([getattr(call, name) for call in calls]) for name in ("wrench", "std"))
    return ContactWrenches(wrench, std)


def test_one_that_falls_silent_leaves_nothing_valid_until_it_reads_again() -> None:
    """From 36 ms on, as poses that stop; what it read last stands for so long."""
    felt = swing().felt.copy()
    felt[500:600] = np.nan
    found = swing().run(felt)
    assert found.valid[4:534].all()
    assert not found.valid[538:600].any()
    assert found.valid[600:].all()
    assert str(found.reason[549]) == "frozen: the accelerometer has read nothing for 0.05 s"
    exact = swing().run()
    assert found.wrench[605:] == pytest.approx(exact.wrench[605:], abs=1e-9)


def test_one_that_fell_silent_is_not_believed_behind_a_gap_of_the_wrench() -> None:
    """Nor where the times begin anew, until it reads again."""
    felt, kept = swing().felt.copy(), np.r_[0:510, 660:1000]
    felt[500:900] = np.nan
    one, R = swing().compensator(), _orientations(T).as_quat()
    found = one.run(swing().wrench[kept], R[kept], T[kept], acceleration=felt[kept])
    assert not found.valid[510:750].any()
    assert found.valid[750:].all()
    again = one.run(swing().wrench[:200], R[:200], T[:200], acceleration=np.full((200, 3), np.nan))
    assert not again.valid.any()


def test_one_that_is_stuck_while_the_arm_turns_has_fallen_silent() -> None:
    """What is the same once more is not read anew."""
    felt = swing().felt.copy()
    felt[500:600] = felt[499]
    found = swing().run(felt)
    assert found.valid[4:534].all()
    assert not found.valid[538:600].any()
    assert found.valid[600:].all()
    assert not (found.contact == 1).any()


@pytest.mark.parametrize("held", [True, False], ids=["held", "none between"])
@pytest.mark.parametrize("every", [10, 30])
def test_one_that_is_slower_than_the_wrench_leaves_what_its_std_says(held: bool, every: int) -> None:
    """100 and 33 Hz, as a loop gives the latest value, or none: what it tells ages, and the std grows with it."""
    rows = np.arange(len(T))
    felt = swing().felt[rows // every * every]
    felt[rows % every > 0] = felt[rows % every > 0] if held else np.nan
    found = swing().run(felt)
    off = np.abs(found.wrench[50:, :3]) / np.hypot(found.std[50:, :3], 1e-3)
    assert 0.2 < float(np.sqrt(np.mean(off**2))) < 1.0
    assert found.valid[4:].all()
    assert not (found.contact == 1).any()


def test_one_that_repeats_itself_at_rest_reads_until_the_arm_turns() -> None:
    """As coarse ones do. Where the arm has begun to turn, it has been stuck for as long as it has repeated itself; when
    that stops, what it says is not how it stands.
    """
    moved, rest, R = swing(), np.zeros(300, np.int_), _orientations(T).as_quat()
    rows, t = np.concatenate([rest, np.arange(500), rest + 499]), np.arange(1100) / RATE
    standing = _orientations(T[rest] - DELAY).as_matrix()
    noise = np.random.default_rng(4).normal(size=(300, 6)) * NOISE
    felt_at_rest = _felt_standing(moved.calibration, standing[:1])[0]
    wrench = moved.wrench[rows]
    wrench[:300] = moved.calibration.predict(standing) + noise
    found = moved.compensator().run(wrench, R[rows], t, acceleration=np.tile(felt_at_rest, (1100, 1)))
    assert found.valid[4:300].all()
    assert not (found.contact == 1).any()
    assert not found.valid[306:].any()
    assert str(found.reason[310]).startswith("frozen: the accelerometer has read nothing for 0.3")


def _felt_standing(calibration: cw.Calibration, R: Array) -> Array:
    """What an accelerometer of the tool reads (n, 3) where it stands at R_base_flange (n, 3, 3)."""
    assert calibration.dynamics is not None
    sits = calibration.dynamics.accelerometer
    assert sits is not None
    return -calibration.g * calibration.gravity_direction @ R @ sits.matrix.T + sits.bias


def test_a_motion_of_a_recording_comes_before_what_was_felt() -> None:
    """And nothing that was felt stays behind it."""
    moved, R = swing(), _orientations(T).as_quat()
    one, other = moved.compensator(True), moved.compensator(True)
    one.run(moved.wrench[:500], R[:500], T[:500], acceleration=moved.felt[:500])
    for rows, motion in ((slice(500, 1499), _motion(T[500:1499])), (slice(1499, 1500), None)):
        left = [each.run(moved.wrench[rows], R[rows], T[rows], motion=motion).wrench[-900:] for each in (one, other)]
        assert left[0] == pytest.approx(left[1], abs=1e-9)


REFUSED: tuple[tuple[bool, dict[str, Any], str], ...] = (
    (
        True,
        {"position": [0.5, 0.0, 0.6]},
        "found position, and a calibration whose inertia counts from an accelerometer, expected acceleration: give "
        "that with the reading, `acceleration=`, or calibrate by the other",
    ),
    (
        False,
        {"acceleration": [0.0, 0.0, 1.0]},
        "found acceleration, and a calibration whose inertia counts from positions, expected position: give that "
        "with the reading, `position=`, or calibrate by the other",
    ),
    (
        True,
        {"position": [0.5, 0.0, 0.6], "acceleration": [0.0, 0.0, 1.0]},
        "found position and acceleration, expected what the inertia counts from: leave one out",
    ),
    (True, {"acceleration": [0.0, 1.0]}, "position or acceleration has shape (2,), expected (3,)"),
)


@pytest.mark.parametrize(("by_one", "given", "message"), REFUSED)
def test_what_does_not_go_with_the_calibration_is_refused(by_one: bool, given: dict[str, Any], message: str) -> None:
    calibration = swing().calibration if by_one else known(1)[1]
    with pytest.raises(InputError) as refused:
        cw.Compensator(calibration, fast=False)(np.zeros(6), np.eye(3), 0.0, **given)
    assert str(refused.value) == message


def test_on_the_rig_it_feels_the_push_and_not_the_motion() -> None:
    """The recording's accelerometer is 4 ms late, at 250 Hz, and noisy; what it reads is there, or the whole motion."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    from tests.support.accelerometer import Mounted, calibrated_by_accelerometer, with_readings
    from tests.support.in_motion import pushed

    calibration, samples = calibrated_by_accelerometer(), with_readings(Mounted())
    t = np.asarray(samples.t)
    since: Array = t - pushed().begin
    free, pushing = (since > 6.0) & (since < 14.0), (since > 4.1) & (since < 5.4)
    by_felt, by_motion, standing = (
        cw.Compensator(calibration, rate=500.0, lowpass=20.0).run(samples.wrench, samples.R_base_flange, t, **given)
        for given in ({"acceleration": samples.accelerometer}, {"motion": motion_of(calibration, samples)}, {})
    )
    for found in (by_felt, by_motion):
        left, without = (float(np.sqrt(np.mean(each.wrench[free, :3] ** 2))) for each in (found, standing))
        assert left < 0.025 * without
        assert not (found.contact[free] == 1).any()
        assert (found.contact[pushing] == 1).mean() > 0.95
