"""A calibration in plain words and columns, for a terminal or a log."""

from __future__ import annotations

import re
from textwrap import wrap

import numpy as np

from ..errors import visible
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..model import AXES, GRAVITY, MOUNT, horizontal_axes
from ..samples.delay import is_significant
from ..statistics import counted, meaningful_digits, two_digits
from .dynamics import INERTIA, elements
from .fields import CalibrationFields

NOISE_IS_LEARNED = "noise of a sample unknown: a Compensator takes its first second for free air"
Row = tuple[str, str, str, str]  # name, value, standard deviation, unit

LEAST_OF_DIRECTION = 1e-6
"""Of a unit vector's part, in words: that along it is known to the square of the others."""
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
    required, and the findings; a sentence is one line, which `flowed` makes fit.
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
    said = [f"{finding.label:<7}  {finding.text}" for finding in calibration.findings]
    lines += [f"Verdict  {head}: {'; '.join(reasons)}", *said]
    return "\n".join(map(visible, lines))


def verdict_sentences(c: CalibrationFields, missed: str = "") -> list[str]:
    """The verdict, with what is `missed` of what was required; why it is doubtful; and the error to expect."""
    of_both = np.array([*c.expected_error, *c.largest_std]) * (1.0, 1e3, 1.0, 1e3)
    force, torque, own_force, own_torque = map(two_digits, of_both)
    link = "but" if c.verdict == "good" else "and"
    return [
        f"{c.verdict}, {link} misses what is required, {missed}" if missed else c.verdict,
        *(c.doubts if c.verdict == "doubtful" else ()),
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
    units = ["N" if axis[0] == "f" else "N m" for axis in AXES]
    of_bias = zip(AXES, c.bias, std["bias"], units, strict=True)
    rows += [_row(f"bias_{axis}", value, spread, unit) for axis, value, spread, unit in of_bias]
    if c.model == "affine":
        of_B = zip(c.parameter_names, c.parameters, np.sqrt(np.diag(c.covariance)), np.repeat(units, 4), strict=True)
        rows += [_row(*row) for row in of_B if not row[0].endswith("_1")]  # which is the bias
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
        spread, k = np.sqrt(np.maximum(np.diag(about), LEAST_OF_DIRECTION**2)), int(np.argmax(np.abs(d)))
        rows += [_row(f"gravity_{x}", v, s, "in base axes") for x, v, s in zip("xyz", d, spread, strict=True)]
        rows.append(_row("lean", *_angle_to_axis(d, k, about), f"deg, of gravity from the base's {'xyz'[k]}"))
    if c.dynamics is not None:
        moments = zip(INERTIA, elements(c.dynamics.inertia), std["inertia"], strict=True)
        rows += [_row(name, 1e4 * v, 1e4 * s, "kg cm^2, about com") for name, v, s in moments]
        place = zip("xyz", c.dynamics.sensor_offset, std["sensor_offset"], strict=True)
        origin = "flange" if c.dynamics.accelerometer is None else "accelerometer, flange axes"
        rows += [_row(f"offset_{x}", 1e3 * v, 1e3 * s, f"mm, sensor from {origin}") for x, v, s in place]
    if c.delay is not None and c.delay_std is not None:
        late = "wrench" if c.delay >= 0.0 else "orientation"
        unit = f"ms, {late} late; {'applied' if is_significant(c.delay, c.delay_std) else 'not applied'}"
        rows.append(_row("delay", 1e3 * abs(c.delay), 1e3 * c.delay_std, unit))
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
    if c.dynamics is not None:
        named |= {"rms in motion": c.dynamics.residual_rms, "without inertia": c.dynamics.static_rms}
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
