"""Still stretches, judged by runs of the virtual rig, whose stops, contacts and true wrenches are known."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.samples.recorded_poses import is_stream
from contactwrench.samples.still_segments import StillSegments, still_segments
from tests.support.measured_sets import SHARED
from tests.support.rigs import seeds
from tests.support.runs import Run, run
from tests.support.world import Array

pytest.importorskip("mujoco")

FILTER = ("sensor.low_pass=10",)
THIRD_STOP = 10.5
"""s: when the fourth stop of 2 s begins, after moves of 1.5 s."""

WAYS: dict[str, dict[str, object]] = {
    "1 kHz": {},
    "100 Hz": {"rate": 100.0},
    "10 Hz": {"rate": 10.0},
    "noisy orientation at 1 kHz": {"orientation_noise_deg": 0.05},
    "noisy orientation at 10 Hz": {"rate": 10.0, "orientation_noise_deg": 0.03, "stop": 3.0},
    "sensor filter of 10 Hz": {"settings": FILTER},
    "sensor filter of 2 Hz": {"settings": ("sensor.low_pass=2",)},
    "late sensor": {"settings": ("sensor.delay=0.05",)},
    "short stops": {"stop": 0.6},
    "coarse readings": {"settings": ("sensor.quantum=0.1",)},
}


@cache
def recorded(way: str) -> tuple[Run, StillSegments]:
    made = run(stops=8, seed=3, **WAYS[way])  # type: ignore[arg-type]
    return made, still_segments(made.samples)


def disturbed(disturb: Callable[[Array, Array], Array]) -> tuple[Run, StillSegments]:
    made = run(stops=6, seed=4, settings=FILTER, disturb=disturb)
    return made, still_segments(made.samples)


def pushed(begin: float, end: float, newton: float) -> Callable[[Array, Array], Array]:
    def push(t: Array, wrench: Array) -> Array:
        return wrench + np.outer((t >= begin) & (t < end), [0.0, 0.0, newton, 0.0, 0.0, 0.0])

    return push


def stop_of(made: Run, t_start: float, t_end: float) -> int:
    """The stop around the middle of a stretch; fails where the arm moved."""
    middle = 0.5 * (t_start + t_end)
    (inside,) = np.flatnonzero((made.stops[:, 0] <= middle) & (middle <= made.stops[:, 1]))
    return int(inside)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_every_stop_is_found_and_none_is_invented(way: str) -> None:
    made, found = recorded(way)
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == list(range(8))
    assert found.rejected == ()


@pytest.mark.parametrize("way", WAYS)
def test_a_stretch_begins_when_all_has_settled_and_ends_with_the_stop(way: str) -> None:
    made, found = recorded(way)
    begin, end = made.stops.T
    late = np.array([one.t_start for one in found.accepted]) - begin
    early = end - np.array([one.t_end for one in found.accepted])
    # the least jerk leaves hardly any way in the last tenth of a second; 0.7 s are nine time constants of 2 Hz
    assert late.min() > -0.12
    assert late.max() < 0.7
    assert np.abs(early).max() < 0.16


@pytest.mark.parametrize("way", WAYS)
def test_the_means_lie_within_their_std_of_the_truth(way: str) -> None:
    made, found = recorded(way)
    off = np.array([one.wrench for one in found.accepted]) - made.wrench
    std = np.sqrt([np.diag(one.wrench_cov) for one in found.accepted])
    if way == "coarse readings":
        assert np.abs(off).max() < 0.05
        return
    assert 0.7 < np.sqrt(np.mean((off / std) ** 2)) < 1.4
    assert np.mean(np.abs(off) < 2.0 * std) > 0.85


def test_correlated_readings_count_for_fewer() -> None:
    rng = np.random.default_rng(0)
    R = np.repeat(Rotation.random(20, random_state=1).as_matrix(), 2000, axis=0)
    white = rng.normal(size=(len(R), 6))
    slow = lfilter([0.05], [1.0, -0.95], rng.normal(size=(len(R), 6)), axis=0)
    t = np.arange(len(R)) / 1000.0
    expected = {"white": 1.0, "slow": 39.0}  # (1 + 0.95) / (1 - 0.95), the sum of a first-order correlation
    for name, wrench in (("white", white), ("slow", slow)):
        found = still_segments(cw.Samples(wrench, R, t))
        of_row = wrench.var(axis=0).mean()
        worth = [one.n * np.diag(one.wrench_cov).mean() / of_row for one in found.accepted]
        assert len(worth) >= 19
        assert np.median(worth) == pytest.approx(expected[name], rel=0.6)


def test_a_bump_in_a_stop_is_cut_out_with_the_reason() -> None:
    made, found = disturbed(pushed(THIRD_STOP + 0.8, THIRD_STOP + 1.1, 4.0))
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == [0, 1, 2, 3, 3, 4, 5]
    (bump,) = found.rejected
    assert bump.t_start <= THIRD_STOP + 0.8 < THIRD_STOP + 1.1 <= bump.t_end
    assert bump.rejected is not None
    assert bump.rejected.startswith("the reading moves by 4 N and ")
    assert bump.rejected.endswith(" mN m though the arm stands: contact, drift or vibration")


def test_a_bump_that_hardly_shows_leaves_two_stretches_that_touch() -> None:
    """Nothing lies between them, so nothing is left out."""
    rng = np.random.default_rng(1)
    wrench = 0.05 * rng.normal(size=(1500, 6))
    wrench[750, 0] += 7.0
    found = still_segments(cw.Samples(wrench, np.tile(np.eye(3), (1500, 1, 1)), np.arange(1500) / 500.0))
    before, after = found.accepted
    assert before.last + 1 == after.first
    assert found.rejected == ()


@pytest.mark.parametrize("newton", [0.2, 1.0, 10.0])
@pytest.mark.parametrize(("begin", "end"), [(0.9, 2.0), (-0.5, 1.0)])
def test_a_stop_at_two_levels_is_left_out(newton: float, begin: float, end: float) -> None:
    made, found = disturbed(pushed(THIRD_STOP + begin, THIRD_STOP + end, newton))
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == [0, 1, 2, 4, 5]
    assert [stop_of(made, one.t_start, one.t_end) for one in found.rejected] == [3]
    assert "the reading moves by" in str(found.rejected[0].rejected)


def test_a_shaking_stop_is_left_out() -> None:
    def shake(t: Array, wrench: Array) -> Array:
        on = (t > THIRD_STOP - 0.2) & (t < THIRD_STOP + 2.2)
        return wrench + np.outer(on * np.sin(2.0 * np.pi * 50.0 * t), [3.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    made, found = disturbed(shake)
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == [0, 1, 2, 4, 5]
    assert "contact" in str(found.rejected[0].rejected)


QUIET = ("sensor.noise.force=0.001", "sensor.noise.torque=0.00002")


def creeping(seed: int, stop: float, shape: Callable[[Array], Array]) -> Callable[[Array, Array], Array]:
    """In each stop and on each axis by 5 to 60 times the noise of a sample."""
    rng = np.random.default_rng(seed)
    std = np.array([1e-3, 1e-3, 1e-3, 2e-5, 2e-5, 2e-5])

    def creep(t: Array, wrench: Array) -> Array:
        number = (t // (stop + 1.5)).astype(int)
        by = std * np.exp(rng.uniform(np.log(5.0), np.log(60.0), (number.max() + 1, 6)))
        way = shape(np.minimum((t % (stop + 1.5)) / stop, 1.0))
        crept: Array = wrench + by[number] * rng.choice([-1.0, 1.0], size=by.shape)[number] * way[:, None]
        return crept

    return creep


@pytest.mark.parametrize(("rate", "stop"), [(10.0, 5.0), (200.0, 2.0)])
@pytest.mark.parametrize(
    "shape", [np.array, np.sqrt, lambda way: np.exp(-4.0 * way)], ids=["even", "slowing", "decaying"]
)
def test_a_sensor_that_creeps_is_weighed_and_not_refused(
    rate: float, shape: Callable[[Array], Array], stop: float
) -> None:
    made = run(stops=8, stop=stop, seed=13, rate=rate, settings=QUIET, disturb=creeping(14, stop, shape))
    found = still_segments(made.samples)
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == list(range(8))
    std = np.sqrt([np.diag(one.wrench_cov) for one in found.accepted])
    assert (std[:, :3].mean(axis=0) > 0.001).all()  # that of one sample
    assert (std[:, :3] < 0.05).all()


def test_a_push_shows_beside_creep() -> None:
    creep = creeping(15, 2.0, np.array)

    def push(t: Array, wrench: Array) -> Array:
        return pushed(THIRD_STOP + 0.9, THIRD_STOP + 2.0, 0.3)(t, creep(t, wrench))

    made = run(stops=8, seed=16, rate=200.0, settings=QUIET, disturb=push)
    found = still_segments(made.samples)
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == [0, 1, 2, 4, 5, 6, 7]
    assert "the reading moves by" in str(found.rejected[0].rejected)


def test_a_filter_that_is_slower_than_the_stops_is_named() -> None:
    made = run(stops=10, seed=17, rate=200.0, settings=(*QUIET, "sensor.low_pass=0.27"))
    found = still_segments(made.samples)
    assert any(
        str(one.rejected).startswith("the force still follows the move before, by ")
        and str(one.rejected).endswith(" N: a filter is slower than the stops")
        for one in found.rejected
    )
    assert len(found.accepted) <= 2


def test_the_swing_after_a_stop_is_cut_off() -> None:
    def swing(t: Array, wrench: Array) -> Array:
        since = t % 3.5
        decaying = 3.0 * np.exp(-since / 0.1) * np.cos(2.0 * np.pi * 6.0 * since)
        return wrench + np.outer(decaying * (since < 2.0), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    made, found = disturbed(swing)
    assert [stop_of(made, one.t_start, one.t_end) for one in found.accepted] == list(range(6))
    late = np.array([one.t_start for one in found.accepted]) - made.stops[:, 0]
    assert late.min() > 0.25
    assert late.max() < 1.3
    off = np.array([one.wrench for one in found.accepted]) - made.wrench
    assert np.abs(off[:, 0]).max() < 0.02


def hold(seconds: float, rate: float, seed: int = 0) -> tuple[Array, Array, Array, np.random.Generator]:
    """Times, orientations and readings of an arm that stands."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    R = np.repeat(Rotation.random(random_state=seed).as_matrix()[None], len(t), axis=0)
    return t, R, np.arange(6.0) + 0.05 * rng.normal(size=(len(t), 6)), rng


