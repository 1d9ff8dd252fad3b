"""Motions of the arm: splines through joint angles at given times, and three that are made to identify a tool; and what
moves the tool meanwhile: a hand that pushes its hook, and drives and links that shake it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen
from ..geometry.ranges import ROWS
from .arm import JOINT_RANGE, MAX_SPEED
from .kinematics import HOME, flange_pose
from .rig import Rig

HARMONICS = 5
KNOTS_PER_SECOND = 20.0
OF_RANGE, OF_SPEED = 0.6, 0.6
"""Of the room that a joint has around home, and of its largest speed: what the exciting motion takes."""

MOVE_SPEED = 0.25
"""Of its largest speed: what the joint that has furthest to go takes at most from one stop to the next."""
PEAK = 1.875
"""Largest over mean speed of a motion of least jerk, `10 s^3 - 15 s^4 + 6 s^5`."""

SWEEP_DEG = (
    (0.0, 0.0, 0.0),
    (0.0, 0.0, 90.0),
    (0.0, 0.0, -90.0),
    (0.0, 0.0, 0.0),
    (0.0, -70.0, 0.0),
    (90.0, -70.0, 0.0),
    (-90.0, -70.0, 0.0),
    (-90.0, -70.0, 90.0),
    (0.0, 0.0, 0.0),
)
"""Turns of the last three joints from home: about the flange's z, then tilted, then round."""

PUSH_FORCE = (1.0, 10.0)
"""N: least and largest."""
PUSH_TIME = (0.2, 2.0)
"""s: shortest and longest."""
RISE = 0.03
"""s: from nothing to the whole force, and back; a hand that taps is about as quick."""
APART = 1.0
"""s: least time between pushes, and before the first and after the last."""

MODES, DAMPING = (12.0, 30.0), 0.05
"""Hz, of an arm of medium reach, and the share of critical damping; assumed."""


@dataclass(frozen=True, eq=False)
class Motion(Frozen):
    """Times (n,), s, and joints (n, 7), rad, with their velocities and accelerations."""

    t: Array
    joints: Array
    velocity: Array
    acceleration: Array


def through(t: Array, joints: Array, rate: float) -> Motion:
    """The motion along cubic splines through points, times (k,), s, and joints (k, 7), rad, at a `rate` of rows, Hz,
    its times from 0, at rest at both ends. Raises `InputError` for fewer than two points, times that do not increase,
    and joints beyond their range or speed.
    """
    from scipy.interpolate import CubicSpline

    if len(t) < 2:
        raise InputError(f"found {len(t)} points of a trajectory, expected 2 or more: add points")
    if np.any(np.diff(t) <= 0.0):
        row = int(np.argmax(np.diff(t) <= 0.0)) + 1
        raise InputError(
            f"t in point {row + 1} is {t[row]:g} s, expected more than {t[row - 1]:g}: sort the points", row
        )
    duration = t[-1] - t[0]
    if duration * rate > ROWS.most:
        raise InputError(
            f"t goes over {duration:g} s, expected at most {ROWS.most / rate:g} s at {rate:g} Hz: is it in seconds?"
        )
    spline = CubicSpline(t, joints, bc_type="clamped")
    times = t[0] + np.arange(int(np.floor(duration * rate + 1e-9)) + 1) / rate
    motion = Motion(times - t[0], spline(times), spline(times, 1), spline(times, 2))
    _require_within(motion)
    return motion


def _require_within(motion: Motion) -> None:
    for what, values, most, unit, mend in (
        ("goes to", motion.joints, JOINT_RANGE, "deg", "leave out the points beyond"),
        ("turns at", motion.velocity, MAX_SPEED, "deg/s", "take more time"),
    ):
        worst = np.abs(values).max(axis=0)
        if np.any(worst > most):
            joint = int(np.argmax(worst / most))
            raise InputError(
                f"q{joint + 1} {what} {np.rad2deg(worst[joint]):.0f} {unit}, expected at most "
                f"{np.rad2deg(most[joint]):.0f}: {mend}"
            )


def stopping(joints: Array, move: float, stop: float, rate: float) -> Motion:
    """The motion from one row of joints (k, 7), rad, to the next in `move` s with the least jerk (Flash and Hogan
    1985), with a `stop`, s, at each; rows at a `rate`, Hz. Raises `InputError` for joints beyond their range or speed,
    and for more rows than anybody could mean.
    """
    each = move + stop
    rows = round((len(joints) * each - move) * rate)
    ROWS.require(rows, "number of rows")
    t = np.arange(rows) / rate
    row = np.minimum((t / each).astype(int), len(joints) - 1)
    s = np.maximum(t - row * each - stop, 0.0) / move
    step = np.vstack([np.diff(joints, axis=0), np.zeros((1, joints.shape[1]))])[row]
    along = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    speed, acceleration = 30.0 * s**2 * (1.0 - s) ** 2 / move, 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / move**2
    motion = Motion(t, joints[row] + along[:, None] * step, speed[:, None] * step, acceleration[:, None] * step)
    _require_within(motion)
    return motion


def calm(joints: Array) -> float:
    """The time, s, for each step between rows of joints (k, 7), rad, in which none of them is fast."""
    step = np.abs(np.diff(joints, axis=0)) / MAX_SPEED
    return PEAK * float(step.max(initial=0.0)) / MOVE_SPEED


