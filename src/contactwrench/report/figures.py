"""The report's figures, each a function of a calibration, drawn by matplotlib (extra `report`) as SVG text."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..assess.verify import LeftOver
from ..calibration.calibration import Calibration
from ..calibration.dynamics import Ellipsoid
from ..calibration.findings import WEAK_SHARE
from ..calibration.observability import LEVER
from ..errors import of_extra
from ..geometry.arrays import Array
from ..geometry.rotations import spread_directions, spread_rotations
from ..model import gravity_in_flange, horizontal_axes
from ..statistics import counted, meaningful_digits, three_digits, two_digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 10.0
"""Inches, of a figure as wide as the text."""
BODY = "#7a5c2e"
CAPTION_OF_BODY = (
    " Brown: the uniform solid ellipsoid of the same mass and inertia, with its principal axes; the band is two std "
    "of its semi-axes, cut off where that is far more. Around the centre of mass its 95 % ellipse, where it "
    "is large enough to be seen."
)
PRINCIPAL = ("principal axis", "moment, kg cm²", "semi-axis, mm")
PLAIN = {"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.6}
"""Behind a name, so that lines do not cross it."""
MOST_OF_BAND = 1.6
"""Of the longest semi-axis: a band that goes further is cut off, so that the axes can be seen."""
SIDES = (1.0, -1.0)
DIRECTIONS = 600
"""Of gravity, over which a map is drawn."""
AXIS_COLOURS = ("#c1443c", "#3a7d44", "#2f5fa8")
METHODS = {
    "full": ("#1b6e9c", "o", "this calibration: bias and the turning weight subtracted"),
    "tare": ("#c98a1b", "s", "the sensor zeroed in the first pose only"),
    "gravity only": ("#8a5a9e", "^", "the turning weight subtracted, the bias left in (the paper's Table VIII)"),
    "raw": ("#8a8f94", "x", "what the sensor reads"),
}
"""Colour and marker of each, and what it is."""
LEFT_OUT = "#b3541e"
PARTS = ((0, "force, N", 1.0), (3, "torque, mN m", 1e3))
"""Of a wrench: the first column, name and unit, and the factor to that unit from SI."""
ONE_AT_A_TIME = Lock()
"""Matplotlib's style belongs to the whole program, whose threads may draw."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "contactwrench",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#6a7178",
    "axes.labelcolor": "#2a3036",
    "xtick.color": "#6a7178",
    "ytick.color": "#6a7178",
    "legend.frameon": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


def residuals_per_pose(calibration: Calibration, left: LeftOver) -> str:
    """What the fit leaves in each pose, axis by axis; the band is two standard deviations of a pose's noise."""
    kept, _ = places_in_time(calibration)
    with drawing(2, (WIDTH, 3.3)) as (figure, axes):
        for ax, (part, name, scale) in zip(axes, PARTS, strict=True):
            band = 2.0 * scale * float(calibration.noise[part : part + 3].max())
            ax.axhspan(-band, band, color="#e9eef2", lw=0)
            ax.axhline(0.0, color="#9aa2a9", lw=0.8)
            for k in range(3):
                values = scale * left.wrench[:, part + k]
                ax.plot(kept + 0.18 * (k - 1), values, "o", ms=4, color=AXIS_COLOURS[k], label="xyz"[k])
            ax.set_ylabel(f"residual {name}")
            _number_poses(ax, calibration)
        axes[1].legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), handletextpad=0.1, columnspacing=1.0)
        return svg_text(figure)


def left_over_per_pose(calibration: Calibration, methods: tuple[LeftOver, ...]) -> str:
    """The norm of force and torque left in each contact-free pose, by each method of compensation; log scale."""
    kept, _ = places_in_time(calibration)
    with drawing(2, (WIDTH, 3.4)) as (figure, axes):
        for ax, (part, name, scale) in zip(axes, PARTS, strict=True):
            for method in methods:
                norm = scale * np.linalg.norm(method.wrench[:, part : part + 3], axis=1)
                colour, marker, _ = METHODS[method.name]
                shown = np.where(norm > 0.0, norm, np.nan)
                ax.plot(kept, shown, marker, ms=4, color=colour, label=method.name, ls="-", lw=0.7)
            ax.set_yscale("log")
            ax.yaxis.set_major_formatter("{x:g}")
            ax.set_ylabel(f"left over, {name}")
            _number_poses(ax, calibration)
        axes[0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), handletextpad=0.3, columnspacing=1.2)
        return svg_text(figure)


