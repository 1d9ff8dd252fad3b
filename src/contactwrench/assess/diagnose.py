"""Which reading of a file a rigid tool explains.

The most common failure of a calibration is not noise but a wrong reading of the file. So every reading that a person
could have meant is tried, one of the orientation's columns times one of the wrench's, and ranked by what a rigid tool
leaves of it: first all of them in closed form (screening.py), then the best by the fit that `calibrate` makes.

The model is `mount`: the mounting is free, the base is upright or as stated. With the base free too, a convention with
its axes renamed fits as well as the right one, on a robot whose base lies on its side; so a base that leans is tried
for the best few readings only, has to leave decisively less, and counts as a change. The affine model never enters: it
would explain what no tool can.

Thousands of readings are tried, so one of them may win by chance. Each change from what was stated costs (a prior
probability of 1 in 20), and a reading is given up for one with more changes only where the odds against it are
overwhelming and the other leaves less than half. So a file that is read rightly is left alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.observability import LEVER
from ..errors import InputError, UnobservableError
from ..estimation.initial_guess import SEARCH_OF_MODEL, explained_by_start
from ..estimation.least_squares import PoseReadings
from ..estimation.rigid import fit_rigid
from ..estimation.sign_ambiguity import negated
from ..geometry.arrays import Array, read_only
from ..model import GRAVITY, RigidTool, gravity_in_flange
from .interpretations import Reading, Readings, TorqueUnit, as_read
from .screening import FORCE_PARAMETERS, LEAST_TILT, NOTHING_LEFT, TORQUE_PARAMETERS, Orientations, misfit, screen

DOWN = (0.0, 0.0, -1.0)
FEWEST_POSES = 5

COST_OF_CHANGE = 2.0 * float(np.log(20.0))
"""-2 log of the prior probability of one change from what was stated."""

DECISIVE = 20.0
"""-2 log of the odds that a stated reading must be worse by, its prior counted: 1 to 22,000."""

LESS_THAN_HALF = 0.5
LEFT_BY_NO_TOOL = 0.5
"""Of the weight: a wrong reading leaves as much, also where shifted rows happen to drop a pose in contact."""

REVERSED_SIGN = 1.0
REVERSED_GRAVITY = 1.2
LEANING_BASE = 1.1
NO_TOOL = 10.0
"""Costs, in changes: of a base that leans, once more for each right angle, so that a robot on a wall, whose user would
have said so, counts for a little more than two wrong flags; of a reading that is explained by no weight at all.
"""

LEANING_FLAG = "--model mount+base"

SURE_WEIGHT = 3.0
WORTH_LEANING = 0.7
"""Of the readings' scatter, that the nearest of a few dozen directions of gravity explains."""

MOST_FITTED, LEAST_FITTED = 12, 2
NOT_FITTED = 60.0
"""-2 log of the odds by which screening may be worse than at its best, and its reading still be fitted."""

SAME_FIT = 1e-6
"""Relative: readings of which screening leaves sums of squares this close are one class, see method, section 4b."""

TIE_REACH = 1.5
"""In changes: members of a class that are less likely than its best by more are not worth a line."""

PUSH = (
    "push the tool by hand along +x, +y and +z of the sensor: if fx, fy and fz rise, each in its turn, sign and axes "
    "are as the file names them; if all fall, --sign reaction; if one falls, it is reversed; if another one moves, the "
    "two are exchanged"
)
SEE_COM = "see where the tool's centre of mass really lies: on which side of the sensor, and how far away"
SEE_POSE = "bring the arm to a pose whose axes you can see, tilted about two of them, and try the conventions on it"
SEE_BASE = "see how the robot's base stands: upright, leaning, on a wall or on the ceiling"
"""Observations that tell apart what free air cannot."""

TYPICAL_COM = 0.05
"""m from the sensor: what tells N mm from N m."""

