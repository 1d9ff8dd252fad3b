"""The readings of poses as arrays, and what is known of their noise before a fit (method, "The noise of a pose").

The variance of a pose is estimated from what a fit leaves (least_squares.py); what its still segment shows is the least
that it can be, and tells poses that rest on few samples from those that rest on many. Where the noise is stated, it is
known up to one scale. Else forces share a level, and torques another, about which the logarithms of the axes' variances
have a Gaussian prior, so that there is one optimum, wherever a search begins.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calibration.observability import LEVER
from ..errors import InputError
from ..geometry.arrays import Array, numbers
from ..geometry.ranges import NOISE_OF_AXIS
from ..samples.poses import Pose
from ..samples.samples import Samples

ROUNDING = 1e-10
"""Of the largest reading: what noise-free data carry."""

STEPS = np.outer(10.0 ** np.arange(0.0, -6.0, -1.0), [5.0, 2.5, 2.0, 1.25, 1.0]).ravel()
"""That tables are rounded to, and converters resolve, in powers of ten; the coarsest that fits is it."""

FEW_STEPS, MOST_ALIKE = 3.5, 6.0
"""Steps that an axis stays within, whose readings are off alike; of one that sweeps more, as many are as poses along
the axes read the same, while of thousands most are equal by chance.
"""
FEWEST_TO_TELL, OFF_GRID = 6, 1e-3
"""Readings of different size, of which every second one is even by chance; and a part of a step."""

ALIKE, APART = 0.12, 2.0
"""Standard deviation of the logarithm of an axis' variance about that of its group: of axes of one make, and where one
is plainly worse or better.
"""
AXES = {APART: 0.001, ALIKE: 0.999}
"""With probabilities; the wider first, as kernels are looked at under the last hypothesis. What is left of few poses is
more systematic error and chance than noise, and an axis that comes out exact by either would take over the fit.
"""

OF_GROUP = np.kron(np.eye(2), np.ones((3, 3)))
OFF_GROUP = np.eye(6) - OF_GROUP / 3.0
"""Times values of the axes: of each axis, the sum over its group, and what it is off the mean of it."""

LEAST_DOF = 0.05
LARGEST_STEP = 2.0

ROWS_IN_ORDER = 0.1
"""That rows without times are in the order in which they were taken, and evenly: likely enough that a bias that moves
shows; more would make their order count where none does.
"""

MOST_DOF = 1e6
"""What a parameter that the prior alone settles is said to have."""

PER_NEWTON = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""A noise or a drift of one number, N, stands for as many N m at a lever of 5 cm, as in `TYPICAL_DRIFT`."""

NoiseLike: TypeAlias = "ArrayLike | Samples | None"


def variance_of_means(noise: Array, fitted: tuple[Pose, ...], rows: Array) -> Array:
    """Variance (m, 6) of the mean of so many `rows` (m,) each: what the `fitted` poses, whose readings have the std
    `noise` (6,), differ by, and the scatter of a sample, pooled over the poses (where no row is repeated, `noise` has
    both).
    """
    n = np.array([pose.n for pose in fitted], dtype=np.float64)
    if not (n > 1.0).any():
        return np.tile(noise**2, (len(rows), 1))
    of_means = np.array([np.diag(pose.wrench_cov) for pose in fitted])
    of_sample = n * (n - 1.0) @ of_means / np.sum(n - 1.0)
    between = np.maximum(noise**2 - of_sample * np.mean(1.0 / n), 0.0)
    return np.asarray(between + of_sample / rows[:, None])


@dataclass(frozen=True, eq=False)
class PoseReadings:
    """The poses of a fit as arrays: `R_base_flange` (n, 3, 3), mean `wrench` (n, 6); `variance` (n, 6) of these means
    as their still segments show it, 0 where that is unknown; `time` (n,), s, or their number, and the probability that
    they were taken `in_order` of it.
    """

    R_base_flange: Array
    wrench: Array
    variance: Array
    time: Array
    in_order: float

    def __len__(self) -> int:
        return len(self.wrench)

    def select(self, kept: NDArray[np.bool_]) -> PoseReadings:
        """The poses of a mask (n,)."""
        if kept.all():
            return self
        R_base_flange, wrench = self.R_base_flange[kept], self.wrench[kept]
        return PoseReadings(R_base_flange, wrench, self.variance[kept], self.time[kept], self.in_order)

    def with_lag(self, lag: Array | None) -> PoseReadings:
        """The same, as uncertain as one `lag` (10, 6) of all poses leaves them (`RecordedPoses`): what it makes of each
        does not average out over them, as noise does. None: there is none.
        """
        if lag is None:
            return self
        late = np.column_stack([self.R_base_flange.reshape(-1, 9), np.ones(len(self))]) @ lag
        return replace(self, variance=self.variance + len(self) * late**2)

    @cached_property
    def least_variance(self) -> Array:
        """The least variance (6,) that is taken seriously: what the stops show on average, and rounding."""
        scale = np.abs(self.wrench).reshape(-1, 2, 3).max(axis=(0, 2), initial=0.0)
        rounding = np.repeat((ROUNDING * scale + 1e-14) ** 2, 3) + variance_of_digits(self.wrench)
        return np.asarray(np.maximum(rounding, self.variance.mean(axis=0)))

    @property
    def relative_variance(self) -> Array:
        """The variances (n,) of the poses' means relative to their average, over all axes."""
        mean = self.variance.mean(axis=0)
        if not (mean > 0.0).any():
            return np.ones(len(self))
        return np.asarray(np.mean(self.variance[:, mean > 0.0] / mean[mean > 0.0], axis=1))


