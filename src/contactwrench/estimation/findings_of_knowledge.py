"""Readings held against what is known beforehand: an earlier calibration, and what was weighed or drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind
from ..geometry.arrays import Array
from ..model import MOUNT, PARAMETERS, wrench_jacobian
from ..samples.poses import Pose
from ..statistics import MisfitTest, counted, percent
from .estimate import Estimate, RigidEstimate
from .findings import DOUBTFUL, NOTE, SIGNIFICANCE, WEAK, Row, largest_force_std, poor_fit, those_that_hold
from .moved_bias import held_against, noise_dof
from .noise import PoseReadings, variance_of_means
from .priors import BASE_TILT_SD, MOUNT_TILT_SD, Question, TiltPriors, rows_of, stated_knowledge
from .rigid import estimated, model_fitted
from .variance_components import inverse_of

OPEN_SHARE = 0.025
"""Of the weight: by so much, a standard deviation, poses may leave the contact force open that are to show whether tool
and mounting are those of before. A mounting that slipped by 5 deg makes 9 % of it.
"""
FAR_BETTER = 0.5
"""Of the std of the contact force that the earlier poses leave, by noise: what these would, for that to be said."""
UNLIKELY = 0.01
"""The probability by which less is left of an earlier calibration that holds, from which on that it does is doubted."""


def of_prior(fit: Estimate, readings: PoseReadings, poses: Iterable[Pose], question: Question) -> list[Finding]:
    """That `readings` of `poses`, those kept, and the earlier calibration do not go together whatever the bias is now,
    or that they would not show it.
    """
    prior = question.earlier
    if prior is None or not isinstance(fit, RigidEstimate):
        return []
    R, dof = readings.R_base_flange, noise_dof(prior)
    variance = variance_of_means(prior.noise, prior.fitted_poses, np.array([float(pose.n) for pose in poses]))
    if question.noise is not None and question.noise.dof == 0.0:  # stated by the user
        variance, dof = np.tile(question.noise.std**2, (len(R), 1)), 0.0
    residuals = prior.compensate(readings.wrench - fit.change[fit.kept], R)
    _, bias = held_against(prior, residuals, R, variance, dof)
    by_chance = 1.0 if bias is None else min(bias.rest_probability, 2.0 * bias.other_probability)
    contradict = (
        "the poses contradict the earlier calibration: tool, mounting or base changed, the tool touches something, or "
        "the poses are noisier (--noise); calibrate anew, without --prior"
    )
    unlike = (
        "tool, mounting and base of the earlier calibration explain these poses with a probability of "
        f"{percent(by_chance)}: if one of them changed a little, calibrate anew, without --prior"
    )
    rows = [
        (by_chance < SIGNIFICANCE, WEAK, Kind.CONTRADICTS_PRIOR, contradict),
        (SIGNIFICANCE <= by_chance < UNLIKELY, DOUBTFUL, Kind.CONTRADICTS_PRIOR, unlike),
        *_beside_prior(fit, R, np.sqrt(variance), prior if by_chance >= UNLIKELY else None),
        *([poor_fit(fit)] if by_chance < SIGNIFICANCE else []),
    ]
    return those_that_hold(rows)


def _beside_prior(fit: RigidEstimate, R_base_flange: Array, std: Array, agrees: Calibration | None) -> list[Row]:
    """By themselves the poses would leave the contact force open somewhere, or a moving bias took what they tell; or
    they would leave it open far less than those of the calibration that `agrees` with them did, by the same noise.
    """
    earlier = [] if agrees is None or "prior" in agrees.provenance else [p.R_base_flange for p in agrees.fitted_poses]
    open_by = _force_left_open(fit, R_base_flange, std)
    rests = open_by > OPEN_SHARE * fit.weight_scale or fit.bias_moved
    text = (
        "that tool, mounting and base are those of the earlier calibration is taken for granted: "
        f"{counted(len(std), 'pose')}{' with a moving bias' * fit.bias_moved} cannot show others; record more, tilted "
        "by 30 deg or more"
    )
    better = (
        "tool, mounting and base stay as the earlier calibration has them, and by themselves these poses tell them "
        "better: calibrate without --prior"
    )
    left_open = _force_left_open(fit, np.array(earlier), np.sqrt(np.mean(std**2, axis=0))) if earlier else 0.0
    tell_more = not rests and open_by < FAR_BETTER * left_open
    return [(rests, DOUBTFUL, Kind.RESTS_ON_PRIOR, text), (tell_more, NOTE, Kind.ADVICE, better)]


def _force_left_open(fit: RigidEstimate, R_base_flange: Array, std: Array) -> float:
    """The largest std (N) of the contact force that poses (n, 3, 3) leave alone, of noise `std` (n, 6) or (6,)."""
    J = wrench_jacobian(fit.tool, R_base_flange, fit.names) / std[..., None]
    alone = inverse_of(np.sum(J.transpose(0, 2, 1) @ J, axis=0))
    return largest_force_std(replace(fit, covariance=alone, gain_covariance=None))


def of_known(known: Mapping[str, tuple[Any, Any]], readings: PoseReadings, question: Question) -> list[Finding]:
    """What of the `known`, as `calibrate` takes it, the readings contradict, if these are enough to tell without it."""
    if not known or 6 * len(readings) <= len(PARAMETERS[model_fitted(question.model)]):
        return []
    tilts = TiltPriors(question.priors.mount or MOUNT_TILT_SD, question.priors.base or BASE_TILT_SD)
    question = replace(question, knowledge=(), earlier=None, priors=tilts)
    free = estimated(readings, question)
    asked = [(name, replace(question, knowledge=stated_knowledge({name: pair}))) for name, pair in known.items()]
    held = [(name, each) for name, each in asked if name != "mount" or MOUNT[0] in free.names]
    return those_that_hold(_contradicted(name, each, readings, free) for name, each in held)


def _contradicted(name: str, asked: Question, readings: PoseReadings, free: RigidEstimate) -> Row:
    """By how far it is from the `free` fit, and by how much worse a fit with it alone is: with few poses the free one
    may be another of several solutions.
    """
    rows = rows_of(asked.knowledge, free.tool, free.names)
    left, tool, std = rows.residuals, free.tool, np.sqrt(np.maximum(np.diag(free.covariance), 0.0))
    spread = np.eye(len(left)) + rows.jacobian @ free.covariance @ rows.jacobian.T
    dof = float(free.dof.min())
    test = MisfitTest(float(left @ np.linalg.pinv(spread) @ left), len(left), dof)
    if test.probability < SIGNIFICANCE:
        with_it = estimated(readings, asked)
        pull = rows_of(asked.knowledge, with_it.tool, with_it.names).residuals
        worse = np.sum((with_it.errors[free.kept] ** 2 - free.errors[free.kept] ** 2) / free.noise**2) + pull @ pull
        test = max(test, MisfitTest(max(float(worse), 0.0), len(left), dof), key=lambda each: each.probability)
    (x, y, z), of_com = 1e3 * tool.com, 1e3 * std[1:4].max()
    found = {
        "weight": f"{tool.weight:.4g} +- {std[0]:.2g} N",
        "com": f"({x:.1f}, {y:.1f}, {z:.1f}) mm, +- {of_com:.2g} mm",
    }
    text = (
        f"the readings contradict the known {name} (probability {percent(test.probability)}): by themselves they give "
        f"{found.get(name, 'another direction')}: one of the two is wrong"
    )
    return test.probability < SIGNIFICANCE, WEAK, Kind.CONTRADICTS_KNOWN, text
