"""`calibrate`: from samples to a Calibration, by the rung of the ladder of models that is asked for.

Samples become poses, an estimator fits them, and the result is returned only if the poses separate every parameter
and if the data do not contradict the sign of the readings and the side of the base that they were given with.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..calibration import Calibration
from ..errors import AmbiguityError, InputError, UnobservableError
from ..model import PARAMETERS, RigidTool, gravity_in_flange, yaw_of_mounting
from ..observability import (
    advice_for_weak,
    describe,
    natural_jacobian,
    require_full_rank,
    require_separable,
    weak_parameters,
)
from ..orientation import Array
from ..poses import Pose, moments_of_poses, poses_from_samples
from ..samples import Samples
from ..version import __version__
from ..wrench import STANDARD_GRAVITY, unit_direction
from .affine import fit_affine
from .joint import fit_rigid
from .least_squares import Fit, PoseReadings
from .noise import pooled_scatter
from .paper import fit_paper
from .start import explained_by_start

MODELS = ("auto", "paper", "yaw", "mount", "mount+base", "affine")
MODEL_OF_AUTO = "mount"
DOWN = (0.0, 0.0, -1.0)
MOST_POSES_KEPT = 10_000
RIVAL_SIGNIFICANCE = 0.001

NoiseLike: TypeAlias = "ArrayLike | Samples | None"


def calibrate(
    samples: Samples,
    model: str = "auto",
    noise: NoiseLike = None,
    gravity: ArrayLike | None = None,
    *,
    g: float = STANDARD_GRAVITY,
) -> Calibration:
    """Identify weight, centre of mass, bias and mounting from contact-free samples at several orientations.

    `model`: paper, yaw, mount, mount+base, affine or auto (as yet, mount). `noise`: None, estimated from the
    residuals; (6,) standard deviations of one pose's reading, N and N m, whose common scale the residuals settle; or
    a recording at rest, as Samples or (n, 6), whose scatter gives them. `gravity`: direction (3,) in base axes,
    default down; `mount+base` finds it within 90 deg of this one. `g` m/s^2 turns the weight into a mass.

    Samples with a load (`load_mass` above 0) are left out, and a warning says so. Raises `InputError` for unusable
    arguments, `UnobservableError` where the poses cannot separate the parameters, `AmbiguityError` where the data
    contradict the sign of the readings or the side of the base: free air cannot tell those two apart.
    """
    if model not in MODELS:
        raise InputError(f"model {model!r} is not known, expected one of {', '.join(MODELS)}")
    stated = unit_direction(DOWN if gravity is None else gravity)
    if not (np.isfinite(g) and g > 0.0):
        raise InputError(f"g is {g!r}, expected m/s^2 above 0")
    free, warnings = _contact_free(samples)
    poses = poses_from_samples(free)
    if not poses:
        raise InputError(f"{samples.source}: found no contact-free samples, expected poses without a load")
    readings = PoseReadings(
        np.array([pose.R_base_flange for pose in poses]),
        np.array([pose.wrench for pose in poses]),
        pooled_scatter(poses),
    )
    rung = MODEL_OF_AUTO if model == "auto" else model
    weight_xy = weight_z = None
    if rung == "paper":
        paper = fit_paper(readings, stated)
        fit, weight_xy, weight_z = paper.fit, paper.weight_xy, paper.weight_z
        _require_sign(fit, readings, "yaw", stated, None)
        if paper.weight_z <= 0.0:
            raise AmbiguityError(
                f"the paper's G_z comes out as {paper.weight_z:.3g} N, expected above 0: its model takes the sensor's z "
                "to point along the flange's; for a sensor mounted flipped or tilted use --model mount, for readings of "
                f"the reaction --sign reaction, for a robot upside down --gravity {_negated(stated)}"
            )
    elif rung == "affine":
        fit = _affine(readings, stated, _noise_std(noise))
        if np.linalg.det(fit.B[:3, :3]) < 0.0:
            warnings += ("the force matrix A mirrors: an axis has the wrong sign, or the sensor reports the reaction",)
    else:
        fit = _rigid(readings, rung, stated, _noise_std(noise))
    provenance: dict[str, str | int | float] = {
        "software": f"contactwrench {__version__}",
        "source": samples.source,
        "rows": len(free),
        "g": g,
    }
    return _assemble(fit, model, rung, poses, readings, warnings, provenance, g, weight_xy, weight_z)


def _contact_free(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    if samples.load_mass is None or not (samples.load_mass > 0.0).any():
        return samples, ()
    free = samples.load_mass == 0.0
    left_out = int(np.sum(~free))
    return samples.select(free), (f"{left_out} rows with a load hung on the tool were left out",)


def _noise_std(noise: NoiseLike) -> Array | None:
    """Standard deviations (6,) of one pose's reading from what the user gave, or None."""
    if noise is None:
        return None
    values = np.asarray(noise.wrench if isinstance(noise, Samples) else noise, dtype=np.float64)
    if values.ndim == 2 and values.shape[1] == 6 and len(values) >= 2:
        values = values.std(axis=0, ddof=1)
    if values.shape != (6,) or not (np.isfinite(values).all() and (values > 0.0).all()):
        raise InputError(
            "noise must be six standard deviations above 0 (fx..tz, N and N m), or a recording at rest (n, 6) in which "
            f"every axis moves; found {np.array2string(values, threshold=8)}"
        )
    return values


