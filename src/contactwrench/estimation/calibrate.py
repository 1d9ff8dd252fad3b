"""`calibrate`: from samples to a Calibration, by the rung of the ladder of models that is asked for.

Samples become poses, an estimator fits them, and the result is returned only if the poses separate every parameter
and if the data do not contradict the sign of the readings and the side of the base that they were given with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.alternative import Alternative
from ..calibration.calibration import Calibration
from ..calibration.observability import describe
from ..errors import InputError, UnobservableError
from ..geometry.arrays import Array
from ..geometry.wrench import STANDARD_GRAVITY, unit_direction
from ..model import yaw_of_mounting
from ..samples.delay import with_delay_of_rows
from ..samples.poses import Pose, moments_of_poses
from ..samples.recorded_poses import is_stream, recorded_poses, resting_poses
from ..samples.samples import Samples
from ..version import __version__
from .assumptions import assumptions_in_words
from .auto import BASE_TILT_SD, MOUNT_TILT_SD, TiltPriors
from .cleaned import what_was_cleaned, what_was_not_still
from .estimate import HELD_GRAVITY, Question, fitted, require_answerable, rung_fitted
from .findings import weaknesses
from .given import earlier_tool, knowledge_given
from .least_squares import LEAST_LEFT, GivenNoise, PoseReadings
from .noise import pooled_scatter
from .robust import MOST_CLEANED, RobustEstimate, cleaned_estimate, confirmed

MODELS = ("auto", "paper", "yaw", "mount", "mount+base", "affine")
OTHER_RUNGS = ("yaw", "mount", "mount+base", "affine")
DOWN = (0.0, 0.0, -1.0)
MOST_POSES_KEPT = 10_000
MOST_VISITS = 1_000
"""With more, rows alternate between orientations, and the order of the visits says little."""


NoiseLike: TypeAlias = "ArrayLike | Samples | None"


def calibrate(
    samples: Samples,
    model: str = "auto",
    noise: NoiseLike = None,
    gravity: ArrayLike | None = None,
    *,
    g: float = STANDARD_GRAVITY,
    mount_tilt_sd: float = MOUNT_TILT_SD,
    base_tilt_sd: float = BASE_TILT_SD,
    known: Mapping[str, tuple[Any, Any]] | None = None,
    prior: Calibration | None = None,
) -> Calibration:
    """Identify weight, centre of mass, bias and mounting from contact-free samples at several orientations.

    Poses that the others do not explain are left out, and a bias that stepped or drifted is followed, the last one
    kept; not for `paper` and `affine`. Samples with a load or a saturated channel are left out too. Warnings say so.

    Args:
        samples: at rest at several orientations, or a recording with times in which the arm stops at them.
        model: `paper`, `yaw`, `mount`, `mount+base`, `affine`, or `auto` where nobody knows which of them holds.
        noise: of one pose's reading: std (6,), N and N m, or a recording at rest (n, 6); None: from the residuals.
        gravity: direction (3,), base axes; None: down. `mount+base` and `auto` find it within 90 deg of this one.
        g: m/s^2, 9.80665 unless stated; turns the weight into the mass.
        mount_tilt_sd: rad an axis, of the prior of `auto` on the mounting, 1.41 deg unless stated.
        base_tilt_sd: rad an axis, of the prior of `auto` on the base, 0.71 deg unless stated.
        known: (value, std) of `weight` N, `com` (3,) m, `mount` R_flange_sensor (std rad), `gravity` (3,) (std rad).
        prior: an earlier calibration of the same tool, whose bias may have moved: a single pose gives the new one.

    Returns:
        Every parameter with its covariance, what was assumed, and warnings.

    Raises:
        InputError: unusable arguments.
        UnobservableError: the poses cannot separate the parameters.
        AmbiguityError: the data contradict the sign of the readings or the side of the base.
    """
    question = question_asked(model, noise, gravity, TiltPriors(mount_tilt_sd, base_tilt_sd), known)
    if prior is not None:
        question = _with_prior(question, prior, gravity is not None, samples)
    recorded = from_recording(samples, question, g)
    origin = {} if prior is None else {"prior": str(prior.provenance.get("source", "arrays"))}
    try:
        checked = confirmed(recorded.found, question)
    except UnobservableError as error:
        raise UnobservableError(f"{error}{recorded.what_was_still}") from None
    return assembled(replace(recorded, found=checked), question, origin)


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording less its rows under load, its poses, the estimate from them, and the `g` (m/s^2) of the place;
    `rejected` the stretches of a stream that are no pose; `stretches` how many made the poses, 0 of a table.
    """

    samples: Samples
    poses: tuple[Pose, ...]
    found: RobustEstimate
    warnings: tuple[str, ...]
    g: float
    rejected: tuple[Pose, ...]
    stretches: int

    @property
    def what_was_still(self) -> str:
        """What to add to a complaint about the poses of a stream."""
        if not self.stretches:
            return ""
        return f" (still stretches: {self.stretches}, left out: {len(self.rejected)}; stop for a second or two at each)"


