"""What a calibration holds: its numbers, what was found on the way to them, and how good they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen, Matrix, ReadOnlyDict, Vector, frozen, read_only, shaped
from ..geometry.orientation import OrientationLike, rotation_matrices
from ..geometry.rotations import spread_rotations
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import (
    GRAVITY,
    LINEAR_PARAMETERS,
    MOUNT,
    PARAMETERS,
    RigidTool,
    affine_jacobian,
    free_wrench,
    gravity_in_flange,
    matrix_jacobian,
    response_of,
    wrench_jacobian,
    yaw_of_mounting,
)
from ..samples.flange_motion import FlangeMotion
from ..samples.poses import Pose, PoseMoments
from ..samples.still_noise import StillNoise
from ..statistics import square_root
from .alternative import Alternative
from .dynamics import Dynamics, Ellipsoid, covariance_in_motion, equal_ellipsoid
from .findings import DOUBT_OF_KIND, Doubt, Finding, Severity, WithFindings
from .observability import Observability

ROWS_AT_ONCE = 4096
INTERVALS = ("weight", "com", "bias", "yaw", "inertia", "sensor_offset")
"""Of `std`, what has a value beside it."""


@dataclass(frozen=True, eq=False)
class CalibrationFields(Frozen, WithFindings):
    """The fields of a `Calibration`, which says what each of them is, and what follows from them alone."""

    requested_model: str
    model: str
    weight: float | None
    mass: float | None
    com: Vector | None = field(metadata=shaped(3))
    bias: Vector = field(metadata=shaped(6))
    R_flange_sensor: Matrix | None = field(metadata=shaped(3, 3))
    yaw: float | None
    gravity_direction: Vector = field(metadata=shaped(3))
    B: Matrix = field(metadata=shaped(6, 4))
    B_covariance: Matrix = field(metadata=shaped(24, 24))
    parameter_names: tuple[str, ...]
    parameters: Vector = field(metadata=shaped("p"))
    covariance: Matrix = field(metadata=shaped("p", "p"))
    noise: Vector = field(metadata=shaped(6))
    residual_rms: Vector = field(metadata=shaped(6, least=0.0))
    held_out_rms: Vector | None = field(metadata=shaped(6, least=0.0))
    reduced_chi2: float
    dof: float
    observability: Observability
    findings: tuple[Finding, ...]
    provenance: dict[str, str | int | float | bool | None]
    poses: tuple[Pose, ...]
    moments: PoseMoments | None
    weight_xy: float | None
    weight_z: float | None
    parameter_dof: Vector | None = field(default=None, metadata=shaped("p", least=0.0))
    assumptions: tuple[str, ...] = ()
    alternatives: Sequence[Alternative] = ()
    delay: float | None = None
    delay_std: float | None = None
    still_noise: StillNoise | None = None
    gain_covariance: Matrix | None = field(default=None, metadata=shaped(24, 24))
    dynamics: Dynamics | None = None
    orientation_std: float | None = None

    @cached_property
    def std(self) -> dict[str, Any]:
        """Standard deviations under `weight` N, `com` (3,) m, `bias` (6,), `yaw` rad, `mount` (3,) rad about the
        sensor's axes, `gravity` (2,) rad, `inertia` (6,) kg m^2 (xx xy xz yy yz zz), `sensor_offset` (3,) m; None for
        what the model does not estimate.
        """
        index = {name: k for k, name in enumerate(self.parameter_names)}
        std = np.sqrt(np.diag(self.covariance))

        def of(*names: str) -> Array | None:
            return std[[index[name] for name in names]] if names[0] in index else None

        of_B = np.sqrt(np.diag(self.B_covariance)[3::4])
        return ReadOnlyDict(
            weight=float(std[index["weight"]]) if "weight" in index else None,
            com=frozen(of(*LINEAR_PARAMETERS[1:4])),
            bias=frozen(of(*LINEAR_PARAMETERS[4:]) if "weight" in index else of_B),
            yaw=self._yaw_std(index),
            mount=frozen(of(*MOUNT)),
            gravity=frozen(of(*GRAVITY)),
            inertia=None if self.dynamics is None else self.dynamics.std[:6],
            sensor_offset=None if self.dynamics is None else self.dynamics.std[6:],
        )

    @property
    def inertia(self) -> Array | None:
        """(3, 3), kg m^2, about the centre of mass, sensor axes, its `std` (6,); None of a calibration of poses."""
        return None if self.dynamics is None else self.dynamics.inertia

    @property
    def sensor_offset(self) -> Array | None:
        """Where the sensor's origin is (3,), m from the flange's, flange axes; None of a calibration of poses."""
        return None if self.dynamics is None else self.dynamics.sensor_offset

    @property
    def ellipsoid(self) -> Ellipsoid | None:
        """The uniform one of the tool's mass and inertia; None of a calibration of poses, and of a mass below zero."""
        if self.dynamics is None or self.mass is None or self.mass <= 0.0:
            return None
        weight = self.parameter_names.index("weight")
        covariance = np.empty((7, 7))
        covariance[0, 0] = self.covariance[weight, weight] / self.g**2
        covariance[0, 1:] = covariance[1:, 0] = self.dynamics.with_parameters[:6, weight] / self.g
        covariance[1:, 1:] = self.dynamics.covariance[:6, :6]
        return equal_ellipsoid(self.mass, self.dynamics.inertia, covariance)

    def _yaw_std(self, index: dict[str, int]) -> float | None:
        if "yaw" in index:
            return float(np.sqrt(self.covariance[index["yaw"], index["yaw"]]))
        if self.R_flange_sensor is None:
            return None
        first = index[MOUNT[0]]
        _, _, derivative = yaw_of_mounting(self.R_flange_sensor)
        return float(np.sqrt(derivative @ self.covariance[first : first + 3, first : first + 3] @ derivative))

    @property
    def g(self) -> float:
        """m/s^2: what turned the weight into the mass; standard gravity where nothing says."""
        stated = self.provenance.get("g")
        if isinstance(stated, float) and 0.0 < stated < np.inf:
            return stated
        return self.weight / self.mass if self.weight is not None and self.mass is not None else STANDARD_GRAVITY

    @property
    def first_time(self) -> float:
        """The recording's first time, s, from which the times that people see are counted; 0 where nothing says."""
        stated = self.provenance.get("t_first")
        return stated if isinstance(stated, float) and np.isfinite(stated) else 0.0

    @property
    def fitted_poses(self) -> tuple[Pose, ...]:
        """The poses that were not left out."""
        return tuple(pose for pose in self.poses if pose.rejected is None)

    @property
    def left_of_poses(self) -> Array | None:
        """RMS (6,), N and N m, of what the free wrench leaves of the `fitted_poses`, a bias that moved among it."""
        if self.moments is not None:
            to_wrench = np.column_stack([response_of(self.B[:, :3], self.gravity_direction), self.B[:, 3]])
            squares = self.moments.squares_left(to_wrench)
        elif poses := self.fitted_poses:
            r = gravity_in_flange(np.array([pose.R_base_flange for pose in poses]), self.gravity_direction)
            squares = np.mean((np.array([pose.wrench for pose in poses]) - free_wrench(self.B, r)) ** 2, axis=0)
        else:
            return None
        return np.asarray(np.sqrt(squares))

    @property
    def sensor_z_along_flange(self) -> bool | None:
        """Whether the sensor's z points along the flange's (True) or against it; `yaw` is counted accordingly."""
        return None if self.R_flange_sensor is None else bool(self.R_flange_sensor[2, 2] >= 0.0)

    def wrench_std(self, orientation: OrientationLike, motion: FlangeMotion | None = None) -> Array:
        """Standard deviation of a contact wrench from the calibration alone.

        Args:
            orientation: `R_base_flange`, as of `predict`.
            motion: as of `compensate`; what drives and links shake counts too.

        Returns:
            (n, 6), (6,) or (..., 6), N and N m, sensor axes.
        """
        R, leading = rotation_matrices(orientation)
        variance = np.empty((len(R), 6))
        for start in range(0, len(R), ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            variance[rows] = (self._variance_forms @ _products(R[rows])).T
            if motion is not None:
                variance[rows] += np.einsum("nii->ni", covariance_in_motion(self, R[rows], motion.select(rows)))
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)).reshape(*leading, 6))

    def covariance_in_motion(self, R_base_flange: Array, motion: FlangeMotion) -> Array:
        """What a motion adds to the covariance (n, 6, 6) of contact wrenches at orientations (n, 3, 3)."""
        return covariance_in_motion(self, R_base_flange, motion)

    @property
    def error_names(self) -> tuple[str, ...]:
        """What the errors of the free wrench are made of: the parameters; with gain and cross-talk B and rotations."""
        return self.parameter_names if self.gain_covariance is None else (*PARAMETERS["affine"], *self._rotations)

    @property
    def _rotations(self) -> tuple[str, ...]:
        return tuple(name for name in self.parameter_names if name not in LINEAR_PARAMETERS)

    @cached_property
    def error_covariance(self) -> Array:
        """Covariance of `error_names`."""
        if self.gain_covariance is None or self.rigid_tool is None:
            return self.covariance
        turns = self._rotations
        to_errors = np.zeros((24 + len(turns), len(self.parameter_names)))
        to_errors[:24] = matrix_jacobian(self.rigid_tool, self.parameter_names)
        to_errors[24:, [self.parameter_names.index(name) for name in turns]] = np.eye(len(turns))
        total = to_errors @ self.covariance @ to_errors.T
        unit = np.sqrt(np.diag(total) + 1e-30)
        unit[:24] = np.hypot(unit[:24], np.sqrt(np.abs(np.diag(self.gain_covariance))))
        total[:24, :24] += self.gain_covariance
        root = square_root(total / np.outer(unit, unit)) * unit[:, None]  # a mean of several: not quite positive
        return read_only(root @ root.T)

    def error_jacobian(self, R_base_flange: Array) -> Array:
        """Derivative (n, 6, ...) of the free wrench with respect to `error_names`, for orientations (n, 3, 3)."""
        J = self.free_wrench_jacobian(R_base_flange)
        if self.gain_covariance is None:
            return J
        of_turns = J[:, :, [self.parameter_names.index(name) for name in self._rotations]].copy()
        of_turns[:, :, [name not in GRAVITY for name in self._rotations]] = 0.0  # the mounting's are in B
        of_B = affine_jacobian(gravity_in_flange(R_base_flange, self.gravity_direction))
        return np.concatenate([of_B, of_turns], axis=2)

    def free_wrench_jacobian(self, R_base_flange: Array) -> Array:
        """Derivative (n, 6, p) of the free wrench with respect to `parameters`, for orientations (n, 3, 3)."""
        if self.rigid_tool is None:
            return affine_jacobian(gravity_in_flange(R_base_flange, self.gravity_direction))
        return wrench_jacobian(self.rigid_tool, R_base_flange, self.parameter_names)

    @cached_property
    def rigid_tool(self) -> RigidTool | None:
        """Weight, centre of mass, bias, mounting and gravity in one; None of `affine`."""
        if self.weight is None or self.com is None or self.R_flange_sensor is None:
            return None
        return RigidTool(self.weight, self.com, self.bias, self.R_flange_sensor, self.gravity_direction)

    @cached_property
    def _variance_forms(self) -> Array:
        """Of each axis its quadratic form (6, 55) in 1 and the entries of R_base_flange: the free wrench is linear."""
        J = self.error_jacobian(np.eye(10, 9, -1).reshape(10, 3, 3))
        J[1:] -= J[0]
        forms = (J @ self.error_covariance).transpose(1, 0, 2) @ J.transpose(1, 2, 0)
        return np.asarray((forms + forms.transpose(0, 2, 1) * (1.0 - np.eye(10)))[:, *np.triu_indices(10)])

    @cached_property
    def largest_std(self) -> tuple[float, float]:
        """The largest std over all orientations, within 1 %, of contact force (N) and torque (N m), each a norm."""
        of_groups = (self._variance_forms @ _products_everywhere()).T.reshape(-1, 2, 3).sum(axis=2)
        return float(np.sqrt(of_groups[:, 0].max())), float(np.sqrt(of_groups[:, 1].max()))

    @property
    def expected_error(self) -> tuple[float, float]:
        """The error of the contact force (N) and torque (N m) to expect at a new orientation, each a norm over three
        axes: the largest std, and what poses differ by beyond the model, which no number of poses averages away.
        """
        force, torque = np.hypot(self.largest_std, np.linalg.norm(self.noise.reshape(2, 3), axis=1)).tolist()
        return force, torque

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Why the verdict is doubtful: each reason once."""
        kinds = [finding.kind for finding in self.findings if finding.severity is Severity.DOUBTFUL]
        return tuple(dict.fromkeys(DOUBT_OF_KIND.get(kind, Doubt.MODEL) for kind in kinds))

    @property
    def verdict(self) -> str:
        """`good`, `doubtful` or `weak`, by the severities of the findings."""
        if any(finding.severity is Severity.WEAK for finding in self.findings):
            return "weak"
        return "doubtful" if self.doubts else "good"


def _products(R_base_flange: Array) -> Array:
    """Of any two of 1 and the entries (55, n) of orientations (n, 3, 3)."""
    entries = np.vstack([np.ones(len(R_base_flange)), R_base_flange.reshape(-1, 9).T])
    one, other = np.triu_indices(10)
    return np.asarray(entries[one] * entries[other])


@cache
def _products_everywhere() -> Array:
    """Of orientations that are spread evenly: most of the time to load a calibration is to make these."""
    return read_only(_products(spread_rotations(288, 24)))


def require_calibration(calibration: object) -> None:
    """Raise `InputError` for what is none, as the name of its file is."""
    if not isinstance(calibration, CalibrationFields):
        raise InputError(f"found {type(calibration).__name__}, expected a Calibration: cw.Calibration.load(path)")
