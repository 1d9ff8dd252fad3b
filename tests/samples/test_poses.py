"""Rows within 0.2 deg are one pose, whenever they were taken; its mean, its scatter, its times."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.samples.poses import Pose, averaged, label_orientations, moments_of_poses
from tests.support.rigs import seeds
from tests.support.world import Array, random_rotations


def _turned(R: Array, degrees: float, rng: np.random.Generator) -> Array:
    axis = rng.normal(size=(len(R), 3))
    axis *= np.deg2rad(degrees) / np.linalg.norm(axis, axis=1, keepdims=True)
    turned: Array = R @ Rotation.from_rotvec(axis).as_matrix()
    return turned


def _poses(samples: cw.Samples) -> tuple[Pose, ...]:
    return averaged(samples, label_orientations(samples.R_base_flange))


@pytest.mark.parametrize(("degrees", "poses"), [(0.02, 1), (0.15, 1), (0.25, 2), (2.0, 2)])
def test_rows_within_a_fifth_of_a_degree_are_one_pose(degrees: float, poses: int) -> None:
    rng = np.random.default_rng(1)
    for R in random_rotations(20, rng):
        both = np.stack([R, _turned(R[None], degrees, rng)[0]])
        assert len(_poses(cw.Samples(rng.normal(size=(2, 6)), both))) == poses


@settings(deadline=None, max_examples=25)
@given(seed=seeds, poses=st.integers(1, 12), rows=st.integers(1, 6))
def test_visits_are_gathered_whatever_their_order(seed: int, poses: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    R, wrench = random_rotations(poses, rng), rng.normal(size=(poses * rows, 6))
    of_row = rng.permutation(np.repeat(np.arange(poses), rows))
    t = np.linspace(0.0, 5.0, poses * rows)
    found = _poses(cw.Samples(wrench, _turned(R[of_row], 0.03, rng), t=t))
    first = list(dict.fromkeys(of_row.tolist()))
    assert len(found) == poses
    for pose, number in zip(found, first, strict=True):
        mine = of_row == number
        assert pose.n == rows
        assert pose.wrench == pytest.approx(wrench[mine].mean(axis=0))
        assert (pose.t_start, pose.t_end) == (t[mine].min(), t[mine].max())
        assert np.linalg.norm(pose.R_base_flange - R[number]) < np.deg2rad(0.1)
        assert pose.R_base_flange.T @ pose.R_base_flange == pytest.approx(np.eye(3), abs=1e-12)
        expected = np.cov(wrench[mine].T) / rows if rows > 1 else np.zeros((6, 6))
        assert pose.wrench_cov == pytest.approx(expected)
        assert pose.rejected is None


@pytest.mark.slow
def test_hundreds_of_thousands_of_rows_at_a_few_orientations_are_a_few_poses() -> None:
    rng = np.random.default_rng(3)
    R = np.repeat(random_rotations(5, rng), 60_000, axis=0)
    found = _poses(cw.Samples(np.zeros((len(R), 6)), R))
    assert [pose.n for pose in found] == [60_000] * 5


def test_no_rows_no_poses() -> None:
    assert _poses(cw.Samples(np.empty((0, 6)), np.empty((0, 3, 3)))) == ()


def test_poses_without_times() -> None:
    rng = np.random.default_rng(4)
    (pose,) = _poses(cw.Samples(rng.normal(size=(1, 6)), random_rotations(1, rng)))
    assert pose.t_start is None
    assert pose.t_end is None


def test_poses_cannot_be_changed() -> None:
    rng = np.random.default_rng(5)
    (pose,) = _poses(cw.Samples(rng.normal(size=(1, 6)), random_rotations(1, rng)))
    with pytest.raises(ValueError, match="read-only"):
        pose.wrench[0] = 1.0


def test_moments_hold_what_a_linear_fit_needs() -> None:
    """The affine fit from the moments alone is the one from the poses."""
    rng = np.random.default_rng(6)
    R, wrench = random_rotations(40, rng), rng.normal(size=(40, 6))
    moments = moments_of_poses(R, wrench)
    keep = [6, 7, 8, 9]  # the third row of R, which gravity picks, and 1
    from_moments = np.linalg.solve(moments.design[np.ix_(keep, keep)], moments.cross[keep])
    from_poses = np.linalg.lstsq(np.column_stack([R[:, 2], np.ones(40)]), wrench, rcond=None)[0]
    assert moments.n == 40
    assert from_moments == pytest.approx(from_poses)
    assert np.trace(moments.wrench) == pytest.approx(np.sum(wrench**2))
