"""What is left in one pose and in the next too: of rows on the way, and not of a gain that poses of a cone share."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from tests.support.rigs import NOISE
from tests.support.world import Array, random_rig, readings

LEVER = np.repeat([1.0, 0.05], 3)
"""m: of cross-talk from forces to torques and back."""


def _wrong(wrench: Array, rng: np.random.Generator) -> Array:
    """As read by a sensor whose gain and cross-talk are off by about that share."""
    return np.asarray(wrench + 0.01 * wrench @ (np.outer(LEVER, 1.0 / LEVER) * rng.normal(size=(6, 6))).T)


def _said(seed: int, late: float, n: int) -> list[str]:
    """Of poses within 25 deg, in a random order, or on one way on which the readings are `late` by so many poses."""
    rng = np.random.default_rng(seed)
    rig = replace(random_rig(rng), weight=20.0, bias=np.zeros(6))
    first, turns = Rotation.random(random_state=rng), np.deg2rad(25.0) * rng.uniform(-0.6, 0.6, size=(n, 3))
    rates, begin = rng.uniform(3.0, 8.0, size=3), rng.uniform(0.0, 6.0, size=3)

    def at(k: Array) -> Array:
        on_the_way = np.deg2rad(15.0) * np.sin(begin + np.outer(k / n, rates))
        return np.asarray((first * Rotation.from_rotvec(on_the_way if late else turns)).as_matrix())

    k = np.arange(float(n))
    wrench = _wrong(readings(rig, at(k - late)), rng) + 0.3 * NOISE * rng.normal(size=(n, 6))
    calibration = cw.calibrate(cw.Samples(wrench, at(k), t=8.0 * k))
    assert calibration.gain_covariance is not None
    return [finding.text for finding in calibration.findings if finding.kind is Kind.CORRELATED_POSES]


@pytest.mark.parametrize("seed", [3, 5])
def test_rest_in_a_cone_with_a_wrong_gain_is_no_motion(seed: int) -> None:
    """The gain is left of all poses alike, and a mean correlates with its neighbour, by 0.81 in the first of these."""
    assert _said(seed, 0.0, 12) == []


def test_rows_on_the_way_are_found_beside_a_wrong_gain() -> None:
    (text,) = _said(0, 1.0, 24)
    found = re.fullmatch(
        r"weak: what is left in one pose is left in the next too \(correlation (0\.\d\d)\), as in rows taken while the "
        r"arm moves: these 24 poses tell as much as 1, and every std is too small: stop at each orientation, and give "
        r"the times in a column t",
        text,
    )
    assert found is not None
    assert float(found[1]) > 0.8


def test_cross_talk_that_reads_as_another_tool_is_in_the_std_of_a_long_one() -> None:
    """What looks like another centre of mass, or mounting, leaves no trace in what the fit leaves."""
    off = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        rig = replace(random_rig(rng), weight=45.0, com=np.array([0.03, -0.02, 0.14]), bias=np.zeros(6))
        R = Rotation.random(12, random_state=rng).as_matrix()
        wrench = _wrong(readings(rig, R), rng) + 0.01 * NOISE * rng.normal(size=(12, 6))
        calibration = cw.calibrate(cw.Samples(wrench, R))
        assert calibration.com is not None
        off.append((calibration.com - rig.com) / calibration.std["com"])
    assert np.sqrt(np.mean(np.square(off))) < 2.0
