"""How a recorded arm moves: its orientation between the stamps, the accelerations of its tool, and where it stands.

A tool that turns is thrown outwards and held back. Whatever its mass, centre and inertia are, that is linear in the
angular acceleration (3), the products of the angular velocity (6) and the acceleration of the flange (3), all in flange
axes: left out, they are taken for a delay of several ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..geometry.rotations import path_through, rotation_vectors
from .buffer import Buffer, Nodes
from .change_detection import NoiseOfMeans, Segment, noise_of_windows, segments_between_changes
from .poses import SAME_POSE_ANGLE
from .samples import Samples
from .timestamps import FINEST, GAP_IN_ROWS, at_pace

CELL = 0.01
"""s: what is faster than this is no motion of an arm; orientations that come faster are thinned."""
LEAST_SMOOTHED, SMOOTHED, WINDOWS = 0.05, 0.19, 150
"""s, over which readings and motion are averaged: at least, as an arm trembles, and so do the digits of its pose; at
most, in a recording of so many windows: where poses come a little late or early, accelerations are off by more than
there are: by 10 m/s^2, were they not averaged, of 125 poses a second at 1 m/s that are off by 0.3 ms. No part of the
periods that people program.
"""
PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """Between nodes at `t` (k,) s a state, straight from one to the next: the base's axes in flange axes, 3 x 3
    numbers, row by row one axis, and what exerts a wrench beside gravity, 9 numbers, or 12 where positions are known.
    `gap` (k - 1,): where nothing is known between two nodes.

    All is seen through a window that falls to zero `width` s to each side, as readings are that were averaged over as
    long, twice: what is filtered alike still obeys the same law, and the noise of positions is little in accelerations.
    So its double integral over time is kept, four coefficients for each number of the state: `twice` (4, k - 1, m),
    falling powers of the time from the node before.
    """

    t: Array
    twice: Array
    gap: NDArray[np.bool_]
    width: float

    @property
    def knows_positions(self) -> bool:
        """Whether the accelerations of the flange are among those known."""
        return int(self.twice.shape[2]) > 18

    def state_at(self, t: Array) -> Array:
        """The state (n, m), averaged over the window around t (n,)."""
        return self._averaged(self.twice, t)

    def change_at(self, t: Array) -> Array:
        """Its derivative, 1/s; zero for axes where the arm does not turn, and for accelerations that are known in part:
        they would be taken for the others.
        """
        change = self._averaged(self.twice[:3] * np.array([3.0, 2.0, 1.0])[:, None, None], t)
        change[np.linalg.norm(change[:, :9], axis=1) < np.sqrt(2.0) * LEAST_SPEED, :9] = 0.0
        if not self.knows_positions:
            change[:, 9:] = 0.0
        return change

    def _averaged(self, powers: Array, t: Array) -> Array:
        """The second difference of what has these powers, over the window."""
        before, now, after = (self._value(powers, t + shift) for shift in (-self.width, 0.0, self.width))
        return np.asarray((after - 2.0 * now + before) / self.width**2)

    def _value(self, powers: Array, t: Array) -> Array:
        place = self._place(t)
        since = (t - self.t[place])[:, None]
        value = powers[0].take(place, axis=0)
        for power in powers[1:]:
            value = value * since + power.take(place, axis=0)
        return np.asarray(value)

    def _place(self, t: Array) -> NDArray[np.intp]:
        """The nodes that come before t (n,), the last one left out."""
        return np.clip(np.searchsorted(self.t, t, "right") - 1, 0, len(self.t) - 2)

    def is_known(self, earliest: Array, latest: Array) -> NDArray[np.bool_]:
        """Whether all moments from `earliest` to `latest` (n,), with the windows around them, lie within the recording
        and in no gap.
        """
        earliest, latest = earliest - self.width, latest + self.width
        gaps = np.r_[0, np.cumsum(self.gap)]
        known = gaps[self._place(earliest)] == gaps[self._place(latest) + 1]
        inside: NDArray[np.bool_] = (earliest >= self.t[0]) & (latest <= self.t[-1]) & known
        return inside


LEAST_SPEED = 0.01
"""rad/s: slower than that is the trembling of an arm at rest, or of its encoders."""


def arm_motion(buffer: Buffer, nodes: Nodes, longest_gap: float) -> ArmMotion:
    """The motion through the orientations of a whole recording, whose gaps are longer than `longest_gap` s."""
    index, orientations = nodes.index, buffer.orientations
    if orientations.position is not None:
        placed = index[np.isfinite(orientations.position[index]).all(axis=1)]
        steps, gaps = (np.diff(orientations.t[rows]) > longest_gap for rows in (placed, index))
        index = placed if steps.sum() <= gaps.sum() and len(placed) > 2 else index
    fast = CELL / max(float(np.median(np.diff(nodes.t))), 1e-9)
    if fast >= 2.0:
        index = index[:: int(fast)]
    R = orientations.R_base_flange[index]
    t = at_pace(orientations.t[index], R.reshape(-1, 9))
    is_gap = np.r_[0, np.cumsum(np.diff(orientations.t[: nodes.count]) > longest_gap)]
    position = None if orientations.position is None else orientations.position[index]
    state = _state(t, R, None if position is None or np.isnan(position).any() else position)
    step = np.diff(t)[:, None]
    once = _until(0.5 * step * (state[1:] + state[:-1]))
    both = _until(step * (once[:-1] + step / 6.0 * (2.0 * state[:-1] + state[1:])))
    twice = np.stack([np.diff(state, axis=0) / (6.0 * step), 0.5 * state[:-1], once[:-1], both[:-1]])
    of_pose, of_reading = (float(np.median(np.diff(stamps))) for stamps in (t, buffer.readings.t))
    smoothed = max(float(np.clip(np.ptp(orientations.t) / WINDOWS, LEAST_SMOOTHED, SMOOTHED)), of_pose)
    width = max(round(smoothed / of_reading), 1) * of_reading if of_reading > 0.0 else smoothed
    return ArmMotion(t, twice, np.diff(is_gap[index]) > 0, width)


def _until(parts: Array) -> Array:
    """Sums (k, m) of all parts (k - 1, m) before each node."""
    return np.concatenate([np.zeros((1, parts.shape[1])), np.cumsum(parts, axis=0)])


def _state(t: Array, R: Array, position: Array | None) -> Array:
    """At nodes (k,) with rotations (k, 3, 3): the base's axes, angular acceleration, products of the angular velocity,
    and of positions (k, 3) the acceleration, all in flange axes.
    """
    step, middle = np.diff(t)[:, None], 0.5 * (t[1:] + t[:-1])
    turning = rotation_vectors(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / step
    angular = [np.interp(t, middle, column) for column in turning.T]
    products = np.stack([angular[i] * angular[j] for i, j in PRODUCTS], axis=1)
    state = [R.reshape(-1, 9), _derivative(middle, turning), products]
    if position is not None:
        acceleration = _derivative(middle, np.diff(position, axis=0) / step)
        state.append(np.einsum("nij,ni->nj", R, acceleration))
    return np.concatenate(state, axis=1)


def _derivative(middle: Array, rate: Array) -> Array:
    """At the nodes, of a `rate` known in the `middle` of the steps between; at both ends that of the next node."""
    if len(middle) < 2:
        return np.zeros((len(rate) + 1, rate.shape[1]))
    within = np.diff(rate, axis=0) / np.diff(middle)[:, None]
    return np.concatenate([within[:1], within, within[-1:]])


BLOCK = 0.02
WINDOW = 0.1
FEWEST_ROWS_OF_WINDOW = 3
"""Blocks and windows: s, and rows where these take longer."""

FEWEST_ROWS = 5
"""Of a segment."""

LONGEST_GAP = 0.1
"""s; a gap ends a segment, and `GAP_IN_ROWS` where these take longer. No arm turns away and comes back in less."""

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
    noise = noise_of_windows([blocks.path for blocks in between_gaps], window, float(STILL_ANGLE), FINEST_ANGLE**2)
    blocks_to_see_creep = 12.0 * CREEP_SHOWS**2 * noise.over(1.0)[0] / SAME_POSE_ANGLE**2
    duration = max(least_duration, float(blocks_to_see_creep) * block)
    segments = [
        (blocks, segment)
        for blocks in between_gaps
        for segment in _stationary_segments(blocks, noise, duration / block)
    ]
    return StationaryArm(segments, window, duration if segments else least_duration)


def _stationary_segments(blocks: Blocks, noise: NoiseOfMeans, least: float) -> list[Segment]:
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


def _creeps(path: Array, noise: NoiseOfMeans) -> bool:
    """Whether the arm turns over the segment by more than noise and `CREEP_ANGLE`."""
    std = np.sqrt(12.0 * float(noise.over(len(path))[0]))
    return turn_over(path) > max(CREEP_ANGLE, CREEP_SHOWS * float(std))


def blocks_of(samples: Samples) -> tuple[float, list[Blocks]]:
    """Seconds from row to row, and what lies between gaps where it is long enough to look at."""
    t = samples.t if samples.t is not None else np.empty(0)
    step = np.diff(t)
    if not (step > 0.0).any():
        return 0.0, []
    gap = (step < 0.0) | (step > max(LONGEST_GAP, GAP_IN_ROWS * float(np.median(step[step > 0.0]))))
    period = float(step[~gap].mean())
    if samples.load_mass is not None:
        gap |= np.diff(samples.load_mass) != 0.0
    rows = max(1, round(BLOCK / period)) if period > FINEST else 1
    edges = np.r_[0, np.flatnonzero(gap) + 1, len(t)]
    ends = zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    return period, [_blocks(samples, a, b, rows) for a, b in ends if b - a >= FEWEST_ROWS * rows]


def _blocks(samples: Samples, first: int, last: int, rows: int) -> Blocks:
    count = (last - first) // rows
    whole = slice(first, first + count * rows)
    wrench = samples.wrench[whole].reshape(count, rows, 6).mean(axis=1)
    R = samples.R_base_flange[whole].reshape(count, rows, 9).mean(axis=1).reshape(count, 3, 3)
    return Blocks(first, last, rows, wrench, path_through(R))
