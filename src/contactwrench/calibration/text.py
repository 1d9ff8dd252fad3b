"""A calibration in plain words and columns, for a terminal or a log; and what a difference of two means."""

from __future__ import annotations

import re
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np

from ..errors import visible
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..model import AXES, GRAVITY, LINEAR_PARAMETERS, MOUNT, horizontal_axes
from ..samples.delay import applied_or_not
from ..statistics import (
    SIGNIFICANCE,
    MisfitTest,
    counted,
    in_standard_deviations,
    meaningful_digits,
    misfit_of_parameters,
    percent,
    two_digits,
)
from .fields import CalibrationFields
from .observability import SPOKEN_UNITS

if TYPE_CHECKING:
    from .difference import Difference, GroupChange

NOISE_IS_LEARNED = "noise of a sample unknown: a Compensator takes its first second for free air"
Row = tuple[str, str, str, str]  # name, value, standard deviation, unit

COLUMNS = 80
"""Of text where nobody says how wide it may be."""
LABEL = re.compile(r" *(?:[-*] |\S+  +)?")
"""What stands before a sentence: an indent, a bullet, or a word and two spaces."""


def flowed(text: str, columns: int = COLUMNS) -> str:
    """Lines with more `columns` go on in the next one, under their first word; a word is never broken. A line with two
    spaces in a row behind its label is a row of a table, and stays as it is.
    """
    lines: list[str] = []
    for line in text.split("\n"):
        label = LABEL.match(line)
        indent = label.end() if label is not None else 0
        if len(line) <= columns or "  " in line[indent:]:
            lines.append(line)
        else:
            room, below = max(columns, indent + 1), " " * indent
            lines += wrap(line, room, subsequent_indent=below, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines)


def describe(calibration: CalibrationFields, missed: str = "") -> str:
    """Every parameter with its standard deviation and unit, the fit, the verdict, with what is `missed` of what was
    required, and the warnings; a sentence is one line, which `flowed` makes fit.
    """
    rows = parameter_rows(calibration)
    width = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = [", ".join(filter(None, [headline(calibration), str(calibration.provenance.get("source", ""))])), ""]
    lines += [
        f"  {name:<{width[0]}}  {value:>{width[1]}}  {'+- ' + std if std else '':<{width[2] + 3}}  {unit}".rstrip()
        for name, value, std, unit in rows
    ]
    of_axes = [["", *AXES], *fit_rows(calibration)]
    table = [f"  {name:<15}{''.join(f'{cell:>9}' for cell in cells)}" for name, *cells in of_axes]
    lines += ["", f"{table[0]}  N, mN m", *table[1:], *(f"  {fact}" for fact in fit_facts(calibration)), ""]
    lines += [f"Assumed  {assumption}" for assumption in calibration.assumptions]
    if calibration.alternatives:
        lines += ["", "  other models  weight N             left N     mN m   force changes by up to"]
        others = alternative_rows(calibration)
        lines += [*(f"  {a:<12}  {b:<18}  {c:>7}  {d:>7}   {e} N" for a, b, c, d, e in others), ""]
    head, *reasons = verdict_sentences(calibration, missed)
    lines += [f"Verdict  {head}: {'; '.join(reasons)}", *(f"Warning  {warning}" for warning in calibration.warnings)]
    return "\n".join(map(visible, lines))


def verdict_sentences(c: CalibrationFields, missed: str = "") -> list[str]:
    """The verdict, with what is `missed` of what was required; why it is doubtful; and the error to expect."""
    of_both = np.array([*c.expected_error, *c.largest_std]) * (1.0, 1e3, 1.0, 1e3)
    force, torque, own_force, own_torque = map(two_digits, of_both)
    link = "but" if c.verdict == "good" else "and"
    return [
        f"{c.verdict}, {link} misses what is required, {missed}" if missed else c.verdict,
        *c.doubts,
        f"at a new orientation expect an error of {force} N and {torque} mN m (std), of which the calibration's own "
        f"uncertainty is up to {own_force} N and {own_torque} mN m",
    ]


def headline(c: CalibrationFields) -> str:
    """Model, and how many poses and rows it was fitted on."""
    n = len(c.poses) if c.moments is None else c.moments.n
    kept = len(c.fitted_poses) if c.moments is None else n
    rows = c.provenance.get("rows", n)
    of_all = "" if kept == n else f"{kept} of "
    poses = f"{of_all}{counted(n, 'pose')}"
    of_rows = "" if rows == n else f" from {rows} rows"
    return f"Calibration, model {c.requested_model}, {poses}{of_rows}"


