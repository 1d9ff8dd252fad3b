"""`calibrate`: from samples to a Calibration, by the rung of the ladder of models that is asked for.

Samples become poses, an estimator fits them, and the result is returned only if the poses separate every parameter
and if the data do not contradict the sign of the readings and the side of the base that they were given with.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..calibration import Calibration
from ..errors import InputError, UnobservableError
from ..model import PARAMETERS, gravity_in_flange, yaw_of_mounting
from ..observability import describe, require_full_rank, require_separable
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
from .sign import check_sign, require_positive_weight, require_stated_side
from .weakness import beyond_given_noise, weak_noise, weak_parameters

MODELS = ("auto", "paper", "yaw", "mount", "mount+base", "affine")
MODEL_OF_AUTO = "mount"
DOWN = (0.0, 0.0, -1.0)
MOST_POSES_KEPT = 10_000
FEWEST_POSES_WITH_BASE = 4
PAPER_HINT = "the paper's model takes the sensor's z along the flange's (--model mount finds any mounting); or "

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
    a recording at rest, as Samples or (n, 6), whose scatter gives them; `paper` has no use for it. `gravity`:
    direction (3,) in base axes, default down; `mount+base` finds it within 90 deg of this one. `g` m/s^2 turns the
    weight into a mass.

    Samples with a load (`load_mass` above 0) are left out, and a warning says so. Raises `InputError` for unusable
    arguments, `UnobservableError` where the poses cannot separate the parameters, `AmbiguityError` where the data
    contradict the sign of the readings or the side of the base: free air cannot tell those two apart.
    """
    if not isinstance(samples, Samples):
        raise InputError(f"found {type(samples).__name__}, expected Samples: cw.read(path) or cw.Samples(wrench=, ...)")
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
    noise_std = _noise_std(noise)
    weight_xy = weight_z = None
    if rung == "paper":
        paper = fit_paper(readings, stated)
        fit, weight_xy, weight_z = paper.fit, paper.weight_xy, paper.weight_z
        warnings += check_sign(fit_rigid(readings, "yaw", stated, None), readings, "yaw", stated, None)
        require_positive_weight(weight_z, stated, PAPER_HINT)
    elif rung == "affine":
        fit = _affine(readings, stated, noise_std)
        if np.linalg.det(fit.B[:3, :3]) < 0.0:
            warnings += (
                "weak: the force matrix A mirrors: an axis has the wrong sign, or the sensor reports the reaction",
            )
    else:
        fit, unconfirmed = _rigid(readings, rung, stated, noise_std)
        warnings += unconfirmed
    provenance: dict[str, str | int | float] = {
        "software": f"contactwrench {__version__}",
        "source": samples.source,
        "rows": len(free),
        "g": float(g),
    }
    return _assemble(
        fit,
        model,
        rung,
        poses,
        readings,
        warnings,
        provenance,
        g,
        weight_xy,
        weight_z,
        noise is None or rung == "paper",
    )


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


def _rigid(readings: PoseReadings, model: str, stated: Array, noise: Array | None) -> tuple[Fit, tuple[str, ...]]:
    """The fit of a rigid model, checked, and a warning where its sign was not confirmed."""
    names = PARAMETERS[model]
    fit = fit_rigid(readings, model, stated, noise)
    tool = fit.tool
    if tool is None:
        raise TypeError("a rigid fit has a tool")
    require_full_rank(tool, readings.R_base_flange, names)
    if model == "mount+base" and len(readings) < FEWEST_POSES_WITH_BASE:
        raise UnobservableError(
            f"found {len(readings)} distinct orientations, expected {FEWEST_POSES_WITH_BASE} or more for mount+base: "
            "with fewer, several tools and bases fit alike; record 6 or more that turn about two axes"
        )
    _require_noise(readings, len(names), noise)
    require_stated_side(tool, stated)
    unconfirmed = check_sign(fit, readings, model, stated, noise)
    require_positive_weight(tool.weight, stated)
    return fit, unconfirmed


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
    noise_estimated: bool,
) -> Calibration:
    names, tool = PARAMETERS[model], fit.tool
    observability = describe(readings.R_base_flange, fit.gravity_direction, fit.singular_values, fit.covariance, names)
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
    many = len(poses) > MOST_POSES_KEPT
    held_out = fit.held_out
    warnings += weak_parameters(fit, model, readings, observability.trade_offs)
    warnings += weak_noise(fit) if noise_estimated else beyond_given_noise(fit)
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