@pytest.mark.parametrize("rate", [10.0, 125.0, 1000.0])
@pytest.mark.parametrize("since", [0.0, 1.7e9])
def test_a_recording_of_one_pose_is_one_stretch(rate: float, since: float) -> None:
    t, R, wrench, _ = hold(20.0, rate)
    found = still_segments(cw.Samples(wrench, R, since + t))
    assert [(one.first, one.last) for one in found.accepted] == [(0, len(t) - 1)]


def test_a_gap_ends_a_stretch() -> None:
    t, R, wrench, _ = hold(4.0, 500.0)
    t[1000:] += 30.0
    found = still_segments(cw.Samples(wrench, R, t))
    assert [(one.first, one.last) for one in found.accepted] == [(0, 999), (1000, 1999)]


def test_times_that_jump_back_end_a_stretch() -> None:
    t, R, wrench, _ = hold(4.0, 500.0)
    t[1000:] -= 1.0
    assert len(still_segments(cw.Samples(wrench, R, t)).accepted) == 2


def test_a_saturated_stretch_is_left_out() -> None:
    t, R, wrench, _ = hold(4.0, 500.0)
    t[1000:] += 30.0
    samples = cw.Samples(wrench, R, t)
    saturated = np.zeros(2000, dtype=bool)
    saturated[1200:1210] = True
    object.__setattr__(samples, "saturated", saturated)
    found = still_segments(samples)
    assert len(found.accepted) == 1
    assert found.rejected[0].rejected == "saturated: 10 of 1000 rows stand at the sensor's limit"


