"""What a difference of two calibrations means, in plain words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..geometry.arrays import Array
from ..statistics import SIGNIFICANCE, MisfitTest, in_standard_deviations, misfit_of_parameters, percent
from .dynamics import SPOKEN_UNIT_OF

if TYPE_CHECKING:
    from .difference import Difference, GroupChange

SAME_GRAVITY = 1e-6
"""rad: two stated directions closer than this are one."""

MOUNTED_ANEW = "the sensor slipped or was mounted anew, or the robot reports the orientation of another TCP"
COPIED = "tool, mounting and base of both come from one calibration (--prior): that they are the same is no finding"
WORDS = {
    "tool": "the tool",
    "bias": "the bias",
    "mounting": "the mounting",
    "gravity": "the base",
    "inertia": "the tool's inertia",
    "offset": "the sensor's place on the flange",
    "matrix": "the tool, the mounting or a gain",
}


def meaning(change: Difference) -> tuple[str, ...]:
    """One sentence for each cause that shows; one that says so where none does."""
    *groups, everything = change.groups
    moved = [group for group in groups if group.significant]
    sentences = [_sentence(change, group, len(moved) == 1) for group in moved]
    if not moved and everything.significant:
        sentences.append(_unresolved(groups, everything))
    elif not moved:
        probability = f"{_improbable(everything)}{everything.test.caution}"
        copied = f"; {COPIED}" if change.copied else ""
        sentences.append(f"nothing changed beyond the errors of both: {probability}{copied}")
    if "delay" in change.significant:
        k = change.names.index("delay")
        sentences.append(
            f"the delay between wrench and orientation changed by {1e3 * change.change[k]:+.3g} ms "
            f"({abs(change.in_std[k]):.3g} std): another clock, or another filter in the sensor"
        )
    if change.gravity_angle > SAME_GRAVITY and "gravity" not in [group.name for group in groups]:
        sentences.append(
            f"gravity was stated {np.rad2deg(change.gravity_angle):.3g} deg apart in base axes: another stand, or "
            "another option"
        )
    return tuple(sentences)


def _sentence(change: Difference, group: GroupChange, is_alone: bool) -> str:
    """What happened, where a group changed, and no other where it `is_alone`."""
    improbable = _improbable(group)
    if group.name in ("tool", "mounting"):
        return _tool(group) if group.name == "tool" else _mounting(change, group)
    if group.name == "bias":
        shift = ", ".join(_shown(group, slice(0, 3), slice(3, 6))) or improbable
        if is_alone:
            rest = COPIED if change.copied else "all else is the same within its errors"
            return f"drift, or a new zero: only the bias changed, {shift}; {rest}"
        return f"the bias changed as well: {shift}"
    if group.name in ("inertia", "offset"):
        return f"{WORDS[group.name]} changed: {_largest(group, slice(0, len(group.parameters)))}, {improbable}"
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
        return f"{MOUNTED_ANEW}: {_largest(group, slice(0, 1))} about its z"
    angle = np.rad2deg(change.mounting_angle or 0.0)
    about = ", ".join(f"{part:.2f}" for part in group.change / max(float(np.linalg.norm(group.change)), 1e-300))
    turned = f"turned by {angle:.3g} deg about ({about}) in sensor axes"
    return f"{MOUNTED_ANEW}: it is {turned} ({_improbable(group)})"


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
    factor, unit = SPOKEN_UNIT_OF[name]
    return f"{name} by {factor * value:+.3g} {unit} ({ratio.max():.3g} std)"


def _improbable(group: GroupChange) -> str:
    return f"chi-square {group.test.chi2:.3g} per parameter, probability {percent(group.test.probability)}"