def _rigid(readings: PoseReadings, model: str, stated: Array, noise: Array | None) -> Fit:
    names = PARAMETERS[model]
    fit = fit_rigid(readings, model, stated, noise)
    tool = fit.tool
    if tool is None:
        raise TypeError("a rigid fit has a tool")
    require_full_rank(tool, readings.R_base_flange, names)
    _require_noise(readings, len(names), noise)
    _require_stated_side(tool, stated)
    _require_sign(fit, readings, model, stated, noise)
    _require_positive_weight(tool.weight, stated)
    return fit


def _affine(readings: PoseReadings, stated: Array, noise: Array | None) -> Fit:
    r = gravity_in_flange(readings.R_base_flange, stated)
    columns = np.column_stack([r, np.ones(len(r))])
    require_separable(columns, ("B_*_rx", "B_*_ry", "B_*_rz", "B_*_1"), readings.R_base_flange, stated)
    _require_noise(readings, 24, noise)
    return fit_affine(readings, stated, noise)


def _require_noise(readings: PoseReadings, parameters: int, noise: Array | None) -> None:
    n = len(readings)
    if noise is None and 6 * n <= parameters:
        raise UnobservableError(
            f"{n} poses give {6 * n} readings for {parameters} parameters: nothing is left to estimate the noise "
            "from; record more poses, or give noise"
        )


def _require_stated_side(tool: RigidTool, stated: Array) -> None:
    angle = np.rad2deg(np.arccos(np.clip(tool.gravity_direction @ stated, -1.0, 1.0)))
    if angle > 90.0:
        found = ",".join(f"{part:.3f}" for part in tool.gravity_direction)
        raise AmbiguityError(
            f"gravity comes out {angle:.0f} deg from the stated direction: either the sensor reports the reaction "
            f"(--sign reaction), or the base is mounted that way (--gravity {found}); free air cannot tell, one push "
            "by hand can"
        )


