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
from ..calibration.fields import Alternative
from ..calibration.findings import Finding, Kind, Severity
from ..calibration.observability import describe
from ..errors import InputError, UnobservableError
from ..geometry.wrench import STANDARD_GRAVITY, unit_direction
from ..model import yaw_of_mounting
from ..samples.delay import with_delay_of_rows
from ..samples.poses import Pose, moments_of_poses
from ..samples.recorded_poses import RecordedPoses, is_stream, recorded_poses, resting_poses
from ..samples.samples import Samples
from ..version import __version__
from .affine import MIRRORED, fit_affine
from .alternatives import alternatives_to
from .estimate import Estimate, RigidEstimate
from .findings import doubts, of_recording
from .findings_of_beliefs import assumptions_in_words, of_beliefs, reasons_left_out
from .noise import NoiseLike, PoseReadings, in_time, readings_of, stated_noise
from .paper import fit_paper
from .priors import BASE_TILT_SD, MOUNT_TILT_SD, Question, TiltPriors, earlier_tool, stated_knowledge
from .rigid import estimated, model_fitted
from .sign_ambiguity import HELD_GRAVITY, checked, require_noise

MODELS = ("auto", "paper", "yaw", "mount", "mount+base", "affine")
DOWN = (0.0, 0.0, -1.0)
MOST_POSES_KEPT = 10_000
REVISITED = 1.2
"""Visits to each pose of a table without times, from which on the order of its rows says something."""

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
        return assembled(recorded, question, origin)
    except UnobservableError as error:
        raise UnobservableError(f"{error}{recorded.what_was_still}") from None


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording less its rows under load, its poses and their `readings`, the `estimate` from them, what was found
    on the way, the `g` (m/s^2) of the place, and how the poses were `found`.
    """

    samples: Samples
    poses: tuple[Pose, ...]
    readings: PoseReadings
    estimate: Estimate
    findings: tuple[Finding, ...]
    g: float
    found: RecordedPoses

    @property
    def what_was_still(self) -> str:
        """What to add to a complaint about the poses of a stream."""
        if not self.found.segments:
            return ""
        left_out = len(self.found.rejected)
        return f" (still stretches: {self.found.segments}, left out: {left_out}; stop for a second or two at each)"


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
    findings += (*of_recording(recorded, _first_time(free)),)
    visits = recorded.visits or ()
    ordered = stream or len(visits) > REVISITED * len(recorded.poses)
    if recorded.visits is not None:
        poses = in_time(recorded.visits)
        readings = readings_of(poses, ordered)
        estimate = fitted(readings, question)
        if estimate.bias_moved:
            return Recorded(free, poses, readings, estimate, findings, g, recorded)
    poses = in_time(recorded.poses)
    readings = readings_of(poses, ordered)
    return Recorded(free, poses, readings, fitted(readings, question), findings, g, recorded)


def fitted(readings: PoseReadings, question: Question) -> Estimate:
    """The estimate by the model that is asked for, not yet checked."""
    if question.model == "paper":
        return fit_paper(readings, question.gravity_direction)
    return fit_affine(readings, question) if question.model == "affine" else estimated(readings, question)


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
    """The estimate, checked, as a Calibration; `origin` joins its provenance. Raises `UnobservableError` and
    `AmbiguityError` where it may not be returned.
    """
    estimate, poses, kept = recorded.estimate, recorded.poses, recorded.readings.select(recorded.estimate.kept)
    if isinstance(estimate, RigidEstimate):
        of_sign = checked(estimate, recorded.readings, question)
    else:
        require_noise(len(kept), 24, float(estimate.readings_left.min()), question)
        of_sign = (MIRRORED,) if np.linalg.det(estimate.B[:3, :3]) < 0.0 else ()
    provenance: dict[str, str | int | float | bool | None] = {
        "software": f"contactwrench {__version__}",
        "source": recorded.samples.source,
        "rows": len(recorded.samples),
        "g": float(recorded.g),
        **({} if recorded.samples.t is None else {"t_first": _first_time(recorded.samples)}),
        **origin,
    }
    names, R = estimate.names, kept.R_base_flange
    observability = describe(R, estimate.gravity_direction, estimate.singular_values, estimate.covariance, names)
    weight = mass = com = R_flange_sensor = yaw = weight_xy = weight_z = None
    parameters, bias = estimate.B.ravel(), estimate.B[:, 3]
    if isinstance(estimate, RigidEstimate):
        tool, weight_xy, weight_z = estimate.tool, estimate.weight_xy, estimate.weight_z
        weight, com, bias, R_flange_sensor = tool.weight, tool.com, tool.bias, tool.R_flange_sensor
        mass = weight / recorded.g
        yaw = yaw_of_mounting(R_flange_sensor)[0]
        parameters = np.zeros(len(names))
        parameters[:10] = np.r_[weight, com, bias]
        if "yaw" in names:
            parameters[10] = yaw
    many = len(poses) > MOST_POSES_KEPT
    alternatives: tuple[Alternative, ...] = ()
    if isinstance(estimate, RigidEstimate) and question.model == "auto" and question.earlier is None:
        steady = replace(kept, wrench=kept.wrench - estimate.change[estimate.kept])
        alternatives = alternatives_to(estimate.tool, steady, question)
    return Calibration(
        requested_model=question.model,
        model=model_fitted(question.model),
        weight=weight,
        mass=mass,
        com=com,
        bias=bias,
        R_flange_sensor=R_flange_sensor,
        yaw=yaw,
        gravity_direction=estimate.gravity_direction,
        B=estimate.B,
        B_covariance=estimate.B_covariance,
        parameter_names=names,
        parameters=parameters,
        covariance=estimate.covariance,
        noise=estimate.noise,
        residual_rms=np.sqrt(np.mean(estimate.residuals**2, axis=0)),
        held_out_rms=None if estimate.held_out is None else np.sqrt(np.mean(estimate.held_out**2, axis=0)),
        reduced_chi2=estimate.reduced_chi2,
        dof=float(estimate.dof.min()),
        observability=observability,
        findings=(
            *recorded.findings,
            *of_beliefs(estimate, poses, _first_time(recorded.samples)),
            *of_sign,
            *doubts(estimate, kept, question, observability.trade_offs),
        ),
        provenance=provenance,
        poses=() if many else (*map(_marked, poses, reasons_left_out(estimate)), *recorded.found.rejected),
        moments=moments_of_poses(R, kept.wrench) if many else None,
        weight_xy=weight_xy,
        weight_z=weight_z,
        parameter_dof=estimate.dof,
        assumptions=assumptions_in_words(estimate, question),
        alternatives=alternatives,
        delay=recorded.samples.delay,
        delay_std=recorded.samples.delay_std,
        still_noise=recorded.found.still_noise,
        gain_covariance=estimate.gain_covariance if isinstance(estimate, RigidEstimate) else None,
    )


def _marked(pose: Pose, reason: str | None) -> Pose:
    return pose if reason is None else replace(pose, rejected=reason)
