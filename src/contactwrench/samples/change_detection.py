"""Where values in noise stay at one level: the noise of their means by length, and the segments between their changes.

Two neighbouring windows whose means differ by more than their noise are a change; what changes more slowly is looked
for with windows twice as long, and so on (method, "Still segments").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array

FALSE_ALARM = 1e-6
"""Probability that two neighbouring windows of white noise are taken for a change."""

END_ALARM = 2e-5
"""The same where the beginning of a segment is compared with what follows: a later beginning costs little."""

MOST_STD = 12.0
"""Standard deviations that are a change, however few stops tell what is usual."""

QUIETEST = 0.05
"""Of all windows, that are taken for still to begin with."""

ROUNDS = 6
SETTLED = 1e-3
TAIL_WINDOWS, ONSET_WINDOWS = 4.0, 0.5
"""Up to so many windows the beginning of a segment is compared: a drift that is slower is no tail. Where the length of
a change counts, no longer than a whole window would show it, too."""

CLEARLY = 2.0
"""Times the least change: windows that are long enough to part what changes slowly from what does not show as much."""

PARTS = 8
"""Into which a segment is cut to see whether it stays at one level."""

BEYOND, FASTEST_GROWTH = 2, 4.0
"""Doublings beyond the lengths whose noise shows in half a stop; and of the variance with each, of what creeps evenly.
"""

CERTAIN = 1e9
"""Blocks, or degrees of freedom: more than there are."""

MEDIAN_OF_SQUARE = 0.4549
"""Of a standard normal number."""


@dataclass(frozen=True, eq=False)
class NoiseOfMeans:
    """`variance` (k, d) of means over `lengths` (k,) blocks, with `dof` (k,); a change is first looked for between
    windows of `window` blocks, and is none where it is smaller than `least` (d,).

    Where `joint`, the length of the change counts against the one variance and the one `least` that all axes share;
    else each axis counts alone.
    """

    lengths: Array
    variance: Array
    dof: Array
    window: int
    least: Array
    joint: bool

    def over(self, length: float) -> Array:
        """The variance (d,) of a mean over so many blocks; that of the longest known one beyond it."""
        at, known = np.log(length), np.log(self.lengths)
        return np.exp([np.interp(at, known, log_variance) for log_variance in np.log(self.variance.T)])

    def changes(
        self,
        difference: Array,
        lengths: tuple[float, float],
        apart: float = 0.0,
        alarm: float = FALSE_ALARM,
        least: Array | None = None,
    ) -> NDArray[np.bool_]:
        """Whether differences (n, d) between means over two `lengths`, their middles `apart` blocks (0: neighbours),
        are beyond noise, whose probability is `alarm`, and `least` (d,); None: the noise's own.
        """
        from scipy.special import chdtri, stdtrit

        least = self.least if least is None else least
        variance = self.over(lengths[0]) + self.over(lengths[1])
        if apart:  # what wanders, wanders further from a mean to a distant one than to the next
            variance += 2.0 * np.maximum(self.over(apart) - self.over(min(lengths)), 0.0)
        d = difference.shape[-1]
        if self.joint:
            return np.asarray(np.sum(difference**2, axis=-1) > max(chdtri(d, alarm) * variance[0], least[0] ** 2))
        dof = float(np.interp(max(apart, *lengths), self.lengths, self.dof))
        beyond = min(-float(stdtrit(dof, 0.5 * alarm / d)), MOST_STD)
        return np.asarray((np.abs(difference) > np.maximum(beyond * np.sqrt(variance), least)).any(axis=-1))


def noise_at_all_lengths(series: Sequence[Array], window: int, least: Array, floor: Array, most: Array) -> NoiseOfMeans:
    """The noise of means of the readings (n, d) of stops, each axis alone: half the square of how far each differs from
    the one before (Allan 1966), the median over a stop and then over the stops, from the later half of each, where most
    has settled. `floor` (d,): the least variance of a block; `most` (d,): the largest of what is no white noise.
    """
    later = [values[len(values) // 2 :] for values in series]
    curve: list[tuple[float, Array, float]] = []
    for length in 2 ** np.arange(31):
        usable = [values for values in later if len(values) >= 2 * length]
        if not usable:
            break
        squares = np.median([np.median(_steps(values, int(length)) ** 2, axis=0) for values in usable], axis=0)
        allan = np.maximum(0.5 * squares / MEDIAN_OF_SQUARE, floor / length)
        if curve:
            white = 0.5 * curve[-1][1]
            allan = np.clip(allan, white, np.maximum(white, most))
        curve.append((float(length), allan, sum(map(len, usable)) / (2.0 * length)))
    for _ in range(BEYOND if len(curve) > 1 else 0):  # to the length of a stop it goes on as it went last
        longest, allan, freedom = curve[-1]
        white = 0.5 * allan
        growth = np.clip(allan / curve[-2][1], 0.5, FASTEST_GROWTH)
        curve.append((2.0 * longest, np.clip(growth * allan, white, np.maximum(white, most)), freedom))
    lengths, variance, dof = zip(*curve or [(1.0, floor, 1.0)], strict=True)
    return NoiseOfMeans(np.array(lengths), np.array(variance), np.array(dof), window, least, joint=False)


def noise_of_windows(series: Sequence[Array], window: int, least: float, floor: float) -> NoiseOfMeans:
    """The noise of the means of windows, from the quietest parts of all `series` (n, d) of blocks, white beyond them:
    from the second difference of three windows in a row, which no steady movement changes, over the windows that do not
    differ from their neighbours. Their axes count jointly; `floor` is the least variance.
    """
    from scipy.special import chdtri

    means = [_means(values, window) for values in series if len(values) >= 3 * window]
    d = series[0].shape[1]

    def noise(variance: float) -> NoiseOfMeans:
        of_block = np.full((2, d), variance * window)
        lengths = np.array([1.0, CERTAIN])
        return NoiseOfMeans(lengths, of_block / lengths[:, None], np.full(2, CERTAIN), window, np.full(d, least), True)

    if not means:
        return noise(floor)
    first = [m[window:] - m[:-window] for m in means]
    steps = np.concatenate([np.stack([f[:-window], f[window:]], axis=1) for f in first])
    squares = np.sum(np.concatenate([f[window:] - f[:-window] for f in first]) ** 2, axis=1)

    def of_quantile(values: Array, share: float) -> float:
        """The variance of a window's mean: a bend has six times that."""
        return max(float(np.quantile(values, share)) / (6.0 * float(chdtri(d, 1.0 - share))), floor)

    variance = of_quantile(squares, QUIETEST)
    for _ in range(ROUNDS):
        still = ~noise(variance).changes(steps, (window, window)).any(axis=1)
        before = variance
        variance = of_quantile(squares[still], 0.5) if still.any() else variance
        if abs(variance - before) <= SETTLED * before:
            break
    return noise(variance)


