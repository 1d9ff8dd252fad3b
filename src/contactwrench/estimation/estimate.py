"""What an estimator hands on: one type for all models, and one for those that have a tool."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import Kind
from ..geometry.arrays import Array
from ..model import RigidTool, weight_scale
from .bias_drift import Drift


@dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """In the terms of `Calibration`: parameters `names` (p), their `covariance` and the `dof` (p,) behind each std; `B`
    and its covariance; `noise` (6,) of a pose's reading.

    `kept` (n,) which poses took part; `errors` (n, 6) N and N m, what is left of all readings, known changes of the
    bias taken out; `held_out` (m, 6) what each pose kept is off the fit to the others, None where these are too few;
    `reduced_chi2` against the noise that is known; `readings_left` of forces and of torques (2,), degrees of freedom;
    `singular_values` (p,) of the whitened Jacobian with columns of unit length, largest first.
    """

    names: tuple[str, ...]
    gravity_direction: Array
    B: Array
    B_covariance: Array
    covariance: Array
    noise: Array
    dof: Array
    kept: NDArray[np.bool_]
    errors: Array
    held_out: Array | None
    reduced_chi2: float
    readings_left: Array
    singular_values: Array

    def with_noise_of(self, other: Estimate) -> Self:
        """The same with the noise of `other`, from the same readings less what all of them may be off alike by."""
        return replace(self, noise=other.noise, reduced_chi2=other.reduced_chi2)

    @property
    def residuals(self) -> Array:
        """Of the poses kept, (m, 6)."""
        return self.errors[self.kept]

    @property
    def beyond_robot(self) -> Array:
        """The same less what errors of the robot's orientation are known to make of it."""
        return self.residuals

    @property
    def bias_moved(self) -> bool:
        """Whether that is likelier than not."""
        return False

    @property
    def weight_scale(self) -> float:
        """As in the model, N."""
        return weight_scale(self.B)

    @property
    def force_left(self) -> float:
        """RMS norm (N) of what is left of the force in a pose, degrees of freedom counted."""
        freedom = max(float(self.readings_left.sum()) / 6.0, 0.5)
        return float(np.sqrt(np.sum(self.residuals[:, :3] ** 2) / freedom))

    @property
    def force_missed(self) -> float:
        """RMS norm (N) of what the other poses miss of the force in one; 0 where these are too few."""
        return 0.0 if self.held_out is None else float(np.sqrt(np.mean(np.sum(self.held_out[:, :3] ** 2, axis=1))))

    @property
    def torque_left(self) -> float:
        """RMS norm (N m) of what is left of the torque in a pose, degrees of freedom counted."""
        freedom = max(float(self.readings_left.sum()) / 6.0, 0.5)
        return float(np.sqrt(np.sum(self.residuals[:, 3:] ** 2) / freedom))


IN_DOUBT = 1.0 / 20.0
"""Probability of a rival from which on a decision is in doubt."""

DECIDES, DECIDES_BY_FAR = 2.0, 3.5
"""Standard deviations by which the answer is off in a rival's case, from which on the rival matters; the second where
it is unlikely."""

EXCLUDED = 1.0 / 500.0
"""The same where the rival's answer is so far off that a decision against it would be a confident error."""


@dataclass(frozen=True, eq=False)
class Rival:
    """A `drift` of the bias that is not the likeliest cause of what the poses differ by, its `probability`, and by how
    many std the weight, com or bias would be `off`.
    """

    drift: Drift
    probability: float
    off: float

    @property
    def decides(self) -> float:
        """From 1 on it matters: by how many times it is further off than a rival of that probability may be."""
        return self.off / (DECIDES if self.probability > IN_DOUBT else DECIDES_BY_FAR)


@dataclass(frozen=True, eq=False, kw_only=True)
class Beliefs:
    """Probabilities once the readings are known: that each pose is `outlying` (n,); of each kind of the bias' motion,
    `moved`, of which `drift` is the likeliest, by `change` (n, 6) N and N m from the last bias; of each kind of
    error that goes `with_orientation`, two levels among them, by which the bias is off their middle, `backlash` (n,
    6), and the robot's turns of about `turn` rad an axis; that mounting and base are exactly nominal,
    `mounting_exact`, `base_exact` and `both_exact`, or point anywhere, `any_mounting` and `any_base`. By how many
    std the answer would be off, were the less likely of exactly nominal or not so, `off_by_mounting` and
    `off_by_base`; 0 where that one is excluded; the drift, not excluded, in whose case it would be so far off that
    it decides most, `furthest`.
    """

    outlying: Array
    moved: dict[Kind, float]
    drift: Drift | None
    change: Array
    with_orientation: dict[Kind, float]
    backlash: Array
    turn: float
    mounting_exact: float
    base_exact: float
    both_exact: float
    off_by_mounting: float
    off_by_base: float
    furthest: Rival | None
    any_mounting: float
    any_base: float


@dataclass(frozen=True, eq=False, kw_only=True)
class RigidEstimate(Estimate):
    """An estimate of a rigid tool; the paper's has its two weights, N, the others what is believed of the rest, and the
    covariance (24, 24) that gain and cross-talk add to that of B; what the robot's errors in orientation are known to
    make of all readings, `of_robot` (n, 6).
    """

    tool: RigidTool
    beliefs: Beliefs | None = None
    gain_covariance: Array | None = None
    of_robot: Array | None = None
    weight_xy: float | None = None
    weight_z: float | None = None

    @property
    def orientation_std(self) -> float | None:
        """Rad an axis by which the robot's orientations are likely off, None where they are likely right."""
        off = self.beliefs is not None and self.beliefs.with_orientation.get(Kind.ROBOT, 0.0) > 0.5
        return self.beliefs.turn if off and self.beliefs is not None else None

    @property
    def bias_moved(self) -> bool:
        """Whether the bias is likelier than not to have moved."""
        return self.beliefs is not None and sum(self.beliefs.moved.values()) > 0.5

    @property
    def beyond_robot(self) -> Array:
        """What is left (m, 6) less what errors of the robot's orientation are known to make of it."""
        return self.residuals if self.of_robot is None else self.residuals - self.of_robot[self.kept]

    @property
    def change(self) -> Array:
        """What each pose's bias was off the last one (n, 6), where it is believed to have moved; else zero."""
        return np.zeros_like(self.errors) if self.beliefs is None or not self.bias_moved else self.beliefs.change


def alike_to_the_next(left: Array) -> Array:
    """Correlation (6,) of what is `left` (m, 6) in a pose with what is left in the next, each axis; 0 of one pose."""
    left = (left - left.mean(axis=0)) / np.maximum(left.std(axis=0), 1e-300)
    return np.asarray(np.mean(left[1:] * left[:-1], axis=0)) if len(left) > 1 else np.zeros(6)
