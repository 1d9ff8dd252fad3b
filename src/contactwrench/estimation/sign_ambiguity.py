"""What free-air data cannot tell: the sign of the readings, and the side of the base (method, section 4b).

Negating force and torque of an upright robot gives exactly the data of a robot that hangs from the ceiling; a mirrored
axis looks the same, with another mounting. So readings that contradict the sign or the side that they were given with
are refused, both ways to read them named. Where they fit both ways alike, as they do when gravity's directions all
lie in one plane of the sensor, what was given is taken, and a warning says that it was not confirmed.
"""

from __future__ import annotations

import numpy as np

from ..errors import AmbiguityError
from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool
from .initial_guess import SEARCH_OF_MODEL, explained_by_start
from .least_squares import Fit, GivenNoise, PoseReadings
from .rigid import fit_rigid

SIGNIFICANCE = 0.001
NEAR_TIE = 0.9
SURE_SIDE = 4.0
SURE_WEIGHT = 3.0
"""Standard deviations: a fit whose weight is less sure explains nothing, so that a tie with it says nothing either."""

NOT_CONFIRMED = (
    "the sign of the readings is taken as given: the negated readings fit as well, mostly because gravity's directions "
    "lie close to one plane of the sensor; confirm it by a push, or tilt the tool about another axis"
)


def check_sign(
    fit: Fit, readings: PoseReadings, model: str, gravity_direction: Array, noise: GivenNoise | None
) -> tuple[str, ...]:
    """Refuse readings that a tool explains much better once they are negated (or, the same, gravity is).

    `model` yaw, mount or mount+base is fitted to the negated readings; arguments as for `fit_rigid`. Returns a
    warning where both fit alike, else nothing. Raises `AmbiguityError` naming both readings.
    """
    R, wrench = readings.R_base_flange, readings.wrench
    as_given = explained_by_start(R, wrench, SEARCH_OF_MODEL[model], gravity_direction)
    if explained_by_start(R, -wrench, SEARCH_OF_MODEL[model], gravity_direction) < NEAR_TIE * as_given:
        return ()
    rival = fit_rigid(readings, model, gravity_direction, noise, sign=-1.0)
    dof = max(6 * len(readings) - len(PARAMETERS[model]), 1)
    left, left_negated = (
        float(np.sqrt(np.mean(np.sum(e[:, :3] ** 2, axis=1)))) for e in (fit.residuals, rival.residuals)
    )
    if left_negated < 0.5 * left and _fits_worse(fit.residuals, rival, dof):
        raise AmbiguityError(
            f"a tool explains these readings only with a negative weight: {left:.3g} N are left as given, "
            f"{left_negated:.3g} N with force and torque negated; either the sensor reports the reaction (--sign "
            f"reaction), or gravity points the other way (--gravity {negated(gravity_direction)}), or one axis is "
            "mirrored; free air cannot tell, one push by hand can"
        )
    explained = fit.tool is not None and fit.tool.weight > SURE_WEIGHT * float(np.sqrt(fit.covariance[0, 0]))
    on_stated_side = rival.gravity_direction @ gravity_direction >= 0.0
    tie = explained and on_stated_side and not _fits_worse(rival.residuals, fit, dof)
    return (NOT_CONFIRMED,) if tie else ()


def require_stated_side(tool: RigidTool, stated: Array, std: float) -> None:
    """Raise `AmbiguityError` if gravity was found surely more than 90 deg from the stated direction (3,): a robot on a
    wall is right there, give or take `std` rad.
    """
    angle = np.rad2deg(np.arccos(np.clip(tool.gravity_direction @ stated, -1.0, 1.0)))
    if angle > 90.0 + SURE_SIDE * np.rad2deg(std):
        found = ",".join(f"{part:.3f}" for part in tool.gravity_direction)
        raise AmbiguityError(
            f"gravity comes out {angle:.0f} deg from the stated direction: either the sensor reports the reaction "
            f"(--sign reaction), or the base is mounted that way (--gravity {found}); free air cannot tell, one push "
            "by hand can"
        )


def require_positive_weight(weight: float, gravity_direction: Array, hint: str = "") -> None:
    """Raise `AmbiguityError` for a weight (N) that is not above zero; `hint` names a reading of the model's own."""
    if weight <= 0.0:
        raise AmbiguityError(
            f"the weight comes out as {weight:.3g} N, expected above 0: {hint}either the sensor reports the reaction "
            f"(--sign reaction), or gravity points the other way (--gravity {negated(gravity_direction)}), or the "
            "poses cannot tell; one push by hand decides"
        )


def negated(direction: Array) -> str:
    """The opposite direction as the flag --gravity takes it."""
    return ",".join(f"{-part + 0.0:g}" for part in direction)


def _fits_worse(residuals: Array, other: Fit, dof: int) -> bool:
    """Whether `residuals` (n, 6) exceed those of `other`, in units of its noise, by more than chance (F test)."""
    from scipy.special import fdtri

    noise = np.maximum(other.noise, 1e-9 * float(np.abs(residuals).max()) + 1e-300)
    own, least = float(np.sum((residuals / noise) ** 2)), float(np.sum((other.residuals / noise) ** 2))
    return own > float(fdtri(dof, dof, 1.0 - SIGNIFICANCE)) * least
