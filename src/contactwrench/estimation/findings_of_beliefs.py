"""What the posterior says beside the numbers: poses left out, a bias that moved, errors that go with the orientation;
and what `auto` took for granted.
"""

from __future__ import annotations

import numpy as np

from ..calibration.findings import Finding, Kind
from ..geometry.arrays import Array
from ..samples.poses import Pose, names_of
from ..statistics import counted, force_and_torque, two_digits
from .bias_drift import Drift
from .estimate import DECIDES, DECIDES_BY_FAR, IN_DOUBT, Beliefs, Estimate, RigidEstimate
from .findings import DOUBTFUL, REFUSED, WARNING, WEAK
from .outliers import LEVEL_SHARE, alike, probability_of_a_level
from .priors import Question

LARGE_SHARE, FAR_OFF = 0.25, 0.5
"""Of the poses: where more are left out, the result hangs on which; and of the weight: off by more, they may as well be
the ones that are right.
"""

LIKE_CONTACTS, FEW_LIKE_CONTACTS = 0.3, 2
"""Of the poses, and poses: so few after a step may as well be in contact, all in the same way."""

SAID, WANDERS = 0.5, 0.75
"""Probabilities from which on the bias is said to have moved; to have wandered, which takes up chance of any shape."""

FEW_POSES = 4
MOST_NAMED = 6
SURELY, LONG_LEVER = 3.0, 0.15
"""Standard deviations, of a force that is none and of the prior of backlash; m."""
COUNTED = "(probability {}): it is counted in every std"
WITH_ORIENTATION = {
    Kind.GAIN: f"gain or cross-talk of the sensor shows {COUNTED}; a calibrated sensor matrix would mend it",
    Kind.CREEP: f"a part of the load of the pose before shows {COUNTED}, as of a sensor that creeps; rest for longer",
    Kind.CABLE: f"a pull that goes with the orientation shows, as of a cable {COUNTED}; fasten or free the cable",
    Kind.ROBOT: "the robot's orientations are off by about {} deg an axis (probability {}): it is counted in every "
    "std, and in what a new orientation reads; a calibrated robot would mend it, where it is "
    "not the sensor that has hysteresis",
}


def reasons_left_out(estimate: Estimate) -> tuple[str | None, ...]:
    """Why each pose was left out, None where it was kept."""
    return tuple(
        None if kept else _reason(error, estimate.noise)
        for error, kept in zip(estimate.errors, estimate.kept, strict=True)
    )


def _reason(error: Array, noise: Array) -> str:
    return (
        f"{force_and_torque(error)} off what the other poses explain, "
        f"{float(np.linalg.norm(error / noise)):.0f} std: in contact, bumped, or read before the arm was still"
    )


def _in_torque_alone(error: Array, noise: Array) -> bool:
    """Whether a contact would have so long a lever that no tool has it: then something on the tool shifted."""
    force, of_noise, torque = (float(np.linalg.norm(part)) for part in (error[:3], noise[:3], error[3:]))
    return force < SURELY * of_noise and torque > LONG_LEVER * (force + SURELY * of_noise)


def of_beliefs(estimate: Estimate, poses: tuple[Pose, ...], since: float, in_order: bool) -> list[Finding]:
    """Poses left out, up to `MOST_NAMED` by name, those in doubt, how the bias moved, and what goes with the
    orientation; times count from `since`, and `in_order` is whether the poses are known to be.
    """
    beliefs = estimate.beliefs if isinstance(estimate, RigidEstimate) else None
    if beliefs is None:
        return []
    names = names_of(poses, since)
    return [
        *_poses_left_out(estimate, names),
        *_poses_in_doubt(estimate, beliefs, names),
        *_bias_moved(beliefs, names, poses, in_order),
        *_with_orientation(beliefs, estimate.weight_scale, names, poses),
        *_anywhere(estimate, beliefs),
        *_tilt_in_doubt(beliefs),
        *_drift_in_doubt(beliefs, names),
    ]


