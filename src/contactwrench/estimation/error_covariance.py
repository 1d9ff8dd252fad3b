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
from .moments import precision_diagonal, precision_times


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

    def precision_times(self, values: Array) -> Array:
        """`V^-1 values` of the poses kept, (m, 6, c)."""
        flat = values.reshape(len(values), -1)
        weighted = precision_times(self.columns[self.kept], self.strength, self.relative[self.kept], flat)
        return np.asarray(weighted.reshape(values.shape) / self.variance[:, None])

    def constant(self, values: Array) -> tuple[Array, Array]:
        """The constant (6, c) nearest to `values` (m, 6, c), and the covariance (6, 6) of one that errors leave."""
        one = np.ones((len(values), 1))
        of_one = precision_times(self.columns[self.kept], self.strength, self.relative[self.kept], one)[:, 0]
        mean = (of_one @ values.reshape(len(values), -1) / of_one.sum()).reshape(values.shape[1:])
        return mean, np.diag(self.variance / of_one.sum())

    def precision_blocks(self) -> Array:
        """The blocks (m, 6, 6) of V^-1 on its diagonal."""
        diagonal = precision_diagonal(self.columns[self.kept], self.strength, self.relative[self.kept])
        return np.asarray(diagonal[:, None, None] * np.diag(1.0 / self.variance))

    @property
    def of_forces(self) -> float:
        """N, the noise of an axis of force, RMS."""
        return float(np.sqrt(np.mean(self.variance[:3])))

    @property
    def log_determinant(self) -> float:
        """Of V of the poses kept."""
        relative, L = self.relative[self.kept], self.strength * self.columns[self.kept]
        of_columns = np.linalg.slogdet(np.eye(L.shape[1]) + L.T @ (L / relative[:, None]))[1]
        of_K = float(np.sum(np.log(relative))) + float(of_columns)
        return 6.0 * of_K + len(relative) * float(np.sum(np.log(self.variance)))

    def in_common(self, weighted: Array) -> Array:
        """What all poses (n, 6) are known to be off, from `V^-1 errors` (m, 6) of those kept."""
        L = self.columns
        return np.asarray(self.strength**2 * L @ (L[self.kept].T @ weighted) * self.variance)


@dataclass(frozen=True, eq=False)
class Turns:
    """What a turn of each pose by 1 rad about either axis across gravity reads, `reads` (n, 6, 2), and how such turns
    are `alike` (2 n, 2 n); of the poses `kept` (n,) the same, with the inverse.
    """

    reads: Array
    alike: Array
    kept: NDArray[np.bool_]

    @cached_property
    def reads_of_kept(self) -> Array:
        """(m, 6, 2)."""
        return self.reads[self.kept]

    @cached_property
    def alike_of_kept(self) -> Array:
        """(2 m, 2 m)."""
        both = np.repeat(self.kept, 2)
        return self.alike[np.ix_(both, both)]

    @cached_property
    def inverse_of_kept(self) -> Array:
        """(2 m, 2 m)."""
        return np.asarray(np.linalg.inv(self.alike_of_kept))

    @cached_property
    def each_of_kept(self) -> Array:
        """The readings (m, 6, 2 m) as columns of all turns."""
        m = len(self.reads_of_kept)
        each = np.zeros((m, 6, m, 2))
        each[range(m), :, range(m)] = self.reads_of_kept
        return each.reshape(m, 6, 2 * m)


@dataclass(frozen=True, eq=False)
class Turned:
    """The `base` of another cause, and orientations off by `turns` of `sd` rad an axis."""

    base: AlikeOnAxes
    turns: Turns
    sd: float

    @property
    def shares(self) -> Array:
        """The variance of each axis (6,) by turns, of what the noise has."""
        return np.asarray(self.sd**2 * np.mean(self.turns.reads_of_kept**2, axis=(0, 2)) / self.base.variance)

    @property
    def root_of_turns(self) -> Array:
        """Columns (m, 6, 2 m) of which turns make the readings, independent and of size one."""
        return np.asarray(self.sd * self.turns.each_of_kept @ np.linalg.cholesky(self.turns.alike_of_kept))

    @property
    def beyond_first_order(self) -> Array:
        """Variance (6,) of what turns make of a reading beyond first order."""
        return np.asarray(self.sd**4 * np.mean(self.turns.reads_of_kept**2, axis=(0, 2)) + 1e-300)

    @cached_property
    def covariance_of_turns(self) -> Array:
        """Of the turns (2 m, 2 m) of the poses kept, given errors of the readings."""
        of_readings = self.pull(self._weighted_turns)
        return np.asarray(np.linalg.inv(self.turns.inverse_of_kept / self.sd**2 + of_readings))

    def pull(self, weighted: Array) -> Array:
        """What `weighted` readings (m, 6, c) of the poses kept pull at their turns with, (2 m, c)."""
        T = self.turns.reads_of_kept.transpose(0, 2, 1)
        return np.asarray((T @ weighted).reshape(2 * len(T), -1))

    @cached_property
    def _weighted_turns(self) -> Array:
        return self.base.precision_times(self.turns.each_of_kept)

    def precision_times(self, values: Array) -> Array:
        """`V^-1 values` of the poses kept, (m, 6, c)."""
        weighted = self.base.precision_times(values)
        return np.asarray(weighted - self._weighted_turns @ (self.covariance_of_turns @ self.pull(weighted)))

    def constant(self, values: Array) -> tuple[Array, Array]:
        """The constant (6, c) nearest to `values` (m, 6, c), and the covariance (6, 6) of one that errors leave."""
        one = np.tile(np.eye(6), (len(values), 1, 1))
        total = self.precision_times(np.concatenate([one, values], axis=2)).sum(axis=0)
        covariance = np.linalg.inv(total[:, :6])
        return covariance @ total[:, 6:], covariance

    def precision_blocks(self) -> Array:
        """The blocks (m, 6, 6) of V^-1 on its diagonal."""
        W = self._weighted_turns
        return np.asarray(self.base.precision_blocks() - (W @ self.covariance_of_turns) @ W.transpose(0, 2, 1))

    @property
    def log_determinant(self) -> float:
        """Of V of the poses kept."""
        of_turns = np.linalg.slogdet(self.turns.alike_of_kept)[1] - np.linalg.slogdet(self.covariance_of_turns)[1]
        two_n = len(self.turns.alike_of_kept)
        return self.base.log_determinant + float(of_turns) + 2.0 * two_n * float(np.log(self.sd))

    def by_turns(self, weighted: Array) -> Array:
        """What all poses (n, 6) are known to be off by turns, beside what the `base` has in common, from `V^-1 errors`
        (m, 6) of those kept.
        """
        turns = self.sd**2 * self.turns.alike[:, np.repeat(self.turns.kept, 2)] @ self.pull(weighted[..., None])
        return np.asarray((self.turns.reads @ turns.reshape(-1, 2, 1))[..., 0])


ErrorCovariance: TypeAlias = AlikeOnAxes | Turned
