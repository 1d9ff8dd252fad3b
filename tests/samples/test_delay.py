"""The delay between two streams: tools and motions of which it is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.robot_arms import flange_pose, known_arm
from contactwrench.errors import InputError
from contactwrench.samples.delay import (
    Delay,
    delay_in_words,
    estimate_delay,
    is_significant,
    on_one_clock,
    with_delay_of_rows,
)
from contactwrench.samples.samples import OrientationStream, Samples, Streams, WrenchStream
from tests.support.moving import gravity_alone, rig_recording, two_streams, whole_arm, with_joints
from tests.support.recordings import Array

TRUE = 0.0137
"""Of `gravity_alone`, s."""
NEAR = 0.1
"""Searched to both sides, s, where the range is not what is asked: ten times less work than the default."""


def _shifted(streams: Streams, by: float | Array) -> Streams:
    return Streams(WrenchStream(streams.wrench.t + by, streams.wrench.wrench), streams.orientation)


def _read(streams: Streams, wrench: Array) -> Streams:
    return Streams(WrenchStream(streams.wrench.t, wrench), streams.orientation)


def _turned(streams: Streams, R: Array) -> Streams:
    """The same orientations (n, 3, 3) stated otherwise."""
    return Streams(streams.wrench, OrientationStream(streams.orientation.t, R, streams.orientation.position))


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10_000), shift=st.floats(-0.15, 0.15))
def test_the_estimate_follows_a_shift_of_one_stream(seed: int, shift: float) -> None:
    streams = gravity_alone(seed, duration=20.0)
    before, after = (estimate_delay(_shifted(streams, by), within=0.2) for by in (0.0, shift))
    assert after.value - before.value == pytest.approx(shift, abs=1e-6)
    assert after.std == pytest.approx(before.std, rel=1e-3)


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_any_tool_mounting_and_base(seed: int) -> None:
    found = estimate_delay(gravity_alone(seed, duration=20.0), within=0.2)
    assert found.reason is None
    assert abs(found.value - TRUE) < 5.0 * found.std
    assert found.std < 0.002


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_rotated_base_with_rotated_gravity_changes_nothing(seed: int) -> None:
    streams = gravity_alone(seed, duration=20.0)
    Q = Rotation.random(random_state=seed).as_matrix()
    turned = _turned(streams, Q @ streams.orientation.R_base_flange)
    before = estimate_delay(streams, within=NEAR)
    after = estimate_delay(turned, gravity=Q @ [0.0, 0.0, -1.0], within=NEAR)
    assert after.value == pytest.approx(before.value, abs=1e-8)
    assert after.std == pytest.approx(before.std, rel=1e-5)
    unstated = estimate_delay(turned, within=NEAR)
    assert unstated.value == pytest.approx(before.value, abs=before.std)


@pytest.mark.slow
def test_units_and_axes_of_the_sensor_do_not_matter() -> None:
    streams = gravity_alone(4)
    mixed = streams.wrench.wrench @ (np.eye(6) + 0.1 * np.random.default_rng(0).normal(size=(6, 6)))
    before, after = (estimate_delay(one, within=NEAR) for one in (streams, _read(streams, 1e3 * mixed)))
    assert abs(after.value - before.value) < 2.0 * before.std


@pytest.mark.slow
@pytest.mark.parametrize("over", [0.0, 0.2])
def test_two_standard_deviations_cover(over: float) -> None:
    """Of 8 recordings at 95 % fewer than 6 are inside once in 170 times; benchmarks/clock_delay.py counts many."""
    found = [
        estimate_delay(gravity_alone(seed, duration=15.0, noise=5.0, correlated_over=over), within=NEAR)
        for seed in range(8)
    ]
    off = np.array([one.value - TRUE for one in found]) / np.array([one.std for one in found])
    assert np.sum(np.abs(off) < 2.0) >= 6
    assert np.std(off) > 0.5


@pytest.mark.slow
def test_correlated_noise_widens_the_std() -> None:
    white, slow = (
        estimate_delay(gravity_alone(3, noise=5.0, correlated_over=over), within=NEAR) for over in (0.0, 0.2)
    )
    assert white.std < 1.3 * white.bound
    assert slow.std > 2.0 * white.std


@pytest.mark.slow
@pytest.mark.parametrize("seed", [13, 14])
def test_where_a_clock_runs_off_the_std_covers_the_delays_of_begin_and_end(seed: int) -> None:
    streams, off = gravity_alone(seed, duration=20.0), 5e-4
    found = estimate_delay(_shifted(streams, off * streams.wrench.t), within=NEAR)
    assert abs(found.value - TRUE - 0.5 * off * 20.0) < 0.5 * found.std
    assert abs(found.value - TRUE) < 4.0 * found.std
    assert abs(found.value - TRUE - off * 20.0) < 4.0 * found.std
    assert estimate_delay(streams, within=NEAR).std < 0.2 * found.std


@pytest.mark.slow
def test_contacts_count_little() -> None:
    streams = gravity_alone(5)
    rng = np.random.default_rng(5)
    wrench = streams.wrench.wrench.copy()
    for start in (300, 900, 1500, 2100, 2600):
        wrench[start : start + 100] += rng.normal(size=6) * [8.0, 8.0, 8.0, 0.5, 0.5, 0.5]
    found = estimate_delay(_read(streams, wrench), within=NEAR)
    assert abs(found.value - TRUE) < 0.002
    assert found.significant


@pytest.mark.slow
@pytest.mark.parametrize("rate", [10.0, 25.0])
def test_slow_recordings_tell_it_within_half_a_sample(rate: float) -> None:
    found = estimate_delay(gravity_alone(6, delay=0.7 / rate, rate=rate, fastest=0.4, duration=60.0))
    assert found.value == pytest.approx(0.7 / rate, abs=0.5 / rate)
    assert found.significant


def test_a_single_axis_tells_it() -> None:
    streams = gravity_alone(7)
    angle = np.sin(1.7 * streams.orientation.t) + 0.4 * np.sin(2.9 * streams.orientation.t)
    R = Rotation.from_rotvec(0.8 * angle[:, None] * [0.6, 0.8, 0.0]).as_matrix()
    force = -5.0 * R[:, 2]
    wrench = np.concatenate([force, 0.05 * force], axis=1)
    wrench += np.random.default_rng(7).normal(size=wrench.shape) * 0.02
    found = estimate_delay(_turned(_read(streams, wrench), R), within=NEAR)
    assert abs(found.value - TRUE) < 0.002


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["vertical", "tilted", "hand"])
def test_joints_of_a_whole_arm_tell_it(kind: str) -> None:
    """Also where their stamps jitter, where some are lost, and where a second of them is."""
    rec = whole_arm(kind, 30.0, 4)
    for jitter, kept in ((0.0, 1.0), (3e-4, 0.97), (1e-3, 1.0)):
        rng = np.random.default_rng(4)
        streams = with_joints(rec, 0.03, rng, jitter)
        rows = (rng.random(len(streams.orientation)) < kept) & (
            np.abs(streams.orientation.t - 15.0) > 0.5 * (kept < 1.0)
        )
        found = estimate_delay(Streams(streams.wrench, streams.orientation.select(rows)), within=NEAR)
        assert abs(found.value - 0.03) < 0.0003
        assert abs(found.value - 0.03) < 4.0 * found.std
        assert found.significant


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "rate", "by"), [("vertical", 30.0, 3e-3), ("tilted", 125.0, 1e-3), ("hand", 125.0, 1e-3)]
)
def test_poses_that_are_older_or_newer_than_their_stamps_say_tell_it(kind: str, rate: float, by: float) -> None:
    """By 1 ms: at 1 m/s a position is off by 1 mm then, and accelerations from three in a row by 30 m/s^2 and more."""
    rng, rec = np.random.default_rng(17), whole_arm(kind, 60.0, 78)
    t = np.arange(0.1, 59.9, 1.0 / rate)
    read = t + by * rng.normal(size=len(t))
    joints = np.stack([np.interp(read, rec.t, angle) for angle in rec.joints.T], axis=1)
    R, position = flange_pose(known_arm("iiwa7"), joints)
    found = estimate_delay(Streams(WrenchStream(rec.t + 0.03, rec.wrench), OrientationStream(t, R, position)))
    assert found.reason is None
    assert abs(found.value - 0.03) < min(4e-4, 4.0 * found.std)


def test_nor_does_a_wall_that_the_base_stands_on_hide_it() -> None:
    """Where gravity as it is stated explains little, at another delay."""
    streams = with_joints(whole_arm("hand", 30.0, 2), 0.03, np.random.default_rng(4))
    wall, pose = Rotation.from_euler("x", 90.0, degrees=True).as_matrix(), streams.orientation
    on_wall = OrientationStream(pose.t, wall @ pose.R_base_flange, np.asarray(pose.position) @ wall.T)
    found = estimate_delay(Streams(streams.wrench, on_wall), within=NEAR)
    assert abs(found.value - 0.03) < min(0.0003, 4.0 * found.std)
    assert found.significant


@pytest.mark.slow
def test_on_a_wall_the_search_is_judged_where_it_looked_for_gravity_too() -> None:
    """Both fits come to one place, and only the scan under gravity as stated is far from it."""
    streams = gravity_alone(11, duration=20.0)
    wall = Rotation.from_euler("x", 90.0, degrees=True).as_matrix()
    found = estimate_delay(_turned(streams, wall @ streams.orientation.R_base_flange))
    assert abs(found.value - TRUE) < 0.002
    assert found.reason is None


@pytest.mark.parametrize("seed", range(3))
def test_gravity_that_stays_square_to_an_axis_of_the_flange_tells_it(seed: int) -> None:
    """In base axes of any direction: the column of that axis is rounding."""
    streams, rng = gravity_alone(7), np.random.default_rng(seed)
    t = streams.orientation.t
    turned = Rotation.from_rotvec(0.8 * (np.sin(1.7 * t) + 0.4 * np.sin(2.9 * t))[:, None] * [0.0, 0.0, 1.0])
    R = (Rotation.random(random_state=seed) * turned).as_matrix()
    down = R[0] @ [0.6, 0.8, 0.0]
    force = 5.0 * down @ R
    wrench = np.concatenate([force, 0.05 * force], axis=1) + 0.02 * rng.normal(size=(len(t), 6))
    found = estimate_delay(_turned(_read(streams, wrench), R), gravity=down, within=NEAR)
    assert abs(found.value - TRUE) < 0.002


@pytest.mark.slow
@pytest.mark.parametrize("delay", [-0.97, 0.95])
def test_pieces_between_gaps_that_are_hardly_longer_than_the_range_are_no_error(delay: float) -> None:
    streams = _shifted(gravity_alone(3, duration=200.0), delay - TRUE)
    for piece in (2.15, 2.2, 2.3):
        found = estimate_delay(
            Streams(streams.wrench, streams.orientation.select(streams.orientation.t % (piece + 1.0) < piece))
        )
        assert abs(found.value - delay) < 0.002 or found.reason is not None


def test_stamps_of_an_uneven_pace_stay() -> None:
    """A robot that is asked for its pose now and then says when it was there."""
    streams = gravity_alone(9, rate=1000.0)
    rng = np.random.default_rng(9)
    rows = np.cumsum(rng.integers(8, 13, 2500))
    pose = streams.orientation.select(rows)
    assert abs(estimate_delay(Streams(streams.wrench, pose), within=NEAR).value - TRUE) < 0.0005


def test_readings_most_of_whose_stamps_repeat_tell_nothing() -> None:
    """Their median distance is none: a window of so many rows as that asks for took seconds, and all memory."""
    streams = gravity_alone(8)
    coarse = WrenchStream(np.floor(streams.wrench.t / 0.04) * 0.04, streams.wrench.wrench)
    found = estimate_delay(Streams(coarse, streams.orientation), within=NEAR)
    assert found.reason == "found 0 readings with orientations around them, expected 60 or more"


def test_poses_that_were_held_make_no_delay() -> None:
    """Shown at 1 kHz until the next one comes: taken as they stand they would be half a hold, 10 ms, late."""
    streams = gravity_alone(8)
    t = np.arange(0.0, 29.9, 0.001)
    shown = 2 * ((t + 1e-9) // 0.02).astype(int)
    held = Streams(streams.wrench, OrientationStream(t, streams.orientation.R_base_flange[shown]))
    assert estimate_delay(held, within=NEAR).value == pytest.approx(TRUE, abs=0.001)


# What cannot be told


def _reason(streams: Streams, within: float = 0.3) -> str:
    found = estimate_delay(streams, within=within)
    assert not found.significant
    assert found.reason is not None
    return found.reason


def test_an_arm_at_rest_tells_nothing() -> None:
    streams = gravity_alone(9)
    trembling = 1e-5 * np.random.default_rng(9).normal(size=(len(streams.orientation), 3))
    R = Rotation.from_rotvec(np.array([0.3, -1.0, 0.4]) + trembling).as_matrix()
    assert _reason(_turned(streams, R)) == "the arm turns by less than 2 deg"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_turning_about_the_vertical_tells_nothing(seed: int) -> None:
    streams = gravity_alone(seed)
    about = Rotation.from_rotvec(np.sin(streams.orientation.t)[:, None] * [0.0, 0.0, 1.5])
    R = (about * Rotation.from_rotvec([0.5, 0.2, 0.0])).as_matrix()
    noise = np.random.default_rng(seed).normal(size=(len(R), 6))
    _reason(_turned(_read(streams, noise), R))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_readings_that_do_not_follow_tell_nothing(seed: int) -> None:
    streams = gravity_alone(seed)
    _reason(_read(streams, np.random.default_rng(seed).normal(size=streams.wrench.wrench.shape)))


def test_a_motion_that_repeats_itself_does_not_tell_which() -> None:
    t = np.arange(0.0, 30.0, 0.01)
    R = Rotation.from_rotvec(0.5 * np.sin(2.0 * np.pi * t / 0.6)[:, None] * [0.6, 0.8, 0.0]).as_matrix()
    wrench = np.concatenate([-5.0 * R[:, 2], -0.5 * R[:, 2]], axis=1)
    wrench += 0.01 * np.random.default_rng(1).normal(size=wrench.shape)
    found = _reason(Streams(WrenchStream(t + 0.05, wrench), OrientationStream(t, R)))
    assert found.startswith("the motion repeats itself: delays of ")
    assert found.endswith(" ms explain the wrench equally well; vary it")


@pytest.mark.parametrize("seed", [7, 9])
def test_a_short_smooth_motion_does_not_tell_which(seed: int) -> None:
    """Eight seconds, in which gravity, free on each axis, and accelerations explain noise at any delay a bit."""
    streams = gravity_alone(seed, delay=0.0, duration=8.0, rate=30.0, noise=3.0, fastest=0.3)
    found = _reason(streams, within=1.0)
    assert found.startswith("the motion is too short: delays of ")
    assert found.endswith(" ms explain the wrench equally well; record more of it, or faster")


@pytest.mark.slow
def test_a_delay_beyond_the_range_is_not_told() -> None:
    streams = gravity_alone(10, delay=0.3)
    assert estimate_delay(streams).value == pytest.approx(0.3, abs=0.001)
    _reason(streams, within=0.2)


def test_too_little_tells_nothing() -> None:
    streams = gravity_alone(11)
    few = Streams(WrenchStream(streams.wrench.t[:40], streams.wrench.wrench[:40]), streams.orientation)
    assert _reason(few).startswith("found ")
    assert _reason(few).endswith(" readings with orientations around them, expected 60 or more")


def test_bad_arguments_and_stamps_are_refused() -> None:
    streams = gravity_alone(12)
    with pytest.raises(InputError, match=r"^within is 0\.0, expected s above 0$"):
        estimate_delay(streams, within=0.0)
    with pytest.raises(InputError, match="they have nothing in common"):
        estimate_delay(_shifted(streams, 1e9))


# What becomes of it


def test_it_is_significant_at_three_standard_deviations() -> None:
    assert is_significant(0.0031, 0.001)
    assert is_significant(-0.0031, 0.001)
    assert not is_significant(0.0029, 0.001)
    assert not is_significant(1.0, np.inf)
    assert not is_significant(0.0, 0.0)


@pytest.mark.slow
def test_a_significant_delay_is_applied() -> None:
    streams = gravity_alone(13)
    samples, notes = on_one_clock(streams)
    assert samples.delay == pytest.approx(TRUE, abs=0.001)
    assert samples.delay_std is not None
    assert notes[0].startswith("the wrench is stamped 13.")
    assert notes[0].endswith(" ms later than the orientation: applied")
    assert samples.t is not None
    place = np.searchsorted(streams.orientation.t, samples.t - TRUE)
    true = streams.orientation.R_base_flange[np.clip(place, 0, len(streams.orientation) - 1)]
    assert np.abs(samples.R_base_flange - true).max() < 0.05


@pytest.mark.slow
def test_one_that_is_not_is_reported_and_not_applied() -> None:
    streams = gravity_alone(14, delay=0.0)
    samples, notes = on_one_clock(streams)
    assert samples.delay is not None
    assert np.allclose(samples.R_base_flange, streams.orientation.R_base_flange[: len(samples)], rtol=0.0, atol=1e-12)
    assert notes[0].endswith("than the orientation: not applied: less than 3 standard deviations from zero")
    still = _turned(streams, np.broadcast_to(np.eye(3), (len(streams.orientation), 3, 3)))
    samples, notes = on_one_clock(still)
    assert (samples.delay, samples.delay_std) == (None, None)
    assert notes == ("delay between wrench and orientation not applied: the arm turns by less than 2 deg",)


@pytest.mark.slow
def test_rows_that_came_with_an_orientation_have_a_delay_too() -> None:
    """A table at 100 Hz in which the wrench of each row is late: the rows stay, the calibration knows."""
    streams = gravity_alone(13)
    t, R = streams.orientation.t, streams.orientation.R_base_flange
    wrench = np.stack([np.interp(t, streams.wrench.t, column) for column in streams.wrench.wrench.T], axis=1)
    rows = Samples(wrench, R, t)
    found = with_delay_of_rows(rows)
    assert found.delay == pytest.approx(TRUE, abs=0.003)
    assert np.array_equal(found.R_base_flange, rows.R_base_flange)
    assert with_delay_of_rows(Samples(wrench, R)).delay is None
    again = np.concatenate([t, t])
    assert with_delay_of_rows(Samples(np.tile(wrench, (2, 1)), np.tile(R, (2, 1, 1)), again)).delay is None


def test_words_for_either_side() -> None:
    assert delay_in_words(Delay(-0.0123, 0.0004, 0.0001)) == (
        "the wrench is stamped 12.30 +- 0.4 ms earlier than the orientation: applied"
    )


# A tool with inertia, on a whole arm, behind a filter: the rig is the judge


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sweeping", "exciting"])
@pytest.mark.parametrize("base", [0.0, 4.0])
def test_accelerations_and_a_leaning_base_make_no_delay(kind: str, base: float) -> None:
    rec = rig_recording(kind, 10.0, 1, f"base.tilt_deg=[{base},{-base}]", "tool.mass=1.0")
    found = estimate_delay(two_streams(rec), within=NEAR)
    assert found.value == pytest.approx(0.004, abs=0.001)
    assert abs(found.value - 0.004) < 4.0 * found.std
    assert found.significant


@pytest.mark.slow
def test_a_filter_of_the_sensor_adds_its_group_delay() -> None:
    rec = rig_recording("sweeping", 10.0, 1, "sensor.low_pass=10", "tool.mass=1.0")
    found = estimate_delay(two_streams(rec), within=NEAR)
    assert found.value == pytest.approx(0.004 + 1.0 / (2.0 * np.pi * 10.0), abs=0.002)


@pytest.mark.slow
def test_a_position_that_is_missing_here_and_there_costs_little() -> None:
    streams = two_streams(rig_recording("exciting", 10.0, 0), position=True)
    place = np.array(streams.orientation.position)
    place[100::50] = np.nan
    pose = streams.orientation
    missing = Streams(streams.wrench, OrientationStream(pose.t, pose.R_base_flange, place))
    found = estimate_delay(missing, within=NEAR)
    assert found.std < 0.001
    assert abs(found.value - 0.004) < 3.0 * found.std


@pytest.mark.slow
def test_where_positions_are_missing_whole_arm_motions_tell_little() -> None:
    rec = rig_recording("exciting", 10.0, 0)
    with_positions, without = (estimate_delay(two_streams(rec, position=given), within=NEAR) for given in (True, False))
    assert with_positions.std < 0.001
    assert not without.significant
    assert abs(without.value - 0.004) < 2.0 * without.std


@pytest.mark.slow
def test_noise_that_is_correlated_widens_it_further_where_positions_are_missing() -> None:
    """Or where less than 25 s are recorded."""
    for over, duration, factor in ((0.0, 30.0, 1.0), (0.5, 30.0, 3.0), (0.0, 20.0, 3.0)):
        streams = gravity_alone(3, noise=5.0, correlated_over=over, duration=duration)
        pose = streams.orientation
        missing = Streams(streams.wrench, OrientationStream(pose.t, pose.R_base_flange))
        known, unknown = (estimate_delay(one, within=NEAR).std for one in (streams, missing))
        assert unknown == pytest.approx(factor * known, rel=0.05)


def test_a_calibration_shows_it() -> None:
    from dataclasses import replace

    from tests.support.rigs import example, noisy

    rig, R, rng = example(1)
    samples = noisy(rig, R, rng)
    silent, late, early, unsure = (
        cw.calibrate(replace(samples, delay=delay, delay_std=std), "mount")
        for delay, std in ((None, None), (0.0042, 0.0001), (-0.0042, 0.0001), (-0.0002, 0.0001))
    )
    assert "delay" not in str(silent)
    for found, expected in (
        (late, "delay 4.20 +- 0.10 ms, wrench late; applied"),
        (early, "delay 4.20 +- 0.10 ms, orientation late; applied"),
        (unsure, "delay 0.20 +- 0.10 ms, orientation late; not applied"),
    ):
        (shown,) = (line for line in str(found).splitlines() if "delay" in line)
        assert len(shown) <= 80
        assert " ".join(shown.split()) == expected
    assert late.diff(unsure).meaning[-1] == (
        "the delay between wrench and orientation changed by -4.4 ms (31.1 std): another clock, or another filter in "
        "the sensor"
    )
    assert not any("delay" in sentence for sentence in late.diff(late).meaning)
    assert "delay" not in silent.diff(late).names


# Measured: a KUKA with an ATI Gamma, three streams of one computer, 6 s of turning about one axis


def _measured() -> Streams:
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "kuka_atigamma"
    if not folder.exists():
        pytest.skip("the measured recording is not part of the project")
    wrench, pose = (
        np.loadtxt(folder / f"1-baseline_{name}.csv", delimiter=",", skiprows=1) for name in ("wrench", "orientations")
    )
    return Streams(
        WrenchStream(wrench[:, 0] * 1e-6, wrench[:, 1:]),
        OrientationStream(pose[:, 0] * 1e-6, pose[:, 1:].reshape(-1, 3, 3)),
    )


@pytest.mark.slow
@pytest.mark.parametrize("shift", [0.1, -0.25, 0.0371])
def test_the_estimate_follows_a_measured_recording(shift: float) -> None:
    streams = _measured()
    before, after = estimate_delay(streams), estimate_delay(_shifted(streams, shift))
    assert after.value - before.value == pytest.approx(shift, abs=1e-4)


def test_a_measured_recording_about_one_axis_does_not_tell() -> None:
    found = estimate_delay(_measured())
    assert abs(found.value) < 0.03
    assert not found.significant
