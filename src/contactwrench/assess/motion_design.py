"""Which motion tells most of inertia and sensor offset: a D-optimal one of all Fourier series that an arm may follow.

The determinant of the information about the nine parameters is largest, as the stops have told all else. The shape says
how fast it may be gone, and every term of the wrench in motion grows with the square of the pace; so the search is for
the shape alone: random ones, and from the best of them steps in one joint after the other, taken where they gain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..calibration.dynamics import DYNAMIC_PARAMETERS, TERMS, inertial_jacobian
from ..errors import InputError
from ..estimation.dynamic import GYRATION
from ..geometry.arrays import Array
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import wrench_jacobian
from .arm_motion import moving_flange
from .fourier_motion import FASTEST, HARMONICS, FourierMotion, Limits, fitted_shapes, pace
from .plan import Expected, fitted_names
from .robot_arms import Arm

READINGS = 1000.0
"""Hz."""
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


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Coefficients (p, HARMONICS, k) that keep the room, the `pace` (p,) rad/s at which they may be gone, and the
    `gain` (p,): the logarithm of the information's determinant for a reading, minus infinity where a limit is passed.
    """

    sine: Array
    cosine: Array
    pace: Array
    gain: Array


@dataclass(frozen=True, eq=False)
class _Task:
    """What is searched: `information` (144, 81) turns the products of the terms into what they tell of the nine
    parameters; `slowest` is the pace at which one period takes all the time, rad/s.
    """

    arm: Arm
    start: Array
    limits: Limits
    information: Array
    slowest: float

    def judged(self, sine: Array, cosine: Array, points: int = POINTS) -> _Shapes:
        angle = 2.0 * np.pi * np.arange(points) / points
        sine, cosine, (shape, slope, curvature) = fitted_shapes(sine, cosine, self.limits, angle)
        rows = (len(sine) * points, len(self.start))
        flange = moving_flange(self.arm, *(each.reshape(rows) for each in (self.start + shape, slope, curvature)))
        fastest = np.minimum(pace(flange, slope, curvature, self.limits), 2.0 * np.pi * FASTEST / HARMONICS)
        place = flange.position.reshape(len(sine), points, 3)
        inside = np.linalg.norm(place - place[:, :1], axis=2).max(axis=1) <= self.limits.within
        inside &= (place[:, :, 2].min(axis=1) >= self.limits.above) & (fastest >= self.slowest)
        products = _products(flange.motion.terms.reshape(len(sine), points, TERMS)).reshape(len(sine), -1)
        count = len(DYNAMIC_PARAMETERS)
        determinant = np.linalg.slogdet((products @ self.information).reshape(-1, count, count))
        gain = np.where(inside & (determinant[0] > 0.0), determinant[1] + 4.0 * count * np.log(fastest), -np.inf)
        return _Shapes(sine, cosine, fastest, gain)


def best_motion(arm: Arm, start: Array, expected: Expected, limits: Limits, duration: float) -> FourierMotion:
    """The motion of an arm from joints `start` (k,), rad, at most `duration` s long, within `limits`, that tells most
    of what moves as `expected`. Raises `InputError` where none was found.
    """
    rng = np.random.default_rng(SEED)
    slowest = 2.0 * np.pi / duration
    task = _Task(arm, start, limits.reduced(OF_ROOM), _information_of_products(expected), slowest)
    best = _best_random(task, rng)
    harmonic = np.arange(1.0, HARMONICS + 1.0)
    for k, width in enumerate(np.geomspace(FIRST_STEP, LAST_STEP, STEPS)):
        step = np.zeros((2, AT_ONCE, HARMONICS, len(arm)))
        step[..., k % len(arm)] = width * rng.normal(size=(2, AT_ONCE, HARMONICS)) / harmonic
        tried = task.judged(best.sine + step[0], best.cosine + step[1])
        if tried.gain.max() > best.gain[0]:
            best = _one_of(tried)
    dense, size = _Task(arm, start, limits, task.information, slowest), 1.0
    while not np.isfinite((kept := dense.judged(size * best.sine, size * best.cosine, DENSE)).gain[0]):
        size *= OF_ROOM
    frequency = NEARLY * float(kept.pace[0]) / (2.0 * np.pi)
    return FourierMotion(start, kept.sine[0], kept.cosine[0], frequency, int(duration * frequency + 1e-9))


