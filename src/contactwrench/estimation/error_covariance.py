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

    @property
    def precision_blocks(self) -> Array:
        """The blocks (m, 6, 6) of V^-1 on its diagonal."""
        diagonal = precision_diagonal(self.columns[self.kept], self.strength, self.relative[self.kept])
        return np.asarray(diagonal[:, None, None] * np.diag(1.0 / self.variance))

    @property
    def of_forces(self) -> float:
        """N, the noise of an axis of force, RMS."""
        return float(np.sqrt(np.mean(self.variance[:3])))

    def in_common(self, weighted: Array) -> Array:
        """What all poses (n, 6) are known to be off, from `V^-1 errors` (m, 6) of those kept."""
        L = self.columns
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
    def in_common(self) -> Array:
        """What turns that are alike read, (m, 6, 2 m) N and N m, as independent parts of 1 rad, or none (m, 6, 0)."""
        m = len(self.reads_of_kept)
        if self.alike is None:
            return np.zeros((m, 6, 0))
        each = np.zeros((m, 6, m, 2))
        each[range(m), :, range(m)] = self.reads_of_kept
        both = np.repeat(self.kept, 2)
        return each.reshape(m, 6, 2 * m) @ np.linalg.cholesky(self.alike[np.ix_(both, both)])


@dataclass(frozen=True, eq=False)
class Turned:
    """The `base` of another cause, and orientations off by `turns` of `sd` rad an axis: of each pose alone, and of
    columns that poses have in common, drift first (inversion lemma).
    """

    base: AlikeOnAxes
    turns: Turns
    sd: float

    @property
    def shares(self) -> Array:
        """The variance of each axis (6,) by turns, of what the noise has."""
        return np.asarray(self.sd**2 * np.mean(self.turns.reads_of_kept**2, axis=(0, 2)) / self.base.variance)

    @property
    def beyond_first_order(self) -> Array:
        """Variance (6,) of what turns make of a reading beyond first order."""
        return np.asarray(self.sd**4 * np.mean(self.turns.reads_of_kept**2, axis=(0, 2)) + 1e-300)

    @cached_property
    def noise(self) -> Array:
        """Standard deviations (6,), N and N m: `own_turns`, `columns` and what weighs them are in these units."""
        return np.sqrt(self.base.variance)

    @cached_property
    def own_turns(self) -> Array:
        """Turns that each pose has for itself, (m, 6, 2), independent and of unit size; none, (m, 6, 0), if alike."""
        own = self.sd * self.turns.reads_of_kept / self.noise[:, None]
        return own if self.turns.alike is None else own[:, :, :0]

    @cached_property
    def columns(self) -> Array:
        """What poses have in common, (m, 6, c), as independent parts of unit size: a drift on each axis, then turns."""
        L = self.base.strength * self.base.columns[self.base.kept]
        drift = (L[:, None, :, None] * np.eye(6)[:, None]).reshape(len(L), 6, 6 * L.shape[1])
        return np.concatenate([drift, self.sd * self.turns.in_common / self.noise[:, None]], axis=2)

    @cached_property
    def _turns_precision(self) -> Array:
        """Precision of each pose's own turns, given its reading, (m, 2, 2), or nothing, (m, 0, 0)."""
        relative = self.base.relative[self.base.kept, None, None]
        added: Array = self.own_turns.transpose(0, 2, 1) @ self.own_turns / relative
        return np.asarray(added + np.eye(added.shape[1]))

    @cached_property
    def own_precision(self) -> Array:
        """Of what each reading has for itself, noise and own turns, (m, 6, 6)."""
        relative = self.base.relative[self.base.kept, None, None]
        by_turns = self.own_turns @ np.linalg.inv(self._turns_precision) @ self.own_turns.transpose(0, 2, 1) / relative
        return np.asarray((np.eye(6) - by_turns) / relative)

    @cached_property
    def weighted_columns(self) -> Array:
        """`own_precision columns`, (m, 6, c)."""
        return self.own_precision @ self.columns

    @cached_property
    def left_in_common(self) -> Array:
        """Covariance (c, c) of the parts of unit size that poses have in common, given their readings."""
        m, _, c = self.columns.shape
        of_readings = self.columns.reshape(6 * m, c).T @ self.weighted_columns.reshape(6 * m, c)
        return np.asarray(np.linalg.inv(np.eye(c) + of_readings))

    def pull(self, weighted: Array) -> Array:
        """What `weighted` readings (m, 6, k) pull at what poses have in common with, (c, k), its parts of unit size."""
        m, _, c = self.columns.shape
        flat = (weighted * self.noise[:, None]).reshape(6 * m, weighted.shape[2])
        return np.asarray(self.columns.reshape(6 * m, c).T @ flat)

    def precision_times(self, values: Array) -> Array:
        """`V^-1 values` of the poses kept, (m, 6, k)."""
        weighted = self.own_precision @ (values / self.noise[:, None]) / self.noise[:, None]
        in_common = self.weighted_columns @ (self.left_in_common @ self.pull(weighted))
        return np.asarray(weighted - in_common / self.noise[:, None])

    def along_drift(self, weighted: Array) -> Array:
        """What `weighted` readings (m, 6, k) pull at a drift with, (q, 6, k): each column of it on each axis."""
        return self.pull(weighted)[: self._of_drift].reshape(-1, 6, weighted.shape[2])

    def along_turns(self, weighted: Array) -> Array:
        """What `weighted` readings (m, 6, k) pull at all turns with, (2 m, k), in common or each pose's own."""
        own = self.own_turns.transpose(0, 2, 1) @ (weighted * self.noise[:, None])
        own = own.reshape(own.shape[1] * len(own), weighted.shape[2])
        return np.concatenate([self.pull(weighted)[self._of_drift :], own])

    @property
    def _of_drift(self) -> int:
        """How many of the columns are a drift's."""
        return 6 * int(self.base.columns.shape[1])

    @property
    def dof_of_drift(self) -> Array:
        """Degrees of freedom of a drift's parts (q, 6), were the tool known."""
        return 1.0 - np.diag(self.left_in_common)[: self._of_drift].reshape(-1, 6)

    @property
    def dof_of_turns(self) -> float:
        """Degrees of freedom of all turns, were the tool known."""
        of_own = self.own_turns * (self.precision_blocks * np.outer(self.noise, self.noise) @ self.own_turns)
        return float(np.sum(1.0 - np.diag(self.left_in_common)[self._of_drift :])) + float(np.sum(of_own))

    @cached_property
    def precision_blocks(self) -> Array:
        """The blocks (m, 6, 6) of V^-1 on its diagonal."""
        W = self.weighted_columns
        blocks = self.own_precision - (W @ self.left_in_common) @ W.transpose(0, 2, 1)
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
        of_noise = 6.0 * np.log(self.base.relative[self.base.kept]) + np.sum(np.log(self.base.variance))
        of_each = of_noise + np.linalg.slogdet(self._turns_precision)[1]
        return float(np.sum(of_each) - np.linalg.slogdet(self.left_in_common)[1])

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
