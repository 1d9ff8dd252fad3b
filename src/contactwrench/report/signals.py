"""Recordings of any length in a picture: what sensor and arm did over time, what was averaged, what was left out; and
what is left in motion, with the inertia and without, over time and by frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.calibration import Calibration
from ..compensate.contact_wrenches import motion_of
from ..estimation.in_motion import as_stamped
from ..geometry.arrays import Array
from ..geometry.rotations import angles_between
from ..samples.poses import SAME_POSE_ANGLE, Pose
from ..samples.samples import Samples
from ..samples.still_segments import StillSegment, StillSegments
from ..samples.timestamps import spread_evenly
from .figures import AXIS_COLOURS, METHODS, PARTS, WIDTH, drawing, svg_text

MOST_BINS = 2000
"""Of a picture; in each the least and the most are drawn, so that a million rows make no larger one."""
FIRST_WIDTH = 0.005
"""s: of a bin, until there are too many of them."""

STILL, NUMBER, ARM = "#d8ecdf", "#6a7178", "#2a3036"
NARROWEST = 0.004
"""Of the picture's width: a shorter stretch is widened so that it is seen."""

MOST_NUMBERED = 40
WITHOUT, WITH = METHODS["gravity only"][0], METHODS["full"][0]
LONGEST_WINDOW = 4.0
"""s, of which spectra are averaged."""
LOWEST = 1e-6
"""Of a logarithmic scale."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """Bins of `width` s from `start` s on: the least `low` (m, k) and the most `high` (m, k) of k signals in each, NaN
    where there was no sample.
    """

    start: float
    width: float
    low: Array
    high: Array

    @property
    def t(self) -> Array:
        """The middle of each bin (m,), s."""
        return self.start + self.width * (np.arange(len(self.low), dtype=np.float64) + 0.5)


def envelope(t: Array, values: Array, before: Envelope | None = None, most_bins: int = MOST_BINS) -> Envelope:
    """The envelope of signals `values` (n, k) at times (n,), s, none before the first of all, NaN left out; of those
    `before` too, where these go on. The width doubles where there would be more than `most_bins`.
    """
    known = np.isfinite(t)
    t, values = t[known], values[known]
    if not len(t):
        return before or Envelope(0.0, FIRST_WIDTH, values, values)
    if before is None or not len(before.low):
        before = Envelope(float(t.min()), FIRST_WIDTH, values[:0], values[:0])
    joined = 1
    while (t.max() - before.start) / (joined * before.width) >= most_bins:
        joined *= 2
    width = joined * before.width
    of_new = np.maximum(((t - before.start) / width).astype(np.intp), 0)
    place = np.concatenate([np.arange(len(before.low)) // joined, of_new])
    low, high = np.full((2, place.max() + 1, values.shape[1]), np.nan)
    np.fmin.at(low, place, np.concatenate([before.low, values]))
    np.fmax.at(high, place, np.concatenate([before.high, values]))
    return Envelope(before.start, width, low, high)


def outline(of: Envelope) -> tuple[Array, Array]:
    """The envelope as lines to draw: times (m,), s, and values (m, k), the least and the most of each bin that holds a
    sample, the most first where the signal falls; NaN in a gap.
    """
    held = np.isfinite(of.low).any(axis=1)
    t, low, high = np.repeat(of.t[held], 2), of.low[held], of.high[held]
    falls = np.diff(low + high, axis=0, prepend=np.inf) < 0.0
    values = np.stack([np.where(falls, high, low), np.where(falls, low, high)], axis=1).reshape(len(t), low.shape[1])
    step = np.diff(t)
    usual, span = (float(np.median(step[step > 0.0])), float(np.ptp(t))) if (step > 0.0).any() else (0.0, 0.0)
    gap = np.flatnonzero(step > max(10.0 * usual, 3.0 * span / MOST_BINS))
    return np.insert(t, np.add(gap, 1), np.nan), np.insert(values, np.add(gap, 1), np.nan, axis=0)


def signals_over_time(calibration: Calibration, samples: Samples, found: StillSegments) -> str:
    """Force, torque and the angle of the arm from where it began, over the time since the first row of the samples that
    a calibration was made from. Still stretches are green; those left out are hatched, by the numbers of their poses.
    """
    t = samples.t if samples.t is not None else np.arange(float(len(samples)))
    first = float(t[0])
    numbered = left_out_spans(calibration, found)
    angle = np.rad2deg(angles_between(samples.R_base_flange[:1], samples.R_base_flange))
    at, lines = outline(envelope(t - first, np.column_stack([samples.wrench, angle]), most_bins=MOST_BINS // 2))
    with drawing(1, (WIDTH, 6.4), rows=3) as (figure, axes):
        for ax, (part, name, scale) in zip(axes[:2], PARTS, strict=True):
            for k in range(3):
                ax.plot(at, scale * lines[:, part + k], color=AXIS_COLOURS[k], lw=0.7, label="xyz"[k])
            ax.set_ylabel(name)
        axes[2].plot(at, lines[:, 6], color=ARM, lw=0.8)
        axes[2].set(xlabel="time since the first row, s", ylabel="angle of the arm, deg")
        span = float(t.max()) - first
        for ax in axes:
            ax.set_xlim(0.0, span)
            ax.margins(y=0.08)
            for stretch in found.accepted:
                ax.axvspan(stretch.t_start - first, stretch.t_end - first, color=STILL, lw=0, zorder=0)
            for begin, end, _ in numbered:
                shown_end = max(end, begin + NARROWEST * span) - first
                ax.axvspan(begin - first, shown_end, fc="#eceff1", ec="#9aa2a9", hatch="////", lw=0, zorder=0)
        if len(numbered) <= MOST_NUMBERED:
            for begin, end, number in numbered:
                axes[0].annotate(
                    f"{number}", (0.5 * (begin + end) - first, 1.0), xycoords=("data", "axes fraction"),
                    ha="center", va="bottom", fontsize=8, color=NUMBER,
                )  # fmt: skip
        axes[1].legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), handletextpad=0.3, columnspacing=1.0)
        return svg_text(figure)


def left_out_spans(calibration: Calibration, found: StillSegments) -> list[tuple[float, float, int]]:
    """From when to when, and the number of the pose, of every stretch that did not take part in the fit."""
    spans = []
    for number, pose in enumerate(calibration.poses, start=1):
        if pose.rejected is not None:
            spans += [(s.t_start, s.t_end, number) for s in (*found.accepted, *found.rejected) if _is_of(s, pose)]
    return spans


def _is_of(stretch: StillSegment, pose: Pose) -> bool:
    """Whether a pose was made of the stretch, perhaps among others."""
    if pose.t_start is None or pose.t_end is None or pose.n < stretch.n:
        return False
    within = pose.t_start <= stretch.t_start and stretch.t_end <= pose.t_end
    alike = float(np.linalg.norm(stretch.R_base_flange - pose.R_base_flange)) < np.sqrt(2.0) * 2.0 * SAME_POSE_ANGLE
    return within and alike and (stretch.rejected is None or stretch.rejected == pose.rejected)


def left_in_motion(calibration: Calibration, samples: Samples) -> str:
    """The norm of force and torque left over time, the most in each moment, and the spectrum of the force."""
    samples = as_stamped(samples, calibration)
    motion = motion_of(calibration, samples)
    t = spread_evenly(np.asarray(samples.t)) - calibration.first_time
    known = np.ones(len(t), dtype=bool) if motion is None else motion.inside
    left = {
        "without inertia": calibration.compensate(samples.wrench, samples.R_base_flange),
        "with inertia": calibration.compensate(samples.wrench, samples.R_base_flange, motion=motion),
    }
    with drawing(3, (WIDTH, 3.2)) as (figure, axes):
        from matplotlib.ticker import LogLocator

        for (name, wrench), colour in zip(left.items(), (WITHOUT, WITH), strict=True):
            norms = [scale * np.linalg.norm(wrench[:, part : part + 3], axis=1) for part, _, scale in PARTS]
            most = envelope(t[known], np.stack(norms, axis=1)[known])
            for ax, values in zip(axes[:2], most.high.T, strict=True):
                ax.plot(most.t, np.maximum(values, LOWEST), color=colour, lw=0.7, label=name)
            frequency, density = _spectrum(t, wrench[:, :3])
            axes[2].plot(frequency, np.maximum(density, LOWEST), color=colour, lw=0.9, label=name)
        for ax, (_, name, _) in zip(axes[:2], PARTS, strict=True):
            ax.set(yscale="log", xlabel="time, s", ylabel=f"left over, {name}")
        axes[2].set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="force left, N/√Hz")
        for ax in axes:
            ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            ax.yaxis.set_major_formatter("{x:g}")
            ax.yaxis.set_minor_formatter("")
        axes[2].xaxis.set_major_formatter("{x:g}")
        axes[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), handletextpad=0.3, columnspacing=1.2)
        return svg_text(figure)


def _spectrum(t: Array, force: Array) -> tuple[Array, Array]:
    """Frequencies, Hz, and the amplitude density of a force (n, 3), N/√Hz, all axes together."""
    from scipy.signal import welch

    rate = 1.0 / float(np.median(np.diff(t)))
    rows = min(len(t), round(LONGEST_WINDOW * rate))
    frequency, power = welch(force, rate, nperseg=rows, axis=0)
    return frequency[1:], np.sqrt(power.sum(axis=1))[1:]
