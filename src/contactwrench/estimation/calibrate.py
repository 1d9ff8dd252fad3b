"""`calibrate`: from samples to a Calibration, by the model that is asked for.

Samples become poses, an estimator fits them, and the result is returned only if the poses separate every parameter
and if the data do not contradict the sign of the readings and the side of the base that they were given with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..calibration.fields import Finding, Kind, Severity
from ..calibration.observability import describe
from ..errors import InputError, UnobservableError
from ..geometry.wrench import STANDARD_GRAVITY, unit_direction
from ..model import yaw_of_mounting
from ..samples.delay import with_delay_of_rows
from ..samples.poses import Pose, moments_of_poses
from ..samples.recorded_poses import RecordedPoses, is_stream, recorded_poses, resting_poses
from ..samples.samples import Samples
from ..samples.still_noise import StillNoise
from ..version import __version__
from .estimate import HELD_GRAVITY, alternatives_to, model_fitted
from .findings import assumptions_in_words, doubts
from .noise import NoiseLike, in_time, readings_of, stated_noise, times_of
from .priors import BASE_TILT_SD, MOUNT_TILT_SD, Question, TiltPriors, earlier_tool, stated_knowledge
from .robust import (
    MOST_JUDGED,
    RobustEstimate,
    confirmed,
    poses_left_out,
    robust_estimate,
    segments_left_out,
)

MODELS = ("auto", "paper", "yaw", "mount", "mount+base", "affine")
DOWN = (0.0, 0.0, -1.0)
MOST_POSES_KEPT = 10_000
MOST_VISITS = 1_000
"""With more, rows alternate between orientations, and the order of the visits says little."""


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
        checked = confirmed(recorded.robust, question)
    except UnobservableError as error:
        raise UnobservableError(f"{error}{recorded.what_was_still}") from None
    return assembled(replace(recorded, robust=checked), question, origin)


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording less its rows under load, its poses, the `robust` estimate from them, what was found on the way, and
    the `g` (m/s^2) of the place; `rejected` the segments of a stream that are no pose; `segments` how many made the
    poses, 0 of a table.
    """

    samples: Samples
    poses: tuple[Pose, ...]
    robust: RobustEstimate
    findings: tuple[Finding, ...]
    g: float
    rejected: tuple[Pose, ...]
    segments: int
    still_noise: StillNoise | None

    @property
    def what_was_still(self) -> str:
        """What to add to a complaint about the poses of a stream."""
        if not self.segments:
            return ""
        return f" (still stretches: {self.segments}, left out: {len(self.rejected)}; stop for a second or two at each)"


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
    question = Question(model=model, gravity_direction=stated, noise=stated_noise(noise), priors=priors)
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
    pieces = stated_knowledge(known)
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
    """Poses and the estimate from them, robust and not yet checked; every visit to an orientation is a pose of its own
    where the bias moved. Raises `InputError`.
    """
    if not isinstance(samples, Samples):
        raise InputError(f"found {type(samples).__name__}, expected Samples: cw.read(path) or cw.Samples(wrench=, ...)")
    if not (np.isfinite(g) and g > 0.0):
        raise InputError(f"g is {g!r}, expected m/s^2 above 0")
    free, findings = _contact_free(samples)
    if not len(free):
        raise InputError(f"{free.source}: found no contact-free samples, expected poses without a load")
    stream = is_stream(samples)
    if stream:
        free = with_delay_of_rows(free)
    recorded = recorded_poses(free, MOST_VISITS, stream)
    findings += (*segments_left_out(recorded, _first_time(free)), *_on_the_way(recorded))
    if recorded.visits is not None:
        visits = in_time(recorded.visits)
        robust = robust_estimate(readings_of(visits), times_of(visits), question)
        if robust.bias_drift is not None and robust.bias_drift.kind is not None:
            return Recorded(
                free, visits, robust, findings, g, recorded.rejected, recorded.segments, recorded.still_noise
            )
    poses = in_time(recorded.poses)
    robust = robust_estimate(readings_of(poses), times_of(poses), question)
    return Recorded(free, poses, robust, findings, g, recorded.rejected, recorded.segments, recorded.still_noise)


def _on_the_way(recorded: RecordedPoses) -> tuple[Finding, ...]:
    """That the arm stopped at too few orientations, and how many of the poses are of its slow motion."""
    if not recorded.on_the_way:
        return ()
    text = (
        f"{recorded.on_the_way} of {len(recorded.poses)} poses are parts of a slow motion, "
        f"{recorded.segments} still stretches were found: a stop of two seconds at each orientation tells more"
    )
    return (Finding(Kind.POSES_ON_THE_WAY, Severity.WARNING, text),)


def _first_time(samples: Samples) -> float:
    return 0.0 if samples.t is None else float(samples.t.min(initial=np.inf))


def _contact_free(samples: Samples) -> tuple[Samples, tuple[Finding, ...]]:
    samples, notes = samples.unsaturated()
    findings = tuple(Finding(Kind.SATURATED_ROWS, Severity.REFUSED, note) for note in notes)
    if samples.load_mass is None or not (samples.load_mass > 0.0).any():
        return samples, findings
    free = samples.load_mass == 0.0
    text = f"{int(np.sum(~free))} rows with a load hung on the tool were left out"
    return samples.select(free), (*findings, Finding(Kind.LOADED_ROWS, Severity.REFUSED, text))


def assembled(recorded: Recorded, question: Question, origin: Mapping[str, str]) -> Calibration:
    """The checked estimate as a Calibration; `origin` joins its provenance."""
    robust, poses, estimate = recorded.robust, recorded.poses, recorded.robust.estimate
    provenance: dict[str, str | int | float | bool | None] = {
        "software": f"contactwrench {__version__}",
        "source": recorded.samples.source,
        "rows": len(recorded.samples),
        "g": float(recorded.g),
        **({} if recorded.samples.t is None else {"t_first": _first_time(recorded.samples)}),
        **origin,
    }
    fit, readings, names, tool = estimate.fit, robust.readings, estimate.names, estimate.fit.tool
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
    left_out = poses_left_out(robust, poses, _first_time(recorded.samples))
    doubtful = doubts(robust, question, observability.trade_offs)
    compared = question.model == "auto" and question.earlier is None and len(poses) <= MOST_JUDGED
    alternatives = alternatives_to(readings, question) if compared else ()
    return Calibration(
        requested_model=question.model,
        model=model_fitted(question.model),
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
        findings=(*recorded.findings, *left_out, *estimate.findings, *doubtful),
        provenance=provenance,
        poses=() if many else (*map(_marked, poses, robust.reasons), *recorded.rejected),
        moments=moments_of_poses(readings.R_base_flange, readings.wrench) if many else None,
        weight_xy=estimate.weight_xy,
        weight_z=estimate.weight_z,
        parameter_dof=fit.dof,
        assumptions=() if estimate.auto is None else assumptions_in_words(estimate.auto, question),
        alternatives=alternatives,
        delay=recorded.samples.delay,
        delay_std=recorded.samples.delay_std,
        still_noise=recorded.still_noise,
    )


def _marked(pose: Pose, reason: str | None) -> Pose:
    return pose if reason is None else replace(pose, rejected=reason)