def parameter_rows(calibration: CalibrationFields) -> list[Row]:
    """Every parameter as text, in the units that people speak: N, kg, mm, N m, deg."""
    c, std = calibration, calibration.std
    rows: list[Row] = []
    if c.weight is not None and c.mass is not None and c.com is not None and c.yaw is not None:
        rows.append(_row("weight", c.weight, std["weight"], "N"))
        if c.weight_xy is not None and c.weight_z is not None:
            rows.append(("weight_xy", f"{c.weight_xy:.4g}", "", "N, from the x and y rows of Eq. 13"))
            rows.append(("weight_z", f"{c.weight_z:.4g}", "", "N, from the z rows; the paper's G"))
        rows.append(_row("mass", c.mass, std["weight"] / c.g, "kg"))
        rows += [_row(f"com_{x}", 1e3 * v, 1e3 * s, "mm") for x, v, s in zip("xyz", c.com, std["com"], strict=True)]
    rows += [
        _row(f"bias_{axis}", v, s, "N" if axis[0] == "f" else "N m")
        for axis, v, s in zip(AXES, c.bias, std["bias"], strict=True)
    ]
    if c.yaw is not None and c.R_flange_sensor is not None:
        side = "along" if c.sensor_z_along_flange else "against"
        rows.append(_row("yaw", np.rad2deg(c.yaw), np.rad2deg(std["yaw"]), f"deg, sensor's z {side} the flange's"))
        if std["mount"] is not None:
            down = c.R_flange_sensor[2]
            about = cross_matrix(down) @ _block(c, MOUNT) @ cross_matrix(down).T
            rows.append(_row("tilt", *_angle_to_axis(down, 2, about), "deg between those two axes"))
    if std["gravity"] is not None:
        d, axes = c.gravity_direction, np.stack(horizontal_axes(c.gravity_direction), axis=1)
        about = cross_matrix(d) @ axes @ _block(c, GRAVITY) @ axes.T @ cross_matrix(d).T
        spread, k = np.sqrt(np.diag(about)), int(np.argmax(np.abs(d)))
        rows += [_row(f"gravity_{x}", v, s, "in base axes") for x, v, s in zip("xyz", d, spread, strict=True)]
        rows.append(_row("lean", *_angle_to_axis(d, k, about), f"deg, of gravity from the base's {'xyz'[k]}"))
    if c.delay is not None and c.delay_std is not None:
        unit = f"ms, wrench after orientation; {applied_or_not(c.delay, c.delay_std)}"
        rows.append(_row("delay", 1e3 * c.delay, 1e3 * c.delay_std, unit))
    return rows


def _block(c: CalibrationFields, names: tuple[str, ...]) -> Array:
    return c.covariance[np.ix_(*2 * [[c.parameter_names.index(name) for name in names]])]


def _angle_to_axis(v: Array, axis: int, covariance: Array) -> tuple[float, float]:
    """Angle, deg, of a unit vector (3,) from an axis, taken along or against it, and its std; near zero, where it has
    no derivative, the std in the least certain direction. `covariance` (3, 3) of the vector.
    """
    sine = float(np.linalg.norm(np.delete(v, axis)))
    least_certain = sine < 1e-6
    std = np.sqrt(np.linalg.eigvalsh(covariance)[-1] if least_certain else covariance[axis, axis] / sine**2)
    return 0.0 if least_certain else float(np.rad2deg(np.arctan2(sine, abs(v[axis])))), float(np.rad2deg(std))


def fit_rows(c: CalibrationFields) -> list[list[str]]:
    """Of noise, residual and held-out error their name, and the figures of each axis, N and mN m."""
    named = {"noise of a pose": c.noise, "residual rms": c.residual_rms, "held-out rms": c.held_out_rms}
    return [
        [name, *(["-"] * 6 if wrench is None else [f"{v:.3g}" for v in (*wrench[:3], *(1e3 * wrench[3:]))])]
        for name, wrench in named.items()
    ]


def fit_facts(c: CalibrationFields) -> list[str]:
    """How well the noise is known, how well the poses are spread, and where no rows in turn tell a sample's noise."""
    low, high = np.rad2deg(c.observability.tilt_range)
    fit = f"reduced chi-square {c.reduced_chi2:.3g}, {c.dof:.3g} degrees of freedom"
    spread = (
        f"condition number {c.observability.condition:.3g}, gravity {low:.0f} to {high:.0f} deg from the flange's z"
    )
    return [fit, spread, *([NOISE_IS_LEARNED] if c.still_noise is None else [])]


def alternative_rows(c: CalibrationFields) -> list[tuple[str, str, str, str, str]]:
    """Of each other model its name, weight (N), what it leaves (N, mN m) and by how much the force changes (N)."""
    rows = []
    for other in c.alternatives:
        known = other.weight is not None and other.weight_std is not None
        weight = " +- ".join(meaningful_digits(other.weight or 0.0, other.weight_std or 0.0)) if known else "-"
        change = other.largest_force_change(c.B, c.gravity_direction)
        left = f"{other.force_left:.3g}", f"{1e3 * other.torque_left:.3g}"
        rows.append((other.model, weight, *left, f"{change:.2g}"))
    return rows


def _row(name: str, value: float, std: float, unit: str) -> Row:
    return name, *meaningful_digits(value, std), unit


SAME_GRAVITY = 1e-6
"""rad: two stated directions closer than this are one."""

WORDS = {
    "tool": "the tool",
    "bias": "the bias",
    "mounting": "the mounting",
    "gravity": "the base",
    "matrix": "the tool, the mounting or a gain",
}

UNITS_OF_CHANGES = {**SPOKEN_UNITS, "torque": (1e3, "mN m"), "yaw": (180.0 / np.pi, "deg")}


