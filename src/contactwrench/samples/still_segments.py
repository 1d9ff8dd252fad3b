"""Still stretches of a recording: where the arm stands and the reading stays, and why the others are left out.

The rule. A recording is cut where its times have a gap, and averaged over blocks of 20 ms. The arm stands where its
orientation does not change (levels.py: windows of 0.1 s, or of three rows where those take longer), by more than its
own noise and `STILL_ANGLE`; then the same is asked of the reading, its noise taken from where the arm stands. The
beginning of a stretch is cut to where neither the arm swings nor a filter's tail is left that the data show, and by
half as long again, as a tail is there before and after it shows. What is left must last `LEAST_DURATION`, and long
enough for the noise to be independent a few times over.

False alarms: levels.py asks once a window, at a probability of one in a million, whether two neighbours differ; of
3,000 stops in ten kinds of runs three are lost, all at 10 Hz with a noisy orientation (benchmarks/stillness.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..errors import InputError, two_digits
from ..geometry.arrays import Array, read_only
from .change_detection import Noise, Piece, noise_of_windows, pieces_between_changes
from .samples import Samples
from .stationary_arm import FEWEST_ROWS, Section, sections_of, standing_arm, turn_over

LEAST_DURATION = 0.3
"""s: an arm that turns round stands for as long."""

FEWEST_INDEPENDENT = 3.0
"""Of the readings in a stretch: with fewer nobody can tell noise from a tail."""

SETTLING_MARGIN = 0.5
"""Of the time that a tail was seen, that it is taken to last beyond."""

SHAKING = 3.0
"""Times the scatter of the recording's stretches: a stretch that scatters more shakes."""

