"""The variances of the axes at restricted maximum likelihood, and what is known of them beforehand.

Where the noise is stated, it is known up to one scale. Else forces share a level, and torques another; an axis differs
from its group as much as it must: the prior of the logarithms of the axes' variances is a narrow Student's t, so that a
few poses share one variance, with tails that let a plain difference be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array
from .noise import StatedNoise

AXIS_SCALE = 0.2
"""Of the logarithm of an axis' variance about that of its group: up to there chance is believed, not the axis."""

LEAST_DOF = 0.05
LARGEST_STEP = 2.0


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What is known of the variances: `least` (6,), at least; `stated` up to one scale, or None; `start` (6,)."""

    least: Array
    stated: StatedNoise | None
    start: Array

    def improved(self, log_variance: Array, squares: Array, dof: Array, first: bool) -> Array:
        """The logarithms of the variances (m, 6) after a step towards their optimum, given the sums of squares and the
        dof (m, 6) of the axes; the `first` step begins with one level for each group.
        """
        if self.stated is not None:
            given = self.stated.std**2
            total = np.maximum(dof.sum(axis=1) + self.stated.dof, LEAST_DOF)
            scale = np.maximum((squares / given).sum(axis=1) + self.stated.dof, 1e-300) / total
            return np.asarray(np.log(np.maximum(scale[:, None] * given, self.least)))
        grouped, left = squares.reshape(-1, 2, 3), np.maximum(dof, LEAST_DOF).reshape(-1, 2, 3)
        least = np.log(self.least)
        if first:
            level = np.log(np.maximum(grouped.sum(axis=2), 1e-300) / left.sum(axis=2))
            return np.asarray(np.maximum(np.repeat(level, 3, axis=1), least))
        own = log_variance.reshape(-1, 2, 3)
        off, pull = _off_group(own)
        chi2 = grouped * np.exp(-own)
        slope = 0.5 * (left - chi2) + pull[:, :, None] * off
        stiff = 0.5 * np.maximum(left, chi2) + pull[:, :, None]
        step = slope / stiff  # of diag(stiff) less a third of the pull everywhere (Sherman and Morrison, 1950)
        third = pull / 3.0
        step += (third * step.sum(axis=2) / (1.0 - third * (1.0 / stiff).sum(axis=2)))[:, :, None] / stiff
        moved = log_variance - np.clip(step, -LARGEST_STEP, LARGEST_STEP).reshape(-1, 6)
        return np.maximum(moved, least)

    def log_volume(self, log_variance: Array, dof: Array) -> Array:
        """-2 log of the volume that Laplace's method gives the variances, less that of their prior (m,)."""
        if self.stated is not None:
            return np.asarray(np.log(np.maximum(dof.sum(axis=1) + self.stated.dof, LEAST_DOF)))
        off, pull = _off_group(log_variance.reshape(-1, 2, 3))
        stiff = 0.5 * np.maximum(dof, LEAST_DOF).reshape(-1, 2, 3) + pull[:, :, None]
        volume = np.log(stiff).sum(axis=2) + np.log1p(-pull / 3.0 * (1.0 / stiff).sum(axis=2))
        tail = 3.0 * np.log1p(np.sum(off**2, axis=2) / AXIS_SCALE**2)
        total: Array = (volume + tail).sum(axis=1)
        return total

    def log_spread(self, log_variance: Array, dof: Array) -> Array:
        """Covariance (6, 6) of the logarithms (6,) of the axes' variances, from the `dof` (6,) of each."""
        if self.stated is not None:
            return np.full((6, 6), 2.0 / max(float(dof.sum()) + self.stated.dof, LEAST_DOF))
        pull = _off_group(log_variance.reshape(1, 2, 3))[1][0]
        precision = np.diag(0.5 * np.maximum(dof, LEAST_DOF))
        for group, strength in zip((slice(0, 3), slice(3, 6)), pull, strict=True):
            precision[group, group] += strength * (np.eye(3) - 1.0 / 3.0)
        return np.asarray(np.linalg.inv(precision))


def _off_group(log_variance: Array) -> tuple[Array, Array]:
    """What axes (m, 2, 3) are off the mean of their group, and the precision (m, 2) with which they are drawn to it."""
    off = log_variance - log_variance.sum(axis=2, keepdims=True) / 3.0
    return off, 3.0 / (AXIS_SCALE**2 + (off * off).sum(axis=2))
