"""From samples to poses: readings at one orientation are averaged, whenever they were taken.

Rows within 0.2 deg of each other are one pose (method: the noise of a pose is not the scatter of its samples).
Millions of rows at a few orientations are a few poses, and no more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, Frozen, Matrix, Vector, shaped
from ..geometry.rotations import procrustes
from .samples import Samples
from .still_noise import covariances_of_means

SAME_POSE_ANGLE = np.deg2rad(0.2)
"""Orientations closer than this are one pose: robots repeat to about a tenth of it."""

_CELL = 5e-4
_IN_CACHE = 4096
"""Rows: of more at once, what is between takes longer than the sum."""

_HASH = np.array([pow(0x9E3779B97F4A7C15, k, 2**63) for k in range(1, 10)], dtype=np.int64)
"""Odd multipliers that mix nine small integers into one key (powers of 2^64 / golden ratio)."""


@dataclass(frozen=True, eq=False)
class Pose(Frozen):
    """One orientation of the arm at rest, and the mean reading there.

    `R_base_flange` (3, 3); `wrench` (6,) N and N m, the mean of `n` rows; `wrench_cov` (6, 6) of that mean as the rows
    show it at their length, noise that is not white included (zero for a single row); `t_start`, `t_end` s or None;
    `rejected` the reason why the pose is left out, or None.
    """

    R_base_flange: Matrix = field(metadata=shaped(3, 3))
    wrench: Vector = field(metadata=shaped(6))
    wrench_cov: Matrix = field(metadata=shaped(6, 6))
    n: int
    t_start: float | None
    t_end: float | None
    rejected: str | None


def names_of(poses: Sequence[Pose], since: float) -> list[str]:
    """By number, from 1, and the time of each where it is known, counted from `since` (s)."""
    times = ["" if pose.t_start is None else f" (t = {pose.t_start - since:.6g} s)" for pose in poses]
    return [f"pose {k}{time}" for k, time in enumerate(times, start=1)]


def visits(label: NDArray[np.intp], most: int) -> NDArray[np.intp] | None:
    """A label for each visit of rows (n,) whose orientations have these; None where no orientation is visited twice, or
    where there are more than `most` visits.
    """
    visit = np.cumsum(np.r_[0, label[1:] != label[:-1]])[: len(label)]
    again = len(visit) > 0 and label.max() < visit[-1] < most
    return visit if again else None


def averaged(samples: Samples, label: NDArray[np.intp]) -> tuple[Pose, ...]:
    """The mean of the rows of each label (0, 1, ...), in that order; a negative one is left out."""
    return mean_poses(samples, rows_of(label)) if len(label) else ()


def rows_of(label: NDArray[np.intp]) -> Sequence[slice | NDArray[np.intp]]:
    """The rows of each label (0, 1, ...), in that order."""
    in_order = bool((label[1:] >= label[:-1]).all())
    few = label.astype(np.int16) if label.max() < np.iinfo(np.int16).max else label  # which sorts in linear time
    order = np.arange(len(label)) if in_order else np.argsort(few, kind="stable")
    edges = np.flatnonzero(np.r_[True, np.diff(label[order]) != 0, True])
    ends = list(pairwise(edges[int(label[order[0]] < 0) :].tolist()))
    return [slice(a, b) for a, b in ends] if in_order else [order[a:b] for a, b in ends]


def mean_poses(samples: Samples, rows: Sequence[slice | NDArray[np.intp]]) -> tuple[Pose, ...]:
    """The mean readings of `rows`, each at one orientation, with the covariance of means of that length."""
    readings = [taken(samples.wrench, each) for each in rows]
    means = [wrench[0] + np.ones(len(wrench)) @ (wrench - wrench[0]) / len(wrench) for wrench in readings]
    rotations = [_mean_rotation(taken(samples.R_base_flange, each)) for each in rows]
    return tuple(
        Pose(rotation, mean, covariance, len(wrench), *_span(samples.t, each), None)
        for each, wrench, mean, covariance, rotation in zip(
            rows, readings, means, covariances_of_means(readings), rotations, strict=True
        )
    )


def taken(values: Array, rows: slice | NDArray[np.intp]) -> Array:
    """`values[rows]`, in a third of its time."""
    return values[rows] if isinstance(rows, slice) else values.take(rows, axis=0)


def _mean_rotation(R: Array) -> Array:
    return np.asarray(R[0]) if len(R) == 1 else procrustes((np.ones(len(R)) @ R.reshape(-1, 9)).reshape(3, 3))


def _span(t: Array | None, rows: slice | NDArray[np.intp]) -> tuple[float | None, float | None]:
    return (None, None) if t is None else (float(t[rows].min()), float(t[rows].max()))


def cells_of(R: Array, size: float) -> NDArray[np.int64]:
    """A key for each orientation (n, 3, 3), equal for those whose elements round to the same multiples of `size`."""
    corners, keys = R.reshape(-1, 9), np.empty(len(R), dtype=np.int64)
    for first in range(0, len(R), _IN_CACHE):
        some = slice(first, first + _IN_CACHE)
        keys[some] = np.rint(corners[some] * (1.0 / size)).astype(np.int64) @ _HASH
    return keys


def nearly_equal(R: Array) -> tuple[Array, NDArray[np.intp]]:
    """The orientations (k, 3, 3) that are in rows R (n, 3, 3), in order of first appearance, which of these each row
    has, (n,), where they differ by much less than `SAME_POSE_ANGLE`: a million rows at a few cost a sort.
    """
    key = cells_of(R, _CELL)
    run_start = np.flatnonzero(np.r_[True, key[1:] != key[:-1]][: len(R)])
    cells = np.unique(key[run_start])
    cell_of_run, first_run = np.searchsorted(cells, key[run_start]), np.empty(len(cells), dtype=np.intp)
    first_run[cell_of_run[::-1]] = np.arange(len(run_start))[::-1]
    by_appearance = np.argsort(first_run)
    rank = np.empty(len(by_appearance), dtype=np.intp)
    rank[by_appearance] = np.arange(len(by_appearance))
    run_length = np.diff(np.r_[run_start, len(R)])
    return R[run_start[first_run[by_appearance]]], np.repeat(rank[cell_of_run], run_length)


def label_orientations(R: Array) -> NDArray[np.intp]:
    """A label per row, 0, 1, ... in order of first appearance; equal for rows within `SAME_POSE_ANGLE`: those that are
    nearly equal together join the first pose that is near enough.
    """
    from scipy.spatial import cKDTree

    some, of_row = nearly_equal(R)
    corners = some.reshape(-1, 9)
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
    return pose_of_cell[of_row]


@dataclass(frozen=True, eq=False)
class PoseMoments(Frozen):
    """Sums over many poses that stand in for the poses: enough to fit any model of this package again.

    `n` poses; with m = [R_base_flange row-major, 1] (10,): `design` = sum m m^T (10, 10), `cross` = sum m wrench^T
    (10, 6), `wrench` = sum wrench wrench^T (6, 6).
    """

    n: int
    design: Matrix = field(metadata=shaped(10, 10))
    cross: Matrix = field(metadata=shaped(10, 6))
    wrench: Matrix = field(metadata=shaped(6, 6))

    def squares_left(self, to_wrench: Array) -> Array:
        """The mean square (6,) of what a wrench `to_wrench @ m`, (6, 10), leaves of the poses."""
        left = self.wrench - 2.0 * to_wrench @ self.cross + to_wrench @ self.design @ to_wrench.T
        return np.maximum(np.diag(left) / self.n, 0.0)


def moments_of_poses(R_base_flange: Array, wrench: Array) -> PoseMoments:
    """The moments of poses (n, 3, 3) and their mean readings (n, 6)."""
    m = np.column_stack([R_base_flange.reshape(-1, 9), np.ones(len(wrench))])
    return PoseMoments(len(wrench), m.T @ m, m.T @ wrench, wrench.T @ wrench)
