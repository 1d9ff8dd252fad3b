"""Which interpretation of a file a rigid tool explains: all in closed form (screening.py), then the best by the fit
that `calibrate` makes. docs/diagnosing.md says how it is decided.

They are compared by their marginal likelihood, which counts the few degrees of freedom that few poses leave, and by
their prior: each change from what was stated has a probability of 1 in 20.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from ..errors import InputError, UnobservableError, refuse
from ..estimation.estimate import RigidEstimate
from ..estimation.noise import PoseReadings
from ..estimation.plausibility import Unseen, likelier, oddity, require_alive, to_the_tool, unseen
from ..estimation.priors import Question
from ..estimation.rigid import RIGID_MODELS, estimated
from ..geometry.arrays import Array, Frozen, read_only
from ..model import GRAVITY, RigidTool, gravity_in_flange, wrench_matrix
from ..statistics import counted
from .interpretations import COST_OF_CHANGE, Interpretation, Interpretations, as_read
from .screening import LEAST_TILT, NOTHING_LEFT, PARAMETERS, Screened, misfit, scatter_of, screen, screened

FEWEST_POSES = 5
MOST_RANKED = 6
"""Interpretations besides the stated one that are fitted by the model that is asked for, the best by `mount`."""

DECISIVE = 20.0
"""-2 log of the odds that a stated interpretation must be worse by, its prior counted: 1 to 22,000."""

LESS_THAN_HALF, LEFT_BY_NO_TOOL = 0.5, 0.5
"""Of what the other leaves; and of the weight: a wrong interpretation leaves as much, also where shifted rows happen to
drop a pose in contact.
"""

POSE_IN_CONTACT, LEANING_BASE, NO_TOOL = 1.0, 1.1, 10.0
"""Costs, in changes: of a pose in contact; of a base that leans, once more for each right angle, so that a robot on a
wall, whose user would have said so, counts for a little more than two wrong options; of an interpretation that is
explained by no weight at all.
"""

SURE_WEIGHT = 3.0
ANYWHERE = 0.5
"""Probability of a base that points anywhere, from which on `auto` takes it to lean."""

TIE_REACH = 1.5
"""In changes: members of a class that are less likely than its best by more are not worth a line."""

WELL_EXPLAINED = 0.1
"""Of the weight: what may be left of the force where a rigid tool is said to explain a recording."""

RIGHT_ANGLE = 0.5 * np.pi
MOST_LEAN = RIGHT_ANGLE + np.deg2rad(5.0)
"""rad: a base that leans by more hangs, and free air cannot tell that from a reversed sign. A robot on a wall stands at
the right angle itself, and noise and how it is mounted put it on either side: with no room, 3 of 6 such recordings were
read with two wrong options.
"""

LEAST_DOF = 1e-6

FAR_LESS = 0.2
"""Of the force that is left, what is without one pose, for that pose to be named."""


@dataclass(frozen=True, eq=False)
class Explanation(Frozen):
    """What a rigid tool makes of an interpretation.

    `force_left` N and `torque_left` N m: root mean square of the norm of what is left in a pose, the fitted parameters
    counted; `weight` N; `com` (3,) m, `to_the_tool` of which lies on the side of tools (NaN: nobody knows); `lean` rad,
    of gravity from the stated direction, zero unless the base is found to lean; `cost` of its changes, the lean among
    them; `odds` -2 log of the odds against it, up to a constant, the cost counted. Of the stated interpretation also
    `odds_in_contact`, the same where the pose that fits it worst is in contact, and that pose, `pose_off`, from 1,
    with the `force_without` it, N, where that is far less.
    """

    interpretation: Interpretation
    force_left: float
    torque_left: float
    weight: float
    com: Array
    to_the_tool: float
    lean: float
    cost: float
    odds: float
    odds_in_contact: float = np.inf
    pose_off: int | None = None
    force_without: float = np.nan

    @property
    def odd(self) -> str:
        """In a word why no tool is so, nothing where one may be."""
        return oddity(self.weight, self.com, self.to_the_tool)

    @property
    def explained(self) -> bool:
        """Whether a tool is there and leaves little of its weight."""
        return self.force_left < WELL_EXPLAINED * self.weight

    @property
    def explains_nothing(self) -> bool:
        """Whether no tool is there, or so much of its weight is left that any other file would do as well."""
        return not self.force_left <= LEFT_BY_NO_TOOL * self.weight


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """`given`: the stated interpretation, None where it cannot be read. `best`: the one to use, which is the stated one
    unless another is decisively better. `ranked`: the best of each class, best first. `alike`: those that
    free air cannot tell from `best`, the likelier first, of which `likely` are worth a thought, and the `observations`
    that would decide between those; `unseen`: units and signs that only the tool tells, the most plausible first. `n`
    poses, `tried` interpretations, fitted by `model`.
    """

    source: str
    model: str
    n: int
    tried: int
    given: Explanation | None
    best: Explanation
    ranked: tuple[Explanation, ...]
    alike: tuple[Interpretation, ...]
    likely: int
    observations: tuple[str, ...]
    unseen: tuple[Unseen, ...]
    complaint: str | None

    @property
    def read_rightly(self) -> bool:
        """Whether no other interpretation explains the file decisively better than the stated one."""
        return self.best is self.given


def diagnose(file: Interpretations, model: str = "auto") -> Diagnosis:
    """Rank all ways to read a file by what a rigid tool leaves of them.

    Args:
        file: all ways to read it, of `interpretations`.
        model: that `calibrate` will be asked for: auto, yaw, mount or mount+base.

    Returns:
        The best interpretation, the others in their order, and those that these poses cannot tell from it.

    Raises:
        InputError: another model, or no interpretation that makes rotations.
        UnobservableError: fewer than 5 poses.
    """
    n = len(file.wrench)
    require_alive(file.wrench, file.source)
    one_of = f"expected one of {', '.join(RIGID_MODELS)}"
    refuse((model not in RIGID_MODELS, f"model {model!r} tells no interpretation from another, {one_of}: take auto"))
    if n < FEWEST_POSES:
        raise UnobservableError(
            f"{file.source}: found {counted(n, 'distinct orientation')}, expected {FEWEST_POSES} or more to tell one "
            "interpretation from another: record six or more that tilt the tool about two axes"
        )
    if not file.orientations:
        raise InputError(
            f"{file.complaint}; no other convention makes rotations of these columns either: check that they "
            "hold an orientation"
        )
    screening = screened(file)
    explained = cache(partial(_explained, file))  # the stated one is among the promising ones, and those are by `mount`
    given = None if file.stated is None else _excused(file, explained(file.stated, model))
    fits = [] if given is None else [given]
    promising = [explained(file.interpretation(*place), "mount") for place in screening.classes()]
    promising.sort(key=lambda fit: fit.odds)
    fits += [explained(fit.interpretation, model) for fit in promising[:MOST_RANKED]]
    fits.sort(key=lambda fit: fit.odds)
    as_good = [fit for fit in fits if not any(_decisively_better(other, fit) for other in fits)]
    chosen = given if given in as_good else min(as_good, key=lambda fit: fit.cost)
    best = _in_likeliest_unit(file, chosen)
    ranked: dict[Interpretation, Explanation] = {}
    for fit in (best, *fits):
        ranked.setdefault(fit.interpretation, fit)
    alike = _alike(file, screening, best, fits)
    likely = [] if best.explains_nothing else [each for each in alike if each.cost <= best.cost + TIE_REACH]
    own_unit, along = best.interpretation.torque_factor, best.to_the_tool
    leans = any(fit.lean > 0.0 for fit in (best, *fits) if fit is best or fit.interpretation in likely)
    return Diagnosis(
        source=file.source,
        model=model,
        n=n,
        tried=screening.odds.size,
        given=given,
        best=best,
        ranked=tuple(ranked.values()),
        alike=tuple(alike),
        likely=len(likely),
        observations=file.observations(best.interpretation, likely, leans),
        unseen=() if best.explains_nothing else unseen(file.wrench_units, own_unit, best.weight, best.com, along),
        complaint=file.complaint,
    )


def _explained(file: Interpretations, interpretation: Interpretation, model: str) -> Explanation:
    """What the fit of a rigid tool makes of an interpretation. Of the degrees of freedom each parameter takes its share
    where the readings settle it: torques that settle the mounting explain nothing by being explained.
    """
    R, wrench = as_read(file, interpretation)
    down = -file.down if interpretation.reversed_gravity else file.down
    tool, left, taken, sure, lean = _fitted(R, wrench, model, down)
    cost = interpretation.cost + (LEANING_BASE * (1.0 + lean / RIGHT_ANGLE) if lean > 0.0 else 0.0)
    squares = _of_kinds(left)
    dof = np.maximum(3.0 * len(R) - taken, LEAST_DOF)
    of_base = len(GRAVITY) if lean > 0.0 else 0
    force_left, torque_left = np.sqrt(3.0 * squares / (3.0 * len(R) - PARAMETERS - of_base))
    squares = np.maximum(squares, NOTHING_LEFT**2 * _of_kinds(wrench))
    scatter = scatter_of(file.wrench, file.wrenches[interpretation.wrench].matrix)[0]
    odds = float(misfit(squares, dof, scatter)) + COST_OF_CHANGE * (cost + NO_TOOL * (not sure))
    com, along = read_only(tool.com), to_the_tool(wrench_matrix(tool), tool.com)
    return Explanation(interpretation, float(force_left), float(torque_left), tool.weight, com, along, lean, cost, odds)


def _fitted(
    R_base_flange: Array, wrench: Array, model: str, down: Array
) -> tuple[RigidTool, Array, Array, bool, float]:
    """The rigid tool, what it leaves (n, 6), the degrees of freedom (2,) that its parameters take of forces and of
    torques, whether its weight is sure, and by how much (rad) the base leans; a tool of no weight where none fits.
    """
    if float(np.mean(np.var(gravity_in_flange(R_base_flange, down), axis=0))) > LEAST_TILT:
        readings = PoseReadings(R_base_flange, wrench, np.zeros_like(wrench), np.arange(float(len(wrench))), 1.0)
        fit = estimated(readings, Question(model, down), plain=True)
        lean = _lean(fit, model, down)
        if lean > MOST_LEAN:
            fit, lean = estimated(readings, Question("mount", down), plain=True), 0.0
        if fit.tool.weight > 0.0:
            sure = fit.tool.weight > SURE_WEIGHT * float(np.sqrt(fit.covariance[0, 0]))
            return fit.tool, fit.residuals, 3.0 * len(wrench) - fit.readings_left, sure, lean
    bias = wrench.mean(axis=0)
    none = RigidTool(0.0, np.zeros(3), bias, np.eye(3), down)
    return none, wrench - bias, np.full(2, 3.0), False, 0.0


def _lean(fit: RigidEstimate, model: str, down: Array) -> float:
    """The angle (rad) of gravity from the stated direction; 0 where the model holds it, or keeps it close."""
    by_belief = fit.beliefs is not None and fit.beliefs.any_base > ANYWHERE
    if not (by_belief if model == "auto" else model == "mount+base"):
        return 0.0
    return float(np.arccos(np.clip(fit.tool.gravity_direction @ down, -1.0, 1.0)))


def _of_kinds(values: Array) -> Array:
    """Sums of squares (2,) of values (n, 6) of forces and of torques."""
    return np.asarray(np.sum(values.reshape(-1, 2, 3) ** 2, axis=(0, 2)))


def _excused(file: Interpretations, given: Explanation) -> Explanation:
    """The stated interpretation with its excuse: a right file may have a pose in contact."""
    interpretation = given.interpretation
    o, w = file.orientations[interpretation.orientation], file.wrenches[interpretation.wrench]
    n = len(o.R_base_flange)
    others = [replace(o, R_base_flange=o.R_base_flange[kept], rows=kept) for kept in ~np.eye(n, dtype=np.bool_)]
    squares, dof = screen(others, [w], file.wrench, file.down)
    without = misfit(squares, dof, scatter_of(file.wrench, w.matrix))[:, 0, interpretation.place[2]]
    in_contact = float(without.min()) + COST_OF_CHANGE * (interpretation.cost + POSE_IN_CONTACT)
    worst = int(without.argmin())
    left = float(np.sqrt(3.0 * squares[worst, 0, interpretation.place[2], 0] / dof[worst, 0, 0, 0]))
    if left > FAR_LESS * given.force_left:
        return replace(given, odds_in_contact=in_contact)
    return replace(given, odds_in_contact=in_contact, pose_off=worst + 1, force_without=left)


def _decisively_better(one: Explanation, other: Explanation) -> bool:
    """Whether `other` is to be given up for `one`, which must explain the file for that, and not just less badly."""
    if one is other or min(other.odds, other.odds_in_contact) - one.odds < DECISIVE or one.explains_nothing:
        return False
    less_force = one.force_left < LESS_THAN_HALF * other.force_left
    return less_force or one.torque_left < LESS_THAN_HALF * other.torque_left


def _in_likeliest_unit(file: Interpretations, best: Explanation) -> Explanation:
    """The same tool with the torque in another unit, where its centre of mass is then the likelier one."""
    own, factor = best.interpretation, file.torque_unit.factor
    if best.explains_nothing or not likelier(factor, file.wrench_units, best.weight, best.com):
        return best
    return replace(
        best,
        interpretation=file.interpretation(*own.place, by_gravity=own.reversed_gravity, other_unit=True),
        torque_left=factor * best.torque_left,
        com=read_only(factor * best.com),
        to_the_tool=factor * best.to_the_tool,
    )


def _alike(
    file: Interpretations, screening: Screened, best: Explanation, fits: list[Explanation]
) -> list[Interpretation]:
    """Those that free air cannot tell from the best, the likelier first: of its class, or behind it by chance."""
    own = best.interpretation
    alike = [fit.interpretation for fit in fits if not _decisively_better(best, fit)]
    other_unit = own.torque_factor != 1.0
    for place in [] if best.lean > 0.0 else np.argwhere(screening.class_of(own.place)).tolist():
        alike += [file.interpretation(*place, by_gravity=turned, other_unit=other_unit) for turned in (False, True)]
    others = {(interpretation.options, interpretation.mends): interpretation for interpretation in alike}
    others.pop((own.options, own.mends), None)
    return sorted(others.values(), key=lambda interpretation: interpretation.cost)
