"""`auto`: mounting and base free, with priors around nominal that the readings can overrule.

Parallel faces and a level base are what most robots have, to a degree or so; no fixed model is
right for all of them (method, sections 4 and 5). So the tilt of the sensor against the flange and that of the base
are estimated with Gaussian priors. Three questions are put to the readings, each answered by evidence, the probability
of the readings under an assumption, every parameter integrated out (Laplace's method; MacKay, 1992):

1. Do they contradict a prior (a sensor at 45 deg, a robot on a wall)? Then that prior is left, and the result says so.
2. Is a tilt there at all? The estimate is the mean over four assumptions: mounting exactly nominal or not, base exactly
   nominal or not, weighted by their probability. A heavy tool tells a tilt of nothing from one of a degree at once, and
   the mean then is as good as the fit that was told; a light one cannot tell, and need not.
3. How wrong can that be? The covariance is that of the tilts free within their priors, enlarged by the distance of
   the mean from their optimum: parallel faces may lend the estimate their support, but no certainty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.observability import is_separable
from ..geometry.arrays import Array
from ..model import PARAMETERS, RigidTool, matrix_jacobian, small_change_about, stepped, wrench_jacobian, wrench_matrix
from .initial_guess import Search, initial_guesses
from .least_squares import Fit, Solved
from .noise import GROUPS, EstimatedNoise, PoseReadings
from .priors import EXACT_TILT_SD, Knowledge, Question, TiltPriors, known_gravity, nominal_mounting, rows_of
from .rigid import RigidProblem, finished_rigid, solved_from

PROBABILITY = {(True, True): 0.4, (True, False): 0.15, (False, True): 0.15, (False, False): 0.3}
"""Before the readings, of (mounting, base) exactly nominal: in four of ten cells both, in three neither."""

LEAVES_PRIOR = 20.0
"""To one: the odds at which the readings overrule a prior."""

SUSPICIOUS = 3.0
"""A tilt of so many standard deviations of its prior has every way to leave the priors tried."""

CENTRINGS = 4
NAMES = PARAMETERS["mount+base"]


@dataclass(frozen=True)
class Assumption:
    """Which of the two priors hold; a free mounting or base may point anywhere."""

    nominal_mounting: bool
    nominal_base: bool


@dataclass(frozen=True, eq=False)
class Candidate:
    """The optimum under an assumption, the logarithm of its evidence (up to a constant common to all), and whether the
    poses are `separable`: they tell all that the assumption frees.
    """

    assumption: Assumption
    problem: RigidProblem
    tool: RigidTool
    solved: Solved
    log_evidence: float
    separable: bool

    @property
    def answerable(self) -> bool:
        """Whether the readings tell all parameters and, where that is to be estimated, their noise: else the fit goes
        on as it is, to be refused. A noise of nothing would leave the mean over assumptions to rounding.
        """
        linear = self.solved.linear
        told = linear.tells_noise or not isinstance(self.solved.noise, EstimatedNoise)
        return self.separable and told and linear.s[-1] > 0.0


@dataclass(frozen=True, eq=False)
class AutoFit:
    """The fit, which priors it kept, the odds (natural logarithm) by which those that were left were overruled, and the
    probabilities that mounting and base are exactly nominal (None where that prior was left).
    """

    fit: Fit
    assumption: Assumption
    log_odds: float
    mounting_exact: float | None
    base_exact: float | None


def fit_auto(readings: PoseReadings, question: Question) -> AutoFit:
    """The posterior mean of tool, mounting and base; see the head of this file.

    The stated gravity is nominal; what is known joins the readings under every assumption.
    """
    kept = Assumption(question.priors.mount is not None, question.priors.base is not None)
    nominal = _candidate(kept, readings, question)
    freer = [Assumption(*free) for free in ((False, False), (False, True), (True, False))]
    freer = [
        a
        for a in freer
        if a != kept and a.nominal_mounting <= kept.nominal_mounting and a.nominal_base <= kept.nominal_base
    ]
    rivals = [_candidate(assumption, readings, question) for assumption in freer[:1]]
    beaten = any(rival.separable and rival.log_evidence > nominal.log_evidence for rival in rivals)
    if beaten or _largest_tilt(nominal, question) > SUSPICIOUS:
        rivals += [_candidate(assumption, readings, question) for assumption in freer[1:]]
    rivals = [rival for rival in rivals if rival.separable]
    best = max(rivals, key=lambda rival: rival.log_evidence, default=nominal)
    log_odds = best.log_evidence - nominal.log_evidence
    if log_odds <= np.log(LEAVES_PRIOR):
        best, log_odds = nominal, 0.0
    return _mean_over_assumptions(best, question, log_odds)


def _candidate(assumption: Assumption, readings: PoseReadings, question: Question) -> Candidate:
    """The optimum under an assumption."""
    knowledge = (*question.knowledge, *(tilt for tilt, _ in tilt_priors(assumption, question)))
    problem = RigidProblem(readings.R_base_flange, readings.wrench, NAMES, knowledge)
    search = Search(any_mounting=not assumption.nominal_mounting, any_base=not assumption.nominal_base)
    guesses = initial_guesses(readings.R_base_flange, readings.wrench, search, question.gravity_direction)
    tool, solved = solved_from(problem, guesses, readings, question.noise)
    known = rows_of(problem.knowledge, tool, NAMES)
    seen = is_separable(tool, readings.R_base_flange, NAMES, None if known is None else known.jacobian)
    evidence = _log_evidence(assumption, tool, solved, question.priors)
    return Candidate(assumption, problem, tool, solved, evidence, seen)


def tilt_priors(assumption: Assumption, question: Question) -> list[tuple[Knowledge, float]]:
    """The priors that an assumption keeps, each with its standard deviation."""
    priors = question.priors
    tilts: list[tuple[Knowledge, float]] = []
    if assumption.nominal_mounting and priors.mount is not None:
        tilts.append((nominal_mounting(priors.mount), priors.mount))
    if assumption.nominal_base and priors.base is not None:
        tilts.append((known_gravity(question.gravity_direction, priors.base), priors.base))
    return tilts


def _log_evidence(assumption: Assumption, tool: RigidTool, solved: Solved, priors: TiltPriors) -> float:
    """Logarithm of the probability density of the readings, by Laplace's method, with the noise at its restricted
    maximum likelihood. A nominal tilt has its Gaussian density, a free mounting one side of two and the whole sphere, a
    free base half of it.
    """
    linear = solved.linear
    fitted = linear.Vt * linear.s[:, None] * linear.column_length
    information = fitted.T @ fitted
    density = -np.log(4.0 * np.pi) - np.log(2.0 * np.pi)
    if assumption.nominal_mounting and priors.mount is not None:
        density -= 2.0 * np.log(priors.mount)
    if assumption.nominal_base and priors.base is not None:
        density -= 2.0 * np.log(priors.base)
    if not assumption.nominal_mounting:
        information += _gram(nominal_mounting(1.0), tool)
    if not assumption.nominal_base:
        information += _gram(known_gravity(tool.gravity_direction, 1.0), tool)
    of_noise = 2.0 * float(np.sum(np.linalg.slogdet(linear.whitener)[1]))
    return float(0.5 * (of_noise - linear.chi2 - _log_determinant(information)) + density)


def _gram(knowledge: Knowledge, tool: RigidTool) -> Array:
    jacobian = knowledge(tool, NAMES).jacobian
    return jacobian.T @ jacobian


def _log_determinant(information: Array) -> float:
    """Of a symmetric positive matrix whose units differ widely."""
    unit = np.sqrt(np.diag(information))
    if not unit.all():
        return -np.inf
    return float(np.linalg.slogdet(information / np.outer(unit, unit))[1] + 2.0 * np.sum(np.log(unit)))


def _largest_tilt(candidate: Candidate, question: Question) -> float:
    """In standard deviations of its prior."""
    tilts = tilt_priors(candidate.assumption, question)
    off = [float(np.linalg.norm(tilt(candidate.tool, NAMES).residuals)) for tilt, _ in tilts]
    return max(off, default=0.0)


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Steps (k, p) from one tool to the optimum under each of k assumptions of exactness, and their probabilities."""

    steps: Array
    probability: Array


