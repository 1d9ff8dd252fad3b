"""Rotations by formula, and rotations and directions spread evenly: the geometry that several layers share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .wrench import cross_matrix


def rotation_exp(vector: Array) -> Array:
    """The rotation matrix of a rotation vector (3,), rad (Rodrigues)."""
    angle = math.hypot(*vector)
    K = cross_matrix(vector)
    sine, rest = (math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2) if angle > 1e-8 else (1.0, 0.5)
    return np.eye(3) + sine * K + rest * (K @ K)


def rotation_angle(R: Array) -> float:
    """The angle of a rotation matrix (3, 3), rad, 0 to pi; exact for the smallest and the largest."""
    return float(np.arctan2(np.linalg.norm(axes_of_turns(R)), np.trace(R) - 1.0))


def axes_of_turns(R: Array) -> Array:
    """The axes (..., 3) about which rotations (..., 3, 3) turn, each as long as twice the sine of its angle."""
    return np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)


def rotation_log(R: Array) -> Array:
    """The rotation vector (3,), rad, of a rotation matrix (3, 3): the inverse of `rotation_exp`, angle 0 to pi."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_rotvec())


def angles_between(R_a: Array, R_b: Array) -> Array:
    """The angles (n,), rad, from rotations (n, 3, 3) to others, or from one to all; exact for the smallest."""
    off = (R_b - R_a).reshape(-1, 9)
    return np.asarray(2.0 * np.arcsin(np.minimum(np.sqrt(np.einsum("ni,ni->n", off, off) / 8.0), 1.0)))


def procrustes(M: Array) -> Array:
    """The proper rotations R (..., k, k) with the largest `tr(R^T M)`: nearest to matrices M, never a reflection
    (orthogonal Procrustes, Kabsch 1976).
    """
    U, _, Vt = np.linalg.svd(M)
    U[..., -1] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return np.asarray(U @ Vt)


@dataclass(frozen=True, eq=False)
class Arcs:
    """The shortest turns from each of n rotations to the next: `angle` (n - 1,), rad, 0 to pi, and what makes the
    rotations between (Rodrigues, in the turned axes).
    """

    angle: Array
    start: Array
    across: Array
    back: Array

    def at(self, arc: NDArray[np.intp], share: Array) -> Array:
        """The rotations (k, 3, 3) after a `share` (k,), 0 to 1, of the turns `arc` (k,)."""
        turned = share * self.angle[arc]
        sine, rest = np.sin(turned)[:, None], (2.0 * np.sin(0.5 * turned) ** 2)[:, None]
        R: Array = self.start[arc] + sine * self.across[arc] + rest * self.back[arc]
        return R.reshape(-1, 3, 3)


def arcs_through(R: Array) -> Arcs:
    """The arcs through rotations (n, 3, 3). Of a half turn the axis is not known, and it is not turned."""
    axis, angle = _axis_and_angle(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    K = cross_matrix(axis)
    across = R[:-1] @ K
    return Arcs(angle, R[:-1].reshape(-1, 9), across.reshape(-1, 9), (across @ K).reshape(-1, 9))


def rotation_vectors(R: Array) -> Array:
    """The rotation vectors (n, 3), rad, of rotations (n, 3, 3) by less than a half turn."""
    axis, angle = _axis_and_angle(R)
    return angle[:, None] * axis


def path_through(R: Array) -> Array:
    """The path (n, 3), rad, through rotations (n, 3, 3): the rotation vectors from each to the next, summed."""
    steps = rotation_vectors(R[:-1].transpose(0, 2, 1) @ R[1:])
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _axis_and_angle(R: Array) -> tuple[Array, Array]:
    """Unit axes (n, 3), zero where there is none, and angles (n,), rad, 0 to pi."""
    axis = axes_of_turns(R)
    length = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(length, np.trace(R, axis1=1, axis2=2) - 1.0)
    return axis / np.where(length > 0.0, length, 1.0)[:, None], angle


def rotations_about_z(angle: Array) -> Array:
    """`Rz(angle)`, (m, 3, 3) for angles (m,), rad (paper, Eq. 9)."""
    R = np.zeros((len(angle), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angle)
    R[:, 1, 0] = np.sin(angle)
    R[:, 0, 1] = -R[:, 1, 0]
    R[:, 2, 2] = 1.0
    return R


@cache
def spread_directions(n: int) -> Array:
    """N unit vectors (n, 3) spread evenly over the sphere (Fibonacci lattice)."""
    k = np.arange(n) + 0.5
    z = 1.0 - 2.0 * k / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


@cache
def spread_rotations(directions: int, turns: int) -> Array:
    """Rotations (directions * turns, 3, 3): the z axis spread over the sphere, and equal turns about it.

    With 24 directions and 12 turns none is further than about 30 deg from any rotation; with 288 and 24, about 10.
    """
    z = spread_directions(directions)
    helper = np.where(np.abs(z[:, :1]) < 0.9, np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    frames = np.stack([x, np.cross(z, x), z], axis=2)
    about_z = rotations_about_z(np.linspace(0.0, 2.0 * np.pi, turns, endpoint=False))
    return (frames[:, None] @ about_z[None]).reshape(-1, 3, 3)