@pytest.mark.parametrize(("speed_deg", "still"), [(0.002, True), (0.05, False), (1.0, False), (30.0, False)])
@pytest.mark.parametrize("rate", [10.0, 200.0])
def test_an_arm_that_creeps_does_not_stand(speed_deg: float, still: bool, rate: float) -> None:
    t, R, wrench, _ = hold(40.0, rate)
    turn = Rotation.from_rotvec(np.outer(t, np.deg2rad(speed_deg) * np.array([0.6, 0.0, 0.8]))).as_matrix()
    found = still_segments(cw.Samples(wrench, R @ turn, t))
    assert (len(found.accepted) > 0) == still
    if speed_deg == 0.05:
        assert [one.rejected for one in found.rejected] == ["the arm creeps: it turns by 2 deg in 40 s"]


def test_a_stop_that_is_too_short_says_how_long_is_needed() -> None:
    made = run(stops=8, seed=5, rate=100.0)
    s = made.samples
    assert s.t is not None
    shortened = (s.t < THIRD_STOP + 0.06) | (s.t > THIRD_STOP + 2.0 - 0.06)  # with the slow ends of the moves 0.25 s
    t = np.arange(shortened.sum()) / 100.0
    found = still_segments(cw.Samples(s.wrench[shortened], s.R_base_flange[shortened], t))
    assert len(found.accepted) == 7
    (short,) = found.rejected
    assert THIRD_STOP - 0.1 < short.t_start < short.t_end < THIRD_STOP + 0.3
    assert str(short.rejected) == f"too short: {0.01 * short.n:.2g} s, {short.n} rows; 0.3 s and 5 rows are needed"