WELL_EXPLAINED = 0.1
"""Of the weight: what may be left of the force where a rigid tool is said to explain a recording."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """What a rigid tool makes of a reading.

    `force_left` N and `torque_left` N m: root mean square of the norm of what is left in a pose, the fitted parameters
    counted; `weight` N; `com` (3,) m; `lean` rad, of gravity from the stated direction, zero unless the base is free;
    `odds` -2 log of the odds against it, up to a constant, the costs of its changes counted.
    """

    reading: Reading
    force_left: float
    torque_left: float
    weight: float
    com: Array
    lean: float
    odds: float

    @property
    def explained(self) -> bool:
        """Whether a tool is there and leaves little of its weight."""
        return self.force_left < WELL_EXPLAINED * self.weight


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """`given`: the stated reading, None where it cannot be read. `best`: the one to use, which is the stated one unless
    another is decisively better. `ranked`: the best of each class of readings, best first. `alike`: readings that free
    air cannot tell from `best`, the likelier first, of which `likely` are worth a thought, and the `observations` that
    would decide between those. `n` poses, `tried` readings.
    """

    source: str
    n: int
    tried: int
    given: Explanation | None
    best: Explanation
    ranked: tuple[Explanation, ...]
    alike: tuple[Reading, ...]
    likely: int
    observations: tuple[str, ...]
    complaint: str | None

    @property
    def read_rightly(self) -> bool:
        """Whether no other reading explains the file decisively better than the stated one."""
        return self.best is self.given


def diagnose(readings: Readings) -> Diagnosis:
    """Rank all ways to read a file by what a rigid tool leaves of them.

    Raises `UnobservableError` for fewer than 5 poses, and `InputError` where no reading makes rotations.
    """
    return _Diagnosing(readings).diagnosis()


class _Diagnosing:
    """The screened readings of one file, and the steps from them to a diagnosis."""

    def __init__(self, readings: Readings) -> None:
        self.readings, self.n = readings, len(readings.wrench)
        if self.n < FEWEST_POSES:
            raise UnobservableError(
                f"{readings.source}: found {self.n} distinct orientations, expected {FEWEST_POSES} or more to tell one "
                "reading from another: record six or more that tilt the tool about two axes"
            )
        if not readings.orientations:
            raise InputError(
                f"{readings.complaint}; no other convention makes rotations of these columns either: check that they "
                "hold an orientation"
            )
        self.down = np.array(DOWN) if readings.gravity is None else np.asarray(readings.gravity)
        left = screen(
            [Orientations(o.R_base_flange, o.rows) for o in readings.orientations],
            readings.wrench,
            np.array([w.matrix for w in readings.wrenches]),
            np.array([w.in_base for w in readings.wrenches]),
            self.down,
        )
        self.log_force, self.log_torque = np.log(left.force), np.log(left.torque)
        stated_sign = np.array([readings.sign == "reaction", readings.sign == "pull"], dtype=np.float64)
        costs = (
            np.array([o.cost for o in readings.orientations])[:, None, None]
            + np.array([w.cost for w in readings.wrenches])[:, None]
            + REVERSED_SIGN * stated_sign
        )
        self.odds = misfit(left.force, left.torque, self.n) + COST_OF_CHANGE * costs

    def diagnosis(self) -> Diagnosis:
        """Fit what screening finds, weigh the best against what was stated."""
        readings = self.readings
        given = self._given()
        fits = [] if given is None else [given]
        fits += [self._explanation(self._reading(*place)) for place in self._classes()]
        for upright in {id(fit): fit for fit in (min(fits, key=lambda fit: fit.odds), given) if fit}.values():
            leaning = self._leaning(upright.reading)
            if leaning is not None and _decisively_better(leaning, upright):
                fits.append(leaning)
        fits.sort(key=lambda fit: fit.odds)
        as_good = (fit for fit in fits if not _decisively_better(fits[0], fit))
        best = min(as_good, key=lambda fit: fit.reading.cost)
        best = self._in_better_unit(best) or best
        alike = self._alike(best, fits)
        likely = [reading for reading in alike if reading.cost <= best.reading.cost + TIE_REACH]
        return Diagnosis(
            readings.source,
            self.n,
            self.odds.size,
            given,
            best,
            _one_of_each(best, fits),
            tuple(alike),
            len(likely),
            self._observations(best.reading, likely),
            readings.complaint,
        )

    def _given(self) -> Explanation | None:
        if self.readings.given is None:
            return None
        return self._explanation(self._reading(self.readings.given, 0, int(self.readings.sign == "reaction")))

    def _classes(self) -> list[tuple[int, int, int]]:
        """Places of the most promising readings, one of each class, best first."""
        found: list[tuple[int, int, int]] = []
        still = np.ones(self.odds.shape, dtype=np.bool_)
        while len(found) < MOST_FITTED and still.any():
            flat = int(np.argmin(np.where(still, self.odds, np.inf)))
            orientation, wrench, negative = (int(k) for k in np.unravel_index(flat, self.odds.shape))
            if len(found) >= LEAST_FITTED and self.odds.flat[flat] > self.odds.min() + NOT_FITTED:
                break
            found.append((orientation, wrench, negative))
            still &= ~self._fits_like(found[-1])
        return found

    def _fits_like(self, place: tuple[int, int, int]) -> NDArray[np.bool_]:
        """Which readings screening cannot tell from the one at `place`."""
        same_force = np.abs(self.log_force - self.log_force[place]) < SAME_FIT
        same: NDArray[np.bool_] = same_force & (np.abs(self.log_torque - self.log_torque[place]) < SAME_FIT)
        return same

    def _reading(
        self, orientation: int, wrench: int, negative: int, *, by_gravity: bool = False, unit: TorqueUnit | None = None
    ) -> Reading:
        """The reading at a place of the screening; `by_gravity`: gravity reversed and not the sign it would take."""
        readings = self.readings
        o, w = readings.orientations[orientation], readings.wrenches[wrench]
        reaction = bool(negative) != by_gravity
        flags = (*o.flags, *w.flags, *(["--sign reaction"] if reaction else []))
        if by_gravity:
            flags = (*flags, f"--gravity {negated(self.down)}")
        elif readings.gravity is not None:
            flags = (*flags, f"--gravity {negated(-self.down)}")
        cost = o.cost + w.cost + REVERSED_SIGN * (reaction != (readings.sign == "reaction"))
        cost += REVERSED_GRAVITY * by_gravity + (unit.cost if unit else 0.0)
        mends = (*o.mends, *w.mends, *([unit.mend] if unit else []))
        factor = unit.factor if unit else 1.0
        return Reading(flags, mends, cost, orientation, wrench, reaction, by_gravity, factor)

    def _explanation(self, reading: Reading, model: str = "mount") -> Explanation:
        """What the fit of a rigid tool makes of a reading."""
        R, wrench = as_read(self.readings, reading)
        down = -self.down if reading.reversed_gravity else self.down
        tool, left, sure = _fitted(R, wrench, model, down)
        lean, of_base = 0.0, 0
        if model == "mount+base":
            lean, of_base = float(np.arccos(np.clip(tool.gravity_direction @ down, -1.0, 1.0))), len(GRAVITY)
            cost = reading.cost + LEANING_BASE * (1.0 + lean / (0.5 * np.pi))
            reading = replace(reading, flags=(*reading.flags, LEANING_FLAG), cost=cost)
        squares = np.array([np.sum(part**2) for part in (left[:, :3], left[:, 3:])])
        least = NOTHING_LEFT**2 * np.array([np.sum(part**2) for part in (wrench[:, :3], wrench[:, 3:])])
        dof = 3 * len(R) - np.array([FORCE_PARAMETERS + of_base, TORQUE_PARAMETERS])
        force, torque = np.maximum(squares, least) / dof
        force_left, torque_left = np.sqrt(3.0 * squares / dof)
        return Explanation(
            reading,
            float(force_left),
            float(torque_left),
            tool.weight,
            read_only(tool.com),
            lean,
            float(misfit(force, torque, self.n)) + COST_OF_CHANGE * (reading.cost + NO_TOOL * (not sure)),
        )

    def _leaning(self, reading: Reading) -> Explanation | None:
        """The fit with the direction of gravity free; None where no direction on the stated side comes near."""
        R, wrench = as_read(self.readings, reading)
        down = -self.down if reading.reversed_gravity else self.down
        scatter = (wrench - wrench.mean(axis=0)) / np.repeat([1.0, LEVER], 3)
        if explained_by_start(R, wrench, SEARCH_OF_MODEL["mount+base"], down) < WORTH_LEANING * float(
            np.sum(scatter**2)
        ):
            return None
        return self._explanation(reading, "mount+base")

    def _in_better_unit(self, best: Explanation) -> Explanation | None:
        """The same tool with the torque in another unit, where its centre of mass is then the likelier one."""
        own = best.reading
        place = (own.orientation, own.wrench, int(own.negated != own.reversed_gravity))
        for unit in self.readings.torque_units:
            if _oddity_of(unit.factor * best.com) < _oddity_of(best.com):
                reading = self._reading(*place, by_gravity=own.reversed_gravity, unit=unit)
                return replace(
                    best,
                    reading=reading,
                    torque_left=unit.factor * best.torque_left,
                    com=read_only(unit.factor * best.com),
                )
        return None

    def _alike(self, best: Explanation, fits: list[Explanation]) -> list[Reading]:
        """The readings that free air cannot tell from the best, the likelier first: those of its class, of which
        nothing else is left, and those that chance may have put behind it.
        """
        own = best.reading
        found = [fit.reading for fit in fits if not _decisively_better(best, fit)]
        unit = next((u for u in self.readings.torque_units if u.factor == own.torque_factor), None)
        same = self._fits_like((own.orientation, own.wrench, int(own.negated != own.reversed_gravity)))
        for place in [] if LEANING_FLAG in own.flags else np.argwhere(same).tolist():
            found += [self._reading(*place, by_gravity=by_gravity, unit=unit) for by_gravity in (False, True)]
        others = {(reading.flags, reading.mends): reading for reading in found}
        others.pop((own.flags, own.mends), None)
        return sorted(others.values(), key=lambda reading: reading.cost)

    def _observations(self, best: Reading, others: list[Reading]) -> tuple[str, ...]:
        """What would tell the best from the others."""

        def forces(reading: Reading) -> Array:
            return self.readings.wrenches[reading.wrench].matrix[:3] * (-1.0 if reading.negated else 1.0)

        found = []
        if any(not np.array_equal(forces(other), forces(best)) for other in others):
            found.append(PUSH)
        if any(other.wrench != best.wrench or other.torque_factor != best.torque_factor for other in others):
            found.append(SEE_COM)
        if any(other.orientation != best.orientation for other in others):
            found.append(SEE_POSE)
        if any(LEANING_FLAG in other.flags or other.reversed_gravity for other in (best, *others)):
            found.append(SEE_BASE)
        return tuple(found)


def _fitted(R_base_flange: Array, wrench: Array, model: str, down: Array) -> tuple[RigidTool, Array, bool]:
    """The rigid tool, what it leaves (n, 6), and whether its weight is sure; a tool of no weight where none fits."""
    if float(np.mean(np.var(gravity_in_flange(R_base_flange, down), axis=0))) > LEAST_TILT:
        fit = fit_rigid(PoseReadings(R_base_flange, wrench, None), model, down, None)
        if fit.tool is not None and fit.tool.weight > 0.0:
            sure = fit.tool.weight > SURE_WEIGHT * float(np.sqrt(fit.covariance[0, 0]))
            return fit.tool, fit.residuals, sure
    bias = wrench.mean(axis=0)
    return RigidTool(0.0, np.zeros(3), bias, np.eye(3), down), wrench - bias, False


def _decisively_better(one: Explanation, other: Explanation) -> bool:
    """Whether `other` is to be given up for `one`, which must explain the file for that, and not just less badly."""
    if one is other or other.odds - one.odds < DECISIVE or one.force_left > LEFT_BY_NO_TOOL * one.weight:
        return False
    less_force = one.force_left < LESS_THAN_HALF * other.force_left
    return less_force or one.torque_left < LESS_THAN_HALF * other.torque_left


def _oddity_of(com: Array) -> float:
    """How far, in factors, a centre of mass lies from where tools have theirs."""
    return abs(float(np.log(max(float(np.linalg.norm(com)), 1e-12) / TYPICAL_COM)))


def _one_of_each(best: Explanation, fits: list[Explanation]) -> tuple[Explanation, ...]:
    """The best first, then the others in order, each reading once."""
    kept = [best]
    for fit in fits:
        if all(fit.reading != other.reading for other in kept):
            kept.append(fit)
    return tuple(kept)
