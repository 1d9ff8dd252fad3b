"""Still segments of a recording: where the arm stands and the reading stays, and why the others are left out.

The rule. A recording is cut where its times have a gap, and averaged over blocks of 20 ms. The arm stands where its
orientation does not change (change_detection.py: windows of 0.1 s, or of three rows where those take longer), by more
than its own noise and `STILL_ANGLE`; then the same is asked of the reading, its noise taken from where the arm stands.
The beginning of a segment is cut to where neither the arm swings nor a filter's tail is left that the data show, and by
half as long again, as a tail is there before and after it shows. What is left must last `LEAST_DURATION`, and long
enough for the noise to be independent a few times over.

False alarms: change_detection.py asks once a window, at a probability of one in a million, whether two neighbours
differ; of 3,000 stops in ten kinds of runs three are lost, all at 10 Hz with a noisy orientation
(benchmarks/stillness.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen
from ..model import AXES
from ..statistics import two_digits
from .change_detection import Segment, WindowNoise, noise_of_windows, segments_between_changes
from .motion import FEWEST_ROWS, Blocks, blocks_of, stationary_arm, turn_over
from .poses import Pose, mean_pose
from .samples import Samples

LEAST_DURATION = 0.3
"""s: an arm that turns round stands for as long."""

FEWEST_INDEPENDENT = 3.0
"""Of the readings in a segment: with fewer nobody can tell noise from a tail."""

SETTLING_MARGIN = 0.5
"""Of the time that a tail was seen, that it is taken to last beyond."""

SHAKING = 3.0
"""Times the scatter of the recording's segments: a segment that scatters more shakes."""

MOST_ROWS_FOR_STEP = 100_000
ROUNDING = 1e-9
LEAST_LAGS, MOST_LAGS = 4, 100
MOST_LOST = 0.5
"""Of the sum of correlations, that the unknown mean of short segments is corrected for."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StillSegment(Pose):
    """Rows `first` to `last`, both included, in which the arm stands, and their mean: the correlation of the rows in
    time is counted in `wrench_cov`; `independent` readings that the rows are worth; the reading `moves`.
    """

    first: int
    last: int
    t_start: float
    t_end: float
    independent: float
    moves: bool


@dataclass(frozen=True, eq=False)
class StillSegments(Frozen):
    """The segments of a recording in which the arm stands, `accepted` and `rejected`, each in the order of time.

    `noise` (6,) N and N m: standard deviation of a row within segments; `least_duration` s that a segment must last.
    """

    accepted: tuple[StillSegment, ...]
    rejected: tuple[StillSegment, ...]
    noise: Array
    least_duration: float


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

    Raises:
        InputError: samples without times.
    """
    if samples.t is None:
        raise InputError(f"{samples.source}: found no times, expected a column t: stillness shows in time only")
    period, between_gaps = blocks_of(samples)
    arm = stationary_arm(between_gaps, period, max(LEAST_DURATION, FEWEST_ROWS * period))
    if not arm.segments:
        return StillSegments((), (), np.zeros(6), arm.duration)
    rows, window = between_gaps[0].rows, arm.window
    scatter = _scatter_of_rows(samples, [b.rows_of(s.first, s.last) for b, s in arm.segments], rows * window)
    readings = [blocks.wrench[segment.blocks] for blocks, segment in arm.segments]
    noise = noise_of_windows(readings, window, scatter, scatter**2 / (rows * window), joint=False)
    candidates = [
        candidate
        for blocks, segment in arm.segments
        for candidate in _where_the_reading_stays(blocks, segment, noise, period, arm.duration)
    ]
    return _judged(samples, candidates, rows, scatter, arm.duration)