def question_asked(
    model: str,
    noise: NoiseLike,
    gravity: ArrayLike | None,
    priors: TiltPriors,
    known: Mapping[str, tuple[Any, Any]] | None,
) -> Question:
    """The question that the arguments of `calibrate` put. Raises `InputError`."""
    if model not in MODELS:
        raise InputError(f"model {model!r} is not known, expected one of {', '.join(MODELS)}")
    stated = unit_direction(DOWN if gravity is None else gravity)
    for name, sd in (("mount_tilt_sd", priors.mount), ("base_tilt_sd", priors.base)):
        if sd is None or not 0.0 < sd < np.inf:
            raise InputError(f"{name} is {sd!r}, expected rad above 0")
    noise_std = _noise_std(noise)
    question = Question(
        model=model,
        gravity_direction=stated,
        noise=None if noise_std is None else GivenNoise(noise_std),
        priors=priors,
    )
    return _with_known(question, known, gravity is not None) if known else question


def _with_known(question: Question, known: Mapping[str, tuple[Any, Any]], gravity_stated: bool) -> Question:
    if question.model in ("paper", "affine"):
        raise InputError(f"model {question.model} takes nothing as known: leave known out, or choose another model")
    if "gravity" in known and question.model in HELD_GRAVITY:
        raise InputError(
            f"model {question.model} holds gravity, and gravity is given as known with a std: choose auto or mount+base"
        )
    if "gravity" in known and gravity_stated:
        raise InputError("gravity is stated and given as known too: leave one of them out")
    pieces = knowledge_given(known)
    stated = unit_direction(known["gravity"][0]) if "gravity" in known else question.gravity_direction
    priors = TiltPriors(
        None if "mount" in known else question.priors.mount, None if "gravity" in known else question.priors.base
    )
    return replace(question, knowledge=pieces, gravity_direction=stated, priors=priors)


def _with_prior(question: Question, prior: Calibration, gravity_stated: bool, samples: Samples) -> Question:
    if not isinstance(prior, Calibration):
        raise InputError(f"prior is {type(prior).__name__}, expected a Calibration: cw.Calibration.load(path)")
    if question.model != "auto":
        raise InputError(
            f"an earlier calibration brings its model, and model {question.model} is asked for: leave one out"
        )
    if gravity_stated:
        raise InputError("an earlier calibration brings its gravity, and gravity is stated too: leave one of them out")
    rows = min((pose.n for pose in resting_poses(samples)), default=1)
    tool, knowledge, noise = earlier_tool(prior, rows)
    return replace(
        question,
        gravity_direction=tool.gravity_direction,
        knowledge=(*question.knowledge, knowledge),
        earlier=tool,
        noise=noise if question.noise is None else question.noise,
    )


def from_recording(samples: Samples, question: Question, g: float) -> Recorded:
    """Poses and the estimate from them, cleaned and not yet checked; every visit to an orientation is a pose of its own
    where the bias moved. Raises `InputError`.
    """
    if not isinstance(samples, Samples):
        raise InputError(f"found {type(samples).__name__}, expected Samples: cw.read(path) or cw.Samples(wrench=, ...)")
    if not (np.isfinite(g) and g > 0.0):
        raise InputError(f"g is {g!r}, expected m/s^2 above 0")
    free, warnings = _contact_free(samples)
    if not len(free):
        raise InputError(f"{free.source}: found no contact-free samples, expected poses without a load")
    stream = is_stream(samples)
    if stream:
        free = with_delay_of_rows(free)
    recorded = recorded_poses(free, MOST_VISITS, stream)
    poses, rejected = _in_time(recorded.poses), recorded.rejected
    warnings += what_was_not_still(rejected, recorded.segments, _first_time(free))
    if recorded.visits is not None:
        visits = _in_time(recorded.visits)
        found = cleaned_estimate(_readings(visits), _times(visits), question)
        if found.course is not None and found.course.kind != "steady":
            return Recorded(free, visits, found, warnings, g, rejected, recorded.segments)
    found = cleaned_estimate(_readings(poses), _times(poses), question)
    return Recorded(free, poses, found, warnings, g, rejected, recorded.segments)


def _first_time(samples: Samples) -> float:
    return 0.0 if samples.t is None else float(samples.t.min(initial=np.inf))


