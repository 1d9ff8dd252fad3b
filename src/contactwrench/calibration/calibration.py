"""Calibration: what was identified, with its uncertainty, and what it is used for. Immutable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.arrays import Array, read_only
from ..geometry.orientation import OrientationLike, rotation_matrices
from ..geometry.rotations import spread_rotations
from ..geometry.wrench import STANDARD_GRAVITY, unit_direction
from ..model import (
    GRAVITY,
    LINEAR_PARAMETERS,
    MOUNT,
    RigidTool,
    affine_jacobian,
    free_wrench,
    gravity_in_flange,
    wrench_jacobian,
    yaw_of_mounting,
)
from ..samples.poses import Pose, PoseMoments
from ..subtract import Step, compensate, stepper
from .alternative import Alternative
from .observability import Observability

if TYPE_CHECKING:
    from .difference import Difference

ROWS_AT_ONCE = 4096
WEAK_SHARE = 0.1
"""Of the weight: a calibration whose error in the contact force is larger somewhere is weak."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated tool on a sensor.

    `requested_model`, `model`: what was asked for and what was fitted; `weight` N, `mass` kg, `com` (3,) m (sensor
    frame), `bias` (6,) N and N m, `R_flange_sensor` (3, 3), `yaw` rad (the paper's theta), `gravity_direction` (3,)
    in base axes. `B` (6, 4) gives the free wrench `B @ [r, 1]`; `B_covariance` (24, 24) of B row-major.
    `parameters` (p,) under `parameter_names`, with `covariance` (p, p); the small rotations mount_x..z and
    gravity_a..b are zero at the optimum. For `affine` weight, mass, com, R_flange_sensor and yaw are None; `paper`
    also carries `weight_xy` and `weight_z`.

    `noise` (6,) standard deviation of one pose's reading; `residual_rms` (6,); `held_out_rms` (6,) of the readings
    against the fit to the other poses, or None where no pose can be spared; `reduced_chi2` of the residuals against
    the noise that was given or that the rows' scatter explains (about 1 where neither is there, as the noise is then
    estimated from the residuals); `dof` of the variances, for Student's t (0: the noise was taken at its word).
    `poses` it was fitted on, or, beyond 10,000, their `moments`. `parameter_dof` (p,), those of each parameter, of
    which `dof` is the least. `assumptions` that `auto` made, in words, and the `alternatives`, what other models give.
    `delay` s: how much later than the orientation the wrench is stamped, and `delay_std`; None where it was not asked.
    """

    requested_model: str
    model: str
    weight: float | None
    mass: float | None
    com: Array | None
    bias: Array
    R_flange_sensor: Array | None
    yaw: float | None
    gravity_direction: Array
    B: Array
    B_covariance: Array
    parameter_names: tuple[str, ...]
    parameters: Array
    covariance: Array
    noise: Array
    residual_rms: Array
    held_out_rms: Array | None
    reduced_chi2: float
    dof: float
    observability: Observability
    warnings: tuple[str, ...]
    provenance: dict[str, Any]
    poses: tuple[Pose, ...]
    moments: PoseMoments | None = None
    weight_xy: float | None = None
    weight_z: float | None = None
    parameter_dof: Array | None = None
    assumptions: tuple[str, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    delay: float | None = None
    delay_std: float | None = None

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else read_only(value))
        object.__setattr__(self, "parameter_names", tuple(self.parameter_names))
        object.__setattr__(self, "warnings", tuple(self.warnings))
        object.__setattr__(self, "poses", tuple(self.poses))
        object.__setattr__(self, "assumptions", tuple(self.assumptions))
        object.__setattr__(self, "alternatives", tuple(self.alternatives))

    def __str__(self) -> str:
        from .text import describe, flowed

        return flowed(describe(self))

    @cached_property
    def std(self) -> dict[str, Any]:
        """Standard deviations under `weight` N, `com` (3,) m, `bias` (6,), `yaw` rad, `mount` (3,) rad about the
        sensor's axes, `gravity` (2,) rad; None for what the model does not estimate.
        """
        index = {name: k for k, name in enumerate(self.parameter_names)}
        std = np.sqrt(np.diag(self.covariance))

        def of(*names: str) -> Array | None:
            return read_only(std[[index[name] for name in names]]) if names[0] in index else None

        weight = of("weight")
        bias = of(*LINEAR_PARAMETERS[4:])
        if bias is None:
            bias = read_only(np.sqrt(np.diag(self.B_covariance)[3::4]))
        return {
            "weight": None if weight is None else float(weight[0]),
            "com": of(*LINEAR_PARAMETERS[1:4]),
            "bias": bias,
            "yaw": self._yaw_std(index),
            "mount": of(*MOUNT),
            "gravity": of(*GRAVITY),
        }

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
    def sensor_z_along_flange(self) -> bool | None:
        """Whether the sensor's z points along the flange's (True) or against it; `yaw` is counted accordingly."""
        return None if self.R_flange_sensor is None else bool(self.R_flange_sensor[2, 2] >= 0.0)

    def t_quantile(self, level: float = 0.95, dof: float | None = None) -> float:
        """How many standard deviations a two-sided interval of that level reaches (Student's t with `dof`; by default
        the fewest of any parameter).
        """
        from scipy.special import ndtri, stdtrit

        behind = self.dof if dof is None else dof
        upper = 0.5 * (1.0 + level)
        return float(stdtrit(behind, upper) if behind > 0.0 else ndtri(upper))

    def interval(self, name: str, level: float = 0.95) -> tuple[Any, Any]:
        """Lower and upper end of the two-sided interval of `weight`, `com`, `bias` or `yaw`, in their units.

        Raises `InputError` for another name, and for what the model does not estimate.
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level is {level!r}, expected between 0 and 1, as in 0.95")
        value = getattr(self, name) if name in ("weight", "com", "bias", "yaw") else None
        if value is None or self.std[name] is None:
            raise InputError(f"model {self.model} has no interval of {name!r}, expected weight, com, bias or yaw")
        quantile = [self.t_quantile(level, dof) for dof in self._dof_of(name)]
        reach = (quantile[0] if np.ndim(value) == 0 else np.array(quantile)) * self.std[name]
        return value - reach, value + reach

    def _dof_of(self, name: str) -> list[float]:
        """Degrees of freedom of the parameters that make `name`; of the yaw of a free mounting, the fewest of its."""
        parts = [k for k, parameter in enumerate(self.parameter_names) if parameter.startswith(name)]
        if self.parameter_dof is None or not parts:
            mounting = [k for k, parameter in enumerate(self.parameter_names) if parameter in MOUNT]
            if self.parameter_dof is None or not mounting:
                return [self.dof] * max(np.size(getattr(self, name)), 1)
            return [float(self.parameter_dof[mounting].min())]
        return [float(self.parameter_dof[k]) for k in parts]

    def predict(self, orientation: OrientationLike) -> Array:
        """What a free tool reads, (n, 6) or (6,), at `R_base_flange`: matrices, quaternions or a scipy Rotation."""
        R, single = rotation_matrices(orientation)
        wrench = free_wrench(self.B, gravity_in_flange(R, self.gravity_direction))
        return wrench[0] if single else wrench

    def compensate(self, wrench: ArrayLike, orientation: OrientationLike, out: Array | None = None) -> Array:
        """The contact wrench, (n, 6) or (6,), sensor axes, of readings at `R_base_flange`; see compensate.py."""
        return compensate(self.B, self.gravity_direction, wrench, orientation, out)

    def stepper(self) -> Step:
        """A function for one sample of plain floats: `step(fx, fy, fz, tx, ty, tz, qx, qy, qz, qw)`; under 1 us."""
        return stepper(self.B, self.gravity_direction)

    def wrench_covariance(self, orientation: OrientationLike) -> Array:
        """Covariance (n, 6, 6) or (6, 6) of the free wrench, and so of a contact wrench, from the calibration alone."""
        R, single = rotation_matrices(orientation)
        J = self.free_wrench_jacobian(R)
        covariance: Array = J @ self.covariance @ J.transpose(0, 2, 1)
        return covariance[0] if single else covariance

    def wrench_std(self, orientation: OrientationLike) -> Array:
        """Standard deviation (n, 6) or (6,) of a contact wrench from the calibration alone, N and N m."""
        R, single = rotation_matrices(orientation)
        variance = np.empty((len(R), 6))
        for start in range(0, len(R), ROWS_AT_ONCE):
            J = self.free_wrench_jacobian(R[start : start + ROWS_AT_ONCE])
            variance[start : start + ROWS_AT_ONCE] = np.sum((J @ self.covariance) * J, axis=2)
        std: Array = np.sqrt(np.maximum(variance, 0.0))
        return std[0] if single else std

    def free_wrench_jacobian(self, R_base_flange: Array) -> Array:
        """Derivative (n, 6, p) of the free wrench with respect to `parameters`, at orientations (n, 3, 3)."""
        if self.weight is None or self.com is None or self.R_flange_sensor is None:
            return affine_jacobian(gravity_in_flange(R_base_flange, self.gravity_direction))
        tool = RigidTool(self.weight, self.com, self.bias, self.R_flange_sensor, self.gravity_direction)
        return wrench_jacobian(tool, R_base_flange, self.parameter_names)

    @cached_property
    def largest_std(self) -> tuple[float, float]:
        """The largest standard deviation over all orientations of the contact force (N) and torque (N m), each the
        root of the summed variances of its three axes; over a dense set of orientations, within 1 %.
        """
        std = self.wrench_std(spread_rotations(288, 24))
        force, torque = np.linalg.norm(std[:, :3], axis=1), np.linalg.norm(std[:, 3:], axis=1)
        return float(force.max()), float(torque.max())

    @property
    def verdict(self) -> str:
        """In one sentence, how good the contact wrench is because of this calibration."""
        force, torque = self.largest_std
        scale = float(np.linalg.norm(self.B[:3, :3], 2))
        weak = force > WEAK_SHARE * scale or any(warning.startswith("weak") for warning in self.warnings)
        quality = "weak" if weak else "good"
        force, torque = float(f"{force:.2g}"), float(f"{1e3 * torque:.2g}")
        return (
            f"{quality}: at any orientation the calibration's error in the contact wrench has a std of at most "
            f"{force:g} N and {torque:g} mN m"
        )

    def with_gravity(self, gravity: Array | None) -> Calibration:
        """The calibration for a base in which gravity has another direction (3,), known exactly; None: as it is."""
        if gravity is None:
            return self
        d = unit_direction(gravity)
        keep = [k for k, name in enumerate(self.parameter_names) if name not in GRAVITY]
        return replace(
            self,
            gravity_direction=d,
            parameter_names=tuple(self.parameter_names[k] for k in keep),
            parameters=self.parameters[keep],
            covariance=self.covariance[np.ix_(keep, keep)],
            parameter_dof=None if self.parameter_dof is None else self.parameter_dof[keep],
            model="mount" if self.model == "mount+base" else self.model,
        )

    def diff(self, other: Calibration) -> Difference:
        """What changed from this calibration to `other`, with the standard deviation of each change."""
        from .difference import difference

        return difference(self, other)

    def save(self, path: str | Path) -> None:
        """Write the calibration as JSON (design: section 6). Raises `FileAccessError`; never a partial file."""
        from .file import save

        save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a calibration file. Raises `FileAccessError` and `FileFormatError`, naming what is wrong with it."""
        from .file import load

        return load(path)


_ARRAYS = (
    "com",
    "bias",
    "R_flange_sensor",
    "gravity_direction",
    "B",
    "B_covariance",
    "parameters",
    "covariance",
    "noise",
    "residual_rms",
    "held_out_rms",
    "parameter_dof",
)
