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
from ..errors import MissingExtraError
from ..geometry.arrays import Array
from ..model import gravity_in_flange
from ..statistics import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIDES = (1.0, -1.0)
AXIS_COLOURS = ("#c1443c", "#3a7d44", "#2f5fa8")
METHODS = {
    "full": ("#1b6e9c", "o"),
    "tare": ("#c98a1b", "s"),
    "gravity only": ("#8a5a9e", "^"),
    "raw": ("#8a8f94", "x"),
}
"""Colour and marker of each."""
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
    kept, left_out = pose_numbers(calibration)
    with drawing(2, (8.2, 2.9)) as (figure, axes):
        for ax, (part, name, scale) in zip(axes, PARTS, strict=True):
            band = 2.0 * scale * float(calibration.noise[part : part + 3].max())
            ax.axhspan(-band, band, color="#e9eef2", lw=0)
            ax.axhline(0.0, color="#9aa2a9", lw=0.8)
            for k in range(3):
                values = scale * left.wrench[:, part + k]
                ax.plot(kept + 0.18 * (k - 1), values, "o", ms=4, color=AXIS_COLOURS[k], label="xyz"[k])
            ax.set_ylabel(f"residual {name}")
            _number_poses(ax, len(calibration.poses), left_out)
        axes[1].legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), handletextpad=0.1, columnspacing=1.0)
        return svg_text(figure)


def left_over_per_pose(calibration: Calibration, methods: tuple[LeftOver, ...]) -> str:
    """The norm of force and torque left in each contact-free pose, by each method of compensation; log scale."""
    kept, left_out = pose_numbers(calibration)
    with drawing(2, (8.2, 3.0)) as (figure, axes):
        for ax, (part, name, scale) in zip(axes, PARTS, strict=True):
            for method in methods:
                norm = scale * np.linalg.norm(method.wrench[:, part : part + 3], axis=1)
                colour, marker = METHODS[method.name]
                shown = np.where(norm > 0.0, norm, np.nan)
                ax.plot(kept, shown, marker, ms=4, color=colour, label=method.name, ls="-", lw=0.7)
            ax.set_yscale("log")
            ax.yaxis.set_major_formatter("{x:g}")
            ax.set_ylabel(f"left over, {name}")
            _number_poses(ax, len(calibration.poses), left_out)
        axes[0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), handletextpad=0.3, columnspacing=1.2)
        return svg_text(figure)