def in_order_of_time(calibration: Calibration) -> NDArray[np.intp]:
    """The places in `poses`, by the middle of the time of each, as they are numbered; without times as they are."""
    middle = [0.5 * ((pose.t_start or 0.0) + (pose.t_end or 0.0)) for pose in calibration.poses]
    return np.argsort(middle, kind="stable")


def places_in_time(calibration: Calibration) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where, from 1, the poses that were fitted and those that were left out stand in the order of time."""
    place = np.argsort(in_order_of_time(calibration)) + 1
    out = np.array([pose.rejected is not None for pose in calibration.poses])
    return place[~out], place[out]


def sensor_axes(calibration: Calibration) -> str:
    """The sensor's axes as seen from ahead and above, the flange's through the same origin, the centre of mass with the
    way to it along x, y and z, and gravity on it in the first pose; nothing where the model has no mounting. With the
    inertia the ellipsoid that has it, and the centre of mass within its 95 % ellipse.
    """
    c, com, R = calibration, calibration.com, calibration.R_flange_sensor
    if c.weight is None or com is None or R is None or not c.fitted_poses:
        return ""
    onto_paper, body = np.array([[-0.80, -0.42], [0.86, -0.36], [0.0, 1.0]]), c.ellipsoid
    reach = max(float(np.linalg.norm(com)), 0.01, 0.0 if body is None else float(body.semi_axes.max()))
    down = gravity_in_flange(c.fitted_poses[0].R_base_flange[None], c.gravity_direction)[0] @ R
    steps = np.array([np.where(np.arange(3) < k, com, 0.0) for k in range(4)]) @ onto_paper
    arrows = [(f"flange {'xyz'[k]}", np.zeros(3), 0.6 * R[k], "#9aa2a9", ":") for k in range(3)]
    arrows += [("xyz"[k], np.zeros(3), np.eye(3)[k], AXIS_COLOURS[k], "-") for k in range(3)]
    arrows += [(f"{three_digits(c.weight)} N", com, 0.6 * down, "#1f262d", "-")]
    with drawing(1, (3.9, 4.6)) as (figure, (ax,)):
        ax.plot(steps[:, 0], steps[:, 1], ":", color="#1b6e9c", lw=1.2)
        ax.plot(*steps[3], "o", ms=8 if body is None else 3, color="#1b6e9c")
        if body is not None:
            _draw_body(ax, body, steps[3], onto_paper)
            ax.plot(*(steps[3] + _outline(_com_square(c), onto_paper)).T, color="#1b6e9c", lw=0.9)
        for name, start, way, colour, style in arrows:
            tail, tip, beyond = ((start + length * reach * way) @ onto_paper for length in (0.0, 1.0, 1.15))
            ax.annotate("", tip, tail, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.4, "ls": style})
            onwards = (tip - tail) / max(float(np.linalg.norm(tip - tail)), 1e-300)
            side = "center" if abs(onwards[0]) < 0.3 else "left" if onwards[0] > 0.0 else "right"
            of_name: dict[str, Any] = {"ha": side, "va": "center", "color": colour, "bbox": PLAIN}
            ax.annotate(name, tip, 7.0 * onwards, textcoords="offset points", **of_name)
            ax.plot(*beyond, alpha=0.0)  # so that there is room for the name
        at = ", ".join(f"{1e3 * part:.1f}" for part in com)
        ax.set_title(f"com {at} mm", color="#1b6e9c")
        ax.set(aspect="equal")
        ax.margins(0.08)
        ax.set_axis_off()
        return svg_text(figure)


def principal_rows(body: Ellipsoid) -> list[tuple[str, str, str]]:
    """Of each principal axis, sensor axes, the moment with its std, and the semi-axis, or what two std make of it."""
    rows = []
    for k, axis in enumerate(body.axes.T):
        along = ", ".join(f"{part:.2f}" for part in axis * np.sign(axis[np.argmax(np.abs(axis))]))
        moment = " +- ".join(meaningful_digits(1e4 * float(body.moments[k]), 1e4 * float(body.moment_std[k])))
        low, high = (two_digits(1e3 * float(of[k])) for of in (body.low, body.high))
        rows.append((along, moment, low if low == high else f"{low} to {high}"))
    return rows


def _draw_body(ax: Axes, body: Ellipsoid, com: Array, onto_paper: Array) -> None:
    """The ellipsoid around the centre of mass (2,) on paper, its semi-axes, and the band that two std make of it."""
    from matplotlib.patches import Polygon

    def outline(semi_axes: Array) -> Array:
        return com + _outline((body.axes * semi_axes**2) @ body.axes.T, onto_paper)

    ax.plot(*outline(body.semi_axes).T, color=BODY, lw=1.2)
    ax.plot(*outline(np.minimum(body.high, MOST_OF_BAND * body.semi_axes.max())).T, alpha=0.0)  # room for the band
    band = np.concatenate([outline(body.low), outline(body.high)[::-1]])
    ax.add_artist(Polygon(band, color=BODY, alpha=0.2, lw=0))
    for half in (body.semi_axes * body.axes).T @ onto_paper:
        ax.plot(*np.stack([com - half, com + half]).T, color=BODY, lw=0.7)


def _com_square(c: Calibration) -> Array:
    """Of the 95 % ellipsoid of the centre of mass the matrix (3, 3), m^2, of its semi-axes' squares: as seen from any
    side, it holds with 95 %, by Student's t of two dimensions, whose quantile `k ((1 - p)^(-2 / k) - 1)` is exact.
    """
    k, place = c.dof, c.parameter_names.index("com_x")
    reach = -2.0 * np.log(0.05) if k <= 0.0 else k * (0.05 ** (-2.0 / k) - 1.0)
    return np.asarray(reach * c.covariance[place : place + 3, place : place + 3])


def _outline(square: Array, onto_paper: Array) -> Array:
    """The rim (181, 2) on paper of an ellipsoid, whose semi-axes' squares `square` (3, 3) has, flat ones too."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    squares, axes = np.linalg.eigh(onto_paper.T @ square @ onto_paper)
    return np.asarray(np.stack([np.cos(turn), np.sin(turn)], axis=1) @ (np.sqrt(np.maximum(squares, 0.0)) * axes).T)


