"""What mounting and base may be, each with a probability before the readings: exactly nominal, nearly, anything.

Parallel faces and a level base are what most robots have, to a degree or so; no fixed model is right for all of them
(method, sections 4 and 5). A tilt is exactly nominal, or near it by a mixture of Gaussians of two widths, or the
mounting and the base may point anywhere. Nothing is chosen: the answer is the mean over all, by evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..model import RigidTool, all_but_the_bias
from .least_squares import Priors
from .noise import ALIKE, AXES
from .priors import EXACT_TILT_SD, PriorRows, Question, rows_of

PROBABILITY = {(True, True): 0.4, (True, False): 0.15, (False, True): 0.15, (False, False): 0.3}
"""Of (mounting, base) exactly nominal: in four of ten cells both, in three neither."""

WIDTHS = {1.0: 0.8, 4.0: 0.2}
"""Of a tilt near nominal, in units of its stated standard deviation, with their probabilities."""

ANY_MOUNTING, ANY_BASE = 0.03, 0.02
"""That a mounting, or a base, points anywhere."""

COM_SD = 0.15
"""m: a tool's size, which keeps what poor poses cannot tell within it; what is surely further off goes free."""


@dataclass(frozen=True)
class Hypothesis:
    """`mount` and `base`: standard deviation (rad, an axis) of the tilt about nominal, None where it is free; `exact`
    whether each is exactly nominal; `log_prior` its probability, with the density of the tilts; how far `apart` the
    noises of axes are (noise.py).
    """

    mount: float | None
    base: float | None
    exact: tuple[bool, bool]
    log_prior: float
    apart: float = ALIKE


def hypotheses_of(question: Question, any_mounting: bool, any_base: bool) -> tuple[Hypothesis, ...]:
    """Those to which a fit belongs whose mounting, or base, was looked for anywhere, the widest last."""
    tilts = [Hypothesis(None, None, (False, False), 0.0)]
    if question.nominal:
        area, sides = np.log(4.0 * np.pi), np.log(2.0 * np.pi)
        of_mount = _options(question.priors.mount, any_mounting, ANY_MOUNTING, area, area)
        of_base = _options(question.priors.base, any_base, ANY_BASE, sides, sides)
        tilts = [
            Hypothesis(mount, base, (exact, level), float(np.log(PROBABILITY[exact, level]) + log_m + log_b))
            for (mount, log_m, exact), (base, log_b, level) in product(of_mount, of_base)
        ]
    return tuple(
        replace(tilt, apart=apart, log_prior=tilt.log_prior + float(np.log(share)))
        for tilt in tilts
        for apart, share in (AXES if question.noise is None else {ALIKE: 1.0}).items()
    )


def _options(
    sd: float | None, free: bool, any_probability: float, log_area: float, log_sides: float
) -> list[tuple[float | None, float, bool]]:
    """Standard deviation, log density, and whether exact, of each option of one tilt."""
    if sd is None:
        return [(None, 0.0, False)]
    if free:
        return [(None, float(np.log(any_probability) - log_area), False)]
    options = [(EXACT_TILT_SD, 1.0, True), *((sd * width, share, False) for width, share in WIDTHS.items())]
    return [(s, float(np.log(share) - log_sides - 2.0 * np.log(s)), exact) for s, share, exact in options]


def known_at(tool: RigidTool, names: tuple[str, ...], question: Question) -> PriorRows:
    """What is known of the parameters but the bias, and what is nominal, linearised at `tool`."""
    known = rows_of((*question.knowledge, *question.nominal), tool, names)
    return PriorRows(known.residuals, known.jacobian[:, all_but_the_bias(names)])


def priors_at(
    tool: RigidTool, names: tuple[str, ...], hypotheses: tuple[Hypothesis, ...], question: Question
) -> Priors:
    """What is known beforehand under each hypothesis, linearised at `tool`."""
    known, h = known_at(tool, names, question), len(hypotheses)
    J = known.jacobian
    precision, of_volume = np.ones((h, len(J))), np.zeros((h, J.shape[1], J.shape[1]))
    if question.nominal:
        tilts = np.array([[0.0 if sd is None else sd**-2.0 for sd in (each.mount, each.base)] for each in hypotheses])
        precision[:, -7:-4] = 1.0 / (COM_SD**2 + float(tool.com @ tool.com))
        precision[:, -4:] = np.repeat(tilts, 2, axis=1)
        of_volume += np.multiply.outer(tilts[:, 0] == 0.0, J[-4:-2].T @ J[-4:-2])
        of_volume[:, [-2, -1], [-2, -1]] += tilts[:, 1:] == 0.0
    return Priors(
        known,
        precision,
        of_volume,
        np.array([hypothesis.log_prior for hypothesis in hypotheses]),
        np.array([hypothesis.apart for hypothesis in hypotheses]),
    )