def _require_sign(fit: Fit, readings: PoseReadings, model: str, stated: Array, noise: Array | None) -> None:
    """Refuse readings that a tool explains much better once they are negated (or, the same, gravity is)."""
    R, wrench = readings.R_base_flange, readings.wrench
    if explained_by_start(R, -wrench, model, stated) <= explained_by_start(R, wrench, model, stated):
        return
    from scipy.special import fdtri

    rival = fit_rigid(readings, model, stated, noise, sign=-1.0)
    dof = max(6 * len(readings) - len(PARAMETERS[model]), 1)
    misfit = float(np.sum((fit.residuals / rival.noise) ** 2) / np.sum((rival.residuals / rival.noise) ** 2))
    significant = misfit > float(fdtri(dof, dof, 1.0 - RIVAL_SIGNIFICANCE))
    left, left_negated = (
        float(np.sqrt(np.mean(np.sum(e[:, :3] ** 2, axis=1)))) for e in (fit.residuals, rival.residuals)
    )
    if not (significant and left_negated < 0.5 * left):
        return
    raise AmbiguityError(
        f"a tool explains these readings only with a negative weight: {left:.3g} N are left as given, "
        f"{left_negated:.3g} N with force and torque negated; either the sensor reports the reaction (--sign "
        f"reaction), or gravity points the other way (--gravity {_negated(stated)}), or one axis is mirrored; free air "
        "cannot tell, one push by hand can"
    )


def _require_positive_weight(weight: float, stated: Array) -> None:
    if weight <= 0.0:
        raise AmbiguityError(
            f"the weight comes out as {weight:.3g} N, expected above 0: either the sensor reports the reaction (--sign "
            f"reaction), or gravity points the other way (--gravity {_negated(stated)}), or the poses cannot tell; "
            "one push by hand decides"
        )


def _negated(direction: Array) -> str:
    return ",".join(f"{-part + 0.0:g}" for part in direction)


def _assemble(
    fit: Fit,
    requested: str,
    model: str,
    poses: tuple[Pose, ...],
    readings: PoseReadings,
    warnings: tuple[str, ...],
    provenance: dict[str, str | int | float],
    g: float,
    weight_xy: float | None,
    weight_z: float | None,
) -> Calibration:
    names, tool = PARAMETERS[model], fit.tool
    observability = describe(readings.R_base_flange, fit.gravity_direction, fit.singular_values, fit.covariance, names)
    std = np.sqrt(np.diag(fit.covariance))
    if tool is None:
        weight = mass = com = R_flange_sensor = yaw = None
        parameters = fit.B.ravel()
        bias = fit.B[:, 3]
    else:
        weight, com, bias, R_flange_sensor = tool.weight, tool.com, tool.bias, tool.R_flange_sensor
        mass = weight / g
        yaw = yaw_of_mounting(R_flange_sensor)[0]
        parameters = np.zeros(len(names))
        parameters[:10] = np.r_[weight, com, bias]
        if "yaw" in names:
            parameters[10] = yaw
        left = float(np.sqrt(np.mean(np.sum(fit.residuals[:, :3] ** 2, axis=1))))
        advice = advice_for_weak(natural_jacobian(tool, readings.R_base_flange, names), left)
        warnings += weak_parameters(weight, std[0], std[1:4], std[4:7], observability.trade_offs, advice)
    many = len(poses) > MOST_POSES_KEPT
    held_out = fit.held_out
    if held_out is None:
        warnings += ("no pose can be left out for a held-out error: record more poses",)
    return Calibration(
        requested_model=requested,
        model=model,
        weight=weight,
        mass=mass,
        com=com,
        bias=bias,
        R_flange_sensor=R_flange_sensor,
        yaw=yaw,
        gravity_direction=fit.gravity_direction,
        B=fit.B,
        B_covariance=fit.B_covariance,
        parameter_names=names,
        parameters=parameters,
        covariance=fit.covariance,
        noise=fit.noise,
        residual_rms=np.sqrt(np.mean(fit.residuals**2, axis=0)),
        held_out_rms=None if held_out is None else np.sqrt(np.mean(held_out**2, axis=0)),
        reduced_chi2=fit.reduced_chi2,
        dof=fit.dof,
        observability=observability,
        warnings=warnings,
        provenance=provenance,
        poses=() if many else poses,
        moments=moments_of_poses(readings.R_base_flange, readings.wrench) if many else None,
        weight_xy=weight_xy,
        weight_z=weight_z,
    )
