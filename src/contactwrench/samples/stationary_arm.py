"""Where an arm stands: a recording cut at its gaps, averaged over blocks, and the pieces in which it does not turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from .change_detection import Noise, Piece, noise_of_windows, pieces_between_changes
from .poses import SAME_POSE_ANGLE
from .samples import Samples

BLOCK = 0.02
WINDOW = 0.1
FEWEST_ROWS_OF_WINDOW = 3
"""Blocks and windows: s, and rows where these take longer."""

FEWEST_ROWS = 5
"""Of a stretch."""

LONGEST_GAP = 0.1
GAP_IN_ROWS = 5.0
"""A gap ends a stretch: s, and rows where these take longer. No arm turns away and comes back in less."""

STILL_ANGLE = SAME_POSE_ANGLE / 10.0
"""An arm that turns by less from one window to the next stands: the sensor feels less than 1/2000 of the weight."""

FINEST_ANGLE = STILL_ANGLE / 10.0
"""No robot states the mean of a window any better."""

CREEP_ANGLE = float(SAME_POSE_ANGLE / 2.0)
"""An arm that turns by less over a whole stretch stands."""

CREEP_SHOWS = 4.0
"""Standard deviations of the turn over a stretch: three axes exceed them once in a thousand times."""


@dataclass(frozen=True, eq=False)
class Section:
    """Rows `first` up to `last` without a gap, in blocks of `rows`: their mean readings (k, 6), and the way (k, 3) that
    the orientation went, rad: the rotation vectors from each block to the next, summed.
    """

    first: int
    last: int
    rows: int
    wrench: Array
    way: Array

    def rows_of(self, a: int, b: int) -> tuple[int, int]:
        """The rows of blocks `a` up to `b`: the last block takes what is left over."""
        return self.first + a * self.rows, self.last if b == len(self.wrench) else self.first + b * self.rows


@dataclass(frozen=True, eq=False)
class StandingArm:
    """The `pieces` of sections in which the arm stands, or creeps where one is no level; the `window`, in blocks, on
    which that was seen; the `duration`, s, that it must last.
    """

    pieces: list[tuple[Section, Piece]]
    window: int
    duration: float


def standing_arm(sections: list[Section], period: float, least_duration: float) -> StandingArm:
    """Where the arm stands for `least_duration` s, or for longer where the noise of its orientation asks for that."""
    if not sections:
        return StandingArm([], 0, least_duration)
    block = sections[0].rows * period
    window = max(FEWEST_ROWS_OF_WINDOW, int(np.ceil(WINDOW / block)))
    least, floor = np.full(3, STILL_ANGLE), np.full(3, FINEST_ANGLE**2)
    turning = noise_of_windows([section.way for section in sections], window, least, floor, joint=True)
    duration = max(least_duration, _blocks_to_see_creep(turning) * block)
    pieces = [(one, piece) for one in sections for piece in _standing_pieces(one, turning, duration / block)]
    return StandingArm(pieces, window, duration if pieces else least_duration)


def _blocks_to_see_creep(turning: Noise) -> float:
    """Blocks that a stretch must have for an arm that turns by `SAME_POSE_ANGLE` over it to show in the slope of its
    orientation, whose noise goes with the length.
    """
    return float(12.0 * CREEP_SHOWS**2 * turning.variance[0] * turning.window / SAME_POSE_ANGLE**2)


def _standing_pieces(section: Section, turning: Noise, least: float) -> list[Piece]:
    """Pieces of at least `least` blocks in which the arm stands; those in which it creeps are no level. What moves too
    slowly to show at once falls to short pieces and creeping ones, hardly a window apart: they are one creeping piece.
    """
    found: list[Piece] = []
    for piece in pieces_between_changes(section.way, turning):
        stands = piece.last - piece.first >= least and not _creeps(section.way[piece.first : piece.last], turning)
        near = bool(found) and piece.first - found[-1].last <= 2 * turning.window
        if not stands and near and not found[-1].level:
            found[-1] = Piece(found[-1].first, piece.last, False)
        else:
            found.append(Piece(piece.first, piece.last, stands))
    return [piece for piece in found if piece.level or piece.last - piece.first >= least or not _turns(section, piece)]


def turn_over(way: Array) -> float:
    """By how much (rad) an orientation turns over its way (n, 3), from the slope."""
    n = len(way)
    time = np.arange(n) - 0.5 * (n - 1)
    return float(np.linalg.norm(n * (time @ way) / float(time @ time)))


def _creeps(way: Array, turning: Noise) -> bool:
    """Whether the arm turns over the piece by more than noise and `CREEP_ANGLE`."""
    noise = np.sqrt(12.0 * float(turning.variance[0]) * turning.window / len(way))
    return turn_over(way) > max(CREEP_ANGLE, CREEP_SHOWS * float(noise))


def _turns(section: Section, piece: Piece) -> bool:
    """Whether the arm only passes: it turns on while it seems to stand."""
    return turn_over(section.way[piece.first : piece.last]) > CREEP_ANGLE


def sections_of(samples: Samples) -> tuple[float, list[Section]]:
    """Seconds from row to row, and the sections without a gap that are long enough to look at."""
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
    return period, [_section(samples, a, b, rows) for a, b in ends if b - a >= FEWEST_ROWS * rows]


def _section(samples: Samples, first: int, last: int, rows: int) -> Section:
    blocks = (last - first) // rows
    whole = slice(first, first + blocks * rows)
    wrench = samples.wrench[whole].reshape(blocks, rows, 6).mean(axis=1)
    R = samples.R_base_flange[whole].reshape(blocks, rows, 9).mean(axis=1).reshape(blocks, 3, 3)
    turn = R[:-1].transpose(0, 2, 1) @ R[1:]
    axis = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    length = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(length, np.trace(turn, axis1=1, axis2=2) - 1.0)
    steps = axis * np.divide(angle, length, out=np.full(len(length), 0.5), where=length > 0.0)[:, None]
    return Section(first, last, rows, wrench, np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))