def pose_numbers(calibration: Calibration) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The numbers, from 1 and in the order of the recording, of the poses that were fitted and of those left out."""
    out = np.array([pose.rejected is not None for pose in calibration.poses])
    return np.flatnonzero(~out) + 1, np.flatnonzero(out) + 1


def gravity_on_sphere(calibration: Calibration) -> str:
    """The directions of gravity in flange axes that the poses covered: both halves of the sphere, equal areas. Hollow:
    poses that were left out.
    """
    R = np.array([pose.R_base_flange for pose in calibration.poses])
    r = gravity_in_flange(R, calibration.gravity_direction)
    fitted = np.array([pose.rejected is None for pose in calibration.poses])
    with drawing(2, (6.4, 3.3)) as (figure, axes):
        for ax, side in zip(axes, SIDES, strict=True):
            _globe(ax, side)
            here = side * r[:, 2] >= 0.0
            ax.plot(*_equal_area(r[here & ~fitted], side), "o", ms=9, mfc="none", mec=LEFT_OUT, mew=1.2)
            ax.plot(*_equal_area(r[here & fitted], side), "o", ms=6, mfc="#1b6e9c", mec="white", mew=0.8, alpha=0.9)
            count = int((here & fitted).sum())
            ax.set_title(f"{_side(side)}: {counted(count, 'pose')}", fontsize=9, color="#2a3036")
        return svg_text(figure)


def std_over_orientations(calibration: Calibration, quantity: str) -> str:
    """The standard deviation of the contact `force` or `torque` that the calibration causes, over the direction of
    gravity in flange axes; the directions of the poses that were fitted as dots.
    """
    part, scale, unit = {"force": (slice(0, 3), 1.0, "N"), "torque": (slice(3, 6), 1e3, "mN m")}[quantity]
    R = np.array([pose.R_base_flange for pose in calibration.fitted_poses])
    poses = gravity_in_flange(R, calibration.gravity_direction)
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41))
    within = 1.0 / np.maximum(np.hypot(x, y), 1.0)
    std = [
        scale * _std(calibration, _from_equal_area((x * within).ravel(), (y * within).ravel(), side), part)
        for side in SIDES
    ]
    with drawing(2, (6.9, 3.2)) as (figure, axes):
        from matplotlib.patches import Circle

        for ax, half, side in zip(axes, std, SIDES, strict=True):
            shown = ax.pcolormesh(
                x, y, half.reshape(x.shape), vmin=np.min(std), vmax=np.max(std), cmap="YlGnBu", shading="gouraud",
                rasterized=True, clip_path=Circle((0.0, 0.0), 1.0, transform=ax.transData),
            )  # fmt: skip
            _globe(ax, side)
            here = side * poses[:, 2] >= 0.0
            ax.plot(*_equal_area(poses[here], side), "o", ms=4, mfc="white", mec="#2a3036", mew=0.7)
            ax.set_title(_side(side), fontsize=9, color="#2a3036")
        bar = figure.colorbar(shown, ax=list(axes), shrink=0.8, pad=0.02)
        bar.set_label(f"std of the contact {quantity}, {unit}")
        bar.outline.set_visible(False)
        return svg_text(figure)


def _std(calibration: Calibration, r: Array, part: slice) -> Array:
    """Root of the summed variances of three axes for gravity along r (n, 3), the mean over turns about it."""
    from scipy.spatial.transform import Rotation

    d = calibration.gravity_direction
    R = np.array([_half_turn(direction, d) for direction in r])
    turns = Rotation.from_rotvec(np.outer(np.linspace(0.0, 2.0 * np.pi, 6, endpoint=False), d)).as_matrix()
    variances = [np.sum(calibration.wrench_std(turn @ R)[:, part] ** 2, axis=1) for turn in turns]
    std: Array = np.sqrt(np.mean(variances, axis=0))
    return std


def _half_turn(start: Array, end: Array) -> Array:
    """The half turn R about the axis midway between two unit vectors: `R @ start = end`."""
    axis = start + end
    if axis @ axis < 1e-12:
        axis = np.cross(start, np.eye(3)[int(np.argmin(np.abs(start)))])
    R: Array = 2.0 * np.outer(axis, axis) / (axis @ axis) - np.eye(3)
    return R


def _equal_area(r: Array, side: float) -> tuple[Array, Array]:
    """Lambert's azimuthal projection of directions (n, 3) of one half, onto the unit disc."""
    scale = 1.0 / np.sqrt(1.0 + side * r[:, 2])
    return r[:, 0] * scale, r[:, 1] * scale


def _from_equal_area(x: Array, y: Array, side: float) -> Array:
    square = np.minimum(x**2 + y**2, 1.0)
    scale = np.sqrt(2.0 - square)
    return np.stack([x * scale, y * scale, side * (1.0 - square)], axis=1)


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


def _side(side: float) -> str:
    return f"gravity towards the flange's {'+' if side > 0.0 else '-'}z"


@contextmanager
def drawing(columns: int, size: tuple[float, float], rows: int = 1) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of that size, inches, and its axes, row by row. Raises `MissingExtraError` without matplotlib."""
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError(
            "the report needs matplotlib, which is not installed: pip install 'contactwrench[report]'"
        ) from None
    with ONE_AT_A_TIME, mpl.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        yield figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def _number_poses(ax: Axes, n: int, left_out: NDArray[np.intp]) -> None:
    """Poses along x in whole numbers, with a band where one was left out."""
    from matplotlib.ticker import MaxNLocator

    for number in left_out:
        ax.axvspan(number - 0.4, number + 0.4, color=LEFT_OUT, alpha=0.15, lw=0)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
    ax.set(xlabel="pose", xlim=(0.4, n + 0.6))


def svg_text(figure: Figure) -> str:
    """The figure as an SVG element, the same bytes for the same figure."""
    text = StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None}, dpi=150)
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