def exciting(duration: float, rate: float, rng: np.random.Generator) -> Motion:
    """A sum of sines with random amplitudes and phases in every joint around home (Swevers et al. 1997), rising from
    rest and coming back to it.
    """
    t = np.linspace(0.0, duration, max(8, round(duration * KNOTS_PER_SECOND) + 1))
    harmonic = 2.0 * np.pi * np.arange(1, HARMONICS + 1) / duration
    amplitude = rng.uniform(0.3, 1.0, size=(HARMONICS, len(HOME))) / np.sqrt(np.arange(1.0, HARMONICS + 1.0))[:, None]
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(HARMONICS, len(HOME)))
    shape = np.einsum("kj,tkj->tj", amplitude, np.sin(t[:, None, None] * harmonic[:, None] + phase))
    shape *= np.sin(np.pi * t / duration)[:, None] ** 2
    speed = np.abs(np.gradient(shape, t, axis=0)).max(axis=0)
    room = OF_RANGE * (JOINT_RANGE - np.abs(HOME)) / np.abs(shape).max(axis=0)
    return through(t, HOME + shape * np.minimum(room, OF_SPEED * MAX_SPEED / speed), rate)


def sweeping(duration: float, rate: float) -> Motion:
    """One joint of the wrist after the other, slowly: about the flange's z, tilted, and round in the tilt."""
    turns = np.zeros((len(SWEEP_DEG), len(HOME)))
    turns[:, 4:] = np.deg2rad(SWEEP_DEG)
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns, axis=0)).max(axis=1))])
    return through(duration * turned / turned[-1], HOME + turns, rate)


@dataclass(frozen=True, eq=False)
class Push(Frozen):
    """A force (3,), N, base axes, on the hook from `t_start` to `t_end`, s, rising and falling over `RISE`."""

    t_start: float
    t_end: float
    force: Array


def random_pushes(n: int, duration: float, rng: np.random.Generator) -> tuple[Push, ...]:
    """`n` pushes with random force, direction and length, spread over `duration` s. Raises `InputError` where they do
    not fit.
    """
    lasting = rng.uniform(*PUSH_TIME, n)
    free = duration - float(lasting.sum()) - APART * (n + 1)
    if free < 0.0:
        needed = (PUSH_TIME[1] + APART) * n + APART
        raise InputError(f"{n} pushes do not fit into {duration:g} s, expected {needed:g} s or more, or fewer pushes")
    gaps = np.diff(np.sort(rng.uniform(0.0, free, n)), prepend=0.0) + APART
    starts = np.cumsum(gaps + np.r_[0.0, lasting[:-1]])
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    force = rng.uniform(*PUSH_FORCE, (n, 1)) * direction
    return tuple(map(Push, starts.tolist(), (starts + lasting).tolist(), force))


def force_on_hook(pushes: tuple[Push, ...], t: Array) -> Array:
    """The force (n, 3), N, base axes, at times (n,), s."""
    force = np.zeros((len(t), 3))
    for push in pushes:
        force += share_of_push(t, push.t_start, push.t_end)[:, None] * push.force
    return force


def share_of_push(t: Array, start: float, end: float) -> Array:
    """The part (n,) of its force that a push from `start` to `end`, s, has at times (n,), s: it rises over `RISE`."""
    smooth: Array = np.minimum(np.maximum(np.minimum(t - start, end - t) / RISE, 0.0), 1.0)
    return smooth**2 * (3.0 - 2.0 * smooth)


def shaking(rig: Rig, motion: Motion, rng: np.random.Generator) -> Array | None:
    """The tool's acceleration (n, 3), m/s^2, base axes, beside the motion: damped modes stirred by noise, the more the
    faster the arm moves, each with half of the mean square. Encoders sit before the links and see nothing of it, so
    that no stated pose has it. None where nothing shakes; a mode that the motion's rate cannot show is left out.
    """
    of_acceleration, of_speed = rig.settings.arm.vibration
    if not of_acceleration and not of_speed:
        return None
    period = float(motion.t[1] - motion.t[0])
    velocity = np.gradient(flange_pose(rig, motion.joints)[1], period, axis=0)
    acceleration = np.linalg.norm(np.gradient(velocity, period, axis=0), axis=1)
    level = of_acceleration * acceleration + of_speed * np.abs(motion.velocity).max(axis=1)
    modes = [_mode(frequency, level, period, rng) for frequency in MODES if frequency < 0.5 / period]
    return np.asarray(np.sqrt(1.0 / len(MODES)) * np.sum(modes, axis=0)) if modes else None


def _mode(frequency: float, level: Array, period: float, rng: np.random.Generator) -> Array:
    """White noise of a `level` (n,) through a resonance (n, 3), as large as the level is where that stays."""
    from scipy.signal import iirpeak, lfilter

    numerator, denominator = iirpeak(frequency, 0.5 / DAMPING, 1.0 / period)
    bandwidth = np.pi * frequency * 2.0 * DAMPING * period
    stirred = level[:, None] * rng.normal(size=(len(level), 3))
    return np.asarray(lfilter(numerator, denominator, stirred, axis=0) / np.sqrt(bandwidth))
