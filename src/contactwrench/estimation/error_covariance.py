"""The covariance V of the errors of all poses under one member of a table: how readings weigh, what is known of them.

All axes alike and poses alike in a drift or a field, V = K (x) Sigma; or, of a robot whose orientation is off, a few
directions of each pose (robot_errors.py). Both are noise of each reading and a part that the poses have in common.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array


def precision_times(L: Array, variance: Array, values: Array) -> Array:
    """`K^-1 values` (..., n, m) for K = diag(variance) + L L^T, L (..., n, q) (inversion lemma)."""
    scaled, weighted, across = values / variance[:, None], L / variance[:, None], np.swapaxes(L, -1, -2)
    inner = np.linalg.solve(np.eye(L.shape[-1]) + across @ weighted, across @ scaled)
    return np.asarray(scaled - weighted @ inner)


def in_common(L: Array, kept: NDArray[np.bool_], variance: Array, errors: Array) -> tuple[Array, Array]:
    """`errors` (k, n, 6) less the constant nearest to those of the poses kept, whose covariance is diag(`variance`) +
    L L^T, L (k, n, q), and of how much of each column these are known to be, (k, q, 6).
    """
    own, one = L[:, kept], np.ones((len(variance), 1))
    of_one = np.swapaxes(precision_times(own, variance, one), 1, 2)
    errors = errors - of_one @ errors[:, kept] / of_one.sum(axis=2, keepdims=True)
    return errors, np.swapaxes(own, 1, 2) @ precision_times(own, variance, errors[:, kept])


def precision_diagonal(L: Array, variance: Array) -> Array:
    """The diagonal (n,) of that `K^-1`."""
    weighted = L / variance[:, None]
    inner = np.linalg.solve(np.eye(L.shape[1]) + L.T @ weighted, weighted.T)
    return np.asarray(1.0 / variance - np.einsum("nq,qn->n", weighted, inner))


def of_larger(shares: Array) -> float:
    """Of what each axis (6,) has, the mean of the forces or of the torques, which show turns of a tool far away."""
    return float(shares.reshape(2, 3).mean(axis=1).max())


@dataclass(frozen=True, eq=False)
class AlikeOnAxes:
    """`(diag(relative) + strength^2 L L^T) (x) diag(variance)`, of poses (n,) of which some are `kept`: columns L
    (n, q), `relative` (n,), `variance` (6,).
    """

    kept: NDArray[np.bool_]
    relative: Array
    variance: Array
    columns: Array
    strength: float

    @cached_property
    def relative_of_kept(self) -> Array:
        """(m,)."""
        return self.relative[self.kept]

    @cached_property
    def drift(self) -> Array:
        """What the poses kept have in common, (m, q), alike on each axis, as independent parts of unit size."""
        return self.strength * self.columns[self.kept]

    def precision_times(self, values: Array) -> Array:
        """`V^-1 values` of the poses kept, (m, 6, c)."""
        flat = values.reshape(len(values), -1)
        weighted = precision_times(self.drift, self.relative_of_kept, flat)
        return np.asarray(weighted.reshape(values.shape) / self.variance[:, None])

    @property
    def precision_blocks(self) -> Array:
        """The blocks (m, 6, 6) of V^-1 on its diagonal."""
        diagonal = precision_diagonal(self.drift, self.relative_of_kept)
        return np.asarray(diagonal[:, None, None] * np.diag(1.0 / self.variance))

    @property
    def of_forces(self) -> float:
        """N, the noise of an axis of force, RMS."""
        return float(np.sqrt(np.mean(self.variance[:3])))

    def in_common(self, weighted: Array, some: slice) -> Array:
        """What all poses (n, 6) are off by `some` of the columns, as `V^-1 errors` (m, 6) of those kept tell."""
        L = self.columns[:, some]
        return np.asarray(self.strength**2 * L @ (L[self.kept].T @ weighted) * self.variance)


@dataclass(frozen=True, eq=False)
class Turns:
    """What a turn of each pose by 1 rad about either axis across gravity reads, `reads` (n, 6, 2), and how such turns
    are `alike` (2 n, 2 n) from pose to pose, None where each is anew; of which poses some are `kept` (n,).
    """

    reads: Array
    alike: Array | None
    kept: NDArray[np.bool_]

    @cached_property
    def reads_of_kept(self) -> Array:
        """(m, 6, 2)."""
        return self.reads[self.kept]

    @cached_property
    def mean_square(self) -> Array:
        """Of what either turn of the poses kept reads, (6,)."""
        return np.asarray(np.mean(self.reads_of_kept**2, axis=(0, 2)))

    @cached_property
    def root(self) -> Array | None:
        """(2 m, 2 m), times its transpose how the turns of the poses kept are alike."""
        both = np.repeat(self.kept, 2)
        return None if self.alike is None else np.asarray(np.linalg.cholesky(self.alike[np.ix_(both, both)]))

    @cached_property
    def as_columns(self) -> Array:
        """What the turns of all poses read, (m, 6, 2 m) N and N m, as independent parts of 1 rad."""
        m = len(self.reads_of_kept)
        each = np.zeros((m, 6, m, 2))
        each[range(m), :, range(m)] = self.reads_of_kept
        flat = each.reshape(m, 6, 2 * m)
        return flat if self.root is None else flat @ self.root


@dataclass(frozen=True, eq=False)
class Turned:
    """The `base` of another cause, and orientations off by `turns` of `sd` rad an axis.

    Noise and one of the two are inverted first: a drift, which treats all axes alike, or turns, where each pose has its
    own. The other is `columns` that poses have in common (inversion lemma). All of that is in units of the `noise`.
    """

    base: AlikeOnAxes
    turns: Turns
    sd: float

    @property
    def shares(self) -> Array:
        """The variance of each axis (6,) by turns, of what the noise has."""
        return np.asarray(self.sd**2 * self.turns.mean_square / self.base.variance)

    @property
    def beyond_first_order(self) -> Array:
        """Variance (6,) of what turns make of a reading beyond first order."""
        return np.asarray(self.sd**4 * self.turns.mean_square + 1e-300)

    @cached_property
    def noise(self) -> Array:
        """Standard deviations (6,), N and N m."""
        return np.sqrt(self.base.variance)

    @cached_property
    def turned(self) -> Array:
        """What turns of each pose by their standard deviation read, (m, 6, 2)."""
        return self.sd * self.turns.reads_of_kept / self.noise[:, None]

    @cached_property
    def drift_first(self) -> bool:
        """Whether turns are left for the second step: those that are alike, or fewer than a drift has columns."""
        m, q = self.base.drift.shape
        return self.turns.alike is not None or 2 * m < 6 * q

    @cached_property
    def first_covariance(self) -> Array:
        """Of noise and drift, (m, m), alike on all axes; or of noise and turns of each pose, (m, 6, 6)."""
        if self.drift_first:
            return np.diag(self.base.relative_of_kept) + self.base.drift @ self.base.drift.T
        return self.base.relative_of_kept[:, None, None] * np.eye(6) + self.turned @ self.turned.transpose(0, 2, 1)

    @cached_property
    def first_precision(self) -> Array:
        """The inverse of the `first_covariance`."""
        return np.asarray(np.linalg.inv(self.first_covariance))

    def first_times(self, values: Array) -> Array:
        """The `first_precision` times `values` (m, 6, k)."""
        if self.drift_first:
            return np.asarray((self.first_precision @ values.reshape(len(values), -1)).reshape(values.shape))
        return self.first_precision @ values

    @cached_property
    def columns(self) -> Array:
        """What is not inverted first, (m, 6, c), as independent parts of unit size: turns, or a drift on each axis."""
        if self.drift_first:
            return self.sd * self.turns.as_columns / self.noise[:, None]
        m, q = self.base.drift.shape
        return (self.base.drift[:, None, :, None] * np.eye(6)[:, None]).reshape(m, 6, 6 * q)

    @cached_property
    def weighted_columns(self) -> Array:
        """The `first_precision` times the `columns`, (m, 6, c)."""
        return self.first_times(self.columns)

    @cached_property
    def left_in_common(self) -> Array:
        """Covariance (c, c) of the parts that the `columns` are made of, given the readings."""
        return np.asarray(np.linalg.inv(np.eye(self.columns.shape[2]) + self._pull(self.weighted_columns)))

    def _pull(self, weighted: Array) -> Array:
        """What `weighted` readings (m, 6, k) pull at the `columns` with, (c, k)."""
        m, _, c = self.columns.shape
        return np.asarray(self.columns.reshape(6 * m, c).T @ weighted.reshape(6 * m, -1))

    def precision_times(self, values: Array) -> Array:
        """`V^-1 values` of the poses kept, (m, 6, k)."""
        return np.asarray(self.whitened(values / self.noise[:, None]) / self.noise[:, None])

    def whitened(self, values: Array) -> Array:
        """The same, in units of the noise."""
        weighted = self.first_times(values)
        return np.asarray(weighted - self.weighted_columns @ (self.left_in_common @ self._pull(weighted)))

    def parts_times(self, values: Array) -> Array:
        """Each part of V times `values` (m, 6), in units of the noise, (m, 6, 8): noise of the axes, drift, turns."""
        parts = np.zeros((*values.shape, 8))
        parts[:, :, 6] = self.base.drift @ (self.base.drift.T @ values)
        parts[:, range(6), range(6)] = self.base.relative_of_kept[:, None] * values
        turned = self.turned.transpose(0, 2, 1) @ values[..., None]
        if self.turns.root is not None:
            turned = (self.turns.root @ (self.turns.root.T @ turned.ravel())).reshape(turned.shape)
        parts[:, :, 7] = (self.turned @ turned)[:, :, 0]
        return parts

    def along_turns(self, weighted: Array) -> Array:
        """What `weighted` readings (m, 6, k) pull at all turns with, (2 m, k), as independent parts."""
        own = self.turned.transpose(0, 2, 1) @ (weighted * self.noise[:, None])
        flat = own.reshape(-1, weighted.shape[2])
        return flat if self.turns.root is None else self.turns.root.T @ flat

    @property
    def dof_of_drift(self) -> Array:
        """Degrees of freedom of a drift on each axis (6,), were the tool known."""
        if not self.base.drift.shape[1]:
            return np.zeros(6)
        if not self.drift_first:
            return np.asarray(np.sum(1.0 - np.diag(self.left_in_common).reshape(-1, 6), axis=0))
        m, q = self.base.drift.shape
        pulled = (self.base.drift.T @ self.weighted_columns.reshape(m, -1)).reshape(q, 6, -1)
        alone = np.sum(self.base.drift * (self.first_precision @ self.base.drift))
        return np.asarray(alone - np.sum((pulled @ self.left_in_common) * pulled, axis=(0, 2)))

    @cached_property
    def precision_diagonal(self) -> Array:
        """Of V^-1, (m, 6), in units of the noise."""
        W, first = self.weighted_columns, self.first_precision
        own = first.diagonal()[:, None] if self.drift_first else first.diagonal(axis1=1, axis2=2)
        return np.asarray(own - ((W @ self.left_in_common) * W).sum(axis=2))

    @cached_property
    def precision_blocks(self) -> Array:
        """The blocks (m, 6, 6) of V^-1 on its diagonal."""
        W, first = self.weighted_columns, self.first_precision
        blocks = np.diag(first)[:, None, None] * np.eye(6) if self.drift_first else first
        blocks = blocks - (W @ self.left_in_common) @ W.transpose(0, 2, 1)
        return np.asarray(blocks / np.outer(self.noise, self.noise))

    def constant(self, values: Array) -> tuple[Array, Array]:
        """The constant (6, k) nearest to `values` (m, 6, k), and the covariance (6, 6) of one that errors leave."""
        one = np.tile(np.eye(6), (len(values), 1, 1))
        total = self.precision_times(np.concatenate([one, values], axis=2)).sum(axis=0)
        covariance = np.linalg.inv(total[:, :6])
        return covariance @ total[:, 6:], covariance

    @property
    def log_determinant(self) -> float:
        """Of V of the poses kept."""
        of_first = np.sum(np.linalg.slogdet(self.first_covariance)[1]) * (6.0 if self.drift_first else 1.0)
        of_noise = len(self.columns) * np.sum(np.log(self.base.variance))
        return float(of_first + of_noise - np.linalg.slogdet(self.left_in_common)[1])

    def by_turns(self, weighted: Array) -> Array:
        """What all poses (n, 6) are known to be off by turns, beside what the `base` has in common, from `V^-1 errors`
        (m, 6) of those kept.
        """
        kept, reads, alike = self.turns.kept, self.turns.reads, self.turns.alike
        turns = np.zeros((len(kept), 2))
        turns[kept] = self.sd**2 * (reads[kept].transpose(0, 2, 1) @ weighted[..., None])[..., 0]
        if alike is not None:
            turns = (alike @ turns.ravel()).reshape(-1, 2)
        return np.asarray((reads @ turns[..., None])[..., 0])


ErrorCovariance: TypeAlias = AlikeOnAxes | Turned
