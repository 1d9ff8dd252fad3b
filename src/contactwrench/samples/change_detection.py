"""Where values in noise stay at one level: the noise of their window means, and the segments between their changes.

The noise is that of the means of windows, whatever the correlation of the rows: the second difference of three windows
in a row, which no steady movement changes, over the windows that do not differ from their neighbours. Two neighbouring
windows whose means differ by more than this noise gives once in a million windows are a change. What changes more
slowly than the window shows is looked for with windows twice as long, and so on.
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


@dataclass(frozen=True, eq=False)
class WindowNoise:
    """`variance` (d,) of the mean of `window` blocks; a change smaller than `least` (d,) is none.

    Where `joint`, the length of the change counts against the one variance and the one `least` that all axes share;
    else each axis counts alone.
    """

    variance: Array
    window: int
    least: Array
    joint: bool

    def changes(
        self, difference: Array, of: float, over: float, alarm: float = FALSE_ALARM, least: Array | None = None
    ) -> NDArray[np.bool_]:
        """Whether differences (n, d) of a mean over `of` blocks from one over `over` blocks are beyond noise, whose
        probability is `alarm`, and `least` (d,); None: the noise's own.
        """
        from scipy.special import chdtri, ndtri

        least = self.least if least is None else least
        variance = self.variance * self.window * (1.0 / of + 1.0 / over)
        d = difference.shape[-1]
        if self.joint:
            return np.asarray(np.sum(difference**2, axis=-1) > max(chdtri(d, alarm) * variance[0], least[0] ** 2))
        of_each = np.maximum(-ndtri(0.5 * alarm / d) * np.sqrt(variance), least)
        return np.asarray((np.abs(difference) > of_each).any(axis=-1))


def noise_of_windows(series: Sequence[Array], window: int, least: Array, floor: Array, joint: bool) -> WindowNoise:
    """The noise of the means of windows, from the quietest parts of all `series` (n, d) of blocks; `floor` (d,) is the
    least variance.
    """
    from scipy.special import chdtri, ndtri

    means = [_means(values, window) for values in series if len(values) >= 3 * window]
    d = len(least)
    if not means:
        return WindowNoise(floor, window, least, joint)
    first = [m[window:] - m[:-window] for m in means]
    steps = np.concatenate([np.stack([f[:-window], f[window:]], axis=1) for f in first])
    bends = np.concatenate([f[window:] - f[:-window] for f in first])
    squares = np.sum(bends**2, axis=1, keepdims=True) if joint else bends**2

    def of_quantile(values: Array, share: float) -> Array:
        """The variance (d,) of a window's mean: a bend has six times that."""
        expected = chdtri(d, 1.0 - share) if joint else ndtri(0.5 + 0.5 * share) ** 2
        at_quantile: Array = np.quantile(values, share, axis=0) / (6.0 * expected)
        return np.maximum(np.broadcast_to(at_quantile, (d,)), floor).astype(np.float64)

    variance = of_quantile(squares, QUIETEST)
    for _ in range(ROUNDS):
        noise = WindowNoise(variance, window, least, joint)
        still = ~noise.changes(steps, window, window).any(axis=1)
        before = variance
        variance = of_quantile(squares[still], 0.5) if still.any() else variance
        if (np.abs(variance - before) <= SETTLED * before).all():
            break
    return WindowNoise(variance, window, least, joint)


def _means(values: Array, window: int) -> Array:
    """Means (n - window + 1, d) of the windows that begin at each block."""
    sums = _sums(values)
    means: Array = (sums[window:] - sums[:-window]) / window + values[:1]
    return means


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


def segments_between_changes(values: Array, noise: WindowNoise) -> list[Segment]:
    """The segments of values (n, d) without a change, in order, their ends trimmed to where the level is reached."""
    return _segments(values, noise, 0, len(values), noise.window)


def _segments(values: Array, noise: WindowNoise, first: int, last: int, window: int) -> list[Segment]:
    if last - first < 2 * window:
        return []
    means = _means(values[first:last], window)
    differences = means[window:] - means[:-window]
    if window > noise.window and not noise.changes(differences / CLEARLY, window, window).any():
        longer = _segments(values, noise, first, last, 2 * window) if last - first >= 4 * window else []
        return longer or [Segment(first, last, False)]
    unchanged = ~noise.changes(differences, window, window)
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
        steady = _is_steady(values[a:b], noise)
        longer = _segments(values, noise, a, b, 2 * window) if not steady and b - a >= 4 * window else []
        segments += longer or [Segment(a, b, steady)]
    return segments


def _is_steady(values: Array, noise: WindowNoise) -> bool:
    """Whether no part of a segment (n, d) differs from another beyond noise."""
    parts = min(PARTS, len(values) // noise.window)
    if parts < 2:
        return True
    edges = np.linspace(0, len(values), parts + 1).astype(int)
    means = np.array([values[a:b].mean(axis=0) for a, b in pairwise(edges)])
    earlier, later = np.triu_indices(parts, 1)
    length = len(values) / parts
    return not bool(noise.changes(means[earlier] - means[later], length, length).any())


def _settled_after(values: Array, noise: WindowNoise) -> int:
    """How many blocks at the beginning are not yet at the level of those that follow: the beginning of a movement, the
    tail of a filter.
    """
    n = len(values)
    off = np.zeros(n + 1, dtype=bool)
    least = noise.least if noise.joint else 0.0 * noise.least  # an axis that counts alone may not be off at all
    sums, size = _sums(values), 1
    while size <= (ONSET_WINDOWS if noise.joint else TAIL_WINDOWS) * noise.window and 3 * size <= n:
        means = (sums[size:] - sums[:-size]) / size
        after = 0.5 * (means[size:-size] + means[2 * size :])
        off[: len(after)] |= noise.changes(means[: -2 * size] - after, size, 2 * size, END_ALARM, least)
        size *= 2
    return int(np.argmin(off))
