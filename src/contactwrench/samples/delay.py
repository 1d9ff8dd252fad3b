"""How much later than the orientation the wrench is stamped: the delay that lets a rigid tool explain the most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.ranges import DELAY
from ..geometry.wrench import unit_direction
from .buffer import nodes_of, with_batch
from .bursts import evened
from .delay_fit import GRID, DelayFit, Scan, fitted, scans, standard_deviation
from .motion import ArmMotion, arm_motion
from .samples import OrientationStream, Samples, Streams, WrenchStream
from .synchronize import synchronize
from .timestamps import default_gap, require_common_span, require_times

DOWN = (0.0, 0.0, -1.0)
SIGNIFICANT = 3.0
"""Standard deviations from zero."""
TWO_CLOCKS = 0.25
"""s: no filter, no bus and no driver are so late: a filter of first order at 1 Hz is by 0.16."""
LEAST_TURN = np.deg2rad(2.0)
"""Between the orientations that differ most: less does not show when the wrench follows."""
LEAST_MEANS = 60
ANOTHER_BASE = 0.5
"""Of the misfit, a sum of logarithms of variances: gravity far from where it is stated explains more."""
ALIKE = 1e-3
"""Of that misfit: both came to one place."""
SCANNED = 2000
"""Means that the search over the whole range looks at."""
TOLD = 0.3
"""Of the std that noise alone would show: with a tenth of the information that there is, it does no harm."""
MOST_ROUNDS, SETTLED = 4, 4e-4
"""Fits to the means that are known at the delay of the fit before; and s by which the last one moves it."""
ASTRAY = 0.1
"""s from the best of the search to the fit: further it finds another answer, or none."""
LONGEST_DELAY = DELAY.most
"""s, either way: searched where the best delay lies at the end of a second, as between clocks that were set by hand."""
AS_GOOD = 0.02
"""Of the range of misfits: a second minimum as close to the best is another answer."""
ODDS = 20.0
"""Twice the logarithm of the odds, were the residuals independent, up to which it is one too: a smooth motion explains
noise at any delay a bit. Of ten seconds at 30 Hz one episode in ten had a delay of 0.2 s and more without it, none of
540 with it; of 180 true delays it costs 2.
"""


@dataclass(frozen=True)
class Delay:
    """`value` s: the wrench is stamped so much later than the orientation; `std` s, from residuals as they are,
    correlated in time; `bound` s: the least std that this motion allows, were the residuals white noise. `reason`: why
    the motion cannot tell, or None; then the std is at least the range that was searched. `beyond`: whether that is
    because the best delay may lie outside of the range.

    A sensor's own low-pass filter is part of it: one of first order at f Hz adds 1 / (2 pi f).
    """

    value: float
    std: float
    bound: float
    reason: str | None = None
    beyond: bool = False

    @property
    def significant(self) -> bool:
        """Whether the motion tells the delay from zero: only then it is applied."""
        return is_significant(self.value, self.std)


def is_significant(delay: float, std: float) -> bool:
    """Whether a delay is told from zero: three standard deviations off, or more."""
    return bool(np.isfinite(std) and abs(delay) > SIGNIFICANT * std)


def estimate_delay(streams: Streams, gravity: ArrayLike = DOWN, within: float = 1.0) -> Delay:
    """The delay of the wrench behind the orientation, from a recording in which the arm turns a tool in free air.

    Tool, mounting and cross-talk need not be known: gravity's effect on each of six axes is free (24 numbers), and so
    is that of accelerations; those of the flange are known where positions are recorded, and without them whole-arm
    motions tell the delay badly, for which the std is widened. Contacts count little.

    Args:
        streams: the recording.
        gravity: down (3,), base axes, as far as it is known.
        within: the range to search to each side, s, at most a quarter of the recording.

    Returns:
        The delay and its std, s; where the motion cannot tell it, why.

    Raises:
        InputError: stamps that cannot be put in order, streams without a common span.
    """
    stated = unit_direction(gravity)
    if not 0.0 < within < np.inf:
        raise InputError(f"within is {within!r}, expected s above 0")
    (streams,), _ = evened([streams])
    buffer = with_batch(None, streams)
    for stamps in (buffer.wrench_stamps, buffer.orientation_stamps):
        require_times(stamps)
    require_common_span(buffer.wrench_stamps, buffer.orientation_stamps, 0.0)
    gap = default_gap(buffer.orientations.t)
    nodes = nodes_of(buffer, gap, is_last=True)
    if len(nodes.t) < 3:
        return _untold("found fewer than 3 orientations")
    motion = arm_motion(buffer, nodes, gap)
    means = _means(buffer.readings, motion.width)
    span = min(means.t[-1], motion.t[-1]) - max(means.t[0], motion.t[0]) if len(means) else 0.0
    reach = min(within, 0.25 * span)
    steps = max(int(np.ceil(reach / GRID)), 1)
    delays = np.linspace(-reach, reach, 2 * steps + 1)
    scanned = _known(motion, means, -reach, reach)
    if len(scanned) < LEAST_MEANS:
        return _untold(f"found {len(scanned)} readings with orientations around them, expected {LEAST_MEANS} or more")
    axes = motion.state_at(scanned.t)[:, :9]
    cosine_of_turn = 0.5 * (axes @ axes[0] - 1.0)
    if np.arccos(np.clip(cosine_of_turn.min(), -1.0, 1.0)) < LEAST_TURN:
        return _untold("the arm turns by less than 2 deg")
    thin = _thinned(scanned)
    fit, used, chosen = _settled(motion, means, scanned, *scans(motion, thin, delays, stated))
    if int(chosen.misfit.argmin()) in (0, len(delays) - 1):
        return _untold(f"no delay within {1e3 * reach:.0f} ms explains the wrench better than those beyond", True)
    std = standard_deviation(motion, used, fit)
    doubt = _doubt(fit, std, delays, chosen, len(thin))
    return Delay(fit.delay, std if doubt is None else max(std, float(reach)), fit.bound, doubt)


def _untold(reason: str, beyond: bool = False) -> Delay:
    return Delay(0.0, np.inf, np.inf, reason, beyond)


def _means(readings: WrenchStream, width: float) -> WrenchStream:
    """Means of the readings through a window that falls to zero `width` s to each side, `width` s apart; readings that
    say nothing left out, as are means across a gap.
    """
    finite = np.isfinite(readings.wrench).all(axis=1)
    t, wrench = readings.t[finite], readings.wrench[finite]
    if len(t) < 2:
        return WrenchStream(t, wrench)
    spacing = max(float(np.median(np.diff(t))), 1e-9)
    each = min(max(round(width / spacing), 1), len(t))  # of times most of which repeat, all: nothing is told
    n = len(t) // each
    cells = np.column_stack([t, wrench])[: n * each].reshape(n, each, 7)
    share = (np.arange(each) + 0.5) / each**2
    rising, falling = (np.einsum("nek,e->nk", cells, of_cell) for of_cell in (share, share[::-1]))
    mean = rising[:-1] + falling[1:]
    whole = cells[1:, -1, 0] - cells[:-1, 0, 0] <= 3.0 * each * spacing
    return WrenchStream(mean[whole, 0], mean[whole, 1:])


def _thinned(means: WrenchStream) -> WrenchStream:
    """At most `SCANNED` of the means, evenly."""
    return means.select(slice(None, None, -(-len(means) // SCANNED)))


def _known(motion: ArmMotion, means: WrenchStream, least: float, most: float) -> WrenchStream:
    """The means whose orientation is known at every delay from `least` to `most` s."""
    return means.select(motion.is_known(means.t - most, means.t - least))


def _settled(
    motion: ArmMotion, means: WrenchStream, scanned: WrenchStream, stated: Scan, free: Scan
) -> tuple[DelayFit, WrenchStream, Scan]:
    """The fit under gravity as stated, or anywhere if its scan is far better, and the means that it is of: all that are
    known at its delay and near it; and the scan.
    """
    reach = max(abs(stated.best), abs(free.best)) + 2.0 * GRID
    near = _known(motion, means, -reach, reach)  # beyond what was scanned, where short pieces have none
    thin = _thinned(near if len(near) >= LEAST_MEANS else scanned)
    fit, chosen = fitted(motion, thin, stated.best, stated.down), stated
    if free.least < stated.least - ANOTHER_BASE:
        anywhere = fitted(motion, thin, free.best, free.down)
        if anywhere.misfit < fit.misfit + ALIKE:
            fit, chosen = anywhere, free
    for _ in range(MOST_ROUNDS):
        used, before = _known(motion, means, fit.delay - GRID, fit.delay + GRID), fit.delay
        fit = fitted(motion, used, fit.delay, fit.down)
        if abs(fit.delay - before) < SETTLED:
            break
    return fit, used, chosen


def _doubt(fit: DelayFit, std: float, delays: Array, chosen: Scan, count: int) -> str | None:
    """Why the motion does not tell the delay, or None, after a scan of so many means."""
    if not np.isfinite(std):
        return "gravity does not turn in the flange's axes while the arm moves"
    misfit = chosen.misfit
    inner = misfit[1:-1]
    minima = 1 + np.flatnonzero((inner < misfit[:-2]) & (inner <= misfit[2:]))
    best = int(misfit.argmin())
    others = minima[np.abs(minima - best) > 1]
    worse = misfit[others] - misfit[best]
    both = f"delays of {1e3 * delays[best]:.0f} and {{:.0f}} ms explain the wrench equally well"
    if len(rivals := others[worse < AS_GOOD * (misfit.max() - misfit[best])]):
        return f"the motion repeats itself: {both.format(1e3 * delays[rivals[0]])}; vary it"
    if std > TOLD * fit.weightless or abs(fit.delay - chosen.best) > ASTRAY:
        return (
            "gravity's turning shows too little in the wrench, beside accelerations and noise: tilt the tool further, "
            "about more than one axis"
        )
    if len(rivals := others[worse < ODDS * (std / fit.bound) ** 2 / count]):
        return f"the motion is too short: {both.format(1e3 * delays[rivals[0]])}; record more of it, or faster"
    return None


def on_one_clock(streams: Streams) -> tuple[Samples, tuple[str, ...]]:
    """Two streams as samples; the delay is estimated, and applied if significant.

    Args:
        streams: of a recording in which the arm turns a free tool.

    Returns:
        The samples, which carry the delay (s) and its std where the motion gives any, applied or not; and what there is
        to say of it, a sentence each.

    Raises:
        InputError: as `estimate_delay` and `synchronize` raise it.
    """
    (streams,), of_bursts = evened([streams])
    delay = _delay_of_free_readings(streams)
    paired = synchronize(streams, delay.value if delay.significant else 0.0, at_their_pace=True)
    return _with_delay(paired.samples, delay), (*of_bursts, delay_in_words(delay), *paired.notes)


def _delay_of_free_readings(streams: Streams) -> Delay:
    """`estimate_delay` from the readings without a load on the tool and without a saturated channel."""
    wrench = streams.wrench
    free = np.ones(len(wrench), dtype=np.bool_)
    if wrench.load_mass is not None:
        free &= wrench.load_mass == 0.0
    if wrench.saturated is not None:
        free &= ~wrench.saturated
    streams = Streams(wrench.select(free), streams.orientation)
    delay = estimate_delay(streams)
    return estimate_delay(streams, within=LONGEST_DELAY) if delay.beyond else delay


def with_delay_of_rows(samples: Samples) -> Samples:
    """Samples of a motion whose rows each came with an orientation, with the delay of their wrench behind it: the rows
    stay as they are. Where their stamps are none of one clock, nothing is known of it.
    """
    if samples.t is None or samples.delay is not None or samples.pose_period is not None:
        return samples
    wrench = WrenchStream(samples.t, samples.wrench, samples.source, samples.load_mass, samples.saturated)
    orientation = OrientationStream(samples.t, samples.R_base_flange, samples.position, samples.source)
    try:
        return _with_delay(samples, _delay_of_free_readings(Streams(wrench, orientation)))
    except InputError:
        return samples


def _with_delay(samples: Samples, delay: Delay) -> Samples:
    """The samples with the delay and its std, where the motion gives any."""
    return replace(samples, delay=delay.value, delay_std=delay.std) if np.isfinite(delay.std) else samples


def with_known_delay(samples: Samples, delay: float | None, std: float | None) -> Samples:
    """Samples whose delay (s) was known before: the mean of both by how well each is known, and the samples' own where
    they do not agree; None, or infinite: it was not. That of two clocks was of one recording alone.
    """
    if delay is None or std is None or not np.isfinite(std) or abs(delay) > TWO_CLOCKS:
        return samples
    own, own_std = samples.delay, samples.delay_std
    if own is None or own_std is None or not np.isfinite(own_std):
        return replace(samples, delay=delay, delay_std=std)
    apart = max(float(np.hypot(std, own_std)), 1e-12)
    if abs(own - delay) > SIGNIFICANT * apart:
        return samples
    share = (std / apart) ** 2
    return replace(samples, delay=delay + share * (own - delay), delay_std=std * own_std / apart)


def delay_in_words(delay: Delay) -> str:
    """The estimate, and whether it is applied."""
    if delay.reason is not None:
        return f"delay between wrench and orientation not applied: {delay.reason}"
    late = "later" if delay.value >= 0.0 else "earlier"
    by = f"{1e3 * abs(delay.value):.2f} +- {1e3 * delay.std:.2g} ms {late}"
    applied = (
        "applied" if delay.significant else f"not applied: less than {SIGNIFICANT:g} standard deviations from zero"
    )
    return f"the wrench is stamped {by} than the orientation: {applied}"