def test_samples_without_times_are_refused() -> None:
    _, R, wrench, _ = hold(4.0, 500.0)
    with pytest.raises(cw.ContactWrenchError) as refusal:
        still_segments(cw.Samples(wrench, R))
    assert str(refusal.value) == "arrays: found no times, expected a column t: stillness shows in time only"


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(seed=seeds, unit=st.sampled_from([1e-3, 1.0, 50.0]), since=st.sampled_from([0.0, 1.7e9]))
def test_what_is_still_depends_on_no_frame_no_unit_of_force_and_no_clock(seed: int, unit: float, since: float) -> None:
    made, found = recorded("100 Hz")
    R_world_base, R_flange_tool = Rotation.random(2, random_state=seed % 2**31).as_matrix()
    s = made.samples
    assert s.t is not None
    turned = R_world_base @ s.R_base_flange @ R_flange_tool
    again = still_segments(cw.Samples(unit * s.wrench, turned, since + s.t))
    for one, other in zip(found.accepted, again.accepted, strict=True):
        assert abs(one.first - other.first) <= 1
        assert abs(one.last - other.last) <= 1


@pytest.mark.skipif(not (SHARED / "kuka_atigamma").exists(), reason="the measured recordings are not at hand")
def test_a_measured_recording_at_rest_is_one_stretch() -> None:
    wrench = np.loadtxt(SHARED / "kuka_atigamma" / "0-steady-state_wrench.csv", delimiter=",", skiprows=1)
    R = np.repeat(np.eye(3)[None], len(wrench), axis=0)
    found = still_segments(cw.Samples(wrench, R, np.arange(len(wrench)) / 698.0))
    (whole,) = found.accepted
    assert whole.n > 0.8 * len(wrench)
    assert (np.diag(whole.wrench_cov) > 2.0 * wrench.var(axis=0) / whole.n).any()


@pytest.mark.skipif(not (SHARED / "kuka_atigamma").exists(), reason="the measured recordings are not at hand")
def test_a_measured_motion_stands_at_its_ends_only() -> None:
    folder = SHARED / "kuka_atigamma"
    wrench = np.loadtxt(folder / "1-baseline_wrench.csv", delimiter=",", skiprows=1)
    pose = np.loadtxt(folder / "1-baseline_orientations.csv", delimiter=",", skiprows=1)
    t, at = 1e-6 * (wrench[:, 0] - pose[0, 0]), 1e-6 * (pose[:, 0] - pose[0, 0])
    row = np.clip(np.searchsorted(at, t), 0, len(at) - 1)
    samples = cw.Samples(wrench[:, 1:], pose[row, 1:].reshape(-1, 3, 3), t)
    assert is_stream(samples)
    found = still_segments(samples)
    assert all(one.t_start > 5.0 or one.t_end < 0.3 for one in (*found.accepted, *found.rejected))
    assert any(one.t_start > 5.0 for one in found.accepted)
