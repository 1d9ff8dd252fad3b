"""An arm that turns slowly and hardly stops: its way is made of poses, or of none where it moves fast or is touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.estimation.several_tools import calibrate_shared
from contactwrench.samples.recorded_poses import recorded_poses
from contactwrench.samples.slow_motion import poses_on_the_way
from tests.support.world import Array

WEIGHT, COM = 10.0, np.array([0.01, -0.02, 0.06])
BIAS = np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.1])


def sweep(seed: int, deg_per_s: float = 5.0, lag: float = 0.1, rate: float = 100.0, noise: float = 0.05) -> cw.Samples:
    """A minute of turning about axes that wander; the sensor is late."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(60.0 * rate)) / rate
    axis = np.sin(2.0 * np.pi * np.outer(t, rng.uniform(0.02, 0.06, 3)) + rng.uniform(0.0, 2.0 * np.pi, 3))
    turn = np.deg2rad(deg_per_s) * axis / np.linalg.norm(axis, axis=1).mean() / rate
    R = np.empty((len(t), 3, 3))
    R[0] = Rotation.from_euler("x", rng.uniform(0.0, 3.0)).as_matrix()
    for k, step in enumerate(Rotation.from_rotvec(turn[:-1]).as_matrix()):
        R[k + 1] = R[k] @ step
    force = -WEIGHT * R[:, 2]
    wrench = np.hstack([force, np.cross(COM, force)])
    late = np.stack([np.interp(t - lag, t, axis) for axis in wrench.T], axis=1)
    std = noise * np.array([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    return cw.Samples(late + BIAS + std * rng.normal(size=late.shape), R, t)


@pytest.mark.parametrize(("seed", "lag", "rate"), [(43, 0.4, 100.0), (40, 0.0, 20.0)])
def test_a_slow_sweep_without_stops_is_calibrated(seed: int, lag: float, rate: float) -> None:
    found = cw.calibrate(sweep(seed, lag=lag, rate=rate), "mount")
    assert found.weight is not None
    assert found.weight == pytest.approx(WEIGHT, rel=0.01)
    assert abs(found.weight - WEIGHT) < 3.0 * found.std["weight"]
    (said,) = (finding for finding in found.findings if finding.kind is Kind.POSES_ON_THE_WAY)
    assert said.severity is Severity.WARNING
    count = len(found.poses)
    assert said.text == (
        f"{count} of {count} poses are parts of a slow motion, 0 still stretches were found: "
        "a stop of two seconds at each orientation tells more"
    )
    assert count <= 120


def stirred(seed: int, period: float, second: float) -> cw.Samples:
    """A minute and a half of turning to and fro about all axes, with a `period` s and a `second` one, at once."""
    rng = np.random.default_rng(seed)
    t = np.arange(4500) / 50.0
    turns = [np.sin(2.0 * np.pi * t[:, None] / T + rng.uniform(0.0, 6.28, 3)) for T in (period, second)]
    start = Rotation.from_euler("x", 2.6)
    R = (start * Rotation.from_rotvec(sum(turns, np.zeros((4500, 3))) * rng.uniform(0.1, 0.25, 3))).as_matrix()
    u = R.transpose(0, 2, 1) @ [0.0, 0.0, -1.0]
    wrench = BIAS + np.hstack([WEIGHT * u, np.cross(COM, WEIGHT * u)])
    std = 0.08 * np.array([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    return cw.Samples(wrench + std * rng.normal(size=wrench.shape), R, t)


def test_of_a_motion_that_repeats_itself_the_std_counts_the_lag_that_it_does_not_tell() -> None:
    """Where all turns have one period, a wrench that is late looks like one of a mounting that is turned."""
    period, R = 40.0, Rotation.random(100, random_state=0).as_matrix()
    u = R.transpose(0, 2, 1) @ [0.0, 0.0, -1.0]
    truth = BIAS + np.hstack([WEIGHT * u, np.cross(COM, WEIGHT * u)])
    found = cw.calibrate(stirred(0, period, period))
    off = np.abs(found.predict(R) - truth) / found.wrench_std(R)
    assert off.max() < 5.0
    other = cw.calibrate(stirred(0, period, 0.62 * period))
    assert other.wrench_std(R)[:, :3].mean() < 0.5 * found.wrench_std(R)[:, :3].mean()


def test_a_late_reading_is_within_the_std_of_its_pose() -> None:
    """By 0.1 s, which such a motion does not tell: up to ten times what the rows of a pose scatter by."""
    for seed, period in [(0, 30.0), (0, 40.0), (1, 40.0)]:
        samples = stirred(seed, period, period)
        assert samples.t is not None
        t = samples.t
        late = np.stack([np.interp(t - 0.1, t, axis) for axis in samples.wrench.T], axis=1)
        poses, _ = poses_on_the_way(replace(samples, wrench=late), [])
        u = np.array([-pose.R_base_flange[2] for pose in poses])
        truth = BIAS + np.hstack([WEIGHT * u, np.cross(COM, WEIGHT * u)])
        off = np.array([pose.wrench for pose in poses]) - truth
        std = np.sqrt([np.diag(pose.wrench_cov) for pose in poses])
        assert len(off) > 50
        assert (np.abs(off) < 5.0 * std).all()


def test_a_calibration_holds_in_a_motion_that_repeats_itself_unless_its_zero_moved() -> None:
    rng = np.random.default_rng(1)
    R = np.repeat(Rotation.random(14, random_state=3).as_matrix(), 50, axis=0)
    u = R.transpose(0, 2, 1) @ [0.0, 0.0, -1.0]
    std = 0.08 * np.array([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    wrench = BIAS + np.hstack([WEIGHT * u, np.cross(COM, WEIGHT * u)]) + std * rng.normal(size=(len(R), 6))
    calibration = cw.calibrate(cw.Samples(wrench, R), "mount")
    for seed in (0, 8):
        samples = stirred(seed, 30.0, 30.0)
        assert verify(calibration, samples).passed
        zeroed = samples.wrench + np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
        assert not verify(calibration, replace(samples, wrench=zeroed)).passed


def test_tools_that_share_a_mounting_share_the_lag_in_their_std_too() -> None:
    R = Rotation.random(100, random_state=1).as_matrix()
    u = R.transpose(0, 2, 1) @ [0.0, 0.0, -1.0]
    truth = BIAS + np.hstack([WEIGHT * u, np.cross(COM, WEIGHT * u)])
    for found in calibrate_shared([stirred(seed, 30.0, 30.0) for seed in (10, 11)]):
        assert (np.abs(found.predict(R) - truth) / found.wrench_std(R)).max() < 5.0
        assert all(finding.kind is not Kind.CONTRADICTS_OTHERS for finding in found.findings)


def test_a_fast_sweep_is_refused_as_before() -> None:
    with pytest.raises(cw.ContactWrenchError, match="found no stretch in 60 s in which arm and reading are still"):
        cw.calibrate(sweep(45, deg_per_s=40.0))


def test_a_sweep_in_contact_or_with_times_of_another_clock_gives_no_poses() -> None:
    samples = sweep(46)
    assert len(poses_on_the_way(samples, [])[0]) > 50
    rng = np.random.default_rng(0)
    wander = np.cumsum(rng.normal(size=(len(samples), 3)), axis=0) * 0.05
    touched = samples.wrench + np.hstack([wander, np.zeros_like(wander)])
    assert poses_on_the_way(replace(samples, wrench=touched), []) == ((), None)
    assert poses_on_the_way(replace(samples, wrench=samples.wrench[::-1].copy()), []) == ((), None)


def test_rows_elsewhere_are_not_used_and_a_push_is_left_to_the_other_poses() -> None:
    samples = sweep(47)
    assert samples.t is not None
    poses, _ = poses_on_the_way(samples, [slice(0, 3000)])
    assert min(pose.t_start for pose in poses if pose.t_start is not None) >= 30.0
    pushed = samples.wrench + np.outer((samples.t > 20.0) & (samples.t < 23.0), [0.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    found = cw.calibrate(replace(samples, wrench=pushed), "mount")
    assert found.weight == pytest.approx(WEIGHT, rel=0.01)


def test_enough_stops_need_no_way_between_them() -> None:
    rng = np.random.default_rng(48)
    R = Rotation.random(8, random_state=1)
    t = np.arange(100 * 100) / 100.0
    place = np.minimum(np.interp(t % 14.0, [0.0, 2.0, 14.0], [0.0, 0.0, 1.0]) + t // 14.0, 7.0)
    turned = Slerp(np.arange(8), R)(place).as_matrix()
    force: Array = -WEIGHT * turned[:, 2]
    wrench = np.hstack([force, np.cross(COM, force)]) + 0.01 * rng.normal(size=(len(t), 6))
    found = recorded_poses(cw.Samples(wrench, turned, t), 0)
    assert found.segments >= 6
    assert found.on_the_way == 0
