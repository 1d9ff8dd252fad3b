"""The rotations nearest to matrices are rotations, whatever the matrices."""

from __future__ import annotations

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.geometry.rotations import procrustes, rotation_exp
from contactwrench.samples.poses import averaged
from tests.support.world import random_rotations

Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("k", [2, 3])
def test_no_rotation_is_nearer_and_none_is_a_reflection(k: int) -> None:
    rng = np.random.default_rng(k)
    M = rng.normal(size=(40, 5, k, k))
    R = procrustes(M)
    assert R.shape == M.shape
    assert np.linalg.det(R) == pytest.approx(np.ones((40, 5)))
    assert np.swapaxes(R, -1, -2) @ R == pytest.approx(np.broadcast_to(np.eye(k), M.shape))
    for turn in random_rotations(20, rng) if k == 3 else np.array([rotation_exp(a * Z)[:2, :2] for a in range(20)]):
        assert np.all(np.sum(R * M, axis=(-2, -1)) >= np.sum(turn * M, axis=(-2, -1)) - 1e-12)
    assert procrustes(M[0, 0]) == pytest.approx(R[0, 0])


def test_the_mean_of_orientations_far_apart_is_a_rotation() -> None:
    """Half turns about three axes: their mean has a determinant below zero, and a reflection is nearest."""
    half_turns = np.stack([np.diag(2.0 * axis - 1.0) for axis in np.eye(3)])
    pose = averaged(cw.Samples(np.zeros((3, 6)), half_turns), np.zeros(3, dtype=np.intp))[0]
    assert np.linalg.det(pose.R_base_flange) == pytest.approx(1.0)
