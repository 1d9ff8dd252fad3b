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
    """A calibrated tool on a sensor: what was identified, with its uncertainty. Made by `calibrate` or `load`.

    Attributes:
        requested_model: what was asked for.
        model: what was fitted.
        weight: N; None for `affine`, and so are mass, com, R_flange_sensor and yaw.
        mass: kg, the weight over `g`.
        com: centre of mass (3,), m, sensor axes.
        bias: reading without any load (6,), N and N m, sensor axes.
        R_flange_sensor: the mounting (3, 3), from sensor to flange axes.
        yaw: rad, the paper's theta, about the sensor's z.
        gravity_direction: unit vector (3,), base axes.
        B: (6, 4), N and N m; the free wrench is `B @ [r, 1]` with `r = R_base_flange.T @ gravity_direction`.
        B_covariance: of B row by row, (24, 24).
        parameter_names: p of them, in the order of every covariance.
        parameters: (p,); the small rotations mount_x..z and gravity_a..b, rad, are zero at the optimum.
        covariance: of the parameters, (p, p).
        noise: standard deviation of one pose's reading (6,), N and N m.
        residual_rms: of the poses used (6,), N and N m.
        held_out_rms: of each pose against the fit to the others (6,), N and N m; None where none can be spared.
        reduced_chi2: of the residuals, against the noise given or the rows' scatter; about 1 where neither is there.
        dof: degrees of freedom for Student's t, the least of `parameter_dof`; 0 where the noise was taken at its word.
        observability: rank, singular values, condition, tilt range (rad), and what trades off with what.
        warnings: in words.
        provenance: program, source, rows, g, options of reading, time.
        poses: used and left out; empty beyond 10,000.
        moments: sums that stand for the poses beyond 10,000.
        weight_xy: N, of `paper`: from fx and fy.
        weight_z: N, of `paper`: from fz.
        parameter_dof: degrees of freedom of each parameter's variance (p,).
        assumptions: of `auto`, in words.
        alternatives: what other models make of the same poses.
        delay: s, of the wrench's stamps behind the orientation's; None where it was not estimated.
        delay_std: s.
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
        """How many standard deviations a two-sided interval reaches, by Student's t.

        Args:
            level: probability that it holds the truth.
            dof: degrees of freedom; None: the fewest of any parameter.

        Returns:
            Standard deviations.
        """
        from scipy.special import ndtri, stdtrit

        behind = self.dof if dof is None else dof
        upper = 0.5 * (1.0 + level)
        return float(stdtrit(behind, upper) if behind > 0.0 else ndtri(upper))

    def interval(self, name: str, level: float = 0.95) -> tuple[Any, Any]:
        """Two-sided interval of a parameter.

        Args:
            name: `weight`, `com`, `bias` or `yaw`.
            level: probability that it holds the truth.

        Returns:
            Its lower and upper end, with the shape and unit of the parameter.

        Raises:
            InputError: another name, or what the model does not estimate.
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
        """What a free tool reads.

        Args:
            orientation: `R_base_flange`: matrices (n, 3, 3), quaternions x, y, z, w (n, 4), or a scipy Rotation.

        Returns:
            Free wrench (n, 6), N and N m, sensor axes; (6,) of a single orientation.

        Raises:
            InputError: a wrong shape, or what is no rotation.
        """
        R, single = rotation_matrices(orientation)
        wrench = free_wrench(self.B, gravity_in_flange(R, self.gravity_direction))
        return wrench[0] if single else wrench

    def compensate(self, wrench: ArrayLike, orientation: OrientationLike, out: Array | None = None) -> Array:
        """What is left of readings without the tool's weight and the bias.

        Args:
            wrench: readings (n, 6) or (6,), N and N m, sensor axes, pull sign.
            orientation: `R_base_flange` of each, or one for all: as of `predict`.
            out: where to write; may be `wrench` itself.

        Returns:
            Contact wrench (n, 6) or (6,), N and N m, sensor axes, about the sensor's origin.

        Raises:
            InputError: shapes that do not pair, or what is no rotation.
        """
        return compensate(self.B, self.gravity_direction, wrench, orientation, out)

    def stepper(self) -> Step:
        """A function for one sample of plain floats, under 1 us.

        Returns:
            `step(fx, fy, fz, tx, ty, tz, qx, qy, qz, qw)`, which gives the contact wrench as six floats.
        """
        return stepper(self.B, self.gravity_direction)

    def wrench_covariance(self, orientation: OrientationLike) -> Array:
        """Covariance of a contact wrench from the calibration alone.

        Args:
            orientation: `R_base_flange`, as of `predict`.

        Returns:
            (n, 6, 6) or (6, 6), in N and N m squared, sensor axes.
        """
        R, single = rotation_matrices(orientation)
        J = self.free_wrench_jacobian(R)
        covariance: Array = J @ self.covariance @ J.transpose(0, 2, 1)
        return covariance[0] if single else covariance

    def wrench_std(self, orientation: OrientationLike) -> Array:
        """Standard deviation of a contact wrench from the calibration alone.

        Args:
            orientation: `R_base_flange`, as of `predict`.

        Returns:
            (n, 6) or (6,), N and N m, sensor axes.
        """
        R, single = rotation_matrices(orientation)
        variance = np.empty((len(R), 6))
        for start in range(0, len(R), ROWS_AT_ONCE):
            J = self.free_wrench_jacobian(R[start : start + ROWS_AT_ONCE])
            variance[start : start + ROWS_AT_ONCE] = np.sum((J @ self.covariance) * J, axis=2)
        std: Array = np.sqrt(np.maximum(variance, 0.0))
        return std[0] if single else std

    def free_wrench_jacobian(self, R_base_flange: Array) -> Array:
        """Derivative of the free wrench with respect to `parameters`.

        Args:
            R_base_flange: matrices (n, 3, 3).

        Returns:
            (n, 6, p), sensor axes.
        """
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
        """The calibration for a base in which gravity has another direction, known exactly.

        Args:
            gravity: direction (3,), base axes; None: as it is.

        Returns:
            The same tool, mounting and bias.
        """
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
        """What changed from this calibration to `other`.

        Args:
            other: of the same sensor, later.

        Returns:
            The changes, each with its standard deviation, and what they mean; print it.
        """
        from .difference import difference

        return difference(self, other)

    def save(self, path: str | Path) -> None:
        """Write the calibration as JSON; never a partial file.

        Args:
            path: of the file, which is replaced.

        Raises:
            FileAccessError: it cannot be written.
        """
        from .file import save

        save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read a calibration file.

        Args:
            path: what `save` wrote.

        Returns:
            The calibration, every number as it was.

        Raises:
            FileAccessError: the file cannot be opened.
            FileFormatError: it is no calibration; the message names what is wrong with it.
        """
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
