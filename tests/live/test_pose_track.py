"""Orientations between, after and without poses."""

from __future__ import annotations

from math import isnan

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.geometry.quaternions import Quat
from contactwrench.live.pose_track import PoseTrack

PERIOD, RATE = 0.008, np.array([0.3, -0.4, 0.5])


def at(t: float) -> Rotation:
    return Rotation.from_rotvec(RATE * t) * Rotation.from_euler("zyx", [30.0, 170.0, -60.0], degrees=True)


def quat(R: Rotation, length: float = 1.0) -> Quat:
    x, y, z, w = (length * R.as_quat()).tolist()
    return x, y, z, w


def track(length: float = 1.0, decimals: int = 16) -> PoseTrack:
    heard = PoseTrack()
    for k in range(50):
        sign = (-1.0) ** k
        x, y, z, w = np.round(quat(at(PERIOD * k), sign * length), decimals).tolist()
        heard.add(PERIOD * k, (x, y, z, w), None)
    return heard


@pytest.mark.parametrize("length", [1.0, 0.992])
@pytest.mark.parametrize("t", [0.1, 0.2531, 49 * PERIOD, 49 * PERIOD + 0.004, 49 * PERIOD + 0.039])
def test_a_steady_turn_is_known_between_poses_and_after_them(length: float, t: float) -> None:
    """Also of a sender whose quaternions are not of unit length."""
    found, _ = track(length).at(t, t)
    assert (Rotation.from_quat(found).inv() * at(t)).magnitude() < 1e-7


def test_rounded_quaternions_are_carried_on_no_worse_than_their_rounding() -> None:
    t = 49 * PERIOD + 0.039
    found, _ = track(decimals=3).at(t, t)
    assert (Rotation.from_quat(found).inv() * at(t)).magnitude() < 0.01


def test_an_old_orientation_is_unknown() -> None:
    found, age = track().at(49 * PERIOD + 0.06, 49 * PERIOD + 0.06)
    assert isnan(found[0])
    assert age == pytest.approx(0.06)
    assert isnan(PoseTrack().at(0.0, 0.0)[0][0])


def test_a_gap_is_unknown() -> None:
    heard = track()
    heard.add(49 * PERIOD + 0.1, quat(at(0.5)), None)
    assert isnan(heard.at(49 * PERIOD + 0.05, 1.0)[0][0])
    assert heard.at(49 * PERIOD - 0.001, 1.0)[1] == 0.0


@pytest.mark.parametrize("wrong", [(0.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 3.0)])
def test_what_is_no_orientation_is_passed_over(wrong: Quat) -> None:
    """As a message that nobody has filled in."""
    heard, t = track(), 49 * PERIOD
    heard.add(t + PERIOD, wrong, None)
    found, age = heard.at(t + PERIOD, t + PERIOD)
    assert (Rotation.from_quat(found).inv() * at(t + PERIOD)).magnitude() < 1e-7
    assert age == pytest.approx(PERIOD)


def test_what_does_not_turn_stays_to_the_last_bit() -> None:
    """Or a compensator could not tell an orientation that is frozen."""
    heard, still = PoseTrack(), quat(Rotation.from_rotvec([0.4, -0.7, 0.2]))
    for k in range(10):
        heard.add(PERIOD * k, still, None)
    assert len({heard.at(t, t)[0] for t in np.linspace(0.0, 9 * PERIOD + 0.02, 50).tolist()}) == 1


def test_a_turn_is_carried_on_to_a_late_pose_and_beyond_now_by_what_is_asked() -> None:
    """A cycle of 12 ms: to now no further than 30 ms; a wrench that is stamped 30 ms early asks for 30 ms more."""
    heard, period = PoseTrack(), 0.012
    for k in range(50):
        heard.add(period * k, quat(at(period * k)), None)
    newest = 49 * period
    for t, now, known in ((0.05, 0.05, 0.03), (0.02, 0.02, 0.02), (0.042, 0.012, 0.042), (0.08, 0.05, 0.06)):
        found, _ = heard.at(newest + t, newest + now)
        assert (Rotation.from_quat(found).inv() * at(newest + known)).magnitude() < 1e-7


def test_an_orientation_of_the_very_moment_is_known_however_seldom_they_come() -> None:
    """A recording of one row a second has both in each row; in between nothing is known."""
    heard = PoseTrack()
    for k in range(5):
        heard.add(float(k), quat(at(0.1 * k)), None)
    for k in range(5):
        found, age = heard.at(float(k), float(k))
        assert (Rotation.from_quat(found).inv() * at(0.1 * k)).magnitude() < 1e-12
        assert age == 0.0
    assert isnan(heard.at(1.5, 1.5)[0][0])