def std_over_orientations(calibration: Calibration) -> str:
    """The standard deviation of contact force and torque that the calibration causes, over the direction of gravity in
    flange axes: both halves of the sphere, equal areas. The scale is absolute, from zero to where a calibration is
    weak. Dots: the poses, hollow those that were left out.
    """
    c = calibration
    r = gravity_in_flange(np.array([pose.R_base_flange for pose in c.poses]), c.gravity_direction)
    fitted = np.array([pose.rejected is None for pose in c.poses])
    seen, turned = spread_directions(DIRECTIONS), spread_rotations(DIRECTIONS, 4).transpose(0, 2, 1)
    upright = np.stack([*horizontal_axes(c.gravity_direction), c.gravity_direction], axis=1)
    variances = c.wrench_std(upright @ turned).reshape(DIRECTIONS, 4, 2, 3) ** 2  # four turns about the vertical
    stds = np.sqrt(variances.sum(axis=3).mean(axis=1))
    weak = WEAK_SHARE * float(np.linalg.norm(c.B[:3, :3], 2))
    with drawing(4, (WIDTH, 3.5)) as (figure, axes):
        from matplotlib.patches import Circle

        limits = (("force, N", 1.0, weak), ("torque, mN m", 1e3, 1e3 * LEVER * weak))
        for part, (name, scale, most) in enumerate(limits):
            pair = axes[2 * part : 2 * part + 2]
            std = scale * stds[:, part]
            for ax, side in zip(pair, SIDES, strict=True):
                near = side * seen[:, 2] > -0.3  # beyond the rim, so that the colour reaches it
                shown = ax.tripcolor(
                    *_equal_area(seen[near], side), std[near], vmin=0.0, vmax=most, cmap="YlGnBu", shading="gouraud",
                    rasterized=True, clip_path=Circle((0.0, 0.0), 1.0, transform=ax.transData),
                )  # fmt: skip
                _globe(ax, side)
                here = side * r[:, 2] >= 0.0
                ax.plot(*_equal_area(r[here & ~fitted], side), "o", ms=7, mfc="none", mec=LEFT_OUT, mew=1.2)
                ax.plot(*_equal_area(r[here & fitted], side), "o", ms=4, mfc="white", mec="#2a3036", mew=0.7)
                toward = f"gravity to flange {'+' if side > 0.0 else '-'}z"
                said = f"{toward}: {counted(int((here & fitted).sum()), 'pose')}"
                half = std[side * seen[:, 2] > 0.0]
                ends = " to ".join(map(two_digits, (half.min(), half.max())))
                ax.set_title(f"{said}\n{ends} {name.partition(', ')[2]}", fontsize=9, color="#2a3036")
            bar = figure.colorbar(shown, ax=pair, location="bottom", shrink=0.8, aspect=30, pad=0.02, extend="max")
            bar.set_label(f"std of the contact {name}")
            bar.outline.set_visible(False)
        return svg_text(figure)


