"""What mounting and base may be: each exactly nominal, nearly so, or anything, with a probability before the readings
(method, "One inference"). Nothing is chosen: the answer is the mean over all, by evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .noise import ALIKE, AXES
from .priors import EXACT_TILT_SD, Question

PROBABILITY = {(True, True): 0.33, (True, False): 0.12, (False, True): 0.12, (False, False): 0.43}
"""Of (mounting, base) exactly nominal, to a hundredth of a degree: in one of three cells both."""

WIDTHS = {0.25: 0.33, 1.0: 0.54, 4.0: 0.13}
"""Of a tilt near nominal, in units of its stated standard deviation, with their probabilities: a third are as parallel
as parts are made. Without these what the noise hides was taken for exactly nominal (Lindley, 1957).
"""

ANY_MOUNTING, ANY_BASE = 0.03, 0.02
"""That a mounting, or a base, points anywhere."""


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
        of_mount = _options(question.priors.mount, any_mounting, ANY_MOUNTING, np.log(4.0 * np.pi))
        of_base = _options(question.priors.base, any_base, ANY_BASE, np.log(2.0 * np.pi))
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
    sd: float | None, free: bool, any_probability: float, log_area: float
) -> list[tuple[float | None, float, bool]]:
    """Standard deviation, log density, and whether exact, of each option of one tilt; `log_area` of all directions."""
    if sd is None:
        return [(None, 0.0, False)]
    if free:
        return [(None, float(np.log(any_probability) - log_area), False)]
    options = [(EXACT_TILT_SD, 1.0, True), *((sd * width, share, False) for width, share in WIDTHS.items())]
    return [(s, float(np.log(share) - log_area - 2.0 * np.log(s)), exact) for s, share, exact in options]
