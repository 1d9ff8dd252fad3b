"""Whether readings at one orientation agree: one of them in contact, or lost, would pass for noise of all poses.

Rows belong together unless they are apart by far more than rows scatter elsewhere. Most rows of a visit outvote a few,
which are left out; else each reading is a pose of its own, and the fit to all poses finds the one that is off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from .poses import SAME_POSE_ANGLE, averaged, rows_of, taken
from .recorded_poses import RecordedPoses, told_by_times
from .samples import Samples

ENOUGH = 12
"""Rows beyond the first one of each orientation, from which on they tell by themselves what rows scatter by."""
COMMON = 0.5
"""Of the orientations: where rows are apart at more, it is no accident, as where the zero moved, and all rows count."""
FEWEST_TO_FIT = 4
"""Orientations, from which on a fit to all rows may tell what they scatter by."""
BY_CHANCE, OF_MEDIAN = 1e-4, 0.37
"""Probability that rows of a table are parted without a cause; and what a number in a median is worth, in a mean."""
NOISIER, FEWEST, LOOKED_AT = 3.0, 5, 200
"""Times the usual scatter, that an orientation may have at most, if it has so many rows; of these are looked at."""
LEAST, HARMLESS = 9.0, 20.0
"""Times the scatter that rows may be off by: an orientation that vibrates stays within the first; n rows may be off by
the root of n, up to the second, as one that is off by less hardly moves their mean.
"""
MOST_READINGS, LEAST_SHARE = 4, 0.25
"""That are told apart at one orientation; rows that are fewer than this share of their visit are outvoted, or of the
orientation, where each of its visits is a single row.
"""


def few_repeats(recorded: RecordedPoses) -> bool:
    """Whether rows of a table repeat orientations, but too few to tell what rows scatter by."""
    n = len(recorded.poses)
    return recorded.label is not None and n >= FEWEST_TO_FIT and 0 < len(recorded.label) - n < ENOUGH


def agreed(samples: Samples, recorded: RecordedPoses, known: tuple[Array, float] | None = None) -> RecordedPoses:
    """`recorded` with rows apart that contradict each other. `known` is the std (6,) of a row, and its degrees of
    freedom; None: the rows tell, where `ENOUGH` repeat an orientation.
    """
    label = recorded.label
    if label is None or len(label) == len(recorded.poses) or (known is None and few_repeats(recorded)):
        return recorded
    counts = np.bincount(label)
    together = [(rows, taken(samples.wrench, rows)) for rows, n in zip(rows_of(label), counts, strict=True) if n > 1]
    std, times = _scatter([readings for _, readings in together], known)
    turned = 0.5 * SAME_POSE_ANGLE * _range_of(samples.wrench)  # N and N m, at what counts as one orientation
    told = [(rows, _parts(readings, std, times, turned)) for rows, readings in together]
    told = [(rows, part) for rows, part in told if part.any()]
    if not told:
        return recorded
    row, finer, apart = np.arange(len(label)), label.copy(), []
    visit = np.cumsum(np.r_[0, label[1:] != label[:-1]])
    for rows, part in told:
        if (main := int(np.bincount(part).argmax())) == MOST_READINGS:  # it is noise that parts them
            continue
        for other in sorted({*part.tolist()} - {main}):
            off, others = row[rows][part == other], row[rows][part == main]
            come, of_visits = len(set(visit[off].tolist())), int(np.isin(visit[rows], visit[off]).sum())
            share = len(off) / (len(part) if come == of_visits else of_visits)
            apart.append((off, others, bool(share < LEAST_SHARE or other == MOST_READINGS)))
    if not apart:
        return recorded
    everywhere = len({int(label[others[0]]) for _, others, _ in apart}) > max(1.0, COMMON * len(together))
    apart = [(off, others, outvoted and not everywhere) for off, others, outvoted in apart]
    for off, _, outvoted in apart:
        finer[off] = -1 if outvoted else finer.max() + 1
    last = len(label) - 1 - np.unique(finer[::-1], return_index=True)[1][int(finer.min() < 0) :]
    rank = np.full(finer.max() + 2, -1)  # in the order in which they were seen last; the last entry is of -1
    rank[np.unique(finer[finer >= 0])] = np.argsort(np.argsort(last))
    pose, rest = rank[finer], finer == label
    noise, creep = told_by_times(samples.select(rest), label[rest])
    recorded = replace(recorded, visits=None, label=pose, apart=tuple(apart), still_noise=noise, creep=creep)
    return replace(recorded, poses=averaged(samples, pose))


def _scatter(readings: list[Array], known: tuple[Array, float] | None) -> tuple[Array, float]:
    """The std (6,) of a row, and how many of these it may be off, of readings (n, 6), at one orientation each."""
    from scipy.special import stdtrit

    rows = sum(map(len, readings))
    look = [each[:: len(each) // LOOKED_AT + 1] for each in readings]
    steps = np.abs(np.concatenate([each - np.roll(each, len(each) // 2, axis=0) for each in look]))
    usual = [np.median(axis[axis > 0.0]) if axis.any() else 0.0 for axis in steps.T]  # digits that stay step by none
    std, dof = known or (1.048 * np.array(usual), 3.0 * OF_MEDIAN * (rows - len(readings)))
    alike = np.repeat(std.reshape(2, 3).mean(axis=1), 3)
    by_chance = -float(stdtrit(max(dof, 1.0), BY_CHANCE / (12.0 * rows)))
    return np.maximum(std, alike), by_chance if known else max(by_chance, LEAST)


def _range_of(readings: Array) -> Array:
    """From the least to the largest of each axis, (6,): along memory, in a third of the time."""
    return np.asarray(np.ptp(np.ascontiguousarray(readings.T), axis=1))


def _parts(readings: Array, std: Array, times: float, turned: Array) -> NDArray[np.intp]:
    """Which of readings (n, 6) agree with each other: 0, 1, ..., and `MOST_READINGS` of the rest; `turned` (6,) by how
    much the tool reads otherwise where it is turned as little as counts for one orientation.
    """
    n, part = len(readings), np.zeros(len(readings), dtype=np.intp)
    limit, stride = std * max(times, min(np.sqrt(n), HARMLESS)), n // LOOKED_AT + 1
    if (_range_of(readings) <= limit).all():
        return part
    if n >= FEWEST:
        look = readings[::stride]
        own = 1.483 * np.median(np.abs(look - np.median(look, axis=0)), axis=0)
        limit = limit * np.clip(own / np.maximum(std, 1e-300), 1.0, NOISIER)
    limit = limit * np.sqrt(0.5 if n == 2 else 1.0 + 1.57 / n)  # a median is off itself; of two by half their distance
    limit = limit + turned
    part[:] = MOST_READINGS
    for k in range(MOST_READINGS):
        if not len(left := np.flatnonzero(part == MOST_READINGS)):
            break
        rest = readings[left]
        near = (np.abs(rest - np.median(rest[::stride], axis=0)) <= limit).all(axis=1)
        part[left[near if near.any() else (np.abs(rest - rest[0]) <= limit).all(axis=1)]] = k
    return part
