"""Calibration: what was identified, with its uncertainty, and what it is used for. Immutable."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.arrays import Array, number
from ..geometry.orientation import OrientationLike, rotation_matrices
from ..geometry.wrench import unit_direction
from ..model import GRAVITY, MOUNT, Step, free_wrench, gravity_in_flange, horizontal_axes, stepper
from ..samples.flange_motion import FlangeMotion
from ..subtract import compensate
from .difference import Difference, difference
from .dynamics import elements, require_same_place
from .fields import INTERVALS, CalibrationFields
from .text import describe, flowed


@dataclass(frozen=True, eq=False)
class Calibration(CalibrationFields):
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
        findings: what there is to say beside the numbers, each with its kind and severity.
        warnings: their texts.
        provenance: program, source, rows, g, options of reading, time.
        poses: used and left out; empty beyond 10,000.
        moments: sums that stand for the poses beyond 10,000.
        weight_xy: N, of `paper`: from fx and fy; `weight_z` from fz.
        parameter_dof: degrees of freedom of each parameter's variance (p,).
        assumptions: of `auto`, in words.
        alternatives: what other models make of the same poses.
        delay: s, of the wrench's stamps behind the orientation's; None where it was not estimated.
        delay_std: s.
        gain_covariance: (24, 24), what gain and cross-talk add to that of B; None where nothing speaks for them.
        orientation_std: rad an axis, by which the robot's orientations are off; None where nothing speaks for it.
        still_noise: of means over 10 ms to 1 s at rest; None where the poses came without.
        dynamics: inertia (3, 3) kg m^2 and sensor offset (3,) m with their covariance; None but of `dynamic`.
    """

    def __str__(self) -> str:
        return flowed(describe(self))

    def __repr__(self) -> str:
        return f"<Calibration: {self.model}, {len(self.poses)} poses, {self.verdict}; print it>"

    def t_quantile(self, level: float = 0.95, dof: float | None = None) -> float:
        """How many standard deviations a two-sided interval reaches, by Student's t.

        Args:
            level: probability that it holds the truth.
            dof: degrees of freedom; None: the fewest of any parameter.

        Returns:
            Standard deviations.

        Raises:
            InputError: a level that is no probability.
        """
        from scipy.special import ndtri, stdtrit

        if not 0.0 < number(level, "level") < 1.0:
            raise InputError(f"level is {level!r}, expected between 0 and 1, as in 0.95")
        behind = self.dof if dof is None else dof
        upper = 0.5 * (1.0 + level)
        return float(stdtrit(behind, upper) if behind > 0.0 else ndtri(upper))

    def interval(self, name: str, level: float = 0.95) -> tuple[Any, Any]:
        """Two-sided interval of a parameter.

        Args:
            name: `weight`, `com`, `bias`, `yaw`, `inertia` or `sensor_offset`.
            level: probability that it holds the truth.

        Returns:
            Its lower and upper end, with the shape and unit of `std[name]`: (6,) of the inertia, xx xy xz yy yz zz.

        Raises:
            InputError: another name, what the model does not estimate, or a level that is no probability.
        """
        value = getattr(self, name) if name in INTERVALS else None
        if value is None or self.std[name] is None:
            raise InputError(f"model {self.model} has no interval of {name!r}, expected one of {', '.join(INTERVALS)}")
        value = elements(value) if name == "inertia" else value
        quantile = [self.t_quantile(level, dof) for dof in self._dof_of(name)]
        reach = (quantile[0] if np.ndim(value) == 0 else np.array(quantile)) * self.std[name]
        return value - reach, value + reach

    def _dof_of(self, name: str) -> list[float]:
        """Of the parameters that make `name`; the fewest of a free mounting's for its yaw, of any for the inertia."""
        made_of = MOUNT if name == "yaw" and "yaw" not in self.parameter_names else name
        parts = [k for k, parameter in enumerate(self.parameter_names) if parameter.startswith(made_of)]
        if self.parameter_dof is None or not parts:
            return [self.dof]
        dof: list[float] = self.parameter_dof[parts].tolist()
        return [min(dof)] if made_of is MOUNT else dof

    def predict(self, orientation: OrientationLike) -> Array:
        """What a free tool reads.

        Args:
            orientation: `R_base_flange`: matrices (n, 3, 3), quaternions x, y, z, w (n, 4), Rotation; (b, n, ...) too.

        Returns:
            Free wrench (n, 6), N and N m, sensor axes; (6,) of a single orientation, (b, n, 6) of a batch.

        Raises:
            InputError: a wrong shape, or what is no rotation.
        """
        R, leading = rotation_matrices(orientation)
        return free_wrench(self.B, gravity_in_flange(R, self.gravity_direction)).reshape(*leading, 6)

    def compensate(
        self,
        wrench: ArrayLike,
        orientation: OrientationLike,
        out: Array | None = None,
        motion: FlangeMotion | None = None,
    ) -> Array:
        """What is left of readings without the tool's weight and the bias, and in motion without its inertia.

        Args:
            wrench: readings (n, 6), (6,), or (b, n, 6) of a batch, N and N m, sensor axes, pull sign.
            orientation: `R_base_flange` of each, or one for all: as of `predict`.
            out: where to write; may be `wrench` itself.
            motion: of the flange at the moments of the n readings; None: it is at rest.

        Returns:
            Contact wrench, shaped as `wrench`, N and N m, sensor axes, about the sensor's origin.

        Raises:
            InputError: shapes that do not pair, what is no rotation, or a motion and no inertia.
        """
        matrix = self.B
        if motion is not None:
            if self.dynamics is None:
                raise InputError("found a motion and no inertia: calibrate with model dynamic, or leave the motion out")
            require_same_place(self.dynamics, motion)
            matrix = np.hstack([self.B, self.dynamics.matrix])
        return compensate(matrix, self.gravity_direction, wrench, orientation, out, motion)

    def stepper(self) -> Step:
        """A function for one sample of plain floats, under 1 us.

        Returns:
            `step(fx, fy, fz, tx, ty, tz, qx, qy, qz, qw)`: the contact wrench, six floats; the length of q counts as 1.
        """
        return stepper(self.B, self.gravity_direction)

    def wrench_covariance(self, orientation: OrientationLike) -> Array:
        """Covariance of a contact wrench from the calibration alone.

        Args:
            orientation: `R_base_flange`, as of `predict`.

        Returns:
            (n, 6, 6), (6, 6) or (..., 6, 6), in N and N m squared, sensor axes.
        """
        R, leading = rotation_matrices(orientation)
        J = self.error_jacobian(R)
        return np.asarray((J @ self.error_covariance @ J.transpose(0, 2, 1)).reshape(*leading, 6, 6))

    def with_gravity(self, gravity: ArrayLike | None) -> Calibration:
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
            dynamics=None
            if (moving := self.dynamics) is None
            else replace(moving, with_parameters=moving.with_parameters[:, keep]),
            model="mount" if self.model == "mount+base" else self.model,
        )

    def with_base(self, R_new_base: Array, base_frame: str) -> Calibration:
        """The calibration for orientations that are stated in another base.

        Args:
            R_new_base: (3, 3), from the axes of this one's base to those of the new one.
            base_frame: the new one's name.

        Returns:
            The same tool, mounting and bias; gravity, with its covariance, and the poses in the new base's axes.

        Raises:
            InputError: what is no rotation.
        """
        (R_new_base, *others), _ = rotation_matrices(R_new_base)
        if others:
            raise InputError(f"R_new_base has {1 + len(others)} orientations, expected one")
        d = R_new_base @ self.gravity_direction
        to_new = np.eye(len(self.parameters))
        if self.std["gravity"] is not None:
            axes, new_axes = (np.stack(horizontal_axes(down), axis=1) for down in (self.gravity_direction, d))
            places = [self.parameter_names.index(name) for name in GRAVITY]
            to_new[np.ix_(places, places)] = new_axes.T @ R_new_base @ axes
        of_rows = np.eye(10)
        of_rows[:9, :9] = np.kron(R_new_base, np.eye(3))
        sums = self.moments
        return replace(
            self,
            gravity_direction=d,
            covariance=to_new @ self.covariance @ to_new.T,
            dynamics=self.dynamics and replace(self.dynamics, with_parameters=self.dynamics.with_parameters @ to_new.T),
            poses=tuple(replace(pose, R_base_flange=R_new_base @ pose.R_base_flange) for pose in self.poses),
            moments=sums and replace(sums, design=of_rows @ sums.design @ of_rows.T, cross=of_rows @ sums.cross),
            alternatives=tuple(
                replace(other, gravity_direction=R_new_base @ other.gravity_direction) for other in self.alternatives
            ),
            provenance={**self.provenance, "base_frame": base_frame},
        )

    def diff(self, other: Calibration) -> Difference:
        """What changed from this calibration to `other`.

        Args:
            other: of the same sensor, later.

        Returns:
            The changes, each with its standard deviation; the command `diff` says what they mean.

        Raises:
            InputError: what is no calibration.
        """
        if not isinstance(other, CalibrationFields):
            raise InputError(f"other is a {type(other).__name__}, expected a Calibration: Calibration.load(path)")
        return difference(self, other)

    def save(self, path: str | Path) -> None:
        """Write the calibration as JSON; never a partial file.

        Args:
            path: of the file; one that is there is replaced, as nobody is asked in a script.

        Raises:
            FileAccessError: it cannot be written.
        """
        from ..files import write_text
        from .file import to_json

        write_text(path, to_json(self))

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

        return load(path, cls)