MOST_ROWS_FOR_STEP = 100_000
ROUNDING = 1e-9
LEAST_LAGS, MOST_LAGS = 4, 100
MOST_LOST = 0.5
"""Of the sum of correlations, that the unknown mean of short stretches is corrected for."""

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class StillStretch:
    """Rows `first` to `last`, both included, in which the arm stands: `t_start`, `t_end` s; `n` rows; `R_base_flange`
    (3, 3) and `wrench` (6,) N and N m, their means; `wrench_cov` (6, 6) of that mean, the correlation of the rows in
    time counted; `independent` readings that the rows are worth; `rejected` why it is left out, None where it is not.
    """

    first: int
    last: int
    t_start: float
    t_end: float
    n: int
    R_base_flange: Array
    wrench: Array
    wrench_cov: Array
    independent: float
    rejected: str | None = None

    def __post_init__(self) -> None:
        for name in ("R_base_flange", "wrench", "wrench_cov"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class StillStretches:
    """The stretches of a recording in which the arm stands, `accepted` and `rejected`, each in the order of time.

    `noise` (6,) N and N m: standard deviation of a row within stretches; `least_duration` s that a stretch must last.
    """

    accepted: tuple[StillStretch, ...]
    rejected: tuple[StillStretch, ...]
    noise: Array
    least_duration: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise", read_only(self.noise))


@dataclass(frozen=True, eq=False)
class _Found:
    """Rows `first` up to `last`, and why they are no stretch, where that is known already."""

    first: int
    last: int
    reason: str | None = None


def still_stretches(samples: Samples) -> StillStretches:
    """Find where arm and reading are still in samples with times, rows in the order in which they were recorded.

    Raises `InputError` for samples without times.
    """
    if samples.t is None:
        raise InputError(f"{samples.source}: found no times, expected a column t: stillness shows in time only")
    period, sections = sections_of(samples)
    arm = standing_arm(sections, period, max(LEAST_DURATION, FEWEST_ROWS * period))
    if not arm.pieces:
        return StillStretches((), (), np.zeros(6), arm.duration)
    rows, window, standing = sections[0].rows, arm.window, arm.pieces
    scatter = _scatter_of_rows(samples, [s.rows_of(p.first, p.last) for s, p in standing], rows * window)
    readings = [s.wrench[p.first : p.last] for s, p in standing]
    moving = noise_of_windows(readings, window, scatter, scatter**2 / (rows * window), joint=False)
    found = [
        one for section, piece in standing for one in _of_standing_arm(section, piece, moving, period, arm.duration)
    ]
    return _judged(samples, found, rows, scatter, arm.duration)


def _scatter_of_rows(samples: Samples, standing: list[tuple[int, int]], rows: int) -> Array:
    """Standard deviation (6,) of the rows within a window, of most windows in which the arm stands, and at least what
    the steps of the readings and rounding make of it.
    """
    parts = [samples.wrench[a : a + (b - a) // rows * rows].reshape(-1, rows, 6) for a, b in standing if b - a >= rows]
    if not parts:
        return np.zeros(6)
    variance = np.median(np.concatenate([part.var(axis=1, ddof=1) for part in parts]), axis=0)
    step = np.abs(np.diff(np.concatenate([part.reshape(-1, 6) for part in parts])[:MOST_ROWS_FOR_STEP], axis=0))
    least = np.min(step, axis=0, initial=np.inf, where=step > 0.0)
    rounding = ROUNDING * float(np.abs(samples.wrench).max())
    scatter: Array = np.maximum(np.sqrt(variance), np.maximum(0.5 * np.where(np.isfinite(least), least, 0.0), rounding))
    return scatter


def _of_standing_arm(section: Section, standing: Piece, moving: Noise, period: float, duration: float) -> list[_Found]:
    """The stretches within a piece in which the arm stands; the whole piece, with the reason, where there is none."""
    first, last = section.rows_of(standing.first, standing.last)
    seconds = (last - first) * period
    if not standing.level:
        angle = np.rad2deg(turn_over(section.way[standing.first : standing.last]))
        if seconds < duration:
            return [_Found(first, last, _too_short(seconds, duration, last - first))]
        return [_Found(first, last, f"the arm creeps: it turns by {angle:.2g} deg in {seconds:.2g} s")]
    wrench = section.wrench[standing.first : standing.last]
    pieces, before = [], 0
    for piece in pieces_between_changes(wrench, moving):
        begin = piece.first + int(np.ceil(SETTLING_MARGIN * (piece.first - before)))
        before = piece.last
        if piece.level and begin < piece.last:
            pieces.append(Piece(begin, piece.last, True))
    block = section.rows * period
    usable = [piece for piece in pieces if (piece.last - piece.first) * block >= duration]
    if not usable:
        longest = max(pieces, key=lambda piece: piece.last - piece.first, default=None)
        if longest is None or standing.last - standing.first - longest.last > longest.first:
            return [_Found(first, last, _moves(wrench))]
        left = (longest.last - longest.first) * block
        reason = f"too short: of {seconds:.2g} s the reading takes {seconds - left:.2g} s to settle, and {left:.2g} s "
        return [_Found(first, last, f"{reason}are left, {duration:.2g} s are needed")]
    if not _agree(wrench, usable, moving):
        return [_Found(first, last, _moves(wrench[usable[0].first :]))]
    found: list[_Found] = []
    end = 0
    for piece in usable:
        if found and piece.first > end:  # where two touch, nothing lies between that moves
            between = section.rows_of(standing.first + end, standing.first + piece.first)
            found.append(_Found(*between, _moves(wrench[end : piece.first], wrench[piece.first : piece.last])))
        rows = section.rows_of(standing.first + piece.first, standing.first + piece.last)
        found.append(_Found(*rows))
        end = piece.last
    if standing.last - standing.first - end >= 2 * moving.window:
        rest = section.rows_of(standing.first + end, standing.last)
        found.append(_Found(*rest, _moves(wrench[end:], wrench[usable[-1].first : end])))
    return found


def _too_short(seconds: float, duration: float, rows: int) -> str:
    return f"too short: {seconds:.2g} s, {rows} rows; {duration:.2g} s and {FEWEST_ROWS} rows are needed"


def _agree(wrench: Array, pieces: list[Piece], noise: Noise) -> bool:
    """Whether the readings of all pieces are at one level."""
    means = [(wrench[p.first : p.last].mean(axis=0), p.last - p.first) for p in pieces]
    return not any(
        noise.changes((one - other)[None], of, over).any() for (one, of), (other, over) in combinations(means, 2)
    )


def _moves(wrench: Array, level: Array | None = None) -> str:
    """By how much the reading (k, 6) moves, from what it mostly is or from a `level` (m, 6)."""
    off = wrench - (np.median(wrench, axis=0) if level is None else level.mean(axis=0))
    force, torque = (float(np.linalg.norm(part, axis=1).max()) for part in (off[:, :3], off[:, 3:]))
    return (
        f"the reading moves by {two_digits(force)} N and {two_digits(1e3 * torque)} mN m though the arm stands: "
        "contact, drift or vibration"
    )


def _judged(samples: Samples, found: list[_Found], rows: int, least: Array, duration: float) -> StillStretches:
    """The stretches with their means, once it is known how much the rows scatter and how far they are correlated."""
    kept = [one for one in found if one.reason is None]
    pooled = [samples.wrench[one.first : one.last] for one in kept]
    scatter = [y.std(axis=0, ddof=1) for y in pooled]
    usual = np.maximum(np.median(scatter, axis=0), least) if scatter else least
    worth = _rows_per_independent(pooled, rows)
    accepted, rejected = [], []
    for one in found:
        stretch = _stretch(samples, one, worth)
        reason = one.reason or _saturated(samples, one) or _shakes(samples, one, usual)
        if reason is None and stretch.independent < FEWEST_INDEPENDENT:
            reason = (
                f"too short: its {stretch.n} rows are worth {stretch.independent:.2g} independent readings, "
                f"{FEWEST_INDEPENDENT:.0f} are needed, {FEWEST_INDEPENDENT * stretch.n / stretch.independent:.0f} rows"
            )
        if reason is None:
            accepted.append(stretch)
        else:
            rejected.append(replace(stretch, rejected=reason))
    return StillStretches(tuple(accepted), tuple(rejected), usual, duration)


def _saturated(samples: Samples, found: _Found) -> str | None:
    saturated = samples.saturated
    count = 0 if saturated is None else int(saturated[found.first : found.last].sum())
    return f"saturated: {count} of {found.last - found.first} rows stand at the sensor's limit" if count else None


def _shakes(samples: Samples, found: _Found, usual: Array) -> str | None:
    scatter = samples.wrench[found.first : found.last].std(axis=0, ddof=1)
    if not (scatter > SHAKING * usual).any():
        return None
    worst = int(np.argmax(scatter / np.maximum(usual, 1e-300)))
    unit, scale = ("N", 1.0) if worst < 3 else ("mN m", 1e3)
    return (
        f"the reading shakes though the arm stands: {AXES[worst]} scatters by "
        f"{two_digits(scale * scatter[worst])} {unit}, {two_digits(scale * usual[worst])} in the other stretches: "
        "contact or vibration"
    )


def _rows_per_independent(stretches: list[Array], rows: int) -> Array:
    """How many rows (6,) are worth one independent reading: the correlation in time of the means of blocks, summed as
    long as neighbouring lags add up to more than zero (Geyer 1992), of all stretches together.
    """
    blocks = [y[: len(y) // rows * rows].reshape(-1, rows, 6).mean(axis=1) for y in stretches]
    blocks = [b - b.mean(axis=0) for b in blocks if len(b) >= 2 * LEAST_LAGS]
    if not blocks:
        return np.ones(6)
    count = sum(len(b) - 1 for b in blocks)
    lags = min(MOST_LAGS, min(len(b) for b in blocks) // 2)
    of_row = sum((np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in stretches), np.zeros(6))
    of_row = np.maximum(of_row / sum(len(y) - 1 for y in stretches), 1e-300)
    products = [np.array([np.sum(b[k:] * b[: len(b) - k], axis=0) for k in range(lags)]) for b in blocks]
    covariance = np.sum(products, axis=0) / (count - np.arange(lags)[:, None] * len(blocks))
    pairs = covariance[0 : lags // 2 * 2 : 2] + covariance[1 : lags // 2 * 2 : 2]
    positive = np.cumprod(pairs > covariance[0] * np.sqrt(2.0 / count), axis=0)
    used = 2 * positive.sum(axis=0)
    summed = 2.0 * np.sum(positive * pairs, axis=0) - covariance[0]
    lost = np.minimum((2.0 * used - 1.0) * len(blocks) / (count + len(blocks)), MOST_LOST)
    worth: Array = np.maximum(rows * summed / (1.0 - lost) / of_row, 1.0)
    return worth


def _stretch(samples: Samples, found: _Found, worth: Array) -> StillStretch:
    t = samples.t if samples.t is not None else np.empty(0)
    wrench = samples.wrench[found.first : found.last]
    n = len(wrench)
    from_first = wrench - wrench[0]
    mean = from_first.mean(axis=0)
    centred = (from_first - mean) * np.sqrt(worth)
    U, _, Vt = np.linalg.svd(samples.R_base_flange[found.first : found.last].mean(axis=0))
    return StillStretch(
        first=found.first,
        last=found.last - 1,
        t_start=float(t[found.first]),
        t_end=float(t[found.last - 1]),
        n=n,
        R_base_flange=U @ Vt,
        wrench=wrench[0] + mean,
        wrench_cov=centred.T @ centred / (n * (n - 1.0)),
        independent=float(n / worth.max()),
        rejected=found.reason,
    )
