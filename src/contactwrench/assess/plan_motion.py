"""One recording for model `dynamic`: the planned stops, and after them the motion that tells most of the inertia.

It is a D-optimal one of all Fourier series that an arm may follow (docs/planning.md). Its shape says how fast it may be
gone, so the search is for the shape alone: random ones, and from the best of them steps in one joint after the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..calibration.dynamics import DYNAMIC_PARAMETERS, TERMS, inertial_jacobian
from ..errors import InputError
from ..estimation.dynamic import GYRATION
from ..geometry.arrays import Array, Frozen
from ..geometry.ranges import HEIGHT, MOTION_TIME, NEAR
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import response_jacobian
from .fourier_motion import (
    ABOVE,
    FASTEST,
    HARMONICS,
    WITHIN,
    FourierMotion,
    Limits,
    fitted_shapes,
    limits_of,
    moving_flange,
    pace,
)
from .plan import READINGS, Expected, Plan, expected_tool, fitted_names, information_of, plan
from .robot_arms import Arm, Reach, flange_pose, reach

SEED = 1997
POINTS, DENSE = 80, 4000
"""Of a period: for the search, and to keep the limits by."""
NEARLY = 0.999
"""Of the pace that these allow: between them may be a little more."""
OF_ROOM = 0.97
"""What the search may take: between two of its points a peak is 2 % higher at most."""
STARTS, AT_ONCE, STEPS = 12, 16, 700
"""Random shapes, so many times so many, and steps from the best one, each the best of so many. Twice the steps take
twice the time and gain 2 to 10 % in the mean std; another seed changes it by 5 %.
"""
WIDEST, FIRST_STEP, LAST_STEP = 0.4, 0.15, 0.01
"""rad: random amplitudes of the first harmonic, and steps; of harmonic k the k-th part."""
SMALLER, TRIED = 0.7, 12
"""Where no random shape keeps the limits: so much smaller ones, so often."""
NINE = len(DYNAMIC_PARAMETERS)
LEAST = 1e-6
"""Of information, in natural units: none at all has no inverse. A std of as much as a unit tells nothing."""


@dataclass(frozen=True, eq=False)
class Design:
    """Motions of one shape each: coefficients (m, HARMONICS, k) that keep the room, rad; the `pace` (m,) rad/s at which
    they may be gone; the `gain` (m,), half the logarithm of the determinant of what they tell, minus infinity where a
    limit is passed; and the variances (m, 9) of `DYNAMIC_PARAMETERS`, from the motion's noise alone, and what the stops
    leave open adds, in squares of kg m^2 and m: no estimate has less (Cramer and Rao).
    """

    sine: Array
    cosine: Array
    pace: Array
    gain: Array
    of_noise: Array
    of_stops: Array

    def best(self) -> Design:
        """The best one alone."""
        best = int(np.argmax(self.gain))
        return Design(*(each[best : best + 1] for each in vars(self).values()))


@dataclass(frozen=True, eq=False)
class _Search:
    """What is searched: `unit` (9,) of the parameters; `own` (144, 81) and `shared` (252, 9 p) turn sums of products of
    the terms with themselves and the orientation into information about them, and what it shares with the p of the
    tool, whose covariance the stops leave `open_` (p, p). `slowest`: one period in all the time, rad/s.
    """

    arm: Arm
    start: Array
    limits: Limits
    slowest: float
    unit: Array
    own: Array
    shared: Array
    open_: Array

    def judged(self, sine: Array, cosine: Array, points: int = POINTS) -> Design:
        angle = 2.0 * np.pi * np.arange(points) / points
        sine, cosine, (shape, slope, curvature) = fitted_shapes(sine, cosine, self.limits, angle)
        rows = (len(sine) * points, len(self.start))
        flange = moving_flange(self.arm, *(each.reshape(rows) for each in (self.start + shape, slope, curvature)))
        fastest = pace(flange, slope, curvature, self.limits)
        fastest = NEARLY * np.minimum(fastest, 2.0 * np.pi * FASTEST / HARMONICS)
        place = flange.position.reshape(len(sine), points, 3)
        inside = np.linalg.norm(place - place[:, :1], axis=2).max(axis=1) <= self.limits.within
        inside &= (place[:, :, 2].min(axis=1) >= self.limits.above) & (fastest >= self.slowest)
        # At another pace all terms grow with its square.
        seen = np.column_stack([flange.motion.terms, flange.motion.R_base_flange.reshape(-1, 9)])
        seen = seen.reshape(len(sine), points, -1)
        seen[..., :TERMS] *= (fastest**2)[:, None, None]
        # Less their means: the bias in motion is not taken to be that of the stops.
        seen -= seen.mean(axis=1, keepdims=True)
        count = READINGS * 2.0 * np.pi / self.slowest / points
        products = count * seen[..., :TERMS].transpose(0, 2, 1) @ seen
        information = (products[..., :TERMS].reshape(len(sine), -1) @ self.own).reshape(-1, NINE, NINE)
        known = np.linalg.inv(information + LEAST * np.eye(NINE))
        follows = known @ (products.reshape(len(sine), -1) @ self.shared).reshape(len(sine), NINE, -1)
        of_stops = follows @ self.open_ @ follows.transpose(0, 2, 1)
        gain = np.where(inside, -0.5 * np.linalg.slogdet(known + of_stops)[1], -np.inf)
        variances = (np.einsum("mii->mi", each) * self.unit**2 for each in (known, of_stops))
        return Design(sine, cosine, fastest, gain, *variances)


def best_motion(arm: Arm, start: Array, stops: Plan, limits: Limits, duration: float) -> tuple[FourierMotion, Design]:
    """The motion of an arm from joints `start` (k,), rad, at most `duration` s long, within `limits`, that after the
    stops tells most; and what it tells. Raises `InputError` where none was found.
    """
    rng = np.random.default_rng(SEED)
    dense = _search(arm, start, stops, limits, duration)
    search = replace(dense, limits=limits.reduced(OF_ROOM))
    best = _best_random(search, rng)
    harmonic = np.arange(1.0, HARMONICS + 1.0)
    for k, width in enumerate(np.geomspace(FIRST_STEP, LAST_STEP, STEPS)):
        step = np.zeros((2, AT_ONCE, HARMONICS, len(arm)))
        step[..., k % len(arm)] = width * rng.normal(size=(2, AT_ONCE, HARMONICS)) / harmonic
        tried = search.judged(best.sine + step[0], best.cosine + step[1]).best()
        if tried.gain[0] > best.gain[0]:
            best = tried
    size = 1.0
    while not np.isfinite((kept := dense.judged(size * best.sine, size * best.cosine, DENSE)).gain[0]):
        size *= OF_ROOM
    untold = np.sqrt(kept.of_noise[0]) > dense.unit
    if untold.any():
        names = ", ".join(name for name, is_untold in zip(DYNAMIC_PARAMETERS, untold, strict=True) if is_untold)
        raise InputError(
            f"no motion of {arm.name} tells {names}, expected turns about every axis: take more joints, or more room"
        )
    frequency = float(kept.pace[0]) / (2.0 * np.pi)
    return FourierMotion(start, kept.sine[0], kept.cosine[0], frequency, int(duration * frequency + 1e-9)), kept


def _search(arm: Arm, start: Array, stops: Plan, limits: Limits, duration: float) -> _Search:
    tool, noise = stops.expected.tool, stops.expected.in_motion
    names, mass = fitted_names(stops.model), tool.weight / STANDARD_GRAVITY
    unit = np.r_[np.full(6, mass * GYRATION**2), np.full(3, GYRATION)]
    J = inertial_jacobian(tool, mass, mass * GYRATION**2 * np.eye(3), np.zeros(3), names) / noise[:, None]
    shown = [k for k, name in enumerate(names) if not name.startswith("bias")]
    at_rest = response_jacobian(tool, names).transpose(2, 1, 0) / noise[:, None]
    own, others = J[:, :, len(names) :] * unit, np.concatenate([J[:, :, shown], at_rest])
    left = np.asarray(np.linalg.inv(information_of(stops.expected, stops.model, stops.R_base_flange)))
    about, shared = (np.einsum("iar,jas->ijrs", own, J).reshape(TERMS * len(J), -1) for J in (own, others))
    return _Search(arm, start, limits, 2.0 * np.pi / duration, unit, about, shared, left[np.ix_(shown, shown)])


def _best_random(search: _Search, rng: np.random.Generator) -> Design:
    """The best of random shapes, which are smaller and smaller until one keeps the limits."""
    harmonic = np.arange(1.0, HARMONICS + 1.0)[:, None]
    for smaller in SMALLER ** np.arange(TRIED):
        drawn = smaller * WIDEST * rng.uniform(-1.0, 1.0, (STARTS, 2, AT_ONCE, HARMONICS, len(search.start))) / harmonic
        best = max((search.judged(*each).best() for each in drawn), key=lambda design: float(design.gain[0]))
        if np.isfinite(best.gain[0]):
            return best
    raise InputError(
        f"found no motion of {search.arm.name} that keeps its limits from here, expected room around it: start "
        "elsewhere (--around), or state --above, --within or a longer --duration"
    )


STOPS, STOP, DURATION = 12, 1.5, 30.0
"""How many, and s."""
MOVE_PACE = 0.5
"""Of the fastest, from stop to stop: the sensor and the cables rest sooner."""
ON_A_MOVE, LOOKED_AT = 61, 0.005
"""Moments of a move at which its limits are kept; s, from one to the next at which the largest values are taken."""


@dataclass(frozen=True, eq=False)
class Largest:
    """Of a whole recording: how far each joint goes `from_start`, its `speed` and `acceleration` (k,) in rad and
    s; the flange's `turn_speed` rad/s, `turn_acceleration` rad/s^2 and `flange_speed` m/s, its `lowest` height over the
    plane of the base, m, and its `furthest` from where it starts, m.
    """

    from_start: Array
    speed: Array
    acceleration: Array
    turn_speed: float
    turn_acceleration: float
    flange_speed: float
    lowest: float
    furthest: float


@dataclass(frozen=True, eq=False)
class DynamicPlan(Frozen):
    """One recording for model `dynamic`: stops, and a motion after them, from and to where the arm stands.

    `stops` as planned; `visited` (n + 2, k) rad with the start at both ends, `moves` (n + 1,) s from each to the next;
    then `motion`. `limits` that it keeps; `std` (9,) of `DYNAMIC_PARAMETERS`, kg m^2 and m, given the tool and the
    bias, and `std_after_stops` (9,) with what the stops leave open of these.
    """

    arm: Arm
    stops: Plan
    visited: Array
    moves: Array
    motion: FourierMotion
    limits: Limits
    std: Array
    std_after_stops: Array

    @property
    def duration(self) -> float:
        """Of the recording, s."""
        return float(STOP * (len(self.visited) + 1) + self.moves.sum() + self.motion.duration)

    @cached_property
    def largest(self) -> Largest:
        """What the arm has to do at most, every 5 ms."""
        joints = self.at(np.arange(0.0, self.duration, LOOKED_AT))
        flange = moving_flange(self.arm, *joints)
        turning = flange.motion.angular_velocity, flange.motion.angular_acceleration
        from_start, speed, acceleration = (np.abs(q - q[0]).max(axis=0) for q in joints)
        turn_speed, turn_acceleration = (float(np.linalg.norm(each, axis=1).max()) for each in turning)
        flange_speed, lowest = float(flange.speed.max()), float(flange.position[:, 2].min())
        furthest = float(np.linalg.norm(flange.position - flange.position[0], axis=1).max())
        return Largest(from_start, speed, acceleration, turn_speed, turn_acceleration, flange_speed, lowest, furthest)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Joints at times (n,), s, and their derivatives (n, k): rad, rad/s, rad/s^2. Stops of `STOP`, moves of least
        jerk (Flash and Hogan 1985), a stop, the motion, a stop.
        """
        leaves = np.cumsum(np.r_[STOP, STOP + self.moves])
        row = np.minimum(np.searchsorted(leaves - STOP, t, "right") - 1, len(self.moves))
        step = np.vstack([np.diff(self.visited, axis=0), np.zeros(len(self.arm))])[row]
        taken = np.r_[self.moves, 1.0][row][:, None]
        s = np.clip((t - leaves[row])[:, None] / taken, 0.0, 1.0)
        along, speed, acceleration = _least_jerk(s)
        q, qd, qdd = self.visited[row] + along * step, speed * step / taken, acceleration * step / taken**2
        into = t - leaves[-1]
        moving = (into > 0.0) & (into < self.motion.duration)
        q[moving], qd[moving], qdd[moving] = self.motion.at(into[moving])
        return q, qd, qdd