def _tilt_in_doubt(beliefs: Beliefs) -> list[Finding]:
    """Where it decides the answer whether the mounting, or the base, is exactly nominal, and that is not settled."""
    each = (
        ("the sensor's z is exactly parallel to the flange's", beliefs.mounting_exact, beliefs.off_by_mounting),
        ("gravity is exactly in the stated direction", beliefs.base_exact, beliefs.off_by_base),
    )
    return [
        DOUBTFUL(
            Kind.TILT_IN_DOUBT,
            f"whether {what} decides the answer, with a probability of {_percent(exact)} that it is: the other way the "
            f"answer is {off:.1f} std off; tilt the tool further, about more than one axis, or state it with --known",
        )
        for what, exact, off in each
        if off > (DECIDES if min(exact, 1.0 - exact) > IN_DOUBT else DECIDES_BY_FAR)
    ]


def _drift_in_doubt(beliefs: Beliefs, names: list[str]) -> list[Finding]:
    """Where the answer would be another one, had the bias moved in a way that is unlikely, but not excluded."""
    rival = beliefs.furthest
    if rival is None or rival.decides <= 1.0:
        return []
    moved = {Kind.BIAS_DRIFTED: "drifted", Kind.BIAS_WANDERED: "wandered"}.get(rival.drift.kind or Kind.OTHER, "")
    moved = moved or f"stepped before {names[rival.drift.first_after or 0]}"
    text = (
        f"the bias may have {moved}, with a probability of {_percent(rival.probability)}: the answer would be "
        f"{rival.off:.1f} std off; record more poses"
    )
    return [DOUBTFUL(Kind.DRIFT_IN_DOUBT, text)]


def _anywhere(estimate: Estimate, beliefs: Beliefs) -> list[Finding]:
    """So few poses with a mounting far off nominal, that the negated readings may fit with another one."""
    kept = int(estimate.kept.sum())
    if kept > FEW_POSES or beliefs.any_mounting <= IN_DOUBT:
        return []
    text = (
        f"the mounting is far off nominal by {kept} poses alone: with so few, readings of the other sign may fit "
        "another mounting; confirm the sign by a push, or record 6 or more"
    )
    return [DOUBTFUL(Kind.SIGN_NOT_CONFIRMED, text)]


def _poses_left_out(estimate: Estimate, names: list[str]) -> list[Finding]:
    reasons = zip(names, reasons_left_out(estimate), strict=True)
    texts = [f"{name} was left out: {reason}" for name, reason in reasons if reason is not None]
    out = len(texts)
    if out > MOST_NAMED:
        texts[MOST_NAMED:] = [f"{out - MOST_NAMED} more poses were left out for the same reason"]
    found = [REFUSED(Kind.POSE_LEFT_OUT, text) for text in texts]
    force = np.linalg.norm(estimate.errors[~estimate.kept, :3], axis=1)
    if out > LARGE_SHARE * len(names):
        text = f"{out} of {len(names)} poses were left out: record more, free of contact"
        read_wrongly = (
            f"{out} of {len(names)} poses were left out, off by more than half the weight: unless something was in the "
            "way, the file is read wrongly (orientation, sign, units); contactwrench diagnose tries the other ways"
        )
        far = len(names) - out <= FEW_POSES and np.sqrt(np.mean(force**2)) > FAR_OFF * estimate.weight_scale
        found.append(WEAK(Kind.POSE_LEFT_OUT, read_wrongly) if far else DOUBTFUL(Kind.POSE_LEFT_OUT, text))
    elif out > 1 and alike(estimate.errors[~estimate.kept] / estimate.noise):
        off = force_and_torque(estimate.errors[~estimate.kept].mean(axis=0))
        text = f"the {out} poses left out are all off by the same, {off}: if that is backlash, the bias lies between"
        found.append(DOUBTFUL(Kind.POSE_LEFT_OUT, text))
    errors = zip(names, estimate.errors, estimate.kept, strict=True)
    shifted = [name for name, error, kept in errors if not kept and _in_torque_alone(error, estimate.noise)]
    if shifted:
        text = (
            f"{', '.join(shifted[:FEW_POSES])} {'is' if len(shifted) == 1 else 'are'} off in torque alone, as hardly a "
            "contact is: if something shifts on the tool, where its centre of mass is depends on how it is held; "
            "fasten it"
        )
        found.append(DOUBTFUL(Kind.POSE_LEFT_OUT, text))
    return found


