"""Where an arm is stationary: a recording cut at its gaps, averaged over blocks, and the segments without a turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from ..geometry.rotations import rotation_vectors
from .change_detection import Segment, WindowNoise, noise_of_windows, segments_between_changes
from .poses import SAME_POSE_ANGLE
from .samples import Samples

BLOCK = 0.02
WINDOW = 0.1
FEWEST_ROWS_OF_WINDOW = 3
"""Blocks and windows: s, and rows where these take longer."""

FEWEST_ROWS = 5
"""Of a segment."""

LONGEST_GAP = 0.1
GAP_IN_ROWS = 5.0
"""A gap ends a segment: s, and rows where these take longer. No arm turns away and comes back in less."""

STILL_ANGLE = SAME_POSE_ANGLE / 10.0
"""An arm that turns by less from one window to the next stands: the sensor feels less than 1/2000 of the weight."""

FINEST_ANGLE = STILL_ANGLE / 10.0
"""No robot states the mean of a window any better."""

CREEP_ANGLE = float(SAME_POSE_ANGLE / 2.0)
"""An arm that turns by less over a whole segment stands."""

CREEP_SHOWS = 4.0
"""Standard deviations of the turn over a segment: three axes exceed them once in a thousand times."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Rows `first` up to `last` without a gap, in blocks of `rows`: their mean readings (k, 6), and the path (k, 3) of
    the orientation, rad: the rotation vectors from each block to the next, summed.
    """

    first: int
    last: int
    rows: int
    wrench: Array
    path: Array

    def rows_of(self, a: int, b: int) -> tuple[int, int]:
        """The rows of blocks `a` up to `b`: the last block takes what is left over."""
        return self.first + a * self.rows, self.last if b == len(self.wrench) else self.first + b * self.rows


@dataclass(frozen=True, eq=False)
class StationaryArm:
    """The `segments` in which the arm stands, or creeps where one is not steady; the `window`, in blocks, on which that
    was seen; the `duration`, s, that it must last.
    """

    segments: list[tuple[Blocks, Segment]]
    window: int
    duration: float


def stationary_arm(between_gaps: list[Blocks], period: float, least_duration: float) -> StationaryArm:
    """Where the arm stands for `least_duration` s, or for longer where the noise of its orientation asks for that: an
    arm that turns by `SAME_POSE_ANGLE` must show in the slope of a segment. `period` s from row to row.
    """
    if not between_gaps:
        return StationaryArm([], 0, least_duration)
    block = between_gaps[0].rows * period
    window = max(FEWEST_ROWS_OF_WINDOW, int(np.ceil(WINDOW / block)))
    least, floor = np.full(3, STILL_ANGLE), np.full(3, FINEST_ANGLE**2)
    noise = noise_of_windows([blocks.path for blocks in between_gaps], window, least, floor, joint=True)
    blocks_to_see_creep = 12.0 * CREEP_SHOWS**2 * noise.variance[0] * noise.window / SAME_POSE_ANGLE**2
    duration = max(least_duration, float(blocks_to_see_creep) * block)
    segments = [
        (blocks, segment)
        for blocks in between_gaps
        for segment in _stationary_segments(blocks, noise, duration / block)
    ]
    return StationaryArm(segments, window, duration if segments else least_duration)


def _stationary_segments(blocks: Blocks, noise: WindowNoise, least: float) -> list[Segment]:
    """Segments of at least `least` blocks in which the arm stands; those in which it creeps are not steady. What moves
    too slowly to show at once falls to short segments and creeping ones, hardly a window apart: they are one creeping
    segment.
    """
    segments: list[Segment] = []
    for segment in segments_between_changes(blocks.path, noise):
        path = blocks.path[segment.blocks]
        stands = len(path) >= least and not _creeps(path, noise)
        near = bool(segments) and segment.first - segments[-1].last <= 2 * noise.window
        if not stands and near and not segments[-1].steady:
            segments[-1] = Segment(segments[-1].first, segment.last, False)
        else:
            segments.append(Segment(segment.first, segment.last, stands))
    # where it turns on while it seems to stand, the arm only passes
    return [s for s in segments if s.steady or len(s) >= least or turn_over(blocks.path[s.blocks]) <= CREEP_ANGLE]


def turn_over(path: Array) -> float:
    """By how much (rad) an orientation turns over its path (n, 3), from the slope."""
    n = len(path)
    time = np.arange(n) - 0.5 * (n - 1)
    return float(np.linalg.norm(n * (time @ path) / float(time @ time)))


def _creeps(path: Array, noise: WindowNoise) -> bool:
    """Whether the arm turns over the segment by more than noise and `CREEP_ANGLE`."""
    std = np.sqrt(12.0 * float(noise.variance[0]) * noise.window / len(path))
    return turn_over(path) > max(CREEP_ANGLE, CREEP_SHOWS * float(std))


def blocks_of(samples: Samples) -> tuple[float, list[Blocks]]:
    """Seconds from row to row, and what lies between gaps where it is long enough to look at."""
    t = samples.t if samples.t is not None else np.empty(0)
    step = np.diff(t)
    if not (step > 0.0).any():
        return 0.0, []
    gap = (step < 0.0) | (step > max(LONGEST_GAP, GAP_IN_ROWS * float(np.median(step[step > 0.0]))))
    if gap.all():
        return 0.0, []
    period = float(step[~gap].mean())
    if samples.load_mass is not None:
        gap |= np.diff(samples.load_mass) != 0.0
    rows = max(1, round(BLOCK / period)) if period > 0.0 else 1
    edges = np.r_[0, np.flatnonzero(gap) + 1, len(t)]
    ends = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return period, [_blocks(samples, a, b, rows) for a, b in ends if b - a >= FEWEST_ROWS * rows]


def _blocks(samples: Samples, first: int, last: int, rows: int) -> Blocks:
    count = (last - first) // rows
    whole = slice(first, first + count * rows)
    wrench = samples.wrench[whole].reshape(count, rows, 6).mean(axis=1)
    R = samples.R_base_flange[whole].reshape(count, rows, 9).mean(axis=1).reshape(count, 3, 3)
    steps = rotation_vectors(R[:-1].transpose(0, 2, 1) @ R[1:])
    return Blocks(first, last, rows, wrench, np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))
