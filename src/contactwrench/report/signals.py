"""The picture of a recording: what sensor and arm did over time, which stretches were averaged, which left out."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..geometry.arrays import Array
from ..samples.poses import SAME_POSE_ANGLE, Pose
from ..samples.samples import Samples
from ..samples.still_segments import StillSegment, StillSegments
from .figures import AXIS_COLOURS, drawing, svg_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 500
"""Of the picture; in each the least and the largest reading are drawn, so that a million rows make no larger one."""

STILL, LEFT_OUT, ARM = "#d8ecdf", "#6a7178", "#2a3036"
NARROWEST = 0.004
"""Of the picture's width: a shorter stretch is widened so that it is seen."""

MOST_NUMBERED = 40


def signals_over_time(calibration: Calibration, samples: Samples, found: StillSegments) -> str:
    """Force, torque and the angle of the arm from where it began, over the time since the first row. Green: still
    stretches; hatched: those left out, by the numbers of their poses.
    """
    t = samples.t if samples.t is not None else np.arange(float(len(samples)))
    first = float(t[0])
    numbered = left_out_spans(calibration, found)
    with drawing(1, (8.2, 5.6), rows=3) as (figure, axes):
        for ax, columns, scale, name in zip(
            axes[:2], (slice(0, 3), slice(3, 6)), (1.0, 1e3), ("force, N", "torque, mN m"), strict=True
        ):
            for k, values in enumerate(samples.wrench[:, columns].T):
                at, outline = envelope(t - first, scale * values)
                ax.plot(at, outline, color=AXIS_COLOURS[k], lw=0.7, label="xyz"[k])
            ax.set_ylabel(name)
        at, outline = envelope(t - first, np.rad2deg(_angle_from(samples.R_base_flange)))
        axes[2].plot(at, outline, color=ARM, lw=0.8)
        axes[2].set_ylabel("angle of the arm, deg")
        axes[2].set_xlabel("time since the first row, s")
        span = float(t.max()) - first
        for ax in axes:
            ax.set_xlim(0.0, span)
            ax.margins(y=0.08)
            for stretch in found.accepted:
                ax.axvspan(stretch.t_start - first, stretch.t_end - first, color=STILL, lw=0, zorder=0)
            for begin, end, _ in numbered:
                _hatched(ax, begin - first, max(end - first, begin - first + NARROWEST * span))
        if len(numbered) <= MOST_NUMBERED:
            for begin, end, number in numbered:
                axes[0].annotate(
                    f"{number}", (0.5 * (begin + end) - first, 1.0), xycoords=("data", "axes fraction"),
                    ha="center", va="bottom", fontsize=8, color=LEFT_OUT,
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


def envelope(t: Array, values: Array) -> tuple[Array, Array]:
    """The least and the largest value of every so many rows, `COLUMNS` times, in the order in which they came; all
    values where there are few. A gap in time leaves a gap.
    """
    if len(t) <= 2 * COLUMNS:
        return _with_gaps(t, values)
    edges = np.linspace(0, len(t), COLUMNS + 1).astype(np.intp)
    ends = [(a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b]))) for a, b in pairwise(edges)]
    rows: NDArray[np.intp] = np.unique(ends)
    return _with_gaps(t[rows], values[rows])


def _with_gaps(t: Array, values: Array) -> tuple[Array, Array]:
    step = np.diff(t)
    gap = np.flatnonzero((step < 0.0) | (step > max(10.0 * float(np.median(step)), 3.0 * float(np.ptp(t)) / COLUMNS)))
    return np.insert(t, gap + 1, np.nan), np.insert(values, gap + 1, np.nan)


def _angle_from(R: Array) -> Array:
    """The angle (n,), rad, of each orientation from the first."""
    chord = np.sqrt(np.sum((R - R[:1]) ** 2, axis=(1, 2)))
    angle: Array = 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))
    return angle


def _hatched(ax: Axes, begin: float, end: float) -> None:
    ax.axvspan(begin, end, facecolor="#eceff1", edgecolor="#9aa2a9", hatch="////", lw=0, zorder=0)
