"""The true contact force over time, one line a way."""

from __future__ import annotations

from io import StringIO

import numpy as np

from ..errors import MissingExtraError
from ..orientation import Array
from ..report.figures import STYLE

COLOURS = {"ours": "#1b6e9c", "paper": "#3a7d44", "tare": "#c98a1b", "gravity only": "#8a5a9e"}


def force_chart(force: dict[str, Array], wanted: float, period: float) -> str:
    """An SVG of forces (n,) N by way, a row every `period` s, with the wanted one as a line. Forces that leave others
    no room are on an axis of their own below.
    """
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError(
            "the report needs matplotlib, which is not installed: pip install 'contactwrench[report]'"
        ) from None
    far = {name for name, values in force.items() if abs(float(np.mean(values)) - wanted) > wanted}
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.2, 2.9 if not far else 4.2), layout="constrained")
        heights = [2.4, 1.0] if far else [1.0]
        axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for ax, near in zip(axes, (True, False), strict=False):
            for name, values in force.items():
                if (name not in far) == near:
                    t = period * np.arange(len(values))
                    ax.plot(t, values, color=COLOURS[name], lw=1.1, label=name)
            ax.axhline(wanted, color="#2a3036", lw=0.8, ls=":")
            ax.set_ylabel("force, N")
            ax.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), handlelength=1.2)
        axes[-1].set_xlabel("time, s")
        text = StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
