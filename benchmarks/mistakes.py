"""Recordings as files: without a mistake, or with one or two that a person makes, so that they say one thing and hold
another.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.measured_sets import measured_sets
from tests.support.world import Array, noisy_readings, random_rig, random_rotations, tilted_down

NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])

LETTERS = {
    "kuka_abc": "ZYX",
    "fanuc_wpr": "xyz",
    "yaskawa": "xyz",
    "staubli": "XYZ",
    "kawasaki_oat": "ZYZ",
    "rpy": "xyz",
}
COLUMNS = {
    "kuka_abc": ("a", "b", "c"),
    "fanuc_wpr": ("w", "p", "r"),
    "yaskawa": ("rx", "ry", "rz"),
    "staubli": ("rx", "ry", "rz"),
    "kawasaki_oat": ("o", "a", "t"),
    "rpy": ("roll", "pitch", "yaw"),
    "ur_rotvec": ("rx", "ry", "rz"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "quat_wxyz": ("qw", "qx", "qy", "qz"),
    "matrix": tuple(f"r{i}{j}" for i in "123" for j in "123"),
}
OF_ANGLES = (*LETTERS, "ur_rotvec")
UNIT = dict.fromkeys(LETTERS, "deg") | {"ur_rotvec": "rad"}

MISTAKES = ("orientation", "unit of angle", "inverse", "sign", "frame", "unit of torque", "axes", "shift")


@dataclass
class File:
    """A file in the making: what it holds, and the flags that it is read with."""

    R: Array
    wrench: Array
    written_as: str
    stated_as: str
    unit: str | None = None
    stated_unit: str | None = None
    inverse: bool = False
    sign: float = 1.0
    in_base: bool = False
    torque_factor: float = 1.0
    axes: Array = field(default_factory=lambda: np.eye(6))
    shift: int = 0

    def numbers(self) -> Array:
        """The orientation's columns, as the true convention has them."""
        R = self.R.transpose(0, 2, 1) if self.inverse else self.R
        rotation = Rotation.from_matrix(R)
        if self.written_as == "matrix":
            return R.reshape(-1, 9)
        if self.written_as.startswith("quat"):
            quat: Array = rotation.as_quat()
            return quat if self.written_as == "quat_xyzw" else quat[:, [3, 0, 1, 2]]
        angles: Array = (
            rotation.as_rotvec()
            if self.written_as == "ur_rotvec"
            else rotation.as_euler(LETTERS.get(self.written_as, self.written_as))
        )
        return np.rad2deg(angles) if self.unit == "deg" else angles

    def text(self) -> str:
        """The file as it is written."""
        wrench = self.wrench
        if self.in_base:
            wrench = np.hstack([np.einsum("nij,nj->ni", self.R, part) for part in (wrench[:, :3], wrench[:, 3:])])
        wrench = self.sign * wrench @ self.axes.T * np.repeat([1.0, self.torque_factor], 3)
        numbers = self.numbers()
        if self.shift:
            one, other = slice(self.shift, None), slice(None, -self.shift)
            wrench, numbers = (wrench[one], numbers[other]) if self.shift > 0 else (wrench[:-1], numbers[1:])
        names = COLUMNS.get(self.stated_as, ("e1", "e2", "e3"))
        suffix = (
            "" if self.stated_unit is None or self.stated_unit == UNIT.get(self.stated_as) else f"_{self.stated_unit}"
        )
        header = ",".join(["fx", "fy", "fz", "tx", "ty", "tz", *(name + suffix for name in names)])
        rows = (",".join(f"{value:.6f}" for value in row) for row in np.hstack([wrench, numbers]))
        return "\n".join([header, *rows, ""])

    def true_rows(self, there: int) -> slice:
        """Which poses a reading of that many rows should hold, if it is the right one."""
        n = len(self.R)
        if self.shift == 0 or there != n - 2:
            return slice(None)
        return slice(1, n - 1)


@cache
def measured() -> list[tuple[Array, Array]]:
    """Orientations and wrenches of the measured sets that are at hand."""
    return [(samples.R_base_flange, samples.wrench) for samples in measured_sets().values()]


def a_set(rng: np.random.Generator) -> tuple[Array, Array]:
    """A measured set, one time in three, or a simulated one: any tool and mounting, 6 to 24 poses."""
    if rng.random() < 1.0 / 3.0:
        return measured()[int(rng.integers(len(measured())))]
    R = random_rotations(int(rng.integers(6, 25)), rng)
    return R, noisy_readings(random_rig(rng), R, NOISE, rng)


