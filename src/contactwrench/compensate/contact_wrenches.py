"""What compensation gives: contact wrenches, in whatever axes and about whatever point, contacts, a new zero."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..calibration.fields import ROWS_AT_ONCE
from ..errors import InputError
from ..geometry.arrays import Array, Frozen, Rows, Sealed, column, numbers, read_only
from ..geometry.wrench import cross_matrix, wrench_transform
from ..model import mounting_turn
from ..samples.flange_motion import FlangeMotion, flange_motion
from ..samples.recorded_poses import is_stream
from ..samples.samples import Samples
from .faults import Reason
from .line_of_action import LineOfAction, line_of_action

OUTPUT_FRAMES = ("sensor", "flange", "base")
NOT_KNOWN = read_only(np.full(6, np.nan))
"""The std of a wrench that cannot be computed."""
DENSE = 0.05
"""s from row to row: no one takes poses so fast, so that these are a recording, be it of an arm that does not turn."""
NOT_GIVEN: Any = None
"""Of a column: left out, or filled in."""
NOT_JUDGED, FREE, TOUCHING = -1, 0, 1
"""Of the column `contact`."""
BLANK: dict[str, Callable[[int], Any]] = {
    "valid": lambda n: np.ones(n, np.bool_),
    "reason": lambda n: (None,) * n,
    "contact": lambda n: np.full(n, NOT_JUDGED, np.int8),
}
"""What a column of so many rows is filled in with."""


@dataclass(frozen=True, eq=False)
class ContactWrench(Sealed):
    """The contact wrench of one sample: `wrench` (6,), N and N m, sensor axes, and its `std` (6,), at `t` s.

    `valid` is False where something is wrong with the sample, and `reason` says what, a short word first. Where nothing
    can be computed the wrench is NaN, and the std until the noise is known. `contact`: whether something touches; None
    where that cannot be judged.
    """

    wrench: Array
    std: Array
    t: float
    valid: bool
    reason: Reason | None
    contact: bool | None


@dataclass(frozen=True, eq=False)
class Contact(Frozen):
    """One contact, from `onset` to `release` s (None: it lasts).

    `peak` (6,): the wrench that stood out most; `mean` (6,) with its `covariance` (6, 6): N and N m, sensor axes.
    `onset_seen` is False where the tool had not been seen free before, so that a bias that moved looks the same.
    """

    onset: float
    release: float | None
    peak: Array
    mean: Array
    covariance: Array
    onset_seen: bool

    @cached_property
    def line(self) -> LineOfAction:
        """Where the mean force acts."""
        return line_of_action(self.mean, self.covariance)


@dataclass(frozen=True, eq=False)
class ContactWrenches(Rows):
    """Contact wrenches of n samples: `wrench` and its `std` (n, 6), N and N m, at `t` (n,) s; NaN where there is none.

    Where the samples were `judged` one by one, `valid` (n,) is False where something is wrong with one, and `reason`
    (n) says what; `contact` (n,) is 1 in contact, 0 free, -1 where that was not or cannot be judged. Else all are
    valid, and -1. `contacts`: those that ended in these samples, in sensor axes.

    From a `Compensator` there are also `statistic` (n,), which the test compares with `threshold` (n,), before
    hysteresis, and `covariance` (m, 6, 6), the wrench's, one after the other, of which `covariance_of` (n,) is each
    sample's. Of a set of recordings, `episode` (n,) says of which one a row is.
    """

    wrench: Array = field(metadata=column(6))
    std: Array = field(metadata=column(6))
    t: Array | None = field(default=None, metadata=column())
    judged: bool = False
    valid: NDArray[np.bool_] = field(default=NOT_GIVEN, metadata=column(kind=np.bool_))
    reason: tuple[Reason | None, ...] = field(default=NOT_GIVEN, metadata=column(kind=object))
    contact: NDArray[np.int8] = field(default=NOT_GIVEN, metadata=column(kind=np.int8))
    contacts: tuple[Contact, ...] = ()
    statistic: Array = field(default=NOT_GIVEN, metadata=column(kind=np.float64))
    threshold: Array = field(default=NOT_GIVEN, metadata=column(kind=np.float64))
    covariance_of: NDArray[np.intp] = field(default=NOT_GIVEN, metadata=column(kind=np.intp))
    covariance: Array | None = None
    episode: NDArray[np.int64] | None = field(default=None, metadata=column(kind=np.int64))

    def __post_init__(self) -> None:
        for name, blank in BLANK.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, blank(len(self.wrench)))
        super().__post_init__()

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """All rows and contacts, part after part, without the covariances."""
        plain: dict[str, Any] = {"covariance_of": None, "covariance": None}
        contacts = tuple(contact for part in parts for contact in part.contacts)
        return replace(super().concatenate(parts), contacts=contacts, **plain)


@dataclass(frozen=True, eq=False)
class Zero(Frozen):
    """A new zero: by how much (6,) free readings had moved, N and N m, and the `std` (6,) of that as an estimate of how
    far the bias moved since the calibration, whose own error at this orientation is in it.
    """

    shift: Array
    std: Array


def contact_wrenches(
    calibration: Calibration,
    samples: Samples,
    output_frame: str = "sensor",
    point: Array | None = None,
    gravity: Array | None = None,
) -> ContactWrenches:
    """Compensate every sample; with inertia where the calibration has it and the samples are a motion, whole.

    `output_frame`: sensor, flange or base axes; in the last two the std also counts that the mounting, known within
    a std of its own, turns the wrench. `point` (3,) m in SENSOR axes: where the torque is taken, the TCP, default the
    sensor's origin. `gravity` (3,): its direction in the base axes of this recording, where that differs from the
    calibration's. Raises `InputError` for an unknown frame, or one that `affine` cannot give.
    """
    require_frame(calibration, output_frame)
    calibration = calibration.with_gravity(gravity)
    R, motion = samples.R_base_flange, motion_of(calibration, samples)
    wrench, std = calibration.compensate(samples.wrench, R, motion=motion), np.empty((len(samples), 6))
    if output_frame == "sensor" and point is None:
        return ContactWrenches(wrench, calibration.wrench_std(R, motion), samples.t)
    for start in range(0, len(samples), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        transform, wrench[rows], J_mounting = _turned(calibration, R[rows], wrench[rows], output_frame, point)
        J = transform @ calibration.error_jacobian(R[rows]) + J_mounting
        variance = np.sum((J @ calibration.error_covariance) * J, axis=2)
        if motion is not None:
            own = calibration.covariance_in_motion(R[rows], motion.select(rows))
            variance += np.sum((transform @ own) * transform, axis=2)
        std[rows] = np.sqrt(np.maximum(variance, 0.0))
    return ContactWrenches(wrench, std, samples.t)


def motion_of(calibration: Calibration, samples: Samples, lag: float = 0.0) -> FlangeMotion | None:
    """How the flange moves, where the calibration knows what that does; None where it does not, and for poses. An
    accelerometer is later by `lag` s, of a sensor's filter that is made up for by itself. Raises `InputError` for a
    motion without positions, or without the accelerometer that the calibration counts from.
    """
    if calibration.dynamics is None or samples.t is None or len(samples) < 2:
        return None
    accelerometer, told = calibration.dynamics.accelerometer, samples.position is not None
    dense = (told or accelerometer is not None) and float(np.median(np.diff(samples.t))) <= DENSE
    if not dense and not is_stream(samples):
        return None
    gravity = calibration.g * calibration.gravity_direction
    if accelerometer is not None:
        accelerometer = replace(accelerometer, delay=accelerometer.delay + lag)
    return flange_motion(samples, accelerometer=accelerometer, gravity=gravity)


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
    transform, turned, J = _turned(calibration, R_base_flange, wrench, output_frame, point)
    variance = np.sum((transform @ covariance) * transform, axis=2) + np.sum(
        (J @ calibration.error_covariance) * J, axis=2
    )
    return turned, np.sqrt(np.maximum(variance, 0.0))


def require_frame(calibration: Calibration, output_frame: str) -> None:
    """Raise `InputError` for an unknown frame, or one that `affine` cannot give."""
    if output_frame not in OUTPUT_FRAMES:
        raise InputError(f"output frame is {output_frame!r}, expected {', '.join(OUTPUT_FRAMES)}")
    if output_frame != "sensor" and calibration.R_flange_sensor is None:
        raise InputError(f"model affine has no mounting, so no {output_frame} axes: use sensor, or another model")


def _turned(
    calibration: Calibration, R_base_flange: Array, wrench: Array, output_frame: str, point: Array | None
) -> tuple[Array, Array, Array]:
    """The transforms (n, 6, 6) from sensor axes, what they make of contact wrenches (n, 6), and the derivative
    (n, 6, p) of that, sign turned, because the output axes follow the mounting: an error delta of it, in sensor axes,
    turns force and torque by delta in output axes.
    """
    follows = output_frame != "sensor"
    R_output_sensor = calibration.R_flange_sensor if follows and calibration.R_flange_sensor is not None else np.eye(3)
    axes = R_base_flange @ R_output_sensor if output_frame == "base" else np.tile(R_output_sensor, (len(wrench), 1, 1))
    transform = wrench_transform(axes, np.zeros(3) if point is None else numbers(point, "point"))
    turned = np.einsum("nij,nj->ni", transform, wrench)
    turn = axes @ mounting_turn(calibration.error_names) * follows
    parts = [cross_matrix(turned[:, part]) @ turn for part in (slice(0, 3), slice(3, 6))]
    return transform, turned, np.concatenate(parts, axis=1)
