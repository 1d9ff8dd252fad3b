"""The picture of contact force from joint torques, on the way to singularities."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.report.figures import drawing, svg_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#b3541e", "#b3541e", "#c98a1b", "#c98a1b", "#8a5a9e", "#1b6e9c")
MARKERS = ("o", "o", "s", "s", "^", "D")
DASHED = (False, True, False, True, False, False)
BINS = 10
LEFTMOST = 0.01
"""The share of the configurations in the first bin, all that are closest to a singularity."""
DOTS = 250
"""Of each kind: more hide each other."""


def error_near_singularities(
    names: tuple[str, ...], force: float, distance: Array, errors: Array, short: Array, line: Array
) -> str:
    """Errors of up to six routes to a force of that size, N: (routes, n) at configurations with smallest singular
    values `distance` (n,), and squared (trials, routes, k) at `short` (k,), m, of the end of a line into a singularity.
    """
    edges = np.geomspace(np.quantile(distance, LEFTMOST), distance.max(), BINS)
    place = np.searchsorted(edges[:-1], distance)
    bins = [np.flatnonzero(place == k) for k in np.unique(place)]
    middle = np.array([np.exp(np.log(distance[one]).mean()) for one in bins])
    some = np.random.default_rng(1).permutation(len(distance))[:DOTS]
    with drawing(2, (9.0, 4.2)) as (figure, axes):
        everywhere, into = axes
        for k, name in enumerate(names):
            if not DASHED[k]:
                dots = errors[k, some]
                everywhere.plot(distance[some], dots, MARKERS[k], ms=2.4, color=COLOURS[k], alpha=0.25, mew=0)
            _line(everywhere, middle, [errors[k, one] ** 2 for one in bins], k, name)
            _line(into, 1e3 * short, list(line[:, k].T), k, name)
        for ax in axes:
            ax.axhline(force, color="#6a7178", lw=0.9, ls=":", label="the force itself")
            ax.set_xscale("log")
            ax.set_yscale("log")
            ax.xaxis.set_major_formatter("{x:g}")
            ax.yaxis.set_major_formatter("{x:g}")
            ax.set_ylabel("error of the contact force, N")
        everywhere.set_xlabel("smallest singular value of the Jacobian (m, rad)")
        into.set_xlabel("left to the stretched arm, mm")
        figure.legend(*into.get_legend_handles_labels(), ncols=3, loc="outside upper left", handletextpad=0.4)
        return svg_text(figure)


def _line(ax: Axes, x: Array, squares: list[Array], k: int, name: str) -> None:
    """The RMS of squared errors at each x, with bars of two standard errors."""
    root = np.array([np.sqrt(one.mean()) for one in squares])
    bar = [one.std() / np.sqrt(len(one)) / rms if rms > 0.0 else 0.0 for one, rms in zip(squares, root, strict=True)]
    style, fill = ("--", "white") if DASHED[k] else ("-", COLOURS[k])
    ax.errorbar(
        x, root, bar, color=COLOURS[k], ls=style, marker=MARKERS[k], mfc=fill, ms=4, lw=1.4, elinewidth=1.0, label=name
    )
