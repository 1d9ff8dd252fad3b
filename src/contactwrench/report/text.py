"""Verification, held object and difference as text for the terminal, and as JSON."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import msgspec
import numpy as np

from ..assess.verify import Verification
from ..assess.weigh import HeldObject
from ..calibration.difference import Difference
from ..geometry.arrays import Array
from ..model import AXES
from ..statistics import meaningful_digits, percent


def verification_text(result: Verification) -> str:
    """What is left in the contact-free poses, the paper's Table IX for hung loads, and the verdict."""
    lines = []
    if len(result.residuals):
        lines += [
            f"Verification on {len(result.residuals)} contact-free pose{'' if len(result.residuals) == 1 else 's'}",
            "",
            f"  {'':<14}" + "".join(f"{axis:>9}" for axis in AXES) + "   N, mN m",
            f"  {'residual rms':<14}" + "".join(f"{value:9.3g}" for value in result.rms * _MILLI),
            f"  {'largest':<14}" + "".join(f"{value:9.3g}" for value in np.abs(result.residuals).max(axis=0) * _MILLI),
            f"  largest norms: {result.largest_force:.3g} N, {1e3 * result.largest_torque:.3g} mN m",
            "",
        ]
    if result.weighings:
        lines += ["  weighed g         actual g   error %           poses"]
        lines += [
            f"  {1e3 * w.weighed:7.1f} +- {1e3 * w.std:<6.1f} {1e3 * w.actual:8.1f}   "
            f"{100 * w.error:+6.2f} +- {100 * w.error_std:<5.2f}  {w.n:5d}"
            for w in result.weighings
        ]
        lines += [""]
    lines += [f"Warning  {warning}" for warning in result.warnings]
    lines.append(f"{'PASSED' if result.passed else 'FAILED'}  {result.reason}")
    return "\n".join(lines)


def verification_json(result: Verification) -> str:
    """The fields of `Verification` under their names; each weighing with its `error` and `error_std`."""
    values: dict[str, Any] = {field.name: getattr(result, field.name) for field in fields(result)}
    values["residuals"], values["rms"] = result.residuals.tolist(), result.rms.tolist()
    values["weighings"] = [{**asdict(w), "error": w.error, "error_std": w.error_std} for w in result.weighings]
    return _json(values)


def held_object_text(held: HeldObject) -> str:
    """Mass, centre of mass in sensor and flange axes, what a rigid object leaves, and the warnings."""
    factor, unit = (1.0, "kg") if abs(held.mass) >= 1.0 else (1e3, "g")
    mass, std = meaningful_digits(factor * held.mass, factor * held.mass_std)
    lines = [
        f"Held object, weighed in {held.poses} pose{'' if held.poses == 1 else 's'}, g {held.g:.6g} m/s^2",
        "",
        f"  mass   {mass:>8} +- {std} {unit}",
        *_com_lines(held),
        "",
        f"  {'':<14}" + "".join(f"{axis:>9}" for axis in AXES) + "   N, mN m",
        f"  {'residual rms':<14}" + "".join(f"{value:9.3g}" for value in held.residual_rms * _MILLI),
        f"  chi-square {held.chi2:.3g} per degree of freedom, probability {percent(held.probability)}",
    ]
    lines += [f"Warning  {warning}" for warning in held.warnings]
    return "\n".join(lines)


