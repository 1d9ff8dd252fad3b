"""Charts of figures with standard errors, drawn in the style of figures.py: lines in small multiples, dots by group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from contactwrench.report.figures import drawing, svg_text

from .part import Measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES: dict[str, tuple[str, str]] = {
    "ours": ("#0072b2", "o"),
    "paper": ("#d55e00", "s"),
    "yaw": ("#009e73", "^"),
    "mount": ("#cc79a7", "D"),
    "affine": ("#8c6d1f", "P"),
    "tare": ("#1f262d", "X"),
    "gravity only": ("#8a8f94", "v"),
}
"""Colour and marker of each method of compensation, the same in every chart: colours that the colour-blind tell apart
(Okabe and Ito), and a shape for everyone.
"""
OTHERS = (("#0072b2", "o"), ("#d55e00", "s"), ("#009e73", "^"), ("#cc79a7", "D"))
"""For series that are no method, in their order."""

SPREAD = 0.3
"""Of the distance of two positions: how far the series are moved apart, so that no error bar hides another."""


Cell: TypeAlias = Measured | None
"""None: there is none."""


@dataclass(frozen=True)
class Panel:
    """One of the small multiples: what is changed, its unit or name along x, its steps, and the series over them."""

    title: str
    x: str
    steps: tuple[str, ...]
    series: Mapping[str, Sequence[Cell]]


def lines_in_panels(panels: Sequence[Panel], y: str, columns: int = 3) -> str:
    """Small multiples with one logarithmic y axis, `y` its label; the steps of each panel are equally far apart, and a
    vertical bar is one standard error to both sides.
    """
    rows = -(-len(panels) // columns)
    with drawing(columns, (3.05 * columns, 2.45 * rows + 0.35), rows) as (figure, axes):
        for ax in axes[len(panels) :]:
            ax.set_axis_off()
        for number, (ax, panel) in enumerate(zip(axes, panels, strict=False)):
            for k, (name, cells) in enumerate(panel.series.items()):
                at = np.arange(len(panel.steps)) + SPREAD * ((k + 0.5) / len(panel.series) - 0.5)
                values, errors = _columns(cells)
                colour, marker = _style(name, k)
                ax.errorbar(
                    at, values, errors, color=colour, marker=marker, ms=4, lw=1.1, elinewidth=0.9, label=name, mew=0
                )
            ax.set_yscale("log", nonpositive="clip")
            ax.yaxis.set_major_formatter("{x:g}")
            ax.set_xticks(range(len(panel.steps)), panel.steps)
            ax.set_xlabel(panel.x)
            ax.set_title(panel.title, fontsize=9.5, color="#2a3036", loc="left")
            ax.grid(axis="y", color="#e4e8eb", lw=0.6)
            ax.set_axisbelow(True)
            if number % columns == 0:
                ax.set_ylabel(y)
        _same_range(axes[: len(panels)])
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=len(labels), handletextpad=0.4)
        return svg_text(figure)


def dots_by_group(groups: Mapping[str, Mapping[str, Cell]], x: str) -> str:
    """A line of dots for each group, from the top, one a series, over a logarithmic x axis, `x` its label; beside each
    dot its value, and a bar of one standard error to both sides.
    """
    series = list(dict.fromkeys(name for cells in groups.values() for name in cells))
    own = all(len(cells) == 1 for cells in groups.values())
    lanes = 1 if own else len(series)
    tall = len(groups) * (0.14 + 0.2 * lanes) + 0.95
    with drawing(1, (7.4, tall)) as (figure, (ax,)):
        for k, name in enumerate(series):
            colour, marker = _style(name, k)
            values, errors = _columns([cells.get(name) for cells in groups.values()])
            down = np.arange(len(groups)) + (0.0 if own else 0.72 * ((k + 0.5) / lanes - 0.5))
            ax.errorbar(
                values,
                down,
                xerr=errors,
                color=colour,
                marker=marker,
                ms=6,
                ls="none",
                elinewidth=1.1,
                mew=0,
                label=name,
            )
            for value, error, height in zip(values, errors, down, strict=True):
                if np.isfinite(value):
                    ax.annotate(
                        f"{value:.3g}", (value + error, height), (6, 0), textcoords="offset points", va="center",
                        fontsize=8, color="#2a3036",
                    )  # fmt: skip
        ax.set_xscale("log", nonpositive="clip")
        ax.xaxis.set_major_formatter("{x:g}")
        ax.set_yticks(range(len(groups)), list(groups), color="#2a3036")
        ax.tick_params(axis="y", length=0)
        ax.set_ylim(len(groups) - 0.45, -0.55)
        for between in range(1, len(groups)):
            ax.axhline(between - 0.5, color="#e4e8eb", lw=0.6)
        low, high = ax.get_xlim()
        ax.set_xlim(low, high * (high / low) ** 0.08)
        ax.set_xlabel(x)
        if not own:
            figure.legend(loc="outside upper left", ncols=len(series), handletextpad=0.4)
        return svg_text(figure)


def _style(name: str, number: int) -> tuple[str, str]:
    return STYLES.get(name, OTHERS[number % len(OTHERS)])


def _columns(cells: Sequence[Cell]) -> tuple[list[float], list[float]]:
    """Values and standard errors; NaN and 0 where there is no figure."""
    values = [np.nan if cell is None else cell.value for cell in cells]
    errors = [0.0 if cell is None or cell.standard_error is None else cell.standard_error for cell in cells]
    return values, errors


def _same_range(axes: Sequence[Axes]) -> None:
    """One range of y for all panels: they are there to be compared."""
    limits = [ax.get_ylim() for ax in axes]
    low, high = min(lowest for lowest, _ in limits), max(highest for _, highest in limits)
    for ax in axes:
        ax.set_ylim(low, high)
