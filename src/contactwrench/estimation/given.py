"""What a user states about the tool beside the readings, checked and made into knowledge."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import nearest_rotations
from ..geometry.wrench import unit_direction
from ..model import GRAVITY, MOUNT, RigidTool
from .auto import EXACT_TILT_SD
from .least_squares import MOST_DOF, GivenNoise
from .noise import variance_of_means
from .priors import Knowledge, earlier_calibration, known_com, known_gravity, known_mounting, known_weight

KNOWABLE = ("weight", "com", "mount", "gravity")
LEAST_SHARE = 1e-6
"""Of the earlier covariance's variance: added to it, so that what the earlier model held is held here too."""


def knowledge_given(known: Mapping[str, tuple[Any, Any]]) -> tuple[Knowledge, ...]:
    """`known`: weight: (N, std); com: ((3,) m, std); mount: ((3, 3) R_flange_sensor, std rad); gravity: ((3,) in base
    axes, std rad). A std is one number, or three for com and mount. Raises `InputError`.
    """
    if not isinstance(known, Mapping):
        raise InputError(f"known is {type(known).__name__}, expected a mapping, as in {{'weight': (12.3, 0.1)}}")
    pieces: list[Knowledge] = []
    for name, pair in known.items():
        if name not in KNOWABLE:
            raise InputError(f"known {name!r} is not an unknown of the tool, expected one of {', '.join(KNOWABLE)}")
        try:
            value, std = pair
        except (TypeError, ValueError):
            raise InputError(f"known {name} is {pair!r}, expected a pair: the value and its std") from None
        shapes: tuple[tuple[int, ...], ...] = ((), (3,)) if name in ("com", "mount") else ((),)
        spread = np.broadcast_to(_finite(f"std of known {name}", std, shapes), (3,))
        if not (spread > 0.0).all():
            raise InputError(f"std of known {name} is {_listed(spread)}, expected numbers above 0")
        if name == "weight":
            weight = float(_finite("known weight", value, ((),)))
            if weight <= 0.0:
                raise InputError(f"known weight is {weight:g}, expected N above 0")
            pieces.append(known_weight(weight, float(spread[0])))
        elif name == "com":
            pieces.append(known_com(_finite("known com", value, ((3,),)), spread))
        elif name == "mount":
            R = _finite("known mount", value, ((3, 3),))
            pieces.append(known_mounting(nearest_rotations(R[None])[0], spread))
        else:
            pieces.append(known_gravity(unit_direction(value, "known gravity"), float(spread[0])))
    return tuple(pieces)


def earlier_tool(prior: Calibration, rows: int) -> tuple[RigidTool, Knowledge, GivenNoise]:
    """The tool of an earlier calibration, what that knows of it (its bias forgotten), and the noise of a pose that is
    the mean of so many `rows`: what poses differed by, and the scatter of a sample over the rows.

    What the earlier model held, mounting or base, is held to `EXACT_TILT_SD`. Raises `InputError` for `affine`.
    """
    if prior.weight is None or prior.com is None or prior.R_flange_sensor is None:
        raise InputError(
            "the prior is a calibration of model affine, expected a rigid tool: calibrate with another model"
        )
    tool = RigidTool(prior.weight, prior.com, prior.bias, prior.R_flange_sensor, prior.gravity_direction)
    names = ("weight", "com_x", "com_y", "com_z", *MOUNT, *GRAVITY)
    of_prior = ["yaw" if n == MOUNT[2] and "yaw" in prior.parameter_names else n for n in names]
    place = {name: k for k, name in enumerate(prior.parameter_names)}
    there = [k for k, name in enumerate(of_prior) if name in place]
    covariance = np.diag(np.full(len(names), EXACT_TILT_SD**2))
    source = [place[of_prior[k]] for k in there]
    covariance[np.ix_(there, there)] = prior.covariance[np.ix_(source, source)]
    covariance[range(9), range(9)] *= 1.0 + LEAST_SHARE
    noise = np.sqrt(variance_of_means(prior.noise, prior.fitted_poses, np.array([float(rows)]))[0])
    return tool, earlier_calibration(tool, covariance), GivenNoise(noise, prior.dof or MOST_DOF)


def _finite(what: str, value: ArrayLike, shapes: tuple[tuple[int, ...], ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(0, np.nan)
    if array.shape not in shapes or not np.isfinite(array).all():
        expected = " or ".join(str(shape) if shape else "a number" for shape in shapes)
        raise InputError(f"{what} is {value!r}, expected {expected}, finite")
    return array


def _listed(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)