def _poses_in_doubt(estimate: Estimate, beliefs: Beliefs, names: list[str]) -> list[Finding]:
    """Poses that nearly were left out, or nearly were not, a last one whose error may be a step of the bias, and one of
    few that may be backlash.
    """
    texts = [
        f"{name} may be in contact, with a probability of {_percent(float(probability))}: the result counts both "
        "cases; record that orientation again"
        for name, probability in zip(names, beliefs.outlying, strict=True)
        if IN_DOUBT < probability < 1.0 - IN_DOUBT
    ]
    if not estimate.kept[-1] and len(names) > 1:
        texts.append(
            f"{names[-1]}, the last one, was left out: if the bias stepped there instead, it is off by that; record "
            "one more pose"
        )
    out = np.flatnonzero(~estimate.kept)
    level = probability_of_a_level(len(names), estimate.errors[out], estimate.noise, estimate.weight_scale)
    if len(out) == 1 and level > IN_DOUBT:
        texts.append(
            f"{names[out[0]]} was left out of {len(names)}: if it is off by backlash, the bias is off by half of that; "
            "record more poses"
        )
    return [DOUBTFUL(Kind.POSE_IN_DOUBT, text) for text in texts]


def _bias_moved(beliefs: Beliefs, names: list[str], poses: tuple[Pose, ...], in_order: bool) -> list[Finding]:
    moved, drift = sum(beliefs.moved.values()), beliefs.drift
    if drift is None or drift.kind is None or moved < (WANDERS if drift.kind is Kind.BIAS_WANDERED else SAID):
        return []
    text = _moved_in_words(drift, beliefs.change, moved, names, poses)
    if not in_order:
        return [DOUBTFUL(drift.kind, f"{text}, if the rows are in order: give their times (a column t)")]
    after = len(names) - (drift.first_after or 0)
    if drift.kind is Kind.BIAS_STEPPED and after <= max(LIKE_CONTACTS * len(names), FEW_LIKE_CONTACTS):
        alike = "poses that touch something alike would look the same: record more after it"
        return [DOUBTFUL(drift.kind, f"{text}; {alike}")]
    return [(WARNING if moved >= 1.0 - IN_DOUBT else DOUBTFUL)(drift.kind, text)]


def _moved_in_words(drift: Drift, change: Array, probability: float, names: list[str], poses: tuple[Pose, ...]) -> str:
    """By how much, and when; `change` (n, 6) N and N m, what each pose's bias was off the last one."""
    force, torque = (two_digits(float(np.abs(part).max())) for part in (change[:, :3], 1e3 * change[:, 3:]))
    most = f"up to {force} N and {torque} mN m (probability {_percent(min(probability, 0.999))})"
    if drift.kind is Kind.BIAS_STEPPED and drift.first_after is not None:
        return f"the bias stepped before {names[drift.first_after]} by {most}: the last bias is given"
    first, last = poses[0].t_start, poses[-1].t_end
    over = "" if first is None or last is None else f" over {two_digits(last - first)} s"
    if drift.kind is Kind.BIAS_DRIFTED:
        return f"the bias drifted by {most}{over}: the last bias is given"
    return f"the bias wandered by {most}{over}: the last bias is given, with the std that this leaves it"


