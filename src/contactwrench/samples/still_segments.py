"""Still segments of a recording: where the arm stands and the reading stays, and why the others are left out.

Changes of the reading are looked for against the noise that means of each length have in this recording's own stops:
what creeps as the others do is no change, and counts in the covariance of the mean (method, "Still segments").
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import combinations

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array
from ..model import AXES
from ..statistics import two_digits
from .change_detection import NoiseOfMeans, Segment, is_steady, noise_at_all_lengths, segments_between_changes
from .motion import FEWEST_ROWS, Blocks, StationaryArm, blocks_of, stationary_arm, turn_over
from .poses import SAME_POSE_ANGLE, Pose, mean_poses
from .samples import Samples
from .still_noise import StillNoise, still_noise_of

LEAST_DURATION = 0.3
"""s: an arm that turns round stands for as long."""

SETTLING_MARGIN = 0.5
"""Of the time that a tail was seen, that it is taken to last beyond."""

SHAKING = 3.0
"""Times the scatter of the recording's segments: a segment that scatters more shakes."""

ACCEPTED_TURN = float(0.5 * SAME_POSE_ANGLE)
"""What it does to the reading is no change."""

MOST_CREEP = 0.01
"""Of the weight: means that differ by more in most stops are no creep of the sensor."""

FOLLOWS, FEWEST_TO_FOLLOW = 8.0, 4
"""Standard deviations by which stops go on with the change from the one before, and stops that tell."""

STEPS = 1.5
"""Of coarse readings, that are no change: a level between two."""

MOST_ROWS_FOR_STEP = 100_000
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class StillSegment(Pose):
    """Rows `first` to `last`, both included, in which the arm stands, and their mean; whether the reading `moves`."""

    first: int
    last: int
    t_start: float
    t_end: float
    moves: bool

    @property
    def rows(self) -> slice:
        """Of the samples."""
        return slice(self.first, self.last + 1)

    def as_pose(self) -> Pose:
        """The mean alone."""
        return Pose(**{field.name: getattr(self, field.name) for field in fields(Pose)})


@dataclass(frozen=True, eq=False)
class StillSegments:
    """The segments of a recording in which the arm stands, `accepted` and `rejected`, each in the order of time; the
    `noise` of means within those accepted, where they tell it.
    """

    accepted: tuple[StillSegment, ...]
    rejected: tuple[StillSegment, ...]
    noise: StillNoise | None


@dataclass(frozen=True, eq=False)
class _Candidate:
    """Rows `first` up to `last`, and why they are no still segment, where that is known; the reading `moves`."""

    first: int
    last: int
    reason: str | None = None
    moves: bool = False

    @property
    def rows(self) -> slice:
        return slice(self.first, self.last)


def still_segments(samples: Samples) -> StillSegments:
    """Find where arm and reading are still.

    Args:
        samples: with times, rows in the order in which they were recorded.

    Returns:
        The segments that are accepted and rejected, each with its mean reading (6,) N and N m and orientation (3, 3).

    Raises:
        InputError: samples without times.
    """
    if samples.t is None:
        raise InputError(f"{samples.source}: found no times, expected a column t: stillness shows in time only")
    period, between_gaps = blocks_of(samples)
    least = max(LEAST_DURATION, FEWEST_ROWS * period)
    arm = stationary_arm(between_gaps, period, least)
    if not arm.segments:
        return StillSegments((), (), None)
    step = _resolution(samples, [blocks.rows_of(segment.first, segment.last) for blocks, segment in arm.segments])
    noise = _noise_of_readings(arm, step)
    candidates = [
        replace(candidate, reason=follows or candidate.reason)
        for (blocks, segment), follows in zip(arm.segments, _following(arm), strict=True)
        for candidate in _where_the_reading_stays(blocks, segment, noise, period, arm.duration)
    ]
    return _judged(samples, candidates, between_gaps[0].rows * arm.window, step, period)


def _noise_of_readings(arm: StationaryArm, step: Array) -> NoiseOfMeans:
    """The noise of means where the arm stands. No change is what a turn that is accepted does to the reading, the
    differences between stops standing in for the weight; and a `step` (6,) of coarse readings.
    """
    stops = [blocks.wrench[segment.blocks] for blocks, segment in arm.segments]
    levels = np.array([np.median(stop, axis=0) for stop in stops])
    weight = np.repeat(np.sqrt(levels.var(axis=0).reshape(2, 3).sum(axis=1)), 3)
    least, floor = np.maximum(ACCEPTED_TURN * weight, STEPS * step), step**2 / (12.0 * arm.segments[0][0].rows)
    most = np.where(weight > 0.0, (MOST_CREEP * weight) ** 2, np.inf)
    return noise_at_all_lengths(stops, arm.window, least, floor, most)