def _com_lines(held: HeldObject) -> list[str]:
    """The centre of mass in mm; of one that is known in part, the line on which it lies."""
    if held.com is None or held.com_covariance is None:
        return []
    if held.unknown_along is not None:
        std = 1e3 * np.sqrt(np.linalg.eigvalsh(held.com_covariance)[-1])
        point, along = 1e3 * held.com, held.unknown_along
        return [
            f"  com    on the line ({_triple(point, 1)}) + s ({_triple(along, 3)}) mm, +- {std:.2g} across, sensor axes"
        ]
    columns = [(held.com, held.com_std), (held.com_flange, held.com_flange_std)]
    texts = [
        [meaningful_digits(1e3 * v, 1e3 * s) for v, s in zip(com, std, strict=True)]
        for com, std in columns
        if com is not None and std is not None
    ]
    titles = ("sensor axes", "flange axes")[: len(texts)]
    lines = ["", f"  {'':<5}" + "".join(f"{title:>18}  " for title in titles) + "  mm, from the sensor's origin"]
    for k, axis in enumerate("xyz"):
        cells = "".join(f"{value:>10} +- {std:<6}" for value, std in (column[k] for column in texts))
        lines.append(f"  com_{axis}{cells}".rstrip())
    return lines


def _triple(values: Array, digits: int) -> str:
    return ", ".join(f"{round(value, digits) + 0.0:.{digits}f}" for value in values.tolist())


def held_object_json(held: HeldObject) -> str:
    """The fields of `HeldObject` under their names, and `com_std`; null where a number is not known."""
    values = {field.name: getattr(held, field.name) for field in fields(held)} | {"com_std": held.com_std}
    return _json({name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values.items()})


def difference_text(change: Difference) -> str:
    """What the changes mean; each with its standard deviation, in the units that people speak, * marking more than
    three of them.
    """
    lines = [*change.meaning, "", f"  {'':<9} {'change':>10}    {'std':<9} {'unit':<5} {'in std':>7}"]
    for name, unit, value, std, ratio in zip(
        change.names, change.units, change.change, change.std, change.in_std, strict=True
    ):
        factor, spoken = _SPOKEN.get(unit, (1.0, unit))
        mark = "*" if name in change.significant else " "
        lines.append(f"{mark} {name:<9} {factor * value:>+10.4g} +- {factor * std:<9.2g} {spoken:<5} {ratio:>+7.1f}")
    if change.gravity_angle > 0.0:
        lines.append(f"  gravity is {np.rad2deg(change.gravity_angle):.3g} deg apart in base axes")
    if change.mounting_angle is not None:
        lines.append(f"  the mountings are {np.rad2deg(change.mounting_angle):.3g} deg apart")
    free = change.free_wrench * _MILLI
    each = ", ".join(f"{axis} {value:.3g}" for axis, value in zip(AXES, free, strict=True))
    lines.append(f"  largest change of the free wrench: {each} (N, mN m)")
    if change.significant:
        lines.append(f"* more than 3 standard deviations: {', '.join(change.significant)}")
    else:
        lines.append("no parameter changed by more than 3 standard deviations")
    return "\n".join(lines)


def difference_json(change: Difference) -> str:
    """`change`, `std` and `in_std` by parameter, `free_wrench`, `mounting_angle`, `gravity_angle`, `significant`, the
    joint test of each group, and the `meaning` in words.
    """
    return _json(
        {
            "change": dict(zip(change.names, change.change.tolist(), strict=True)),
            "std": dict(zip(change.names, change.std.tolist(), strict=True)),
            "units": dict(zip(change.names, change.units, strict=True)),
            "free_wrench": change.free_wrench.tolist(),
            "mounting_angle": change.mounting_angle,
            "gravity_angle": change.gravity_angle,
            "significant": list(change.significant),
            "in_std": dict(zip(change.names, change.in_std.tolist(), strict=True)),
            "groups": {
                group.name: {
                    "parameters": group.parameters,
                    "chi2": group.test.chi2,
                    "dof": group.test.dof,
                    "probability": group.test.probability,
                    "significant": group.significant,
                }
                for group in change.groups
            },
            "meaning": change.meaning,
        }
    )


_MILLI = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])
_SPOKEN = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg"), "N m": (1e3, "mN m"), "s": (1e3, "ms")}


def _json(values: dict[str, Any]) -> str:
    return msgspec.json.format(msgspec.json.encode(values), indent=2).decode()
