"""The contact wrench of a recording in the axes and about the point that its user works with, std carried along."""

from __future__ import annotations

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.fields import ROWS_AT_ONCE
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.wrench import cross_matrix, wrench_transform
from ..model import mounting_turn
from ..samples.samples import Samples
from .contact_wrenches import ContactWrenches

OUTPUT_FRAMES = ("sensor", "flange", "base")


def contact_wrenches(
    calibration: Calibration,
    samples: Samples,
    output_frame: str = "sensor",
    point: Array | None = None,
    gravity: Array | None = None,
) -> ContactWrenches:
    """Compensate every sample.

    `output_frame`: sensor, flange or base axes; in the last two the std also counts that the mounting, known within
    a std of its own, turns the wrench. `point` (3,) m in SENSOR axes: where the torque is taken, the TCP, default the
    sensor's origin. `gravity` (3,): its direction in the base axes of this recording, where that differs from the
    calibration's. Raises `InputError` for an unknown frame, or one that `affine` cannot give.
    """
    require_frame(calibration, output_frame)
    calibration = calibration.with_gravity(gravity)
    R = samples.R_base_flange
    wrench, std = calibration.compensate(samples.wrench, R), np.empty((len(samples), 6))
    if output_frame == "sensor" and point is None:
        return ContactWrenches(wrench, calibration.wrench_std(R), samples.t)
    for start in range(0, len(samples), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        transform = wrench_transform(_axes(calibration, R[rows], output_frame), np.zeros(3) if point is None else point)
        J = transform @ calibration.free_wrench_jacobian(R[rows])
        wrench[rows] = np.einsum("nij,nj->ni", transform, wrench[rows])
        if output_frame != "sensor":
            J += _turned_by_mounting(calibration, R[rows], output_frame, wrench[rows])
        std[rows] = np.sqrt(np.maximum(np.sum((J @ calibration.covariance) * J, axis=2), 0.0))
    return ContactWrenches(wrench, std, samples.t)


def in_axes(
    calibration: Calibration,
    R_base_flange: Array,
    wrench: Array,
    covariance: Array,
    output_frame: str,
    point: Array | None = None,
) -> tuple[Array, Array]:
    """Contact wrenches (n, 6), sensor axes, with `covariance` (n, 6, 6) of whatever origin, in the axes and about the
    point of `contact_wrenches`, and their std (n, 6): what the mounting's uncertainty adds counts as independent.
    """
    require_frame(calibration, output_frame)
    axes = _axes(calibration, R_base_flange, output_frame)
    transform = wrench_transform(axes, np.zeros(3) if point is None else point)
    turned: Array = np.einsum("nij,nj->ni", transform, wrench)
    variance = np.sum((transform @ covariance) * transform, axis=2)
    if output_frame != "sensor":
        J = _turned_by_mounting(calibration, R_base_flange, output_frame, turned)
        variance += np.sum((J @ calibration.covariance) * J, axis=2)
    return turned, np.sqrt(np.maximum(variance, 0.0))


def require_frame(calibration: Calibration, output_frame: str) -> None:
    """Raise `InputError` for an unknown frame, or one that `affine` cannot give."""
    if output_frame not in OUTPUT_FRAMES:
        raise InputError(f"output frame is {output_frame!r}, expected {', '.join(OUTPUT_FRAMES)}")
    if output_frame != "sensor" and calibration.R_flange_sensor is None:
        raise InputError(f"model affine has no mounting, so no {output_frame} axes: use sensor, or another model")


def _turned_by_mounting(calibration: Calibration, R_base_flange: Array, output_frame: str, wrench: Array) -> Array:
    """Derivative (n, 6, p), sign turned, of contact wrenches (n, 6) in output axes because those axes follow the
    mounting: an error delta of it, in sensor axes, turns force and torque by delta in output axes.
    """
    turn = _axes(calibration, R_base_flange, output_frame) @ mounting_turn(calibration.parameter_names)
    parts = [cross_matrix(wrench[:, part]) @ turn for part in (slice(0, 3), slice(3, 6))]
    return np.concatenate(parts, axis=1)


def _axes(calibration: Calibration, R_base_flange: Array, output_frame: str) -> Array:
    """Rotations (n, 3, 3) from sensor axes to `output_frame`."""
    R_flange_sensor = np.eye(3) if calibration.R_flange_sensor is None else calibration.R_flange_sensor
    if output_frame == "base":
        return R_base_flange @ R_flange_sensor
    return np.broadcast_to(np.eye(3) if output_frame == "sensor" else R_flange_sensor, R_base_flange.shape)