def _equal_area(r: Array, side: float) -> tuple[Array, Array]:
    """Lambert's azimuthal projection of directions (n, 3) of one half, onto the unit disc."""
    scale = 1.0 / np.sqrt(1.0 + side * r[:, 2])
    return r[:, 0] * scale, r[:, 1] * scale


def _globe(ax: Axes, side: float) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    ax.plot(np.cos(turn), np.sin(turn), color="#9aa2a9", lw=1.0)
    for degrees in (30.0, 60.0):
        radius = np.sqrt(1.0 - np.cos(np.deg2rad(degrees)))
        ax.plot(radius * np.cos(turn), radius * np.sin(turn), color="#9aa2a9", lw=0.5)
        ax.text(0.0, radius + 0.02, f"{degrees:.0f}°", fontsize=7, color="#6a7178", ha="center")
    for name, (x, y) in {"+x": (1.0, 0.0), "+y": (0.0, 1.0), "-x": (-1.0, 0.0), "-y": (0.0, -1.0)}.items():
        ax.text(1.1 * x, 1.1 * y, name, fontsize=8, color="#6a7178", ha="center", va="center")
    ax.text(0.03, 0.03, "+z" if side > 0.0 else "-z", fontsize=8, color="#6a7178")
    ax.plot(0.0, 0.0, "+", ms=5, color="#9aa2a9")
    ax.set(aspect="equal", xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    ax.set_axis_off()


@contextmanager
def drawing(columns: int, size: tuple[float, float], rows: int = 1) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of that size, inches, and its axes, row by row. Raises `MissingExtraError` without matplotlib."""
    mpl = of_extra("matplotlib", "the report", "report")
    from matplotlib.figure import Figure

    with ONE_AT_A_TIME, mpl.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        yield figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def _number_poses(ax: Axes, calibration: Calibration) -> None:
    """Poses along x in the order of time, by their numbers, with a band where one was left out."""
    from matplotlib.ticker import MaxNLocator

    numbers = [k + 1 for k in in_order_of_time(calibration)]
    for place in places_in_time(calibration)[1]:
        ax.axvspan(place - 0.4, place + 0.4, color=LEFT_OUT, alpha=0.15, lw=0)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
    ax.xaxis.set_major_formatter(lambda x, _: str(numbers[int(x) - 1]) if 0 < x <= len(numbers) else "")
    ax.set(xlabel="pose", xlim=(0.4, len(numbers) + 0.6))


def svg_text(figure: Figure) -> str:
    """The figure as an SVG element, the same bytes for the same figure."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = StringIO()
    figure.dpi = 150.0
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(text, metadata={"Date": None})  # savefig draws everything twice
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
