"""What can be wrong with a sample: flagged where it is, not flagged where it only looks like it, and overcome."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from copy import copy, deepcopy
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import contactwrench as cw
from contactwrench.compensate.bias_tracking import TYPICAL_DRIFT
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.compensate.faults import FINE, GAP, STUCK, reasons_of
from contactwrench.compensate.state import SAMPLE
from contactwrench.model import AXES
from tests.support.live import RATE, calibrated, free, still, swinging, times
from tests.support.rigs import NOISE
from tests.support.world import Array, random_rotations, readings

N = 3000


def _run(R: Array, change: Callable[[Array], object] | None = None, **settings: Any) -> ContactWrenches:
    """A free tool at orientations (n, 3, 3), its readings changed."""
    calibration, rig, rng = calibrated(1)
    wrench = free(rig, R, rng)
    if change is not None:
        change(wrench)
    return _compensator(calibration, **settings).run(wrench, R, times(len(R)))


def _compensator(calibration: cw.Calibration, **settings: Any) -> cw.Compensator:
    usual: dict[str, Any] = {"rate": RATE, "noise": NOISE, "lowpass": 50.0}
    return cw.Compensator(calibration, **(usual | settings))


def _words(batch: ContactWrenches) -> set[str]:
    return {reason.partition(":")[0] for reason in batch.reason if reason}


def _swing(n: int = N, speed: float = 0.5) -> Array:
    return swinging(np.random.default_rng(2), n, speed)


def test_a_good_recording_has_nothing_to_flag() -> None:
    for R in (_swing(), still(np.random.default_rng(3), N)):
        batch = _run(R)
        assert batch.valid.all()
        assert set(batch.reason) == {None}


@pytest.mark.parametrize(
    ("break_it", "reason"),
    [
        (lambda w, q, t: w.__setitem__((1000, 4), np.nan), "reading: ty is nan"),
        (lambda w, q, t: w.__setitem__((1000, 0), -np.inf), "reading: fx is -inf"),
        (lambda w, q, t: w.__setitem__((1000, 2), -9999.0), "reading: fz is -9999"),
        (lambda w, q, t: w.__setitem__(1000, 99999.0), "reading: fx is 99999"),
        (lambda w, q, t: w.__setitem__((1000, 5), 999999.0), "reading: tz is 999999"),
        (lambda w, q, t: q.__setitem__((1000, 1), np.nan), "orientation: not a number"),
        (
            lambda w, q, t: q.__setitem__(1000, 1.1 * q[1000]),
            "orientation: its squared length is 1.21, expected 1 within",
        ),
        (lambda w, q, t: t.__setitem__(1000, np.nan), "time: nan is no time"),
        (lambda w, q, t: t.__setitem__(1000, t[999]), "time: 100.999000 s again"),
    ],
)
def test_what_cannot_be_computed_is_nan_and_the_next_sample_is_as_if_it_had_not_been(
    break_it: Callable[[Array, Array, Array], None], reason: str
) -> None:
    calibration, rig, rng = calibrated(4)
    R = _swing()
    wrench, quat_xyzw, t = free(rig, R, rng), Rotation.from_matrix(R).as_quat(), times(N)
    left_out = [np.delete(each, 1000, axis=0) for each in (wrench, quat_xyzw, t)]
    break_it(wrench, quat_xyzw, t)
    batch = _compensator(calibration).run(wrench, quat_xyzw, t)
    assert str(batch.reason[1000]).startswith(reason)
    assert np.isnan(batch.wrench[1000]).all()
    assert np.isnan(batch.std[1000]).all()
    assert batch.contact[1000] == -1
    assert np.flatnonzero(~batch.valid).tolist() == [1000]
    without = _compensator(calibration).run(*left_out)
    assert np.array_equal(np.delete(batch.wrench, 1000, axis=0), without.wrench)


@pytest.mark.parametrize(
    "matrix",
    [np.diag([1.0, 1.0, -1.0]), np.zeros((3, 3)), 1.2 * np.eye(3), np.eye(3) + 0.2 * np.eye(3, k=1), np.ones((3, 3))],
)
def test_a_matrix_that_is_no_rotation(matrix: Array) -> None:
    calibration, _, _ = calibrated(5)
    sample = _compensator(calibration)(np.zeros(6), matrix, 1.0)
    assert not sample.valid
    assert str(sample.reason).startswith("orientation: its squared length is")
    rounded = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix().round(3)
    assert _compensator(calibration)(np.zeros(6), rounded, 1.0).valid


@pytest.mark.parametrize("broken", [np.nan, np.inf])
@pytest.mark.parametrize("element", range(9))
def test_an_element_of_a_matrix_that_is_no_number_spoils_its_sample_alone(element: int, broken: float) -> None:
    calibration, rig, rng = calibrated(5)
    R = still(rng, 50)
    wrench, t = free(rig, R, rng), times(50)
    R[20].reshape(9)[element] = broken
    batch = _compensator(calibration, sensor_filter=10.0).run(wrench, R, t)
    assert np.flatnonzero(~batch.valid).tolist() == [20]
    assert batch.reason[20] == "orientation: not a number"
    assert np.flatnonzero(np.isnan(batch.wrench).any(axis=1)).tolist() == [20]


def test_a_missing_second() -> None:
    """One flagged sample; after it the filter starts at the reading, and the contact that was on is over."""
    calibration, rig, rng = calibrated(6)
    R = still(rng, N)
    wrench, t = free(rig, R, rng), times(N)
    wrench[900:1000, 2] += 3.0
    t[1000:] += 1.0
    batch = _compensator(calibration).run(wrench, R, t)
    assert batch.reason[1000] == "gap: nothing for 1.001 s, filters start anew"
    assert np.flatnonzero(~batch.valid).tolist() == [1000]
    assert np.abs(batch.wrench[1000:1010, 2]).max() < 5.0 * batch.std[1000, 2]
    assert [contact.release for contact in batch.contacts] == [t[999]]
    assert batch.contact[1001] == 0
    short = times(N)
    short[1000:] += 0.05
    assert _compensator(calibration).run(wrench, R, short).valid.all()


@pytest.mark.parametrize(
    ("delay", "back", "fast"), [(0.05, 50, None), (-0.05, 100, False), (-0.004, 24, None), (0.0, 0, None)]
)
def test_what_the_delay_asks_for_is_not_known_at_first(delay: float, back: int, fast: bool | None) -> None:
    """An arm that turns at 60 deg/s from the start and through a gap: what is left with an orientation that is not the
    wrench's is flagged, and taken for no contact.
    """
    calibration, rig, _ = calibrated(2, exact=True)
    t = times(N)
    t[1000:] += 1.0

    def turn(at: Array) -> Array:
        axis = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
        matrices: Array = (
            Rotation.random(random_state=3) * Rotation.from_rotvec(np.outer((at - 100.0) * 1.05, axis))
        ).as_matrix()
        return matrices

    compensator = _compensator(calibration, delay=delay, lowpass=None, fast=fast)
    batch = compensator.run(readings(rig, turn(t - delay)), turn(t), t)
    not_known = np.r_[0:back, 1001 : 1000 + back] if back else np.empty(0, int)
    assert batch.valid[np.r_[back + 1 : 1000, 1001 + back : N]].all()
    assert not batch.valid[not_known].any()
    assert {str(batch.reason[k]) for k in not_known.tolist()} == (
        {f"orientation: that of {0.001 * back:.3g} s before, which the delay asks for, is not known yet"}
        if back
        else set()
    )
    assert not (batch.contact == 1).any()
    assert np.abs(batch.wrench[batch.valid, :3]).max() < 0.02


def test_one_glitch_before_a_fault_and_one_after_it_are_no_contact() -> None:
    calibration, rig, rng = calibrated(1)
    R, t = still(rng, N), times(N)
    wrench = free(rig, R, rng)
    stuck = slice(1000, 1900)
    wrench[stuck, 4] = wrench[1000, 4]
    flagged = np.flatnonzero(~_compensator(calibration, lowpass=None).run(wrench, R, t).valid)
    assert 1000 < flagged[0] < flagged[-1] == 1899
    wrench[[flagged[0] - 1, 1901, 1902], 0] += 5.0
    batch = _compensator(calibration, lowpass=None).run(wrench, R, t)
    assert (batch.statistic > batch.threshold)[[flagged[0] - 1, 1901, 1902]].all()
    assert not batch.contacts


def test_a_clock_that_jumps_back() -> None:
    calibration, rig, rng = calibrated(7)
    R = still(rng, N)
    t = times(N)
    t[1000:] -= 50.0
    batch = _compensator(calibration, drift=0.1 * NOISE).run(free(rig, R, rng), R, t)
    assert batch.reason[1000] == "time: jumped back by 49.999 s"
    assert np.flatnonzero(~batch.valid).tolist() == [1000]
    assert not batch.contacts


def _stick(channel: int, begin: int, end: int) -> Callable[[Array], None]:
    def change(wrench: Array) -> None:
        wrench[begin:end, channel] = wrench[begin, channel]

    return change


def test_reasons_know_their_kind_and_hold_no_more() -> None:
    """A sensor that is stuck gives one a row, each its own: with a dict each they took 1.2 kB."""
    samples = np.zeros(3, SAMPLE)
    samples["fault"], samples["detail"], samples["channel"] = [FINE, STUCK, GAP], [0.0, 101.0, 0.5], [-1, 2, -1]
    reasons = reasons_of(samples)
    assert reasons == (
        None,
        "stuck: fz has not moved for 101 readings while others did",
        "gap: nothing for 0.5 s, filters start anew",
    )
    for reason, channel in zip(reasons[1:], (2, -1), strict=True):
        assert reason is not None
        for other in (reason, copy(reason), deepcopy(reason), pickle.loads(pickle.dumps(reason))):
            assert (other.kind, other.channel) == (reason.split(":")[0], channel)
            assert not hasattr(other, "__dict__")


def test_a_stuck_channel() -> None:
    batch = _run(_swing(), _stick(4, 1000, 2000))
    assert _words(batch) == {"stuck"}
    flagged = np.flatnonzero(~batch.valid)
    assert flagged[0] <= 1000 + 150
    assert flagged.tolist() == list(range(flagged[0], 2000))
    assert batch.reason[1500] == "stuck: ty has not moved for 500 readings while others did"
    assert (batch.contact[flagged] == -1).all()
    assert np.abs(batch.wrench[2000:] / batch.std[2000:]).max() < 6.5


@pytest.mark.parametrize(("rate", "most"), [(20.0, 40), (100.0, 51)])
def test_a_stuck_channel_of_a_slow_sensor_is_found_within_half_a_second_or_as_its_noise_allows(
    rate: float, most: int
) -> None:
    calibration, rig, rng = calibrated(1)
    R = _swing(600, speed=0.05)
    wrench = free(rig, R, rng)
    wrench[100:, 2] = wrench[100, 2]
    batch = _compensator(calibration, rate=rate, lowpass=None).run(wrench, R, np.arange(600) / rate)
    assert batch.valid[:100].all()
    assert not batch.valid[100 + most :].any()


@pytest.mark.parametrize(("rate", "polled", "repeats"), [(20.0, 1, 19), (20.0, 25, 19), (100.0, 1, 45)])
def test_a_channel_that_repeats_for_less_than_that_is_not_stuck(rate: float, polled: int, repeats: int) -> None:
    """Nor where a driver asks a slow sensor more often: those are no more readings."""
    calibration, rig, rng = calibrated(1)
    wrench = free(rig, R := still(rng, 400), rng)
    for channel, begin in enumerate(range(100, 340, 80)):
        wrench[begin : begin + repeats, channel] = wrench[begin, channel]
    t = np.arange(400 * polled) / (rate * polled)
    batch = _compensator(calibration, rate=rate * polled, lowpass=None).run(
        np.repeat(wrench, polled, axis=0), np.repeat(R, polled, axis=0), t
    )
    assert "stuck" not in _words(batch)


def test_missing_values_teach_nothing_of_the_bias() -> None:
    """Twelve readings of -9999 were a push of 17000 N, of which the 0.3 % that may be left hid one of 12 N."""
    calibration, rig, rng = calibrated(1)
    R = still(rng, N)
    wrench = free(rig, R, rng)
    wrench[1000:1012] = -9999.0
    wrench[2000:2500, 0] += 12.0
    batch = _compensator(calibration, lowpass=None, drift=TYPICAL_DRIFT).run(wrench, R, times(N))
    assert not batch.valid[1000:1012].any()
    assert batch.wrench[2100:2400, 0] == pytest.approx(12.0, abs=0.3)
    assert (batch.contact[2100:2400] == 1).all()


@pytest.mark.parametrize(
    ("channel", "at", "fast"), [(0, 1.234, None), (5, 1.234, False), (3, 0.0, None), (1, 0.0, None)]
)
def test_a_channel_that_never_moved_while_the_others_of_its_group_do_is_stuck(
    channel: int, at: float, fast: bool | None
) -> None:
    calibration, rig, rng = calibrated(8)
    R = _swing(3000)
    wrench = free(rig, R, rng)
    wrench[:, channel] = at
    batch = cw.Compensator(calibration, rate=RATE, fast=fast).run(wrench, R, times(3000))
    flagged = np.flatnonzero([str(reason).startswith(f"stuck: {AXES[channel]}") for reason in batch.reason])
    assert flagged.tolist() == list(range(flagged[0], 3000))
    assert 1000 <= flagged[0] < 1010


@pytest.mark.parametrize("noises", [0.3, 1.0, 2.0])
def test_one_at_rest_that_is_three_times_as_coarse_as_the_others_is_not(noises: float) -> None:
    """As the axis along a sensor is."""
    calibration, rig, rng = calibrated(8)
    R = still(rng, 4000)
    wrench = free(rig, R, rng)
    for channel, step in enumerate(noises * NOISE[:3] * [1.0, 1.0, 3.0]):
        wrench[:, channel] = np.round(wrench[:, channel] / step) * step
    batch = cw.Compensator(calibration, rate=RATE).run(wrench, R, times(4000))
    assert "stuck" not in _words(batch)


def test_a_short_repeat_and_a_coarse_sensor_are_not_stuck() -> None:
    assert _run(_swing(), _stick(4, 1000, 1030)).valid.all()

    def coarse(wrench: Array) -> None:
        step = 2.0 * NOISE
        wrench[:] = np.round(wrench / step) * step

    for R in (_swing(), still(np.random.default_rng(3), N)):
        assert _run(R, coarse).valid.all()


def test_a_driver_that_repeats_each_reading_of_a_slower_sensor() -> None:
    def repeat(wrench: Array) -> None:
        wrench[:] = np.repeat(wrench[::20], 20, axis=0)[: len(wrench)]

    batch = _run(_swing(), repeat)
    assert batch.valid.all()
    assert not batch.contacts
    assert np.sqrt(np.mean((batch.wrench / batch.std)[1000:] ** 2)) == pytest.approx(1.0, abs=0.3)


def test_a_reading_that_stops_altogether() -> None:
    def stop(wrench: Array) -> None:
        wrench[1500:2500] = wrench[1500]

    batch = _run(_swing(), stop)
    flagged = np.flatnonzero(~batch.valid)
    assert 1500 + 200 <= flagged[0] < 1500 + 300
    assert flagged[-1] == 2499
    assert str(batch.reason[2400]) == "stuck: the whole reading has not moved for 0.9 s"


@pytest.mark.parametrize(
    ("rate", "seconds", "fast"), [(50.0, 0.4, None), (100.0, 0.2, False), (250.0, 0.2, None), (500.0, 0.2, None)]
)
def test_a_reading_that_stops_is_believed_for_the_same_time_at_every_rate(
    rate: float, seconds: float, fast: bool | None
) -> None:
    """0.2 s, or 20 times as long as one reading takes to come."""
    calibration, rig, rng = calibrated(1)
    R, t, stop = _swing(1000), times(1000, rate), int(8.0 * rate) if rate < 100.0 else 500
    wrench = free(rig, R, rng)
    wrench[stop:] = wrench[stop]
    batch = _compensator(calibration, rate=rate, lowpass=None, fast=fast).run(wrench, R, t)
    flagged = np.flatnonzero([str(reason).startswith("stuck: the whole reading") for reason in batch.reason])
    assert seconds < t[flagged[0]] - t[stop] < seconds + 1.5 / rate
    assert flagged.tolist() == list(range(flagged[0], 1000))


def test_a_torque_that_is_not_measured_is_not_stuck() -> None:
    def unmeasured(wrench: Array) -> None:
        wrench[:, 3:] = 0.0

    assert _words(_run(_swing(12_000), unmeasured)) <= {"contact or bias"}


@pytest.mark.parametrize("model", ["affine", "mount"])
@pytest.mark.parametrize("channels", [[3, 4], [5]])
def test_channels_that_the_calibration_has_nothing_of_are_not_stuck(channels: list[int], model: str) -> None:
    """Of a sensor that measures four or five of the six."""
    _, rig, rng = calibrated(1)
    R = random_rotations(40, rng)
    wrench = free(rig, R, rng)
    wrench[:, channels] = 0.0
    calibration = cw.calibrate(cw.Samples(wrench, R), model)
    R = _swing(2000)
    wrench = free(rig, R, rng)
    wrench[:, channels] = 0.0
    assert "stuck" not in _words(_compensator(calibration).run(wrench, R, times(2000)))


@pytest.mark.parametrize("lost", ["overload", "saturated"])
def test_a_saturated_channel(lost: str) -> None:
    """With the ranges told at once, naming the channel; without, once it has not moved for too long."""
    calibration, rig, rng = calibrated(8)
    R = still(rng, 1500)
    wrench = free(rig, R, rng)
    sign, limit = np.sign(wrench[0, 2]), abs(wrench[0, 2]) + 20.0
    wrench[1000:, 2] = np.clip(wrench[1000:, 2] + 30.0 * sign, -limit, limit)
    ranges = np.full(6, 1e3)
    ranges[2] = limit
    batch = _compensator(calibration, **({"ranges": ranges} if lost == "overload" else {})).run(wrench, R, times(1500))
    assert batch.valid[:1000].all()
    if lost == "overload":
        assert batch.reason[1000] == f"overload: fz reads {sign * limit:.6g} N, at or beyond its range"
        assert (batch.contact[1050:] == 1).all()
    expected = "overload: fz" if lost == "overload" else "stuck: fz"
    assert all(str(reason).startswith(expected) for reason in batch.reason[1200:])


@pytest.mark.parametrize("every", [20, 100])
def test_single_readings_that_are_lost_do_not_end_the_learning_of_the_bias(every: int) -> None:
    """So few say nothing of a contact, and a block of 0.1 s without one may not come for hours."""
    calibration, rig, rng = calibrated(10)
    R = still(rng, N)
    wrench = free(rig, R, rng) + 0.2 * NOISE
    lossy = wrench.copy()
    lossy[::every] = np.nan
    learned = []
    for given in (wrench, lossy):
        compensator = _compensator(calibration, drift=TYPICAL_DRIFT)
        compensator.run(given, R, times(N))
        learned.append(compensator.drift)
    assert (np.abs(learned[0]) > 0.2 * NOISE).any()
    assert (np.abs(learned[1] - learned[0]) < 0.1 * NOISE).all()


def _held(R: Array, every: int) -> Array:
    """Poses that come once in `every` samples."""
    return np.repeat(R[::every], every, axis=0)[: len(R)]


@pytest.mark.parametrize("every", [1, 10])
def test_a_frozen_orientation_of_an_arm_that_was_turning(every: int) -> None:
    calibration, rig, rng = calibrated(9)
    R = _swing(N, speed=1.5)
    told = _held(R, every)
    told[600:1200] = told[600]
    batch = _compensator(calibration).run(free(rig, R, rng), told, times(N))
    flagged = np.flatnonzero([reason is not None and reason.startswith("frozen") for reason in batch.reason])
    assert 600 < flagged[0] <= 600 + 8 * every + 20
    assert flagged.tolist() == list(range(flagged[0], 1200))
    assert str(batch.reason[1150]).startswith("frozen: the orientation has not moved for 0.5")
    assert (batch.contact[flagged] == -1).all()
    assert batch.valid[1200:].all()
    assert np.abs(batch.wrench[1300:2000, 2]).max() < (6.0 if every == 1 else 1e9) * batch.std[1300, 2]


def test_a_single_wrong_pose_does_not_hide_that_poses_freeze_later() -> None:
    """It leaps by 6 deg within 1 ms, as no arm does that could stop so."""
    calibration, rig, rng = calibrated(9)
    R = _swing(N, speed=1.5)
    told = R.copy()
    told[300] @= Rotation.from_rotvec([0.0, 0.1, 0.0]).as_matrix()
    told[600:1200] = told[600]
    batch = _compensator(calibration).run(free(rig, R, rng), told, times(N))
    assert [str(reason).partition(":")[0] for reason in batch.reason[630:1200]] == ["frozen"] * 570


@pytest.mark.parametrize("every", [1, 10])
def test_an_arm_that_stops_and_is_quite_still_is_not_frozen(every: int) -> None:
    """At 5 rad/s^2, poses at 1 kHz or 100 Hz; while it rests its pose repeats exactly."""
    calibration, rig, rng = calibrated(10)
    t = np.arange(N) / RATE
    speed = np.clip(1.5 - 5.0 * np.maximum(t - 1.0, 0.0), 0.0, None)
    angle = np.cumsum(speed) / RATE
    R = (Rotation.random(random_state=rng) * Rotation.from_rotvec(np.outer(angle, [0.6, 0.0, 0.8]))).as_matrix()
    batch = _compensator(calibration).run(free(rig, R, rng), _held(R, every), times(N))
    assert batch.valid.all()


@pytest.mark.parametrize("freezes", [False, True])
def test_poses_of_100_hz_looked_up_between_two_stop_with_the_arm_or_freeze(freezes: bool) -> None:
    """It turns at 1 rad/s and brakes at 10 rad/s^2: from between two poses it seems to stop from one reading to the
    next. A pose that freezes at full speed still shows."""
    calibration, rig, rng = calibrated(10)
    t = np.arange(N) / RATE
    speed = np.clip(10.0 * np.minimum(t - 0.5, 1.2093 - t), 0.0, 1.0)
    R = Rotation.random(random_state=rng) * Rotation.from_rotvec(np.outer(np.cumsum(speed) / RATE, [0.6, 0.0, 0.8]))
    poses = R[::10].as_matrix()
    if freezes:
        poses[100:] = poses[100]
    told = Slerp(t[::10], Rotation.from_matrix(poses))(np.minimum(t, t[-10])).as_matrix()
    told[t >= (1.0 if freezes else 1.21)] = poses[-1]  # to the last digit
    batch = _compensator(calibration).run(free(rig, R.as_matrix(), rng), told, times(N))
    assert _words(batch) == ({"frozen"} if freezes else set())
    assert batch.valid[:1000].all()


@pytest.mark.parametrize("between", [2, 4])
def test_a_single_wrong_pose_of_an_arm_at_rest_is_not_frozen(between: int) -> None:
    """It is 6 deg off, and looked up at so many readings a pose, so that the arm seems to go there and back."""
    calibration, rig, rng = calibrated(8)
    R = np.concatenate([way := swinging(rng, 1571, speed=0.2), np.tile(way[-1], (1429, 1, 1))])  # half a period
    share = np.maximum(1.0 - np.abs(np.arange(3000) - 2000) / between, 0.0)
    wrong = R @ Rotation.from_rotvec(np.outer(share, [0.06, 0.08, 0.0])).as_matrix()
    found = cw.Compensator(calibration, rate=RATE, noise=NOISE).run(free(rig, R, rng), wrong, times(3000))
    assert found.valid[2010:].all()
    assert not (found.contact[2100:] == 1).any()


def test_an_orientation_that_always_jittered_and_now_repeats() -> None:
    calibration, rig, rng = calibrated(11)
    R = still(rng, N)
    jitter = Rotation.from_rotvec(1e-6 * rng.normal(size=(N, 3))).as_matrix()
    told = jitter @ R
    told[2000:] = told[2000]
    wrench = free(rig, R, rng)
    batch = _compensator(calibration).run(wrench, told, times(N))
    assert batch.valid[:2200].all()
    assert not batch.valid[2300:].any()
    assert _words(batch) == {"frozen"}
    quantised = np.round(jitter @ R, 6)
    assert _compensator(calibration).run(wrench, R, times(N)).valid.all()
    assert _compensator(calibration).run(wrench, quantised, times(N)).valid[:2000].all()


def test_after_every_fault_the_filter_is_at_the_reading_again() -> None:
    """Through a low-pass of 2 Hz nothing of what went on during the fault is left."""
    calibration, rig, rng = calibrated(12, exact=True)
    R = _swing()
    wrench = readings(rig, R) + 1e-3 * NOISE * rng.normal(size=(N, 6))
    wrench[1000:1600, 1] = 500.0
    batch = cw.Compensator(calibration, rate=RATE, noise=NOISE, lowpass=2.0).run(wrench, R, times(N))
    assert _words(batch) == {"stuck"}
    assert np.abs(batch.wrench[1600:, 1]).max() < 0.01