def _scatter_of_rows(samples: Samples, ends: list[tuple[int, int]], rows: int) -> Array:
    """Standard deviation (6,) of the rows within a window, of most windows in which the arm stands, and at least what
    the steps of the readings and rounding make of it.
    """
    parts = [samples.wrench[a : a + (b - a) // rows * rows].reshape(-1, rows, 6) for a, b in ends if b - a >= rows]
    if not parts:
        return np.zeros(6)
    variance = np.median(np.concatenate([part.var(axis=1, ddof=1) for part in parts]), axis=0)
    step = np.abs(np.diff(np.concatenate([part.reshape(-1, 6) for part in parts])[:MOST_ROWS_FOR_STEP], axis=0))
    least = np.min(step, axis=0, initial=np.inf, where=step > 0.0)
    rounding = ROUNDING * float(np.abs(samples.wrench).max())
    scatter: Array = np.maximum(np.sqrt(variance), np.maximum(0.5 * np.where(np.isfinite(least), least, 0.0), rounding))
    return scatter


def _where_the_reading_stays(
    blocks: Blocks, stationary: Segment, noise: WindowNoise, period: float, duration: float
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
        if segment.steady and begin < segment.last:
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


def _agree(wrench: Array, segments: list[Segment], noise: WindowNoise) -> bool:
    """Whether the readings of all segments are at one level."""
    means = [(wrench[segment.blocks].mean(axis=0), len(segment)) for segment in segments]
    return not any(
        noise.changes((mean - other)[None], of, over).any() for (mean, of), (other, over) in combinations(means, 2)
    )


def _moves(wrench: Array, level: Array | None = None) -> str:
    """By how much the reading (k, 6) moves, from what it mostly is or from a `level` (m, 6)."""
    off = wrench - (np.median(wrench, axis=0) if level is None else level.mean(axis=0))
    force, torque = (float(np.linalg.norm(part, axis=1).max()) for part in (off[:, :3], off[:, 3:]))
    return (
        f"the reading moves by {two_digits(force)} N and {two_digits(1e3 * torque)} mN m though the arm stands: "
        "contact, drift or vibration"
    )


def _judged(samples: Samples, candidates: list[_Candidate], rows: int, least: Array, duration: float) -> StillSegments:
    """The segments with their means, once it is known how much the rows scatter and how far they are correlated."""
    pooled = [samples.wrench[each.rows] for each in candidates if each.reason is None]
    scatter = [wrench.std(axis=0, ddof=1) for wrench in pooled]
    usual = np.maximum(np.median(scatter, axis=0), least) if scatter else least
    worth = _rows_per_independent(pooled, rows)
    segments = [_segment(samples, candidate, worth, usual) for candidate in candidates]
    accepted = tuple(segment for segment in segments if segment.rejected is None)
    rejected = tuple(segment for segment in segments if segment.rejected is not None)
    return StillSegments(accepted, rejected, usual, duration)


def _segment(samples: Samples, candidate: _Candidate, worth: Array, usual: Array) -> StillSegment:
    t = samples.t if samples.t is not None else np.empty(0)
    mean = mean_pose(samples.wrench[candidate.rows], samples.R_base_flange[candidate.rows], t[candidate.rows], worth)
    independent = float(mean.n / worth.max())
    reason = candidate.reason or _saturated(samples, candidate) or _shakes(samples, candidate, usual)
    if reason is None and independent < FEWEST_INDEPENDENT:
        reason = (
            f"too short: its {mean.n} rows are worth {independent:.2g} independent readings, "
            f"{FEWEST_INDEPENDENT:.0f} are needed, {FEWEST_INDEPENDENT * mean.n / independent:.0f} rows"
        )
    known = vars(replace(mean, rejected=reason))
    return StillSegment(
        **known, first=candidate.first, last=candidate.last - 1, independent=independent, moves=candidate.moves
    )


def _saturated(samples: Samples, candidate: _Candidate) -> str | None:
    count = 0 if samples.saturated is None else int(samples.saturated[candidate.rows].sum())
    rows = candidate.last - candidate.first
    return f"saturated: {count} of {rows} rows stand at the sensor's limit" if count else None


def _shakes(samples: Samples, candidate: _Candidate, usual: Array) -> str | None:
    scatter = samples.wrench[candidate.rows].std(axis=0, ddof=1)
    if not (scatter > SHAKING * usual).any():
        return None
    worst = int(np.argmax(scatter / np.maximum(usual, 1e-300)))
    unit, scale = ("N", 1.0) if worst < 3 else ("mN m", 1e3)
    return (
        f"the reading shakes though the arm stands: {AXES[worst]} scatters by "
        f"{two_digits(scale * scatter[worst])} {unit}, {two_digits(scale * usual[worst])} in the other stretches: "
        "contact or vibration"
    )


def _rows_per_independent(segments: list[Array], rows: int) -> Array:
    """How many rows (6,) are worth one independent reading: the correlation in time of the means of blocks, summed as
    long as neighbouring lags add up to more than zero (Geyer 1992), of all segments together.
    """
    blocks = [y[: len(y) // rows * rows].reshape(-1, rows, 6).mean(axis=1) for y in segments]
    blocks = [b - b.mean(axis=0) for b in blocks if len(b) >= 2 * LEAST_LAGS]
    if not blocks:
        return np.ones(6)
    count = sum(len(b) - 1 for b in blocks)
    lags = min(MOST_LAGS, min(len(b) for b in blocks) // 2)
    of_row = sum((np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in segments), np.zeros(6))
    of_row = np.maximum(of_row / sum(len(y) - 1 for y in segments), 1e-300)
    products = [np.array([np.sum(b[k:] * b[: len(b) - k], axis=0) for k in range(lags)]) for b in blocks]
    covariance = np.sum(products, axis=0) / (count - np.arange(lags)[:, None] * len(blocks))
    pairs = covariance[0 : lags // 2 * 2 : 2] + covariance[1 : lags // 2 * 2 : 2]
    positive = np.cumprod(pairs > covariance[0] * np.sqrt(2.0 / count), axis=0)
    used = 2 * positive.sum(axis=0)
    summed = 2.0 * np.sum(positive * pairs, axis=0) - covariance[0]
    lost = np.minimum((2.0 * used - 1.0) * len(blocks) / (count + len(blocks)), MOST_LOST)
    worth: Array = np.maximum(rows * summed / (1.0 - lost) / of_row, 1.0)
    return worth
