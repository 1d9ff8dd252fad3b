"""A calibration in plain words and columns, for a terminal or a log."""

from __future__ import annotations

import re
from textwrap import wrap

import numpy as np

from ..geometry.arrays import Array
from ..model import AXES, GRAVITY, MOUNT, horizontal_axes
from ..samples.delay import applied_or_not
from ..statistics import counted, meaningful_digits
from .fields import CalibrationFields

Row = tuple[str, str, str, str]
"""Name, value, standard deviation, unit."""

COLUMNS = 80
"""Of text where nobody says how wide it may be."""
LABEL = re.compile(r" *(?:[-*] |\S+  +)?")
"""What stands before a sentence: an indent, a bullet, or a word and two spaces."""


def flowed(text: str, columns: int = COLUMNS) -> str:
    """Sentences that are too long go on in the next line, under their first word; a word is never broken.

    Args:
        text: lines; one with two spaces in a row behind its label is a row of a table, and stays as it is.
        columns: the most that a line may have.

    Returns:
        The same words.
    """
    lines: list[str] = []
    for line in text.split("\n"):
        label = LABEL.match(line)
        indent = label.end() if label is not None else 0
        if len(line) <= columns or "  " in line[indent:]:
            lines.append(line)
        else:
            room = max(columns, indent + 1)
            below = " " * indent
            lines += wrap(line, room, subsequent_indent=below, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines)


def describe(calibration: CalibrationFields) -> str:
    """Every parameter with its standard deviation and unit, how well it fits, the verdict and the warnings; a sentence
    is one line, which `flowed` makes fit.
    """
    rows = parameter_rows(calibration)
    width = [max(len(row[k]) for row in rows) for k in range(3)]
    lines = [headline(calibration), ""]
    lines += [
        f"  {name:<{width[0]}}  {value:>{width[1]}}  {'+- ' + std if std else '':<{width[2] + 3}}  {unit}".rstrip()
        for name, value, std, unit in rows
    ]
    lines += ["", *fit_lines(calibration), ""]
    lines += [f"Assumed  {assumption}" for assumption in calibration.assumptions]
    if calibration.alternatives:
        lines += ["", *alternative_lines(calibration), ""]
    lines += [f"Verdict  {calibration.verdict}", *(f"Warning  {warning}" for warning in calibration.warnings)]
    return "\n".join(lines)


def headline(calibration: CalibrationFields) -> str:
    """Model, and what it was fitted on."""
    c = calibration
    n = len(c.poses) if c.moments is None else c.moments.n
    kept = len(c.fitted_poses) if c.moments is None else n
    rows = c.provenance.get("rows", n)
    of_all = "" if kept == n else f"{kept} of "
    poses = f"{of_all}{counted(n, 'pose')}"
    of_rows = "" if rows == n else f" from {rows} rows"
    return f"Calibration, model {c.requested_model}, {poses}{of_rows}, {c.provenance.get('source', '')}".rstrip(", ")


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
            tilt, tilt_std = _tilt(c.R_flange_sensor, _block(c, MOUNT))
            rows.append(_row("tilt", np.rad2deg(tilt), np.rad2deg(tilt_std), "deg between those two axes"))
    if std["gravity"] is not None:
        a, b = horizontal_axes(c.gravity_direction)
        turned = np.stack([-b, a], axis=1)
        spread = np.sqrt(np.diag(turned @ _block(c, GRAVITY) @ turned.T))
        rows += [
            _row(f"gravity_{x}", v, s, "in base axes")
            for x, v, s in zip("xyz", c.gravity_direction, spread, strict=True)
        ]
    if c.delay is not None and c.delay_std is not None:
        unit = f"ms, wrench after orientation; {applied_or_not(c.delay, c.delay_std)}"
        rows.append(_row("delay", 1e3 * c.delay, 1e3 * c.delay_std, unit))
    return rows


def _block(c: CalibrationFields, names: tuple[str, ...]) -> Array:
    index = [c.parameter_names.index(name) for name in names]
    return c.covariance[np.ix_(index, index)]


def _tilt(R_flange_sensor: Array, covariance: Array) -> tuple[float, float]:
    """Angle between the two z axes, taken along or against each other, and its std; near zero, where the angle has no
    derivative, the std of a tilt in the least certain direction. `covariance` (3, 3) of the mounting.
    """
    along = abs(float(R_flange_sensor[2, 2]))
    sine = float(np.hypot(R_flange_sensor[2, 0], R_flange_sensor[2, 1]))
    if sine < 1e-6:
        return 0.0, float(np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    gradient = np.array([R_flange_sensor[2, 1], -R_flange_sensor[2, 0]]) / sine
    return float(np.arctan2(sine, along)), float(np.sqrt(gradient @ covariance[:2, :2] @ gradient))


def fit_lines(calibration: CalibrationFields) -> list[str]:
    """How well the model explains its poses: noise, residual and held-out error, an axis a column."""
    c = calibration
    table = [
        ("noise of a pose", c.noise),
        ("residual rms", c.residual_rms),
        ("held-out rms", c.held_out_rms),
    ]
    lines = [f"  {'':<15}" + "".join(f"{axis:>9}" for axis in AXES) + "  N, mN m"]
    for name, values in table:
        if values is None:
            lines.append(f"  {name:<15}" + f"{'-':>9}" * 6)
        else:
            in_units = [*values[:3], *(1e3 * values[3:])]
            lines.append(f"  {name:<15}" + "".join(f"{value:9.3g}" for value in in_units))
    low, high = np.rad2deg(c.observability.tilt_range)
    lines += [
        f"  reduced chi-square {c.reduced_chi2:.3g}, {c.dof:.3g} degrees of freedom",
        f"  condition number {c.observability.condition:.3g}, gravity {low:.0f} to {high:.0f} deg from the flange's z",
    ]
    return lines


def alternative_lines(calibration: CalibrationFields) -> list[str]:
    """What other models make of the same poses, a line each."""
    lines = ["  other models  weight N             left N     mN m   force changes by up to"]
    for other in calibration.alternatives:
        weight = "-"
        if other.weight is not None and other.weight_std is not None:
            _, value, std, _ = _row("weight", other.weight, other.weight_std, "N")
            weight = f"{value} +- {std}"
        change = other.largest_force_change(calibration.B, calibration.gravity_direction)
        left = f"{other.force_left:7.3g}  {1e3 * other.torque_left:7.3g}"
        lines.append(f"  {other.model:<12}  {weight:<18}  {left}   {change:.2g} N")
    return lines


def _row(name: str, value: float, std: float, unit: str) -> Row:
    return name, *meaningful_digits(value, std), unit