def plan_motion(
    arm: Arm,
    around: Array | None = None,
    n: int = STOPS,
    expected: Expected | None = None,
    *,
    model: str = "auto",
    duration: float = DURATION,
    above: float = ABOVE,
    within: float = WITHIN,
) -> DynamicPlan:
    """`n` stops of a `model`, as `plan` has it, and after them the motion, at most `duration` s, that tells most of
    inertia and offset: from joints `around` (k,), rad (None: home), the flange `above` m over the plane of the base and
    `within` m of where it starts. Raises `InputError` for joints that leave no room, and as `plan` and `reach` do.
    """
    MOTION_TIME.require(duration, "duration")
    HEIGHT.require(above, "above")
    NEAR.require(within, "within")
    expected = expected_tool(None, model) if expected is None else expected
    wrist = reach(arm, around)
    limits = limits_of(arm, wrist.around, above, within)
    high = flange_pose(arm, wrist.joints)[1][:, 2] >= above
    wrist = Reach(wrist.arm, wrist.around, wrist.R_base_flange[high], wrist.joints[high])
    stops = plan(n, expected, model=model, reach=wrist)
    visited = np.vstack([wrist.around, np.asarray(stops.joints), wrist.around])
    motion, design = best_motion(arm, wrist.around, stops, limits, duration)
    of_noise = design.of_noise[0] * duration / motion.duration
    std = np.sqrt(of_noise), np.sqrt(of_noise + design.of_stops[0])
    return DynamicPlan(arm, stops, visited, _moves(arm, visited, limits), motion, limits, *std)


def _moves(arm: Arm, visited: Array, limits: Limits) -> Array:
    """How long each move between joints (m, k) takes (m - 1,), s, in whole 0.1 s, none of which may be too low."""
    step = np.diff(visited, axis=0)[:, None]
    along, slope, curvature = (each[:, None] * step for each in _least_jerk(np.linspace(0.0, 1.0, ON_A_MOVE)))
    joints = visited[:-1, None] + along
    flange = moving_flange(arm, *(each.reshape(-1, len(arm)) for each in (joints, slope, curvature)))
    lowest = float(flange.position[:, 2].min())
    if lowest < limits.above:
        raise InputError(
            f"the flange of {arm.name} is {lowest:.3g} m above the plane of its base between two stops, expected "
            f"{limits.above:g} m or more: start elsewhere (--around), or state --above"
        )
    return np.ceil(10.0 / (MOVE_PACE * pace(flange, slope, curvature, limits))) / 10.0


def _least_jerk(s: Array) -> tuple[Array, Array, Array]:
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * (s * (1.0 - s)) ** 2, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
