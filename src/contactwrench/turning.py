"""How a recorded arm moves: its orientation between the stamps, and what its tool feels of accelerations.

A tool that turns is thrown outwards and held back. Whatever its mass, centre and inertia are, that is linear in the
angular acceleration (3), the products of the angular velocity (6) and the acceleration of the flange (3), all in flange
axes: left out, they are taken for a delay of several ms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .orientation import Array
from .pending import Knots, Pending
from .rotations import rotation_vectors

CELL = 0.01
"""s: what is faster than this is no motion of an arm; orientations and readings that come faster are thinned or averaged.
"""
PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class Turning:
    """Between knots at `t` (k,) s: `base_axes`, the spline of the base's axes in flange axes, 3 x 3 numbers, row by row
    one axis, and its derivative `change`; `accelerations` (k, 9), or (k, 12) where positions are known. `gap` (k - 1,):
    where nothing is known between two knots.
    """

    t: Array
    base_axes: Any
    change: Any
    accelerations: Array
    gap: NDArray[np.bool_]

    def axes_at(self, t: Array) -> Array:
        """The base's axes in flange axes (n, 3, 3) at t (n,)."""
        axes: Array = self.base_axes(t).reshape(-1, 3, 3)
        return axes

    def change_at(self, t: Array) -> Array:
        """Their derivative (n, 3, 3), 1/s; zero where the arm does not turn."""
        change: Array = self.change(t).reshape(-1, 3, 3)
        half = 0.5 * max(SPEED_OVER, 2.0 * float(np.median(np.diff(self.t))))
        ahead, behind = (self.base_axes(np.clip(t + k * half, self.t[0], self.t[-1])) for k in (1.0, -1.0))
        speed = np.linalg.norm(ahead - behind, axis=1) / (np.sqrt(2.0) * 2.0 * half)
        change[speed < LEAST_SPEED] = 0.0
        return change

    def accelerations_at(self, t: Array) -> Array:
        """What the tool feels beside gravity (n, 9 or 12) at t (n,)."""
        return np.stack([np.interp(t, self.t, column) for column in self.accelerations.T], axis=1)

    def is_known(self, earliest: Array, latest: Array) -> NDArray[np.bool_]:
        """Whether all moments from `earliest` to `latest` (n,) lie within the recording and in no gap."""
        gaps = np.r_[0, np.cumsum(self.gap)]
        first, last = (np.clip(np.searchsorted(self.t, t, "right") - 1, 0, len(self.gap)) for t in (earliest, latest))
        last = np.minimum(last + 1, len(self.gap))
        return (earliest >= self.t[0]) & (latest <= self.t[-1]) & (gaps[last] == gaps[first])


SPEED_OVER = 0.1
LEAST_SPEED = 0.01
"""rad/s, over so many s: slower than that is the trembling of an arm at rest, or of its encoders."""


def turning(pending: Pending, knots: Knots, longest_gap: float) -> Turning:
    """The motion through the orientations of a whole recording."""
    from scipy.interpolate import CubicHermiteSpline

    index = knots.index
    fast = CELL / max(float(np.median(np.diff(knots.t))), 1e-9)
    if fast >= 2.0:
        index = index[:: int(fast)]
    t, R = pending.at[index], pending.R_base_flange[index]
    recorded = pending.at[: knots.count]
    is_gap = np.r_[0, np.cumsum(np.diff(recorded) > longest_gap)]
    gap = np.diff(is_gap[index]) > 0
    axes = R.reshape(-1, 9)
    spline = CubicHermiteSpline(t, axes, _slopes(t, axes))
    middle = 0.5 * (t[1:] + t[:-1])
    step = np.diff(t)[:, None]
    turn = rotation_vectors(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / step
    angular = _between(middle, turn, t)
    felt = [_second(middle, turn, t), np.stack([angular[:, i] * angular[:, j] for i, j in PRODUCTS], axis=1)]
    if pending.position is not None:
        velocity = np.diff(pending.position[index], axis=0) / step
        felt.append(np.einsum("nij,ni->nj", R, _second(middle, velocity, t)))
    return Turning(t, spline, spline.derivative(), np.concatenate(felt, axis=1), gap)


def _slopes(t: Array, values: Array) -> Array:
    slopes: Array = np.gradient(values, t, axis=0, edge_order=2 if len(t) > 2 else 1)
    return slopes


def _between(middle: Array, values: Array, t: Array) -> Array:
    return np.stack([np.interp(t, middle, column) for column in values.T], axis=1)


def _second(middle: Array, rate: Array, t: Array) -> Array:
    """The derivative at `t` of a `rate` that is known in the `middle` of the steps."""
    if len(middle) < 2:
        return np.zeros((len(t), rate.shape[1]))
    return _between(t[1:-1], np.diff(rate, axis=0) / np.diff(middle)[:, None], t)
