"""From samples to poses: readings at one orientation are averaged, whenever they were taken.

Rows within 0.2 deg of each other are one pose (method: the noise of a pose is not the scatter of its samples).
Millions of rows at a few orientations are a few poses, and no more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, Frozen, Matrix, Vector
from .samples import Samples

SAME_POSE_ANGLE = np.deg2rad(0.2)
"""Orientations closer than this are one pose: robots repeat to about a tenth of it."""

_CELL = 5e-4
_HASH = np.array([pow(0x9E3779B97F4A7C15, k, 2**63) for k in range(1, 10)], dtype=np.int64)
"""Odd multipliers that mix nine small integers into one key (powers of 2^64 / golden ratio)."""


@dataclass(frozen=True, eq=False)
class Pose(Frozen):
    """One orientation of the arm at rest, and the mean reading there.

    `R_base_flange` (3, 3); `wrench` (6,) N and N m, the mean of `n` rows; `wrench_cov` (6, 6) of that mean from
    the scatter of its rows (zero for a single row, whose scatter is unknown); `t_start`, `t_end` s or None;
    `rejected` the reason why the pose is left out, or None.
    """

    R_base_flange: Matrix
    wrench: Vector
    wrench_cov: Matrix
    n: int
    t_start: float | None
    t_end: float | None
    rejected: str | None


def visits(label: NDArray[np.intp], most: int) -> NDArray[np.intp] | None:
    """A label for each visit of rows (n,) whose orientations have these; None where no orientation is visited twice, or
    where there are more than `most` visits.
    """
    visit = np.cumsum(np.r_[0, label[1:] != label[:-1]])[: len(label)]
    again = len(visit) > 0 and label.max() < visit[-1] < most
    return visit if again else None


def averaged(samples: Samples, label: NDArray[np.intp]) -> tuple[Pose, ...]:
    """The mean of the rows of each `label` (n,)."""
    if not len(label):
        return ()
    small = label.astype(np.min_scalar_type(int(label.max())))  # numpy sorts 16-bit integers by radix, far faster
    order = slice(None) if (np.diff(label) >= 0).all() else np.argsort(small, kind="stable")
    wrench, R, label = samples.wrench[order], samples.R_base_flange[order], label[order]
    t = None if samples.t is None else samples.t[order]
    starts = np.flatnonzero(np.r_[True, label[1:] != label[:-1]])
    ends = np.r_[starts[1:], len(label)]
    return tuple(
        mean_pose(wrench[a:b], R[a:b], None if t is None else t[a:b]) for a, b in zip(starts, ends, strict=True)
    )


def mean_pose(wrench: Array, R_base_flange: Array, t: Array | None, worth: Array | float = 1.0) -> Pose:
    """The mean of readings (n, 6) at one orientation, as (n, 3, 3); `worth` (6,) of them make an independent one."""
    n = len(wrench)
    t_start, t_end = (None, None) if t is None else (float(t.min()), float(t.max()))
    if n == 1:
        return Pose(R_base_flange[0], wrench[0], np.zeros((6, 6)), 1, t_start, t_end, None)
    from_first = wrench - wrench[0]  # so that rows which repeat exactly have a scatter of exactly zero
    mean = from_first.mean(axis=0)
    centred = (from_first - mean) * np.sqrt(worth)
    U, _, Vt = np.linalg.svd(R_base_flange.mean(axis=0))
    return Pose(U @ Vt, wrench[0] + mean, centred.T @ centred / (n * (n - 1.0)), n, t_start, t_end, None)


def label_orientations(R: Array) -> NDArray[np.intp]:
    """A label per row, 0, 1, ... in order of first appearance; equal for rows within `SAME_POSE_ANGLE`.

    Rows are first collected into cells much smaller than that angle, so that a million rows at a few
    orientations cost a sort; each cell then joins the first pose that is near enough.
    """
    from scipy.spatial import cKDTree

    n = len(R)
    key = np.rint(R.reshape(n, 9) * (1.0 / _CELL)).astype(np.int64) @ _HASH
    run_start = np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if n else np.empty(0, dtype=np.intp)
    _, first_run, cell_of_run = np.unique(key[run_start], return_index=True, return_inverse=True)
    by_appearance = np.argsort(first_run)
    rank = np.empty(len(by_appearance), dtype=np.intp)
    rank[by_appearance] = np.arange(len(by_appearance))
    corners = R[run_start[first_run[by_appearance]]].reshape(-1, 9)

    pose_of_cell = np.full(len(corners), -1, dtype=np.intp)
    radius = 2.0 * np.sqrt(2.0) * np.sin(SAME_POSE_ANGLE / 2.0)
    tree = cKDTree(corners) if len(corners) else None
    count = 0
    for cell, corner in enumerate(corners):
        if pose_of_cell[cell] >= 0 or tree is None:
            continue
        near = np.asarray(tree.query_ball_point(corner, radius))
        pose_of_cell[near[pose_of_cell[near] < 0]] = count
        count += 1
    run_length = np.diff(np.r_[run_start, n])
    return np.repeat(pose_of_cell[rank[cell_of_run]], run_length)


@dataclass(frozen=True, eq=False)
class PoseMoments(Frozen):
    """Sums over many poses that stand in for the poses: enough to fit any model of this package again.

    `n` poses; with m = [R_base_flange row-major, 1] (10,): `design` = sum m m^T (10, 10), `cross` = sum m wrench^T
    (10, 6), `wrench` = sum wrench wrench^T (6, 6).
    """

    n: int
    design: Matrix
    cross: Matrix
    wrench: Matrix


def moments_of_poses(R_base_flange: Array, wrench: Array) -> PoseMoments:
    """The moments of poses (n, 3, 3) and their mean readings (n, 6)."""
    m = np.column_stack([R_base_flange.reshape(-1, 9), np.ones(len(wrench))])
    return PoseMoments(len(wrench), m.T @ m, m.T @ wrench, wrench.T @ wrench)
