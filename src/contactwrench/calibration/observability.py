"""Which parameters the poses separate: rank, singular values, and what a deficiency means in words
(docs/method.md#observability).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import UnobservableError
from ..geometry.arrays import Array, Frozen, Vector, shaped
from ..geometry.rotations import axes_of_turns
from ..model import RigidTool, gravity_in_flange, horizontal_axes, wrench_jacobian
from ..samples.poses import SAME_POSE_ANGLE
from .dynamics import SPOKEN_UNIT_OF

LEVER = 0.05
"""m: the length that compares a torque with a force, and a centre of mass with a weight."""

LEAST_SINGULAR_VALUE = 1e-3
"""Relative to the largest, in natural units: what changes the readings less than an arm's error in orientation of 0.06
deg would is not observed.
"""

NAMED_DIRECTIONS = {
    f"{sign}{axis}": float(f"{sign}1") * e for axis, e in zip("xyz", np.eye(3), strict=True) for sign in "+-"
}
"""Directions of gravity in sensor axes that a person can aim for."""

TRADE_OFF = 0.95
"""Parameters whose estimates correlate more than this are said to trade off."""


@dataclass(frozen=True, eq=False)
class Observability(Frozen):
    """How well the poses separate the parameters.

    `rank` of the Jacobian; its `singular_values` (p,), whitened, columns of unit length, largest first; `condition`
    their ratio; `tilt_range` (2,) rad, the least and largest angle between gravity and the flange's z; `trade_offs`
    the pairs of parameters that trade off, in words.
    """

    rank: int
    singular_values: Vector
    condition: float
    tilt_range: Vector = field(metadata=shaped(2, least=0.0))
    trade_offs: tuple[str, ...]


def require_full_rank(tool: RigidTool, R_base_flange: Array, names: tuple[str, ...], known: Array) -> None:
    """Raise `UnobservableError`, naming the parameters, unless the poses (n, 3, 3), with what is `known` beforehand,
    separate all of `names`; `known` (q, p): derivatives of what is known, each as good as seen.
    """
    unit = np.ones(len(names))
    unit[[0, *range(4, 7)]] = tool.weight
    unit[1:4] = LEVER
    unit[7:10] = tool.weight * LEVER
    rows = known * unit
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    J = np.vstack([natural_jacobian(tool, R_base_flange, names), rows / np.where(length > 0.0, length, 1.0)])
    require_separable(J, names, R_base_flange, tool.gravity_direction)


def natural_jacobian(tool: RigidTool, R_base_flange: Array, names: tuple[str, ...]) -> Array:
    """Derivative (6 n, p) of the readings, in units of the weight and the weight at `LEVER`, with respect to the
    parameters in units of the weight, `LEVER` and 1 rad: every column is of order one where it is observed.

    What the poses separate does not depend on weight and com, which a bad fit may have got absurdly wrong: the weight
    is taken as 1 N and the com at `LEVER` at most.
    """
    com = tool.com * min(1.0, LEVER / max(float(np.linalg.norm(tool.com)), LEVER))
    of_unit_weight = RigidTool(1.0, com, tool.bias, tool.R_flange_sensor, tool.gravity_direction)
    J = wrench_jacobian(of_unit_weight, R_base_flange, names)
    J[:, 3:] /= LEVER
    J[:, :, 1:4] *= LEVER
    J[:, :, 7:10] *= LEVER
    return J.reshape(-1, len(names))


def require_separable(J: Array, names: tuple[str, ...], R_base_flange: Array, gravity_direction: Array) -> None:
    """Raise `UnobservableError` unless the natural Jacobian J (m, p) has full rank."""
    squared, directions = np.linalg.eigh(J.T @ J)
    unseen = squared < LEAST_SINGULAR_VALUE**2 * squared[-1]
    if not unseen.any():
        return
    share = np.sqrt(np.sum(directions[:, unseen] ** 2, axis=1))
    named = [name for name, part in zip(names, share, strict=True) if part > 0.1]
    raise UnobservableError(
        f"cannot separate {', '.join(named)} (rank {int(np.sum(~unseen))} of {len(names)}): "
        f"{_why(R_base_flange, gravity_direction)}"
    )


def _why(R_base_flange: Array, gravity_direction: Array) -> str:
    """The reason for a deficiency in terms of the poses, and what to do."""
    n = len(R_base_flange)
    if n == 1:
        return "all poses at rest have one orientation; record 6 or more that tilt the tool, or take --prior"
    r = gravity_in_flange(R_base_flange, gravity_direction)
    spread = np.linalg.svd(r - r.mean(axis=0), compute_uv=False) / np.sqrt(n)
    if spread[0] < SAME_POSE_ANGLE:
        return f"the {n} poses differ by turns about the vertical only; tilt the tool between poses"
    if n == 2:
        return "there are two distinct poses; record at least 6 that tilt the tool about two axes"
    axes = axes_of_turns(R_base_flange[0].T @ R_base_flange)
    if np.linalg.svd(axes, compute_uv=False)[1] < SAME_POSE_ANGLE * np.sqrt(n):
        return f"the {n} poses turn about a single axis; turn the tool about a second one"
    low, high = np.rad2deg(tilt_range(R_base_flange, gravity_direction))
    return (
        f"gravity stays {low:.1f} to {high:.1f} deg from the flange's z in all {n} poses; "
        "add poses that tilt the tool further"
    )


def advice_on_poses(
    tool: RigidTool | None, covariance: Array, noise: Array, names: tuple[str, ...], weakest: str, R_base_flange: Array
) -> str:
    """Why the poses (n, 3, 3) leave the parameter `weakest` open, and what the best one of six further poses, with
    gravity along an axis of the sensor, would make of its std with the same `noise` (6,).
    """
    if tool is None or weakest not in names:
        return "to mend this, add poses that tilt the tool further, to gravity along +-x, +-y and +-z of the sensor"
    low, high = np.rad2deg(tilt_range(R_base_flange, tool.gravity_direction))
    within = min(float(high), 180.0 - float(low))
    why = f"gravity stayed {low:.0f} to {high:.0f} deg from the flange's z in all poses"
    if within < 60.0:
        why = f"the tool's z axis stayed within {within:.0f} deg of vertical in all poses"
    k = names.index(weakest)
    after = {}
    for direction, u in NAMED_DIRECTIONS.items():
        J = wrench_jacobian(tool, _with_gravity_along(tool, u)[None], names)[0]
        known = J @ covariance
        gain = np.linalg.solve(known @ J.T + np.diag(noise**2), known[:, k])
        after[direction] = covariance[k, k] - known[:, k] @ gain
    best = min(after, key=lambda direction: after[direction])
    scale, unit = SPOKEN_UNIT_OF[weakest]
    least = float(np.sqrt(max(after[best], 0.0)))
    return (
        f"{why}; one more pose, with gravity along the sensor's {best}: std of {weakest} from "
        f"{scale * float(np.sqrt(covariance[k, k])):.2g} to {scale * least:.2g} {unit}; "
        "contactwrench plan --from FILE finds the best ones"
    )


def _with_gravity_along(tool: RigidTool, u: Array) -> Array:
    """An `R_base_flange` at which gravity points along `u` (3,) in sensor axes."""
    r, d = tool.R_flange_sensor @ u, tool.gravity_direction
    of_flange, of_base = np.stack([*horizontal_axes(r), r], axis=1), np.stack([*horizontal_axes(d), d], axis=1)
    return of_base @ of_flange.T


def tilt_range(R_base_flange: Array, gravity_direction: Array) -> Array:
    """Least and largest angle (2,), rad, between gravity and the flange's z over the poses (n, 3, 3)."""
    angle = np.arccos(np.clip(gravity_in_flange(R_base_flange, gravity_direction)[:, 2], -1.0, 1.0))
    return np.array([angle.min(), angle.max()])


def describe(
    R_base_flange: Array, gravity_direction: Array, singular_values: Array, covariance: Array, names: tuple[str, ...]
) -> Observability:
    """The observability of a fit of full rank, from its whitened singular values and covariance (p, p)."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.outer(std, std)
    correlation = np.divide(covariance, scale, out=np.zeros_like(covariance), where=scale > 0.0)
    pairs = [
        (abs(correlation[i, j]), f"{names[i]} and {names[j]}: correlation {correlation[i, j]:+.3f}")
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > TRADE_OFF
    ]
    return Observability(
        rank=len(names),
        singular_values=singular_values,
        condition=float(singular_values[0] / singular_values[-1]),
        tilt_range=tilt_range(R_base_flange, gravity_direction),
        trade_offs=tuple(text for _, text in sorted(pairs, reverse=True)),
    )