def _with_orientation(beliefs: Beliefs, weight: float, names: list[str], poses: tuple[Pose, ...]) -> list[Finding]:
    """Errors that come back with the orientation; of a bias in two levels, which poses are on the smaller side, and
    whether these are further apart than backlash moves a tool of that `weight`, N.
    """
    found = []
    for kind, probability in beliefs.with_orientation.items():
        chance = _percent(min(probability, 0.999))
        if probability > 0.5 and kind in WITH_ORIENTATION:
            how_far = [two_digits(float(np.rad2deg(beliefs.turn)))] if kind is Kind.ROBOT else []
            found.append(WARNING(kind, WITH_ORIENTATION[kind].format(*how_far, chance)))
        if probability > 0.5 and kind is Kind.TWO_LEVELS:
            side = beliefs.backlash @ beliefs.backlash[0] > 0.0
            few = side if 2 * side.sum() <= len(side) else ~side
            named = [name for name, on_it in zip(names, few, strict=True) if on_it]
            more = f" and {counted(len(named) - MOST_NAMED, 'more pose')}" if len(named) > MOST_NAMED else ""
            text = (
                f"the bias comes back in two levels, {force_and_torque(2.0 * beliefs.backlash[0])} apart, as backlash "
                f"makes them {COUNTED.format(chance)}; on the smaller side: {', '.join(named[:MOST_NAMED])}{more}"
            )
            (changes,) = np.nonzero(few[1:] != few[:-1])
            if poses[0].t_start is None and len(changes) == 1 and 0 < changes[0] < len(few) - 2:  # no backlash is so
                first = names[changes[0] + 1]
                text += (
                    f"; split in the order of the rows, as by a new zero before {first}: give their times (a column t)"
                )
            if is_far := float(np.linalg.norm(beliefs.backlash[0, :3])) > SURELY * LEVEL_SHARE * weight:
                text += "; backlash hardly moves that far: rather two zeros, the bias is halfway: calibrate each alone"
            found.append((DOUBTFUL if is_far else WARNING)(kind, text))
    return found


def assumptions_in_words(estimate: Estimate, question: Question) -> tuple[str, ...]:
    """One sentence on the mounting, one on the base."""
    if not isinstance(estimate, RigidEstimate) or question.model != "auto" or question.earlier is not None:
        return ()
    if (beliefs := estimate.beliefs) is None:
        return ()
    z, down = float(estimate.tool.R_flange_sensor[2, 2]), float(estimate.gravity_direction @ question.gravity_direction)
    nominal = f"sensor's z {'along' if z >= 0.0 else 'against'} the flange's"
    of_mounting = ("sensor's z is", "the flange's", "the flange's", nominal, "parallel")
    of_base = ("gravity is", "that direction", "the stated direction", "gravity in the stated direction", "level")
    mount, base = question.priors.mount, question.priors.base
    return (
        f"mounting: {_assumed(mount, beliefs.any_mounting, beliefs.mounting_exact, abs(z), of_mounting)}",
        f"base: {_assumed(base, beliefs.any_base, beliefs.base_exact, down, of_base)}",
    )


def _assumed(sd: float | None, anywhere: float, exact: float, cosine: float, words: tuple[str, ...]) -> str:
    """What a prior of `sd` (rad) made of one tilt, in the `words` for that one."""
    it_is, of_known, of_stated, nominal, exactly = words
    angle = float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))
    if sd is None:
        return f"as known; {it_is} found {angle:.2f} deg off {of_known}"
    an_axis = f"{np.rad2deg(sd):.3g} deg an axis"
    if anywhere > 0.5:
        chance = _percent(min(anywhere, 0.999))
        return f"{it_is} {angle:.1f} deg off {of_stated}, not within {an_axis} (probability {chance})"
    found = f"found {angle:.2f} deg off, exactly {exactly} has a probability of {_percent(exact)}"
    return f"{nominal}, +- {an_axis}; {found}"


def _percent(probability: float) -> str:
    return f"{100.0 * probability:.3g} %"
