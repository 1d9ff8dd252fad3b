"""Gain and cross-talk of a sensor beside a bias that drifts, or backlash: neither hides the other."""

from __future__ import annotations

import numpy as np
import pytest

import contactwrench as cw
from benchmarks.errors import LEVER, NOISE, Contacts, Course, Realistic, direction, in_a_cone, times, usual_rig
from contactwrench.calibration.findings import BIAS_MOVED, Kind
from tests.support.world import Array, random_rotations, readings

UNSEEN = random_rotations(60, np.random.default_rng(8))
GAIN = Realistic(gain=0.01)


def _drifting(seed: int, gain: Realistic, drift: float) -> tuple[cw.Calibration, Array]:
    """24 poses with times, and the bias at the last of them."""
    rng = np.random.default_rng([seed, 31])
    rig, R = usual_rig(rng, 20.0), random_rotations(24, rng)
    wrench = gain.drawn(rig, rng).read(R, rng) + Course("drift", drift).drawn(times(24), rng)[0]
    return cw.calibrate(cw.Samples(wrench, R, times(24))), rig.bias


def test_a_drift_beside_a_gain_is_followed() -> None:
    """A tenth of a newton beside gains that make two tenths: the bias was taken to be the mean over the recording."""
    off, said = list[Array](), 0
    for seed in range(8):
        calibration, bias = _drifting(seed, GAIN, 0.15)
        kinds = {finding.kind for finding in calibration.findings}
        said += bool(kinds & BIAS_MOVED)
        assert Kind.GAIN in kinds
        off.append((calibration.bias - bias) / calibration.std["bias"])
    assert said >= 6
    assert np.sqrt(np.mean(np.square(off))) < 1.5


@pytest.mark.parametrize(("gain", "drift", "expected"), [(GAIN, 0.0, Kind.GAIN), (Realistic(), 0.3, "moved")])
def test_one_cause_alone_is_said_alone(gain: Realistic, drift: float, expected: str) -> None:
    for seed in range(8):
        kinds = {finding.kind for finding in _drifting(seed, gain, drift)[0].findings}
        assert (Kind.GAIN in kinds, bool(kinds & BIAS_MOVED)) == (expected is Kind.GAIN, expected == "moved")


def test_a_gain_behind_backlash_is_in_the_std_beyond_the_cone() -> None:
    """Backlash explains nearly all that is left in the cone, and nothing of what the gain makes beyond it."""
    covered, far = list[float](), 0
    for seed in range(12):
        rng = np.random.default_rng([seed, 32])
        rig, R = usual_rig(rng, 12.0), in_a_cone(12, rng)
        sensor = GAIN.drawn(rig, rng)
        backlash = 0.15 * LEVER * np.r_[direction(rng), direction(rng)]
        wrench = sensor.steady(R) + np.outer(rng.choice([-1.0, 1.0], 12), backlash) + NOISE * rng.normal(size=(12, 6))
        calibration = cw.calibrate(cw.Samples(wrench, R, times(12)))
        off = (calibration.predict(UNSEEN) - sensor.steady(UNSEEN))[:, :3] / calibration.wrench_std(UNSEEN)[:, :3]
        covered.append(float(np.mean(np.abs(off) < 2.0)))
        far += calibration.verdict == "good" and bool(np.abs(off).max() > 5.0)
    assert np.mean(covered) > 0.85
    assert far <= 1  # a walk that took up both


def test_backlash_alone_makes_no_gain() -> None:
    for seed in range(8):
        rng = np.random.default_rng([seed, 33])
        rig, R = usual_rig(rng, 12.0), random_rotations(12, rng)
        backlash = 0.15 * LEVER * np.r_[direction(rng), direction(rng)]
        wrench = readings(rig, R) + np.outer(rng.choice([-1.0, 1.0], 12), backlash) + NOISE * rng.normal(size=(12, 6))
        assert Kind.GAIN not in {finding.kind for finding in cw.calibrate(cw.Samples(wrench, R, times(12))).findings}


@pytest.mark.parametrize(("seed", "poses"), [(11, 16), (13, 16), (27, 16), (7, 24), (9, 24)])
def test_poses_in_contact_beside_two_causes_and_a_robot_that_errs_are_judged(seed: int, poses: int) -> None:
    """Neighbours of a table with pairs of causes have kernels of their own; these seeds ended in a traceback."""
    rng = np.random.default_rng([seed, 56])
    rig, R = usual_rig(rng, 20.0), random_rotations(poses, rng)
    wrench = Realistic(gain=0.01, robot=0.3, backlash=0.15).drawn(rig, rng).read(R, rng)
    wrench += Course("drift", 0.3).drawn(times(poses), rng)[0]
    pushed, bad = Contacts(30.0, False).drawn(poses, poses // 6, rng)
    calibration = cw.calibrate(cw.Samples(wrench + pushed, R, times(poses)))
    out = np.array([pose.rejected is not None for pose in calibration.poses])
    assert out[~bad].mean() < 0.2
    assert calibration.weight == pytest.approx(20.0, abs=4.0 * calibration.std["weight"])