def _mean_over_assumptions(candidate: Candidate, question: Question, odds: float) -> AutoFit:
    """The mean over tilts that are exactly nominal or not, where their prior holds, and its covariance."""
    assumption = candidate.assumption
    exact = [
        pair
        for pair in PROBABILITY
        if (assumption.nominal_mounting or not pair[0]) and (assumption.nominal_base or not pair[1])
    ]
    tool = candidate.tool
    if not candidate.answerable:
        return AutoFit(finished_rigid(tool, NAMES, candidate.solved), assumption, odds, None, None)
    for _ in range(CENTRINGS):
        mixture = _mixture(exact, candidate, tool, question)
        centre, mean = tool, mixture.probability @ mixture.steps
        tool = stepped(centre, mean, NAMES)
    fit = finished_rigid(candidate.tool, NAMES, candidate.solved)
    axes = small_change_about(candidate.tool, tool, NAMES)
    off = small_change_about(centre, tool, NAMES) @ (mixture.steps[exact.index((False, False))] - mean)
    covariance = axes @ fit.covariance @ axes.T + np.outer(off, off)
    from_parameters = matrix_jacobian(tool, NAMES)
    fit = replace(
        fit,
        tool=tool,
        gravity_direction=tool.gravity_direction,
        B=wrench_matrix(tool),
        covariance=covariance,
        B_covariance=from_parameters @ covariance @ from_parameters.T,
        residuals=candidate.problem.residuals(tool),
    )
    of_mounting, of_base = (
        float(sum(p for pair, p in zip(exact, mixture.probability, strict=True) if pair[which])) for which in (0, 1)
    )
    return AutoFit(
        fit,
        assumption,
        odds,
        of_mounting if assumption.nominal_mounting else None,
        of_base if assumption.nominal_base else None,
    )


