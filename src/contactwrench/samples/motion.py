"""How a recorded arm moves: its orientation between the stamps, and the accelerations of its tool.

A tool that turns is thrown outwards and held back. Whatever its mass, centre and inertia are, that is linear in the
angular acceleration (3), the products of the angular velocity (6) and the acceleration of the flange (3), all in flange
axes: left out, they are taken for a delay of several ms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array
from ..geometry.rotations import rotation_vectors
from .buffer import Buffer, Nodes

CELL = 0.01
"""s: what is faster than this is no motion of an arm; orientations that come faster are thinned, readings averaged."""
SMOOTHED = 0.05
"""s, of velocities before they are differentiated: an arm trembles, and so do the digits of its pose."""
PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """Between nodes at `t` (k,) s: `base_axes`, a spline of the base's axes in flange axes, 3 x 3 numbers, row by row
    one axis, and its derivative `change`; `accelerations` (k, 9), or (k, 12) where positions are known. `turns` and
    `gap` (k - 1,): where the arm turns between two nodes, and where nothing is known.
    """

    t: Array
    base_axes: Any
    change: Any
    accelerations: Array
    turns: NDArray[np.bool_]
    gap: NDArray[np.bool_]

    @property
    def knows_positions(self) -> bool:
        """Whether the accelerations of the flange are among those known."""
        return len(self.accelerations[0]) > 9

    def axes_at(self, t: Array) -> Array:
        """The base's axes in flange axes (n, 3, 3) at t (n,)."""
        axes: Array = self.base_axes(t).reshape(-1, 3, 3)
        return axes

    def change_at(self, t: Array) -> Array:
        """Their derivative (n, 3, 3), 1/s; zero where the arm does not turn."""
        change: Array = self.change(t).reshape(-1, 3, 3)
        change[~self.turns[self._place(t)]] = 0.0
        return change

    def accelerations_at(self, t: Array) -> Array:
        """The terms (n, 9 or 12) that exert a wrench beside gravity, at t (n,)."""
        place = self._place(t)
        share = ((t - self.t[place]) / (self.t[place + 1] - self.t[place]))[:, None]
        before, after = self.accelerations[place], self.accelerations[place + 1]
        between: Array = before + share * (after - before)
        return between

    def is_known(self, earliest: Array, latest: Array) -> NDArray[np.bool_]:
        """Whether all moments from `earliest` to `latest` (n,) lie within the recording and in no gap."""
        gaps = np.r_[0, np.cumsum(self.gap)]
        known = gaps[self._place(earliest)] == gaps[self._place(latest) + 1]
        inside: NDArray[np.bool_] = (earliest >= self.t[0]) & (latest <= self.t[-1]) & known
        return inside

    def _place(self, t: Array) -> NDArray[np.intp]:
        """The nodes that come before t (n,), the last one left out."""
        return np.clip(np.searchsorted(self.t, t, "right") - 1, 0, len(self.t) - 2)


SPEED_OVER = 0.1
LEAST_SPEED = 0.01
"""rad/s, over so many s: slower than that is the trembling of an arm at rest, or of its encoders."""


def arm_motion(buffer: Buffer, nodes: Nodes, longest_gap: float) -> ArmMotion:
    """The motion through the orientations of a whole recording, whose gaps are longer than `longest_gap` s."""
    from scipy.interpolate import CubicHermiteSpline
    from scipy.ndimage import uniform_filter1d

    index, orientations = nodes.index, buffer.orientations
    fast = CELL / max(float(np.median(np.diff(nodes.t))), 1e-9)
    if fast >= 2.0:
        index = index[:: int(fast)]
    t, R = orientations.t[index], orientations.R_base_flange[index]
    is_gap = np.r_[0, np.cumsum(np.diff(orientations.t[: nodes.count]) > longest_gap)]
    axes = R.reshape(-1, 9)
    spline = CubicHermiteSpline(t, axes, np.gradient(axes, t, axis=0))
    middle = 0.5 * (t[1:] + t[:-1])
    step = np.diff(t)[:, None]
    width = 2 * round(0.5 * SMOOTHED / float(np.median(step))) + 1
    angular_velocity = uniform_filter1d(rotation_vectors(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / step, width, axis=0)
    angular = _between(middle, angular_velocity, t)
    accelerations = [
        _derivative(middle, angular_velocity, t),
        np.stack([angular[:, i] * angular[:, j] for i, j in PRODUCTS], axis=1),
    ]
    if orientations.position is not None:
        velocity = uniform_filter1d(np.diff(orientations.position[index], axis=0) / step, width, axis=0)
        accelerations.append(np.einsum("nij,ni->nj", R, _derivative(middle, velocity, t)))
    half = max(0.5 * SPEED_OVER, float(np.median(step)))
    ends = [spline(np.clip(middle + sign * half, t[0], t[-1])) for sign in (-1.0, 1.0)]
    speed = np.linalg.norm(ends[1] - ends[0], axis=1) / (np.sqrt(2.0) * 2.0 * half)
    return ArmMotion(
        t,
        spline,
        spline.derivative(),
        np.concatenate(accelerations, axis=1),
        speed >= LEAST_SPEED,
        np.diff(is_gap[index]) > 0,
    )


def _between(middle: Array, values: Array, t: Array) -> Array:
    return np.stack([np.interp(t, middle, column) for column in values.T], axis=1)


def _derivative(middle: Array, rate: Array, t: Array) -> Array:
    """The derivative at `t` of a `rate` that is known in the `middle` of the steps."""
    if len(middle) < 2:
        return np.zeros((len(t), rate.shape[1]))
    return _between(t[1:-1], np.diff(rate, axis=0) / np.diff(middle)[:, None], t)
