"""Files that hold an orientation in any way, written with scipy's rotations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.recordings import WRENCH, csv_text
from tests.support.world import Array

QUAT = ("qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Written:
    """A way to write a file: header and numbers of the orientation, and what is done to the wrench."""

    columns: tuple[str, ...]
    numbers: Callable[[Array], Array]
    wrench: Callable[[Array, Array], Array] = lambda R, wrench: wrench

    def text(self, R: Array, wrench: Array) -> str:
        return csv_text((*WRENCH, *self.columns), np.column_stack([self.wrench(R, wrench), self.numbers(R)]))


def euler(letters: str, *, degrees: bool = True) -> Callable[[Array], Array]:
    return lambda R: Rotation.from_matrix(R).as_euler(letters, degrees=degrees)


def rotvec(R: Array) -> Array:
    vectors: Array = Rotation.from_matrix(R).as_rotvec()
    return vectors


def quat(R: Array) -> Array:
    xyzw: Array = Rotation.from_matrix(R).as_quat()
    return xyzw


def column_by_column(R: Array) -> Array:
    poses = np.tile(np.eye(4), (len(R), 1, 1))
    poses[:, :3, :3] = R
    return poses.transpose(0, 2, 1).reshape(-1, 16)


def in_base_axes(R: Array, wrench: Array) -> Array:
    return np.hstack([np.einsum("nij,nj->ni", R, part) for part in (wrench[:, :3], wrench[:, 3:])])
