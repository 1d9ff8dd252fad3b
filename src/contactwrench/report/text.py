"""Verification and difference as text for the terminal, and as JSON."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import msgspec
import numpy as np

from ..difference import Difference
from ..model import AXES
from ..verify import Verification


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
    lines.append(f"{'PASSED' if result.passed else 'FAILED'}  {result.reason}")
    return "\n".join(lines)


def verification_json(result: Verification) -> str:
    """The fields of `Verification` under their names; each weighing with its `error` and `error_std`."""
    values: dict[str, Any] = {field.name: getattr(result, field.name) for field in fields(result)}
    values["residuals"], values["rms"] = result.residuals.tolist(), result.rms.tolist()
    values["weighings"] = [{**asdict(w), "error": w.error, "error_std": w.error_std} for w in result.weighings]
    return _json(values)


def difference_text(change: Difference) -> str:
    """Each change with its standard deviation, in the units that people speak; * marks more than three of them."""
    lines = [f"  {'':<9} {'change':>10}    {'std':<9} unit"]
    for name, unit, value, std in zip(change.names, change.units, change.change, change.std, strict=True):
        factor, spoken = _SPOKEN.get(unit, (1.0, unit))
        mark = "*" if name in change.significant else " "
        lines.append(f"{mark} {name:<9} {factor * value:>+10.4g} +- {factor * std:<9.2g} {spoken}")
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
    """`change` and `std` by parameter, `free_wrench`, `mounting_angle`, `gravity_angle` and `significant`."""
    return _json(
        {
            "change": dict(zip(change.names, change.change.tolist(), strict=True)),
            "std": dict(zip(change.names, change.std.tolist(), strict=True)),
            "units": dict(zip(change.names, change.units, strict=True)),
            "free_wrench": change.free_wrench.tolist(),
            "mounting_angle": change.mounting_angle,
            "gravity_angle": change.gravity_angle,
            "significant": list(change.significant),
        }
    )


_MILLI = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])
_SPOKEN = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg"), "N m": (1e3, "mN m")}


def _json(values: dict[str, Any]) -> str:
    return msgspec.json.format(msgspec.json.encode(values), indent=2).decode()