def as_it_should_be(rng: np.random.Generator, R: Array, wrench: Array) -> File:
    """A file without a mistake, in a convention by chance."""
    name = str(rng.choice(list(COLUMNS)))
    unit = UNIT.get(name)
    if unit is not None and rng.random() < 0.3:
        unit = "rad" if unit == "deg" else "deg"
    return File(R, wrench, name, name, unit, unit)


def with_mistakes(rng: np.random.Generator) -> tuple[File, tuple[str, ...]]:
    """A file with one or two mistakes."""
    file = as_it_should_be(rng, *a_set(rng))
    kinds = [str(kind) for kind in rng.choice(MISTAKES, size=int(rng.integers(1, 3)), replace=False)]
    for kind in kinds:
        _make_mistake(file, kind, rng)
    return file, tuple(kinds)


def _make_mistake(file: File, kind: str, rng: np.random.Generator) -> None:
    three = file.stated_as in OF_ANGLES
    if kind == "orientation" and three:
        others = [name for name in OF_ANGLES if LETTERS.get(name) != LETTERS.get(file.stated_as)]
        file.written_as = str(rng.choice(others))
    elif kind == "orientation" and file.stated_as.startswith("quat"):
        file.written_as = "quat_wxyz" if file.stated_as == "quat_xyzw" else "quat_xyzw"
    elif kind == "unit of angle" and three:
        file.unit = "rad" if file.stated_unit == "deg" else "deg"
    elif kind == "sign":
        file.sign = -1.0
    elif kind == "frame":
        file.in_base = True
    elif kind == "unit of torque":
        file.torque_factor = 1e3
    elif kind == "axes":
        file.axes = _exchanged(rng)
    elif kind == "shift":
        file.shift = int(rng.choice([-1, 1]))
    else:
        file.inverse = True


def _exchanged(rng: np.random.Generator) -> Array:
    """Two axes exchanged, of force and torque or of one of them; or one reversed, of both.

    Not one of a single kind: where the centre of mass lies on an axis, as in two of the measured sets, the torque about
    that axis is nothing but noise, and so is its sign.
    """
    R = np.eye(3)
    i, j = rng.choice(3, size=2, replace=False)
    axes, which = np.eye(6), int(rng.integers(4))
    if which == 3:
        R[i, i] = -1.0
    else:
        R[[i, j]] = R[[j, i]]
    if which != 1:
        axes[:3, :3] = R
    if which != 2:
        axes[3:, 3:] = R
    return axes


def correct_file(rng: np.random.Generator) -> File:
    """A file without a mistake: clean, or with few poses, a leaning base, a light tool, or one pose in contact."""
    rig = random_rig(rng)
    trouble = rng.integers(5)
    n = int(rng.integers(5, 8)) if trouble == 1 else int(rng.integers(8, 25))
    if trouble == 2:
        rig = replace(rig, down=tilted_down(np.deg2rad(rng.uniform(0.0, 10.0)), rng))
    if trouble == 3:
        rig = replace(rig, weight=0.5)
    R = random_rotations(n, rng)
    wrench = noisy_readings(rig, R, NOISE, rng)
    if trouble == 4:
        wrench[rng.integers(n)] += rng.normal(size=6) * [5.0, 5.0, 5.0, 0.5, 0.5, 0.5]
    return as_it_should_be(rng, R, wrench)


def correct_file_of_few_poses(rng: np.random.Generator) -> File:
    """A file without a mistake that is hard to tell from one: 5 to 24 poses all over or in a cone, light tools too,
    noise of several sizes, and one pose in contact in half of the files.
    """
    n = int(rng.integers(5, 25))
    R = random_rotations(n, rng)
    if rng.random() < 1.0 / 3.0:
        R = R[0] @ Rotation.from_rotvec(rng.normal(size=(n, 3)) * rng.uniform(0.3, 1.0)).as_matrix()
    noise = NOISE * np.exp(rng.uniform(np.log(0.2), np.log(10.0)))
    wrench = noisy_readings(random_rig(rng), R, noise, rng)
    if rng.random() < 0.5:
        push = np.exp(rng.uniform(np.log(0.5), np.log(20.0)))
        wrench[rng.integers(n)] += push * rng.normal(size=6) * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
    return as_it_should_be(rng, R, wrench)