def variance_of_digits(wrench: Array) -> Array:
    """Variance (6,) of readings (n, 6) by the digits that they are rounded to, 0 where none shows. Readings of an axis
    that are equal are off alike, and tell no more together than one of them.
    """
    steps = np.repeat([_step_of(np.abs(wrench[:, group]).ravel()) for group in (slice(0, 3), slice(3, 6))], 3)
    if not steps.any():
        return np.zeros(6)
    # where runs of equal readings begin, axis by axis
    begin = np.flatnonzero(np.diff(np.sort(wrench, axis=0).T, axis=1, prepend=np.nan))
    alike = np.bincount(begin // len(wrench), np.diff(begin, append=wrench.size) ** 2, 6) / len(wrench)
    sweeps = np.ptp(wrench, axis=0) > FEW_STEPS * steps
    return np.asarray(steps**2 / 12.0 * np.where(sweeps, np.minimum(alike, MOST_ALIKE), alike))


def _step_of(sizes: Array) -> float:
    """The coarsest step that all `sizes` (k,) of readings, N or N m, are multiples of, if enough of these differ."""
    largest = sizes.max(initial=0.0)
    if largest == 0.0:
        return 0.0
    steps = STEPS * 10.0 ** np.floor(np.log10(largest))
    by_some = steps[_on_grid(sizes[:FEWEST_TO_TELL], steps[:, None])]  # most often none, and the rest is not looked at
    step = next((float(step) for step in by_some if _on_grid(sizes, step)), 0.0)
    return step if step and np.count_nonzero(np.unique(sizes)) >= FEWEST_TO_TELL else 0.0


def _on_grid(sizes: Array, steps: Array) -> NDArray[np.bool_]:
    multiples = sizes / steps
    return np.asarray(np.all(np.abs(multiples - np.rint(multiples)) < OFF_GRID, axis=-1))


def readings_of(poses: tuple[Pose, ...], order_tells: bool) -> PoseReadings:
    """The poses as arrays; `order_tells` whether poses without times were taken one after the other."""
    variance = np.array([np.diag(pose.wrench_cov) for pose in poses])
    rows = np.array([pose.n for pose in poses], dtype=np.float64)
    known = variance.max(axis=1) > 0.0
    if known.any() and not known.all():
        variance[~known] = (rows[known, None] * variance[known]).mean(axis=0) / rows[~known, None]
    mean = np.maximum(variance.mean(axis=0), 1e-300)
    variance = np.mean(variance / mean, axis=1)[:, None] * mean  # one axis of few rows says little by itself
    R_base_flange, wrench = np.array([pose.R_base_flange for pose in poses]), np.array([pose.wrench for pose in poses])
    in_order = 1.0 if order_tells or poses[0].t_start is not None else ROWS_IN_ORDER
    return PoseReadings(R_base_flange, wrench, variance, times_of(poses), in_order)


def in_time(poses: tuple[Pose, ...]) -> tuple[Pose, ...]:
    """The poses in the order of time."""
    return tuple(sorted(poses, key=_middle))


def _middle(pose: Pose) -> float:
    return 0.0 if pose.t_start is None or pose.t_end is None else 0.5 * (pose.t_start + pose.t_end)


def times_of(poses: tuple[Pose, ...]) -> Array:
    """The middle of each pose (n,), s; the count of poses where no time is known or it stands still."""
    times = np.array([_middle(pose) for pose in poses])
    if poses[0].t_start is not None and times[-1] > times[0]:
        return times
    return np.arange(len(poses), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """Standard deviations (6,) of one pose's reading, N and N m, known up to one scale; `dof` degrees of freedom stand
    behind that scale already (0: none, the residuals settle it).
    """

    std: Array
    dof: float = 0.0


def with_torques(values: ArrayLike) -> Array:
    """Numbers as they are, but a single one, N, as six: `PER_NEWTON`. Raises `InputError` for what is no number."""
    try:
        array = numbers(values, "noise")
    except InputError:
        found = " ".join(repr(values).split())[:60]
        raise InputError(f"found {found}, expected numbers: one in N, or six, N of forces and N m of torques") from None
    return array * PER_NEWTON if array.ndim == 0 else array


def stated_noise(noise: NoiseLike) -> StatedNoise | None:
    """The noise of one pose's reading from what the user states of it, or None. Raises `InputError`."""
    if noise is None:
        return None
    given = noise.wrench if isinstance(noise, Samples) else noise
    values = with_torques(given if isinstance(given, str) else numbers(given, "noise"))
    if values.ndim == 2 and values.shape[1] == 6 and len(values) >= 2:
        values = values.std(axis=0, ddof=1)
    if values.shape != (6,) or len(NOISE_OF_AXIS.outside(values)):
        raise InputError(
            f"noise must be six standard deviations (fx..tz), {NOISE_OF_AXIS}, one number, N, or a recording at rest "
            f"(n, 6) in which every axis moves; found {np.array2string(values, threshold=8, max_line_width=1000)}"
        )
    return StatedNoise(values)


def relative_variances(noise: StatedNoise | None) -> Array:
    """Variances (6,) to begin with: of the given noise, or of torques as forces at a lever."""
    if noise is not None:
        return np.asarray(noise.std**2, dtype=np.float64)
    return np.array([1.0, 1.0, 1.0, LEVER**2, LEVER**2, LEVER**2])


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What is known of the variances: `least` (6,), at least; `stated` up to one scale, or None; `start` (6,)."""

    least: Array
    stated: StatedNoise | None
    start: Array

    def first(self, at_tool: Array) -> Array:
        """The logarithms (m, 6) of the variances to begin with, given the mean squares (m, 6) of what the tool leaves
        where all is linearised: from far above the noise, what is known beforehand would outweigh the readings.
        """
        if self.stated is not None:
            return np.broadcast_to(np.log(self.start), at_tool.shape)
        level = np.minimum((at_tool / self.start).mean(axis=1, keepdims=True), 1.0)
        return np.asarray(np.log(np.maximum(level * self.start, self.least)))

    def improved(self, log_variance: Array, squares: Array, dof: Array, apart: Array, first: bool) -> Array:
        """The logarithms of the variances (m, 6) after a step towards their optimum, given the sums of squares and the
        dof (m, 6) of the axes, how far `apart` (m,) these are; the `first` step begins with one level for each group.
        """
        if self.stated is not None:
            given = self.stated.std**2
            total = np.maximum(dof.sum(axis=1) + self.stated.dof, LEAST_DOF)
            scale = np.maximum((squares / given).sum(axis=1) + self.stated.dof, 1e-300) / total
            return np.asarray(np.log(np.maximum(scale[:, None] * given, self.least)))
        left, least = np.maximum(dof, LEAST_DOF), np.log(self.least)
        all_left = left @ OF_GROUP
        if first:
            return np.asarray(np.maximum(np.log(np.maximum(squares @ OF_GROUP, 1e-300) / all_left), least))
        pull = apart[:, None] ** -2.0
        chi2 = squares * np.exp(-log_variance)
        slope = 0.5 * (left - chi2) + pull * (log_variance @ OFF_GROUP)
        inverse = 1.0 / (0.5 * np.maximum(chi2, 0.5 * left) + pull)  # half: from far above it would leap
        nothing_left = all_left <= 3.0 * LEAST_DOF  # of readings: their noise would vanish
        inverse[((log_variance <= least) | nothing_left) & (slope > 0.0)] = 0.0
        step = inverse * slope  # of diag(1 / inverse) less a third of the pull everywhere (Sherman and Morrison, 1950)
        step += inverse * (step @ OF_GROUP) / (3.0 / pull - inverse @ OF_GROUP)
        moved = log_variance - np.minimum(np.maximum(step, -LARGEST_STEP), LARGEST_STEP)
        return np.asarray(np.maximum(moved, least))

    def log_volume(self, log_variance: Array, dof: Array, apart: Array) -> Array:
        """-2 log of the volume that Laplace's method gives the variances, less that of their prior (m,)."""
        if (stated := self.stated) is not None:
            scale = (log_variance - 2.0 * np.log(stated.std)).min(axis=1)  # of axes that are not at their least
            prior = stated.dof * (scale + np.expm1(-scale))  # so far as the scale was known already
            return np.asarray(np.log(np.maximum(dof.sum(axis=1) + stated.dof, LEAST_DOF)) + prior)
        pull = apart[:, None] ** -2.0
        stiff = 0.5 * np.maximum(dof, LEAST_DOF).reshape(-1, 2, 3) + pull[:, :, None]
        volume = np.log(stiff).sum(axis=2) + np.log1p(-pull / 3.0 * (1.0 / stiff).sum(axis=2))
        prior = pull[:, 0] * np.sum((log_variance @ OFF_GROUP) ** 2, axis=1) - 4.0 * np.log(pull[:, 0])
        return np.asarray(volume.sum(axis=1) + prior)

    def log_spread(self, dof: Array, apart: float) -> Array:
        """Covariance (6, 6) of the logarithms of the axes' variances, from the `dof` (6,) of each."""
        if self.stated is not None:
            return np.full((6, 6), 2.0 / max(float(dof.sum()) + self.stated.dof, LEAST_DOF))
        return np.asarray(np.linalg.inv(np.diag(0.5 * np.maximum(dof, LEAST_DOF)) + OFF_GROUP / apart**2))