def _in_time(poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
    return tuple(sorted(poses, key=_middle))


def _middle(pose: Pose) -> float:
    return 0.0 if pose.t_start is None or pose.t_end is None else 0.5 * (pose.t_start + pose.t_end)


def _readings(poses: tuple[Pose, ...]) -> PoseReadings:
    return PoseReadings(
        np.array([pose.R_base_flange for pose in poses]),
        np.array([pose.wrench for pose in poses]),
        pooled_scatter(poses),
    )


def _times(poses: tuple[Pose, ...]) -> Array:
    """The middle of each pose (n,), s; the count of poses where no time is known or it stands still."""
    times = np.array([_middle(pose) for pose in poses])
    if poses[0].t_start is not None and times[-1] > times[0]:
        return times
    return np.arange(len(poses), dtype=np.float64)


def _alternatives(readings: PoseReadings, question: Question) -> tuple[Alternative, ...]:
    """What the rungs of the ladder make of the same poses; those that the poses cannot tell are left out."""
    rungs = []
    for model in OTHER_RUNGS:
        of_rung = replace(question, model=model)
        try:
            fit = fitted(readings, of_rung).fit
            if fit.tool is not None:
                require_answerable(fit, readings, model, of_rung)
        except UnobservableError:
            continue
        freedom = max(fit.readings_left, LEAST_LEFT) / 6.0
        force, torque = (np.sqrt(np.sum(part**2) / freedom) for part in np.hsplit(fit.residuals, 2))
        rungs.append(
            Alternative(
                model=model,
                weight=None if fit.tool is None else fit.tool.weight,
                weight_std=None if fit.tool is None else float(np.sqrt(fit.covariance[0, 0])),
                force_left=float(force),
                torque_left=float(torque),
                B=fit.B,
                gravity_direction=fit.gravity_direction,
            )
        )
    return tuple(rungs)


def _contact_free(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    samples, notes = samples.unsaturated()
    if samples.load_mass is None or not (samples.load_mass > 0.0).any():
        return samples, notes
    free = samples.load_mass == 0.0
    left_out = int(np.sum(~free))
    return samples.select(free), (*notes, f"{left_out} rows with a load hung on the tool were left out")


def _noise_std(noise: NoiseLike) -> Array | None:
    """Standard deviations (6,) of one pose's reading from what the user gave, or None."""
    if noise is None:
        return None
    try:
        values = np.asarray(noise.wrench if isinstance(noise, Samples) else noise, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.ndim == 2 and values.shape[1] == 6 and len(values) >= 2:
        values = values.std(axis=0, ddof=1)
    if values.shape != (6,) or not (np.isfinite(values).all() and (values > 0.0).all()):
        raise InputError(
            "noise must be six standard deviations above 0 (fx..tz, N and N m), or a recording at rest (n, 6) in which "
            f"every axis moves; found {np.array2string(values, threshold=8)}"
        )
    return values


def assembled(recorded: Recorded, question: Question, origin: Mapping[str, str]) -> Calibration:
    """The checked estimate as a Calibration; `origin` joins its provenance."""
    found, poses, warnings = recorded.found, recorded.poses, recorded.warnings
    provenance: dict[str, str | int | float] = {
        "software": f"contactwrench {__version__}",
        "source": recorded.samples.source,
        "rows": len(recorded.samples),
        "g": float(recorded.g),
        **({} if recorded.samples.t is None else {"t_first": _first_time(recorded.samples)}),
        **origin,
    }
    fit, readings, names, tool = found.found.fit, found.readings, found.found.names, found.found.fit.tool
    observability = describe(readings.R_base_flange, fit.gravity_direction, fit.singular_values, fit.covariance, names)
    if tool is None:
        weight = mass = com = R_flange_sensor = yaw = None
        parameters = fit.B.ravel()
        bias = fit.B[:, 3]
    else:
        weight, com, bias, R_flange_sensor = tool.weight, tool.com, tool.bias, tool.R_flange_sensor
        mass = weight / recorded.g
        yaw = yaw_of_mounting(R_flange_sensor)[0]
        parameters = np.zeros(len(names))
        parameters[:10] = np.r_[weight, com, bias]
        if "yaw" in names:
            parameters[10] = yaw
    many = len(poses) > MOST_POSES_KEPT
    held_out = fit.held_out
    warnings += what_was_cleaned(found, poses, _first_time(recorded.samples)) + found.found.warnings
    warnings += weaknesses(found, question, observability.trade_offs)
    compared = question.model == "auto" and question.earlier is None and len(poses) <= MOST_CLEANED
    alternatives = _alternatives(readings, question) if compared else ()
    return Calibration(
        requested_model=question.model,
        model=rung_fitted(question.model),
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
        dof=float(fit.dof.min()),
        observability=observability,
        warnings=warnings,
        provenance=provenance,
        poses=() if many else (*map(_marked, poses, found.reasons), *recorded.rejected),
        moments=moments_of_poses(readings.R_base_flange, readings.wrench) if many else None,
        weight_xy=found.found.weight_xy,
        weight_z=found.found.weight_z,
        parameter_dof=fit.dof,
        assumptions=() if found.found.auto is None else assumptions_in_words(found.found.auto, question),
        alternatives=alternatives,
        delay=recorded.samples.delay,
        delay_std=recorded.samples.delay_std,
    )


def _marked(pose: Pose, reason: str | None) -> Pose:
    return pose if reason is None else replace(pose, rejected=reason)
