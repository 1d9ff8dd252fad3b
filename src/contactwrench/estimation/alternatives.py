"""What the other models make of the same poses: beside a result, so that nobody has to run five."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..calibration.alternative import Alternative, Alternatives
from ..errors import UnobservableError
from .affine import fit_affine
from .estimate import Estimate, RigidEstimate
from .noise import PoseReadings
from .priors import Question
from .rigid import estimated
from .sign_ambiguity import require_answerable, require_noise

OTHER_MODELS = ("yaw", "mount", "mount+base", "affine")


def alternatives_beside(estimate: RigidEstimate, readings: PoseReadings, question: Question) -> Alternatives:
    """Those to an estimate from `readings`, worked out when first looked at, by a bias that is steady."""
    steady = replace(readings, wrench=readings.wrench - estimate.change).select(estimate.kept)
    return Alternatives(partial(alternatives_to, steady, question))


def alternatives_to(readings: PoseReadings, question: Question) -> tuple[Alternative, ...]:
    """The other models fitted to the poses kept; those that the poses cannot tell are left out."""
    alternatives = []
    for model in [other for other in OTHER_MODELS if other != question.model]:
        as_asked = replace(question, model=model)
        try:
            if model == "affine":
                weight = std = None
                other: Estimate = fit_affine(readings, as_asked)
                require_noise(len(readings), 24, float(other.readings_left.min()), as_asked)
            else:
                other = rigid = estimated(readings, as_asked, plain=True)
                require_answerable(rigid, readings, model, as_asked)
                weight, std = rigid.tool.weight, float(np.sqrt(rigid.covariance[0, 0]))
        except UnobservableError:
            continue
        alternatives.append(
            Alternative(
                model=model,
                weight=weight,
                weight_std=std,
                force_left=other.force_left,
                torque_left=other.torque_left,
                B=other.B,
                gravity_direction=other.gravity_direction,
            )
        )
    return tuple(alternatives)
