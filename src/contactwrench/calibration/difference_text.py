"""What a difference of two calibrations means, in plain sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..geometry.arrays import Array
from ..model import LINEAR_PARAMETERS
from ..statistics import SIGNIFICANCE, MisfitTest, in_standard_deviations, misfit_of_parameters, percent

if TYPE_CHECKING:
    from .difference import Difference, GroupChange

SAME_GRAVITY = 1e-6
"""rad: two stated directions closer than this are one."""

WORDS = {
    "tool": "the tool",
    "bias": "the bias",
    "mounting": "the mounting",
    "gravity": "the base",
    "matrix": "the tool, the mounting or a gain",
}


def meaning(change: Difference) -> tuple[str, ...]:
    """One sentence for each cause that shows; one that says so where none does."""
    *groups, everything = change.groups
    moved = [group for group in groups if group.significant]
    sentences = [_SENTENCES[group.name](change, group, len(moved) == 1) for group in moved]
    if not moved:
        sentences.append(_unresolved(groups, everything) if everything.significant else _nothing(everything.test))
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


def _nothing(test: MisfitTest) -> str:
    return (
        f"nothing changed beyond the errors of both: chi-square {test.chi2:.3g} per parameter, probability "
        f"{percent(test.probability)}{test.caution}"
    )


def _unresolved(groups: list[GroupChange], everything: GroupChange) -> str:
    """Something changed, but each group by itself might be the same: those that could explain it alone are named."""
    alone = []
    for group in groups:
        rest = np.array([name not in group.parameters for name in everything.parameters])
        misfit = misfit_of_parameters(everything.change[rest], everything.covariance[np.ix_(rest, rest)])
        if MisfitTest(misfit, int(rest.sum()), everything.test.dof).probability >= SIGNIFICANCE:
            alone.append(WORDS[group.name])
    suspects = f"{' or '.join(alone)} alone would explain it" if alone else "no single cause explains it"
    return (
        f"something changed ({_improbable(everything.test)}), but these calibrations cannot tell what: {suspects}; "
        "calibrate with poses that tilt the tool further"
    )


def _tool(change: Difference, group: GroupChange, only: bool) -> str:
    shown = _shown(group, slice(0, 1), slice(1, 4))
    if not shown:
        return f"the tool changed: weight and centre of mass together ({_improbable(group.test)})"
    if shown[0].startswith("weight"):
        return f"the tool changed: {', '.join(shown)}"
    std = np.sqrt(group.covariance[0, 0])
    return f"something moved on the tool: {shown[0]}, its weight is the same within {std:.2g} N"


def _bias(change: Difference, group: GroupChange, only: bool) -> str:
    shift = ", ".join(_shown(group, slice(0, 3), slice(3, 6))) or _improbable(group.test)
    if only:
        return f"drift, or a new zero: only the bias changed, {shift}; all else is the same within its errors"
    return f"the bias changed as well: {shift}"


def _mounting(change: Difference, group: GroupChange, only: bool) -> str:
    angle = change.mounting_angle or 0.0
    if group.parameters == ("mounting_angle",):
        return "the sensor was mounted anew, on its other side: its z points along the flange's in one of the two only"
    if group.parameters == ("yaw",):
        return f"the sensor slipped or was mounted anew: {_largest(group, slice(0, 1))} about its z"
    about = ", ".join(f"{part:.2f}" for part in group.change / max(float(np.linalg.norm(group.change)), 1e-300))
    return (
        f"the sensor slipped or was mounted anew: it is turned by {np.rad2deg(angle):.3g} deg about ({about}) in "
        f"sensor axes ({_improbable(group.test)})"
    )


def _gravity(change: Difference, group: GroupChange, only: bool) -> str:
    return (
        f"the base stands otherwise: gravity is {np.rad2deg(change.gravity_angle):.3g} deg apart in base axes "
        f"({_improbable(group.test)})"
    )


def _matrix(change: Difference, group: GroupChange, only: bool) -> str:
    return (
        f"what gravity does changed ({_improbable(group.test)}): the tool, the mounting or a gain; model affine cannot "
        "tell which"
    )


_SENTENCES = {"tool": _tool, "bias": _bias, "mounting": _mounting, "gravity": _gravity, "matrix": _matrix}


def _shown(group: GroupChange, *parts: slice) -> list[str]:
    """Of each part of a group that is significant by itself, its largest change."""
    shown = []
    for rows in parts:
        misfit = misfit_of_parameters(group.change[rows], group.covariance[rows, rows])
        if MisfitTest(misfit, len(group.change[rows]), group.test.dof).probability < SIGNIFICANCE:
            shown.append(_largest(group, rows))
    return shown


def _largest(group: GroupChange, rows: slice) -> str:
    """Of some parameters the one that changed by the most standard deviations, and by how much."""
    ratio: Array = np.abs(in_standard_deviations(group.change, np.sqrt(np.diag(group.covariance))))[rows]
    k = rows.start + int(np.argmax(ratio))
    name, value = group.parameters[k], float(group.change[k])
    factor, unit = _UNIT["torque" if name in LINEAR_PARAMETERS[7:] else name.split("_")[0]]
    return f"{name} by {factor * value:+.3g} {unit} ({ratio.max():.3g} std)"


_UNIT = {
    "weight": (1.0, "N"),
    "com": (1e3, "mm"),
    "bias": (1.0, "N"),
    "torque": (1e3, "mN m"),
    "yaw": (180.0 / np.pi, "deg"),
}


def _improbable(test: MisfitTest) -> str:
    return f"chi-square {test.chi2:.3g} per parameter, probability {percent(test.probability)}"