def _resolution(samples: Samples, ends: list[tuple[int, int]]) -> Array:
    """The least step (6,) of the readings where the arm stands, and no less than rounding."""
    rows = np.concatenate([samples.wrench[a:b] for a, b in ends])[:MOST_ROWS_FOR_STEP]
    step = np.abs(np.diff(rows, axis=0))
    least = np.min(step, axis=0, initial=np.inf, where=step > 0.0)
    rounding = max(ROUNDING * float(np.abs(samples.wrench).max()), 1e-100)
    return np.maximum(np.where(np.isfinite(least), least, 0.0), rounding)


def _following(arm: StationaryArm) -> list[str | None]:
    """For each stop whose force goes on with the change from the one before, where most do, the reason: no creep
    depends on where the arm came from, but a filter's tail that is slower than the stops.
    """
    later = [np.array_split(blocks.wrench[segment.blocks, :3], 4)[2:] for blocks, segment in arm.segments]
    quarters = np.array([[quarter.mean(axis=0) for quarter in each] for each in later])
    change, drift = quarters[:-1, 1] - quarters[1:].mean(axis=1), quarters[1:, 0] - quarters[1:, 1]
    share = np.r_[0.0, np.sum(change * drift, axis=1) / np.maximum(np.sum(change**2, axis=1), 1e-300)]
    usual = float(np.median(share[1:])) if len(share) > FEWEST_TO_FOLLOW else 0.0
    chance = float(np.median(np.abs(share - usual))) / np.sqrt(len(share))
    if usual < max(FOLLOWS * chance, MOST_CREEP):
        return [None] * len(share)
    by = np.r_[0.0, np.linalg.norm(drift, axis=1)]
    text = "the force still follows the move before, by {} N: a filter is slower than the stops"
    return [text.format(two_digits(by[k])) if share[k] > 0.5 * usual else None for k in range(len(share))]


def _where_the_reading_stays(
    blocks: Blocks, stationary: Segment, noise: NoiseOfMeans, period: float, duration: float
) -> list[_Candidate]:
    """What lies within a segment in which the arm stands; the whole of it, with the reason, where nothing is still."""
    first, last = blocks.rows_of(stationary.first, stationary.last)
    seconds = (last - first) * period
    if not stationary.steady:
        angle = np.rad2deg(turn_over(blocks.path[stationary.blocks]))
        if seconds < duration:
            needed = f"{duration:.2g} s and {FEWEST_ROWS} rows are needed"
            return [_Candidate(first, last, f"too short: {seconds:.2g} s, {last - first} rows; {needed}")]
        return [_Candidate(first, last, f"the arm creeps: it turns by {angle:.2g} deg in {seconds:.2g} s")]
    wrench = blocks.wrench[stationary.blocks]
    settled, before = [], 0
    for segment in segments_between_changes(wrench, noise):
        begin = segment.first + int(np.ceil(SETTLING_MARGIN * (segment.first - before)))
        before = segment.last
        if not segment.steady:
            begin += _crept_after(wrench[begin : segment.last], noise)
        if begin < segment.last:
            settled.append(Segment(begin, segment.last, True))
    block = blocks.rows * period
    usable = [segment for segment in settled if len(segment) * block >= duration]
    if not usable:
        longest = max(settled, key=len, default=None)
        if longest is None or len(stationary) - longest.last > longest.first:
            return [_Candidate(first, last, _moves(wrench), moves=True)]
        left = len(longest) * block
        reason = f"too short: of {seconds:.2g} s the reading takes {seconds - left:.2g} s to settle, and {left:.2g} s "
        return [_Candidate(first, last, f"{reason}are left, {duration:.2g} s are needed")]
    if not _agree(wrench, usable, noise):
        return [_Candidate(first, last, _moves(wrench[usable[0].first :]), moves=True)]
    candidates: list[_Candidate] = []

    def add(a: int, b: int, off: str | None) -> None:
        rows = blocks.rows_of(stationary.first + a, stationary.first + b)
        candidates.append(_Candidate(*rows, off, moves=off is not None))

    end = 0
    for segment in usable:
        if candidates and segment.first > end:  # where two touch, nothing lies between that moves
            add(end, segment.first, _moves(wrench[end : segment.first], wrench[segment.blocks]))
        add(segment.first, segment.last, None)
        end = segment.last
    if len(stationary) - end >= 2 * noise.window:
        add(end, len(stationary), _moves(wrench[end:], wrench[usable[-1].first : end]))
    return candidates