def _steps(values: Array, length: int) -> Array:
    """How far means (n, d) over so many blocks differ from those over the blocks before."""
    means = _means(values, length)
    return means[length:] - means[:-length]


def _means(values: Array, window: int) -> Array:
    """Means (n - window + 1, d) of the windows that begin at each block."""
    sums = _sums(values)
    return (sums[window:] - sums[:-window]) / window + values[:1]


def _sums(values: Array) -> Array:
    """What the first k blocks, less the first one, add up to (n + 1, d)."""
    sums = np.zeros((len(values) + 1, values.shape[1]))
    np.cumsum(values - values[:1], axis=0, out=sums[1:])
    return sums


@dataclass(frozen=True)
class Segment:
    """Blocks `first` to `last`, the latter not included; `steady` says whether the values stay at one level there."""

    first: int
    last: int
    steady: bool

    def __len__(self) -> int:
        return self.last - self.first

    @property
    def blocks(self) -> slice:
        """Of the segment."""
        return slice(self.first, self.last)


def segments_between_changes(values: Array, noise: NoiseOfMeans) -> list[Segment]:
    """The segments of values (n, d) without a change, in order, their ends trimmed to where the level is reached."""
    return _segments(values, noise, 0, len(values), noise.window)


def _segments(values: Array, noise: NoiseOfMeans, first: int, last: int, window: int) -> list[Segment]:
    if last - first < 2 * window:
        return []
    differences = _steps(values[first:last], window)
    if window > noise.window and not noise.changes(differences / CLEARLY, (window, window)).any():
        longer = _segments(values, noise, first, last, 2 * window) if last - first >= 4 * window else []
        return longer or [Segment(first, last, False)]
    unchanged = ~noise.changes(differences, (window, window))
    edges = np.flatnonzero(np.diff(np.r_[False, unchanged, False].astype(np.int8)))
    segments: list[Segment] = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        a, b = first + begin, first + end + 2 * window - 1
        a += _settled_after(values[a:b], noise)
        b -= _settled_after(values[a:b][::-1], noise)
        if segments:
            a = max(a, segments[-1].last)
        if b - a < 2 * window:
            continue
        steady = is_steady(values[a:b], noise)
        longer = _segments(values, noise, a, b, 2 * window) if not steady and b - a >= 4 * window else []
        segments += longer or [Segment(a, b, steady)]
    return segments


def is_steady(values: Array, noise: NoiseOfMeans) -> bool:
    """Whether no part of a segment (n, d) differs from another beyond noise."""
    parts = min(PARTS, len(values) // noise.window)
    if parts < 2:
        return True
    edges = np.linspace(0, len(values), parts + 1).astype(int)
    means = np.array([values[a:b].mean(axis=0) for a, b in pairwise(edges)])
    length = len(values) / parts
    return not any(noise.changes(means[k:] - means[:-k], (length, length), k * length).any() for k in range(1, parts))


def _settled_after(values: Array, noise: NoiseOfMeans) -> int:
    """How many blocks at the beginning are not yet at the level that follows: a movement begins, a tail ends."""
    n = len(values)
    off = np.zeros(n + 1, dtype=bool)
    least = noise.least if noise.joint else 0.0 * noise.least  # an axis that counts alone may not be off at all
    sums, size = _sums(values), 1
    while size <= (ONSET_WINDOWS if noise.joint else TAIL_WINDOWS) * noise.window and 3 * size <= n:
        means = (sums[size:] - sums[:-size]) / size
        after = 0.5 * (means[size:-size] + means[2 * size :])
        off[: len(after)] |= noise.changes(means[: -2 * size] - after, (size, 2 * size), alarm=END_ALARM, least=least)
        size *= 2
    return int(np.argmin(off))
