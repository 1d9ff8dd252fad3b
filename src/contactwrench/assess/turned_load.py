"""A load turns with an orientation that is a bit off, and a sensor misreads it: the more, the heavier it is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity
from ..calibration.observability import LEVER
from ..estimation.moved_bias import noise_beside_turns, whitening
from ..estimation.variance_components import USUAL
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix
from ..model import gravity_in_flange, weight_scale
from ..statistics import two_digits

USUAL_GAIN, HEAVY = 0.005, 3.0
"""By how much sensors' gains are off; and times the tool's weight, from which on an object shows what that does not."""


def gravity_in_sensor(calibration: Calibration, R_base_flange: Array) -> Array:
    """Gravity's force (n, 3) on the calibrated tool, N, sensor axes: it points down."""
    return gravity_in_flange(R_base_flange, calibration.gravity_direction) @ calibration.B[:3, :3].T


def down_in_sensor(calibration: Calibration, R_base_flange: Array) -> tuple[Array, Array]:
    """Unit "down" (n, 3) in sensor axes, and its derivative (n, 3, p) with respect to the calibration's parameters."""
    force = gravity_in_sensor(calibration, R_base_flange)
    size = np.linalg.norm(force, axis=1)[:, None]
    down = force / size
    J = calibration.error_jacobian(R_base_flange)[:, :3].copy()
    J[:, :, [name.startswith("bias_") or name.endswith("_1") for name in calibration.error_names]] = 0.0
    across = np.eye(3) - down[:, :, None] * down[:, None, :]
    return down, across @ J / size[..., None]


def largest_turn(calibration: Calibration) -> float:
    """By how many rad an axis the robot's orientations are off, as far as calibrating tells: no more than would show
    there in the tool's weight, which an object is often several times.
    """
    if calibration.orientation_std is not None:
        return calibration.orientation_std
    return min(float(np.sqrt(np.mean(calibration.noise[:3] ** 2))) / _weight(calibration), USUAL)


def _weight(calibration: Calibration) -> float:
    """Of the tool, N; hardly anything of one without."""
    return max(weight_scale(calibration.B), 1e-300)


def of_gain(calibration: Calibration, wrench: Array) -> Array:
    """What the sensor's gain and cross-talk, as far off as calibrating saw them in the force of the tool's weight, make
    of the wrenches (n, 6) of a load, alike in all: (n, 6, 36) as independent parts of unit size.
    """
    if calibration.gain_covariance is None:
        return np.zeros((len(wrench), 6, 0))
    of_force = np.diag(calibration.gain_covariance).reshape(6, 4)[:3, :3]
    share = np.sqrt(max(float(np.mean(of_force)), 0.0)) / _weight(calibration)
    unit = np.repeat([1.0, LEVER], 3)
    each = np.einsum("ab,nc->nabc", share * np.diag(unit), wrench / unit)
    return np.asarray(each.reshape(len(wrench), 6, 36))


def hidden_gain(calibration: Calibration, mass: float, std: float, g: float) -> Iterator[Finding]:
    """That an object of that `mass` kg under `g` m/s^2 is so much heavier than the tool that a gain which the tool's
    weight hardly shows would put it off by more than twice its `std` kg.
    """
    times, off = g * mass / _weight(calibration), USUAL_GAIN * mass
    if times > HEAVY and off > 2.0 * std:
        text = (
            f"the object weighs {two_digits(times)} times the tool, whose weight hardly shows a gain that is off: "
            f"{100.0 * USUAL_GAIN:g} % of it would be {two_digits(1e3 * off)} g here; contactwrench verify tells with "
            "a known load as heavy (load_g)"
        )
        yield Finding(Kind.ADVICE, Severity.NOTE, text)


def whitening_under_load(
    calibration: Calibration, R_base_flange: Array, variance: Array, off: float, weight: float, moment: Array
) -> Array:
    """Matrices (n, 6, 6) that make the errors of readings of the given `variance` (n, 6) independent, of size one.
    Orientations that are `off` rad an axis turn what hangs on the sensor: an object of that `weight` N and `moment`
    (3,) N m, and the tool, whose share is in the variance, where the calibration knows how large it is.
    """
    noise, of_tool = noise_beside_turns(calibration, R_base_flange, variance)
    to_sensor = calibration.B[:3, :3] / weight_scale(calibration.B)
    of_object = np.concatenate([weight * to_sensor, cross_matrix(moment) @ to_sensor])
    r = gravity_in_flange(R_base_flange, calibration.gravity_direction)
    return whitening(noise, off * (of_tool + of_object @ cross_matrix(r)))
