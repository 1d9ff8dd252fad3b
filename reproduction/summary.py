"""The experiment in short: the methods of compensation side by side, and what becomes of the paper's claims."""

from __future__ import annotations

from collections.abc import Iterable

from .joint_torque_routes import PUSH
from .part import Measured, Part, Table

SERIOUS = 0.1
"""Of the force that is to be found: an error that counts."""

METHODS = ("tare", "gravity only", "paper", "ours")
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("force error, paper's six poses, N", "identification", "unseen", "{method}", "force, N"),
    ("force error, six planned poses, N", "planned", "poses", "{method}", "six planned: force, N"),
    ("100 g weighed in any orientation, RMS %", "weighing", "weights_anywhere", "{method}, norm", "100 g"),
    ("guarded moves that end at the plate", "guarded_move", "guarded_move", "{method}", "at the plate (share)"),
    ("pushing with 10 N, upright plate, RMS error, N", "pushing", "pushing", "{method}", "upright plate, N"),
    ("pushing with 10 N, level plate, RMS error, N", "pushing", "pushing", "{method}", "level plate, N"),
    ("pegs in the hole, upright face", "peg", "peg_upright", "{method}", "in the hole (share)"),
    ("largest force on the peg, upright face, N", "peg", "peg_upright", "{method}", "largest force, N"),
    ("pegs in the hole, level face", "peg", "peg_level", "{method}", "in the hole (share)"),
    ("largest force on the peg, level face, N", "peg", "peg_level", "{method}", "largest force, N"),
)
"""Of the headline table: title, and the part, table, row and column that it is taken from."""


def summary(parts: Iterable[Part]) -> Part:
    """The headline table and the paper's claims, from the parts' own tables."""
    figures = _Figures(parts)
    rows = tuple(
        (title, tuple(figures.cell(part, table, row.format(method=method), column) for method in METHODS))
        for title, part, table, row, column in ROWS
    )
    table = Table(
        "headline",
        "Methods of compensation side by side",
        METHODS,
        rows,
        "Force error: RMS at orientations that were not recorded. All but the second row: calibrated on the paper's "
        "six poses (the tare: zeroed in one pose). The level plate and hole are below the place where the tare was "
        "taken. Empty: not part of that comparison. Trials and intervals are in the sections below.",
    )
    return Part("summary", "In short", tuple(_claims(figures)), (table,))


class _Figures:
    """Figures by part, table, row and column."""

    def __init__(self, parts: Iterable[Part]) -> None:
        self._cells: dict[tuple[str, str, str, str], Measured | str | None] = {
            (part.key, table.key, label, column): cell
            for part in parts
            for table in part.tables
            for label, cells in table.rows
            for column, cell in zip(table.columns, cells, strict=True)
        }

    def cell(self, part: str, table: str, row: str, column: str) -> Measured | str | None:
        """The figure, a word in its place, or None where the table has no such row."""
        return self._cells.get((part, table, row, column))

    def value(self, part: str, table: str, row: str, column: str) -> float:
        """The figure; NaN where there is none."""
        cell = self.cell(part, table, row, column)
        return cell.value if isinstance(cell, Measured) else float("nan")


def _claims(figures: _Figures) -> Iterable[str]:
    """Each claim of the paper, and whether it held here."""
    force = {method: figures.value("identification", "unseen", method, "force, N") for method in METHODS}
    planned = {
        method: figures.value("planned", "poses", method, "six planned: force, N") for method in ("paper", "ours")
    }
    yield (
        f"“The errors calculated by the proposed method are much smaller” than with gravity only: "
        f"{_held(force['paper'] < 0.5 * force['gravity only'])} ({force['paper']:.2g} N against "
        f"{force['gravity only']:.3g} N). A tare in one pose, which costs nothing, leaves {force['tare']:.2g} N; ours "
        f"{force['ours']:.2g} N, which is {_times(force['paper'], force['ours'])} the paper's estimator."
    )
    yield (
        f"“The proposed model only needs six sets of data”: from the paper's six its estimator "
        f"leaves {force['paper']:.2g} N, from six planned ones {planned['paper']:.2g} N; ours {force['ours']:.2g} and "
        f"{planned['ours']:.2g} N."
    )
    down = {
        method: figures.value("weighing", "weights", f"{method}: 100 g", "RMS error, %")
        for method in ("paper", "ours", "tare")
    }
    anywhere = {
        method: figures.value("weighing", "weights_anywhere", f"{method}, norm", "100 g")
        for method in ("paper", "ours")
    }
    yield (
        "“Good estimation accuracy”, shown by weighing (Table IX): with the tool down 100 g come out with an RMS error "
        f"of {down['paper']:.2g} % by the paper's estimator, {down['ours']:.2g} % by ours, and {down['tare']:.2g} % by "
        f"a mere tare. In any orientation within range it is {anywhere['paper']:.2g} % by the paper's estimator and "
        f"{anywhere['ours']:.2g} % by ours."
    )
    slope = figures.value("weighing", "gain", "gain 0.974: paper", "slope")
    yield (
        "The errors that Table IX prints lie on a line, which is what a gain of 0.974 gives: such a sensor has a slope "
        f"of {slope:.3f} here, and no calibration in free air can see it."
    )
    angle = [
        figures.value("prior_work", "level_base", row, "six planned")
        for row in ("known mounting, yaw 34 deg off", "paper", "ours")
    ]
    yield (
        f"That the angle of installation has to be identified: {_held(angle[0] > 2.0 * angle[1])}. With the axes taken "
        f"for aligned, 34 deg off, least squares leaves {angle[0]:.2g} N from six planned poses, the paper's estimator "
        f"{angle[1]:.2g} N, ours {angle[2]:.2g} N."
    )
    ours, paper, torques = (
        figures.value("joint_torques", "joint_torques_workspace", route, "median")
        for route in ("wrist sensor, ours", "wrist sensor, paper", "joint torques, any wrench")
    )
    yield (
        "That force from joint torques has “a cumulative error that has a serious impact”: "
        f"{_held(torques > SERIOUS * PUSH)}. Half of the time it is wrong by more than {torques:.2g} N of {PUSH:g}, "
        f"the wrist sensor by {paper:.2g} N with the paper's calibration and {ours:.2g} N with ours."
    )


def _held(holds: bool) -> str:
    return "that holds" if holds else "that did not hold here"


def _times(other: float, ours: float) -> str:
    """How ours stands to another, in words."""
    return f"{other / ours:.2g} times less than" if other > ours else f"{ours / other:.2g} times more than"
