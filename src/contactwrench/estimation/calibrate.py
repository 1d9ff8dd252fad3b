"""`calibrate`: from samples to a Calibration, by the model that is asked for.

Samples become poses, an estimator fits them, and the result is returned only if the poses separate every parameter
and if the data do not contradict the sign of the readings and the side of the base that they were given with.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.alternative import Alternative
from ..calibration.calibration import Calibration
from ..calibration.difference import origin_of_tool
from ..calibration.findings import Finding
from ..calibration.observability import describe
from ..errors import AmbiguityError, UnobservableError, naming, refuse, with_room_for
from ..geometry.ranges import TILT_STD, G
from ..geometry.wrench import STANDARD_GRAVITY, unit_direction
from ..model import parameters_of, yaw_of_mounting
from ..samples.agreement import agreed, few_repeats
from ..samples.delay import with_delay_of_rows, with_known_delay
from ..samples.poses import Pose, averaged, moments_of_poses
from ..samples.recorded_poses import RecordedPoses, is_stream, recorded_poses, resting_poses
from ..samples.samples import Samples, require_samples
from ..version import __version__
from .affine import MIRRORED, fit_affine
from .alternatives import alternatives_beside
from .estimate import Estimate, RigidEstimate
from .findings import doubts
from .findings_of_beliefs import assumptions_in_words, of_beliefs, reasons_left_out
from .findings_of_knowledge import of_known, of_prior
from .findings_of_recording import contact_free, of_estimate, of_recording, rows_apart, with_creep
from .held_rotations import with_rotations_judged
from .in_motion import with_earlier_inertia, with_motion
from .noise import NoiseLike, PoseReadings, in_time, readings_of, stated_noise
from .paper import fit_paper
from .plausibility import dead_channels, inherited
from .priors import BASE_TILT_SD, MOUNT_TILT_SD, Question, TiltPriors, known_of, stated_knowledge, with_errors_of
from .rigid import estimated, model_fitted
from .sign_ambiguity import HELD_GRAVITY, checked, require_noise

MODELS = ("auto", "paper", "yaw", "mount", "mount+base", "affine", "dynamic")
DOWN = (0.0, 0.0, -1.0)
OF_TOOL = ("weight", "mass", "com", "R_flange_sensor", "yaw", "weight_xy", "weight_z")
"""Fields that only a rigid tool has; None of the others."""

MOST_POSES_KEPT = 10_000
REVISITED, MOST_VISITS = 1.2, 1_000
"""Visits to each pose of a table without times, from which on the order of rows tells; of so many, it tells little."""


def calibrate(
    samples: Samples,
    model: str = "auto",
    noise: NoiseLike = None,
    gravity: ArrayLike | None = None,
    *,
    g: float | None = None,
    mount_tilt_sd: float = MOUNT_TILT_SD,
    base_tilt_sd: float = BASE_TILT_SD,
    known: Mapping[str, tuple[Any, Any]] | None = None,
    prior: Calibration | None = None,
    sensor_offset: ArrayLike | None = None,
) -> Calibration:
    """Identify weight, centre of mass, bias and mounting from contact-free samples at several orientations.

    Poses that the others do not explain are left out, and a bias that stepped or drifted is followed, the last one
    kept; not for `paper` and `affine`. Samples with a load or a saturated channel are left out too. Warnings say so.

    Args:
        samples: at rest at several orientations, or a recording with times in which the arm stops at them.
        model: `paper`, `yaw`, `mount`, `mount+base`, `affine`, or `auto` where nobody knows which of them holds;
            `dynamic`: as `auto`, and the inertia from what lies between the stops.
        noise: of one pose's reading: std (6,), N and N m; one number, N, which stands for as many N m at a lever of
            5 cm; or a recording at rest (n, 6); None: from the residuals.
        gravity: direction (3,), base axes; None: down. `mount+base` and `auto` find it within 90 deg of this one.
        g: m/s^2, turns the weight into the mass; None: that of `prior`, or 9.80665.
        mount_tilt_sd: rad an axis, of the prior of `auto` on the mounting, 1.41 deg unless stated.
        base_tilt_sd: rad an axis, of the prior of `auto` on the base, 0.71 deg unless stated.
        known: (value, std) of `weight` N, `com` (3,) m, `mount` R_flange_sensor (std rad), `gravity` (3,) (std rad).
        prior: an earlier calibration of the same tool, whose bias may have moved: a single pose gives the new one.
        sensor_offset: of `dynamic`, where the sensor's origin is (3,), m from the flange's, flange axes, within 0.5 mm;
            None: from the motion.

    Returns:
        Every parameter with its covariance, what was assumed, and warnings.

    Raises:
        InputError: unusable arguments.
        UnobservableError: the poses cannot separate the parameters.
        AmbiguityError: the data contradict the sign of the readings or the side of the base.
    """
    require_samples(samples)
    refuse((sensor_offset is not None and model != "dynamic", f"model {model} has no sensor_offset: leave it out"))
    asked, origin = "auto" if model == "dynamic" else model, dict[str, str]()
    question = question_asked(asked, noise, gravity, TiltPriors(mount_tilt_sd, base_tilt_sd), known)
    if prior is not None:
        stated = (known or {}).get("gravity", None if gravity is None else (gravity, base_tilt_sd))
        question = _with_prior(question, prior, stated, samples)
        origin = {"prior": str(prior.provenance.get("source", "arrays")), "tool_from": origin_of_tool(prior)}
    of_place = STANDARD_GRAVITY if prior is None else prior.g
    with naming(samples.source):
        recorded = from_recording(samples, question, of_place if g is None else g)
        contradicted = of_known(known or {}, recorded.readings, question)
        try:
            calibration = with_errors_of(assembled(recorded, question, origin), prior)
            if model == "dynamic":
                calibration = with_motion(calibration, recorded.samples, sensor_offset)
            elif prior is not None:
                calibration = with_earlier_inertia(calibration, prior)
            return replace(calibration, findings=(*contradicted, *calibration.findings, *inherited(prior)))
        except (UnobservableError, AmbiguityError) as error:
            if reason := samples.doubt or "".join(each.said for each in contradicted[:1]):
                raise type(error)(f"{re.split('[:;] ', str(error))[0]}; but {reason}") from None
            still = recorded.what_was_still if isinstance(error, UnobservableError) else ""
            raise type(error)(with_room_for(str(error), still)) from None


@dataclass(frozen=True, eq=False)
class FittedRecording:
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
    refuse((model not in MODELS, f"model {model!r} is not known, expected one of {', '.join(MODELS)}"))
    stated = unit_direction(DOWN if gravity is None else gravity)
    for name, sd in (("mount_tilt_sd", priors.mount), ("base_tilt_sd", priors.base)):
        TILT_STD.require(np.nan if sd is None else sd, name)
    known = {} if known is None else known
    nothing = f"model {model} takes nothing as known: leave known out, or choose another model"
    held = f"model {model} holds gravity, and gravity is given as known with a std: choose auto or mount+base"
    twice = "gravity is stated and given as known too: leave one of them out"
    refuse(
        (known and model in ("paper", "affine"), nothing),
        ("gravity" in known and model in HELD_GRAVITY, held),
        ("gravity" in known and gravity is not None, twice),
    )
    knowledge = stated_knowledge(known)
    if "gravity" in known:
        stated, priors = unit_direction(known["gravity"][0]), replace(priors, base=None)
    if "mount" in known:
        priors = replace(priors, mount=None)
    return Question(model, stated, stated_noise(noise), priors, knowledge)


def _with_prior(question: Question, prior: Calibration, gravity: tuple[Any, Any] | None, samples: Samples) -> Question:
    other, model = f"prior is {type(prior).__name__}, expected a Calibration: cw.Calibration.load(path)", question.model
    two = f"an earlier calibration brings its model, and model {model} is asked for: leave one out"
    refuse((not isinstance(prior, Calibration), other), (model not in ("auto", "dynamic"), two))
    rows = min((pose.n for pose in resting_poses(contact_free(samples)[0])), default=1)
    knowledge, noise = known_of(prior, rows, gravity)
    return replace(
        question,
        gravity_direction=prior.gravity_direction,
        knowledge=(*question.knowledge, knowledge),
        earlier=prior,
        noise=noise if question.noise is None else question.noise,
    )


def from_recording(samples: Samples, question: Question, g: float) -> FittedRecording:
    """Poses and the estimate from them, robust, not yet checked: visits where the bias moved. Raises `InputError`."""
    require_samples(samples)
    G.require(g, "g")
    free, findings = contact_free(samples)
    refuse((not len(free), f"{free.source}: found no contact-free samples, expected poses without a load"))
    free = with_delay_of_rows(free) if (stream := is_stream(samples)) else free
    recorded = recorded_poses(free, MOST_VISITS, stream)
    dead = dead_channels(free, question.gravity_direction)
    ordered, few = stream or len(recorded.visits or ()) > REVISITED * len(recorded.poses), few_repeats(recorded)
    singly = averaged(free, np.arange(len(free))) if few else recorded.visits
    recorded = recorded if singly else agreed(free, recorded)
    poses = in_time(singly or recorded.poses)
    estimate = fitted(readings := readings_of(poses, ordered and not recorded.apart), question)
    if singly and not (recorded.visits and estimate.bias_moved):  # what is at one orientation is one pose
        recorded = agreed(free, recorded, (estimate.noise, float(estimate.dof.min())) if few else None)
        poses = in_time(recorded.poses)
        estimate = fitted(readings := readings_of(poses, ordered and not recorded.apart), question)
    if recorded.lag is not None:
        estimate = fitted(readings.with_lag(recorded.lag), question).with_noise_of(estimate)
    findings += (*of_recording(recorded, _first_time(free)), *rows_apart(recorded, free.wrench), *dead)
    return FittedRecording(free, poses, readings, estimate, findings, g, recorded)


def fitted(readings: PoseReadings, question: Question) -> Estimate:
    """The estimate by the model that is asked for, not yet checked."""
    if question.model == "paper":
        return fit_paper(readings, question.gravity_direction)
    return fit_affine(readings, question) if question.model == "affine" else estimated(readings, question)


def _first_time(samples: Samples) -> float:
    return 0.0 if samples.t is None else float(samples.t.min(initial=np.inf))


def assembled(recorded: FittedRecording, question: Question, origin: Mapping[str, str]) -> Calibration:
    """The estimate as a Calibration; `origin` joins its provenance. Raises `UnobservableError`, `AmbiguityError`."""
    estimate, poses, kept = recorded.estimate, recorded.poses, recorded.readings.select(recorded.estimate.kept)
    samples, earlier = recorded.samples, question.earlier
    samples = samples if earlier is None else with_known_delay(samples, earlier.delay, earlier.delay_std)
    if isinstance(estimate, RigidEstimate):
        of_sign = checked(estimate, recorded.readings, question)
    else:
        require_noise(len(kept), 24, float(estimate.readings_left.min()), question)
        of_sign = (MIRRORED,) if np.linalg.det(estimate.B[:3, :3]) < 0.0 else ()
    provenance: dict[str, str | int | float | bool | None] = {
        "software": f"contactwrench {__version__}",
        "source": samples.source,
        "rows": len(samples),
        "g": float(recorded.g),
        **({} if samples.t is None else {"t_first": _first_time(samples)}),
        **samples.read_as,
        **origin,
    }
    names, R = estimate.names, kept.R_base_flange
    observability = describe(R, estimate.gravity_direction, estimate.singular_values, estimate.covariance, names)
    parameters, of_tool = estimate.B.ravel(), dict[str, Any].fromkeys(OF_TOOL)
    alternatives: Sequence[Alternative] = ()
    if isinstance(estimate, RigidEstimate):
        tool = estimate.tool
        yaw, mass = yaw_of_mounting(tool.R_flange_sensor)[0], tool.weight / recorded.g
        values = (tool.weight, mass, tool.com, tool.R_flange_sensor, yaw, estimate.weight_xy, estimate.weight_z)
        of_tool = dict(zip(OF_TOOL, values, strict=True))
        parameters = parameters_of(tool, yaw, names)
        if question.model == "auto" and earlier is None:
            alternatives = alternatives_beside(estimate, recorded.readings, question)
    many, reasons = len(poses) > MOST_POSES_KEPT, reasons_left_out(estimate)
    marked = [pose if why is None else replace(pose, rejected=why) for pose, why in zip(poses, reasons, strict=True)]
    calibration = Calibration(
        requested_model=question.model,
        model=model_fitted(question.model),
        **of_tool,
        bias=estimate.B[:, 3],
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
            *of_estimate(estimate, samples, recorded.readings, question, recorded.found.visits),
            *of_beliefs(estimate, poses, _first_time(samples)),
            *of_sign,
            *doubts(estimate, kept, question, observability.trade_offs),
            *of_prior(estimate, kept, compress(poses, estimate.kept), question),
        ),
        provenance=provenance,
        poses=() if many else (*marked, *recorded.found.rejected),
        moments=moments_of_poses(R, kept.wrench) if many else None,
        parameter_dof=estimate.dof,
        assumptions=assumptions_in_words(estimate, question),
        alternatives=alternatives,
        delay=samples.delay,
        delay_std=samples.delay_std,
        still_noise=recorded.found.still_noise,
        gain_covariance=estimate.gain_covariance if isinstance(estimate, RigidEstimate) else None,
        orientation_std=estimate.orientation_std if isinstance(estimate, RigidEstimate) else None,
    )
    judged = with_rotations_judged(calibration, estimate, recorded.readings, question)
    return with_creep(judged, recorded.found.creep, R)
