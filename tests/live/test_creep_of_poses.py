"""A sensor that creeps after each move is weighed too light: the verdict says so, and only then."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from contactwrench.live.fitting import Stated, fitted
from contactwrench.live.pose_taking import Taken
from tests.support.live_world import LiveWorld

Array = NDArray[np.float64]
ROWS, STOOD, MOVE = 250, 1.3, 5.0


def taken(share: float, seconds: float, seed: int, walk: float = 0.0) -> tuple[Taken, ...]:
    """Poses of a sensor that shows `share` of each change of its load late, within some s; whose bias walks."""
    world, rng = LiveWorld(seed), np.random.default_rng(seed)
    late, poses, bias = np.zeros(6), list[Taken](), np.zeros(6)
    before = world.wrench(world.R_base_flange, np.zeros((1, 3)))[0]
    for k, R in enumerate(Rotation.random(12, rng=rng)):
        true = world.wrench(R, np.zeros((1, 3)))[0]
        late = late * np.exp(-MOVE / seconds) + share * (true - before)
        since = STOOD - 1.0 + np.arange(ROWS) / ROWS
        bias = bias + walk * rng.standard_normal(6) * [1.0, 1.0, 1.0, 0.05, 0.05, 0.05]
        noise = 0.02 * rng.standard_normal((ROWS, 6)) * [1.0, 1.0, 1.0, 0.05, 0.05, 0.05]
        wrench = true + bias - np.exp(-since / seconds)[:, None] * late + noise
        t = 1.79e9 + (MOVE + STOOD) * k + since
        poses.append(Taken(t, wrench, np.tile(R.as_quat(), (ROWS, 1)), stood=STOOD))
        before = true
    return tuple(poses)


def fit(poses: tuple[Taken, ...]) -> cw.Calibration:
    found = fitted(poses, (), Stated(), "test").calibration
    assert found is not None
    return found


def doubted(found: cw.Calibration) -> bool:
    return "doubtful" in [each.severity for each in found.findings if each.kind is Kind.CREEP]


@pytest.mark.parametrize(("share", "seconds"), [(0.05, 2.0), (0.02, 1.5)])
def test_a_creeping_sensor_is_doubtful(share: float, seconds: float) -> None:
    found = fit(taken(share, seconds, seed=1))
    assert found.weight is not None
    assert 9.0 - 3.0 * found.std["weight"] < found.weight < 9.0
    assert doubted(found)


@pytest.mark.parametrize(("walk", "seed"), [(0.0, 2), (0.0, 3), (0.05, 4)])
def test_one_that_does_not_is_not(walk: float, seed: int) -> None:
    assert not doubted(fit(taken(0.0, 1.0, seed, walk)))