def _crept_after(wrench: Array, noise: NoiseOfMeans) -> int:
    """How many blocks of a segment that moves to leave: half where that moves as slowly as sensors creep, else all."""
    earlier, later = np.array_split(wrench, 2)
    moved = np.abs(later.mean(axis=0) - earlier.mean(axis=0)) if len(later) else np.inf
    creeps = bool(np.all(moved <= MOST_CREEP / ACCEPTED_TURN * noise.least)) and is_steady(later, noise)
    return len(earlier) if creeps else len(wrench)


def _agree(wrench: Array, segments: list[Segment], noise: NoiseOfMeans) -> bool:
    """Whether the readings of all segments are at one level."""
    means = [wrench[segment.blocks].mean(axis=0) for segment in segments]
    return not any(
        noise.changes(
            (means[j] - means[i])[None],
            (len(segments[i]), len(segments[j])),
            0.5 * (segments[j].first + segments[j].last - segments[i].first - segments[i].last),
        ).any()
        for i, j in combinations(range(len(segments)), 2)
    )


def _moves(wrench: Array, level: Array | None = None) -> str:
    """By how much the reading (k, 6) moves, from what it mostly is or from a `level` (m, 6)."""
    off = wrench - (np.median(wrench, axis=0) if level is None else level.mean(axis=0))
    force, torque = (float(np.linalg.norm(part, axis=1).max()) for part in (off[:, :3], off[:, 3:]))
    return (
        f"the reading moves by {two_digits(force)} N and {two_digits(1e3 * torque)} mN m though the arm stands: "
        "contact, drift or vibration"
    )


def _judged(samples: Samples, candidates: list[_Candidate], window: int, step: Array, period: float) -> StillSegments:
    """The segments with their means, once it is known how much the rows of most scatter within `window` rows; coarse
    readings by a `step` (6,) at least.
    """
    scatter = [_scatter(samples.wrench[each.rows], max(window, FEWEST_ROWS)) for each in candidates]
    still = [own for own, each in zip(scatter, candidates, strict=True) if each.reason is None]
    usual = np.maximum(np.median(still, axis=0), step) if still else step
    reasons = [
        each.reason or _saturated(samples, each) or _shakes(own, usual)
        for own, each in zip(scatter, candidates, strict=True)
    ]
    judged = list(zip(candidates, reasons, strict=True))
    accepted = _segments(samples, [one for one in judged if one[1] is None])
    rejected = _segments(samples, [one for one in judged if one[1] is not None])
    return StillSegments(accepted, rejected, still_noise_of([samples.wrench[each.rows] for each in accepted], period))


def _segments(samples: Samples, candidates: list[tuple[_Candidate, str | None]]) -> tuple[StillSegment, ...]:
    means = mean_poses(samples, [each.rows for each, _ in candidates])
    return tuple(
        StillSegment(**vars(replace(mean, rejected=why)), first=each.first, last=each.last - 1, moves=each.moves)
        for mean, (each, why) in zip(means, candidates, strict=True)
    )


def _scatter(wrench: Array, rows: int) -> Array:
    """Standard deviation (6,) of readings (n, 6) about a straight line over so many rows: of what is no creep."""
    rows = min(rows, len(wrench))
    windows = wrench[: len(wrench) // rows * rows].reshape(-1, rows, 6)
    windows = windows - windows.mean(axis=1, keepdims=True)
    time = np.arange(rows) - 0.5 * (rows - 1)
    square = np.sum(windows**2, axis=1) - np.tensordot(time, windows, (0, 1)) ** 2 / float(time @ time)
    return np.asarray(np.sqrt(np.maximum(square, 0.0).mean(axis=0) / max(rows - 2, 1)))


def _saturated(samples: Samples, candidate: _Candidate) -> str | None:
    count = 0 if samples.saturated is None else int(samples.saturated[candidate.rows].sum())
    rows = candidate.last - candidate.first
    return f"saturated: {count} of {rows} rows stand at the sensor's limit" if count else None


def _shakes(scatter: Array, usual: Array) -> str | None:
    if not (scatter > SHAKING * usual).any():
        return None
    worst = int(np.argmax(scatter / np.maximum(usual, 1e-300)))
    unit, scale = ("N", 1.0) if worst < 3 else ("mN m", 1e3)
    return (
        f"the reading shakes though the arm stands: {AXES[worst]} scatters by "
        f"{two_digits(scale * scatter[worst])} {unit}, {two_digits(scale * usual[worst])} in the other stretches: "
        "contact or vibration"
    )
