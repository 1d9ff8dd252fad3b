"""The true contact force over time, one line a method."""

from __future__ import annotations

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.report.figures import drawing, svg_text

COLOURS = {"ours": "#1b6e9c", "paper": "#3a7d44", "tare": "#c98a1b", "gravity only": "#8a5a9e"}
HEIGHTS = (2.4, 1.0)


def force_chart(force: dict[str, Array], wanted: float, period: float) -> str:
    """An SVG of forces (n,) N by method, a row every `period` s, with the wanted one as a line. Forces that leave
    others no room are on an axis of their own below. Raises `MissingExtraError` without matplotlib.
    """
    far = {name for name, values in force.items() if abs(float(np.mean(values)) - wanted) > wanted}
    with drawing(1, (8.2, 4.2 if far else 2.9), rows=2 if far else 1) as (figure, axes):
        if far:
            axes[0].sharex(axes[1])
            axes[0].tick_params(labelbottom=False)
            grid = axes[0].get_gridspec()
            if grid is not None:
                grid.set_height_ratios(HEIGHTS)
        for ax, near in zip(axes, (True, False), strict=False):
            for name, values in force.items():
                if (name not in far) == near:
                    ax.plot(period * np.arange(len(values)), values, color=COLOURS[name], lw=1.1, label=name)
            ax.axhline(wanted, color="#2a3036", lw=0.8, ls=":")
            ax.set_ylabel("force, N")
            ax.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), handlelength=1.2)
        axes[-1].set_xlabel("time, s")
        return svg_text(figure)