def bounds(arm: Arm, motion: FourierMotion, expected: Expected, model: str, of_stops: Array) -> tuple[Array, Array]:
    """Standard deviations (9,) of `DYNAMIC_PARAMETERS`, below which no estimate from the motion comes (Cramer and
    Rao), kg m^2 and m: where tool and bias are known, and where they have the covariance `of_stops` (p, p).

    The readings come at `READINGS`, their noise is white; the bias in motion is not taken to be that of the stops.
    """
    t = np.arange(DENSE) / (DENSE * motion.frequency)
    flange = moving_flange(arm, *motion.at(t)).motion
    names = fitted_names(model)
    of_terms, at_rest = _of_terms(expected, names), wrench_jacobian(expected.tool, flange.R_base_flange, names)
    J = np.einsum("nk,kip->nip", flange.terms, of_terms) / expected.noise[:, None]
    own = J[:, :, len(names) :] - J[:, :, len(names) :].mean(axis=0)
    rest = J[:, :, : len(names)] + at_rest / expected.noise[:, None]
    count = READINGS * motion.duration / DENSE
    unit = _natural_units(expected)
    inverse = np.linalg.inv(count * np.einsum("nip,niq->pq", own * unit, own * unit)) * np.outer(unit, unit)
    follows = inverse @ (count * np.einsum("nip,niq->pq", own, rest))
    known, open_ = np.diag(inverse), np.sum((follows @ of_stops) * follows, axis=1)
    return np.asarray(np.sqrt(known)), np.asarray(np.sqrt(known + open_))


def _best_random(task: _Task, rng: np.random.Generator) -> _Shapes:
    """The best of random shapes, which are smaller and smaller until one keeps the limits."""
    harmonic = np.arange(1.0, HARMONICS + 1.0)[:, None]
    for smaller in SMALLER ** np.arange(TRIED):
        width = smaller * WIDEST / harmonic
        sets = [
            task.judged(*(width * rng.uniform(-1.0, 1.0, (2, AT_ONCE, HARMONICS, len(task.start)))))
            for _ in range(STARTS)
        ]
        best = max(map(_one_of, sets), key=lambda shapes: float(shapes.gain[0]))
        if np.isfinite(best.gain[0]):
            return best
    raise InputError(
        f"found no motion of {task.arm.name} that keeps its limits from here, expected room around it: start elsewhere "
        "(--around), or state --above, --within or a longer --duration"
    )


def _one_of(shapes: _Shapes) -> _Shapes:
    """The best alone."""
    best = int(np.argmax(shapes.gain))
    at = slice(best, best + 1)
    return _Shapes(shapes.sine[at], shapes.cosine[at], shapes.pace[at], shapes.gain[at])


def _products(terms: Array) -> Array:
    """Mean products (..., 12, 12) of terms (..., n, 12) less their mean: the bias in motion is not taken as known."""
    centred = terms - terms.mean(axis=-2, keepdims=True)
    products: Array = np.swapaxes(centred, -1, -2) @ centred / terms.shape[-2]
    return products


def _of_terms(expected: Expected, names: tuple[str, ...]) -> Array:
    """The derivative (12, 6, p + 9) of the wrench of each term by the tool's parameters and the nine."""
    mass = expected.tool.weight / STANDARD_GRAVITY
    return inertial_jacobian(expected.tool, mass, mass * GYRATION**2 * np.eye(3), np.zeros(3), names)


def _natural_units(expected: Expected) -> Array:
    """Of the nine (9,): a body of that mass as wide as `GYRATION`."""
    mass = expected.tool.weight / STANDARD_GRAVITY
    return np.asarray(np.r_[np.full(6, mass * GYRATION**2), np.full(3, GYRATION)])


def _information_of_products(expected: Expected) -> Array:
    names = fitted_names("auto")
    J = _of_terms(expected, names)[:, :, len(names) :] * _natural_units(expected) / expected.noise[:, None]
    information: Array = np.einsum("iar,jas->ijrs", J, J).reshape(TERMS**2, -1)
    return information