def _mixture(exact: list[tuple[bool, bool]], candidate: Candidate, tool: RigidTool, question: Question) -> _Mixture:
    """Everything linearised at `tool`, with the noise of the candidate; a misfit beyond that noise is judged as one of
    readings whose noise was estimated, by Student's t.
    """
    problem, solved = candidate.problem, candidate.solved
    J = (solved.linear.whitener @ wrench_jacobian(tool, problem.R_base_flange, NAMES)).reshape(-1, len(NAMES))
    errors = np.einsum("nij,nj->ni", solved.linear.whitener, problem.residuals(tool)).ravel()
    steps, log_probability = [], []
    for mounting_exact, base_exact in exact:
        stds = TiltPriors(
            EXACT_TILT_SD if mounting_exact else question.priors.mount,
            EXACT_TILT_SD if base_exact else question.priors.base,
        )
        tilts = tilt_priors(candidate.assumption, replace(question, priors=stds))
        known = rows_of((*question.knowledge, *(tilt for tilt, _ in tilts)), tool, NAMES)
        rows, left = (np.zeros((0, len(NAMES))), np.zeros(0)) if known is None else (known.jacobian, known.residuals)
        information = J.T @ J + rows.T @ rows
        unit = np.sqrt(np.diag(information))
        step = np.linalg.solve(information / np.outer(unit, unit), (J.T @ errors + rows.T @ left) / unit) / unit
        of_readings = _student_misfit((errors - J @ step).reshape(-1, 6), solved)
        of_prior = float(np.sum((left - rows @ step) ** 2)) + sum(4.0 * float(np.log(std)) for _, std in tilts)
        steps.append(step)
        log_probability.append(
            np.log(PROBABILITY[mounting_exact, base_exact])
            - 0.5 * (of_readings + of_prior + _log_determinant(information))
        )
    odds = np.exp(np.array(log_probability) - max(log_probability))
    return _Mixture(np.array(steps), odds / odds.sum())


def _student_misfit(whitened: Array, solved: Solved) -> float:
    """-2 log likelihood of whitened residuals (n, 6) up to a constant, the scale of the noise integrated out: of forces
    and of torques apart where each was estimated, of all together where their ratio was given.
    """
    squares = np.sum(whitened**2, axis=0)
    if isinstance(solved.noise, EstimatedNoise):
        groups = [(float(squares[group].sum()), float(solved.noise.dof[group].sum())) for group in GROUPS]
    else:
        groups = [(float(squares.sum()), solved.noise.dof)]
    return sum(dof * float(np.log(max(chi2, 1e-300) / dof)) if dof > 0.0 else chi2 for chi2, dof in groups)