def meaning(change: Difference) -> tuple[str, ...]:
    """One sentence for each cause that shows; one that says so where none does."""
    *groups, everything = change.groups
    moved = [group for group in groups if group.significant]
    sentences = [_sentence(change, group, len(moved) == 1) for group in moved]
    if not moved and everything.significant:
        sentences.append(_unresolved(groups, everything))
    elif not moved:
        probability = f"{_improbable(everything)}{everything.test.caution}"
        sentences.append(f"nothing changed beyond the errors of both: {probability}")
    if "delay" in change.significant:
        k = change.names.index("delay")
        sentences.append(
            f"the delay between wrench and orientation changed by {1e3 * change.change[k]:+.3g} ms "
            f"({abs(change.in_std[k]):.3g} std): another clock, or another filter in the sensor"
        )
    if change.gravity_angle > SAME_GRAVITY and "gravity" not in [group.name for group in groups]:
        sentences.append(
            f"gravity was stated {np.rad2deg(change.gravity_angle):.3g} deg apart in base axes: another stand, or "
            "another flag"
        )
    return tuple(sentences)


def _sentence(change: Difference, group: GroupChange, is_alone: bool) -> str:
    """What happened, where a group changed, and no other where it `is_alone`."""
    improbable = _improbable(group)
    if group.name == "tool":
        return _tool(group)
    if group.name == "bias":
        shift = ", ".join(_shown(group, slice(0, 3), slice(3, 6))) or improbable
        if is_alone:
            return f"drift, or a new zero: only the bias changed, {shift}; all else is the same within its errors"
        return f"the bias changed as well: {shift}"
    if group.name == "mounting":
        return _mounting(change, group)
    if group.name == "gravity":
        apart = f"{np.rad2deg(change.gravity_angle):.3g} deg apart in base axes"
        return f"the base stands otherwise: gravity is {apart} ({improbable})"
    return f"what gravity does changed ({improbable}): {WORDS['matrix']}; model affine cannot tell which"


def _tool(group: GroupChange) -> str:
    shown = _shown(group, slice(0, 1), slice(1, 4))
    if not shown:
        return f"the tool changed: weight and centre of mass together ({_improbable(group)})"
    if shown[0].startswith("weight"):
        return f"the tool changed: {', '.join(shown)}"
    std = np.sqrt(group.covariance[0, 0])
    return f"something moved on the tool: {shown[0]}, its weight is the same within {std:.2g} N"


def _mounting(change: Difference, group: GroupChange) -> str:
    if group.parameters == ("mounting_angle",):
        return "the sensor was mounted anew, on its other side: its z points along the flange's in one of the two only"
    if group.parameters == ("yaw",):
        return f"the sensor slipped or was mounted anew: {_largest(group, slice(0, 1))} about its z"
    angle = np.rad2deg(change.mounting_angle or 0.0)
    about = ", ".join(f"{part:.2f}" for part in group.change / max(float(np.linalg.norm(group.change)), 1e-300))
    turned = f"turned by {angle:.3g} deg about ({about}) in sensor axes"
    return f"the sensor slipped or was mounted anew: it is {turned} ({_improbable(group)})"


def _unresolved(groups: list[GroupChange], everything: GroupChange) -> str:
    """Something changed, but each group by itself might be the same: those that could explain it alone are named."""
    alone = []
    for group in groups:
        rest = np.array([name not in group.parameters for name in everything.parameters])
        if _of_parameters(everything, rest).probability >= SIGNIFICANCE:
            alone.append(WORDS[group.name])
    suspects = f"{' or '.join(alone)} alone would explain it" if alone else "no single cause explains it"
    return (
        f"something changed ({_improbable(everything)}), but these calibrations cannot tell what: {suspects}; "
        "calibrate with poses that tilt the tool further"
    )


def _shown(group: GroupChange, *parts: slice) -> list[str]:
    """Of each part of a group that is significant by itself, its largest change."""
    return [_largest(group, rows) for rows in parts if _of_parameters(group, rows).probability < SIGNIFICANCE]


def _of_parameters(group: GroupChange, rows: slice | Array) -> MisfitTest:
    """The test of no change in some parameters of a group, whatever the others do."""
    change = group.change[rows]
    return MisfitTest(misfit_of_parameters(change, group.covariance[rows][:, rows]), len(change), group.test.dof)


def _largest(group: GroupChange, rows: slice) -> str:
    """Of some parameters the one that changed by the most standard deviations, and by how much."""
    ratio: Array = np.abs(in_standard_deviations(group.change, np.sqrt(np.diag(group.covariance))))[rows]
    k = rows.start + int(np.argmax(ratio))
    name, value = group.parameters[k], float(group.change[k])
    factor, unit = UNITS_OF_CHANGES["torque" if name in LINEAR_PARAMETERS[7:] else name.split("_")[0]]
    return f"{name} by {factor * value:+.3g} {unit} ({ratio.max():.3g} std)"


def _improbable(group: GroupChange) -> str:
    return f"chi-square {group.test.chi2:.3g} per parameter, probability {percent(group.test.probability)}"
