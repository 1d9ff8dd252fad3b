"""How each robot brand writes an orientation, turned into rotation matrices.

A convention is a name, the columns that a file usually gives it, and a function from those columns (angles
already in radians) to rotation matrices. Everything downstream sees `R_base_flange`, (n, 3, 3), and nothing else.
In scipy's letters, capitals are intrinsic rotations (about the turned axes), small letters fixed ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .arrays import Array, numbers
from .ranges import TURN
from .rotations import procrustes

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

OrientationLike: TypeAlias = "ArrayLike | Rotation"
ORIENTATIONS = "(n, 3, 3) rotation matrices, (n, 4) quaternions x, y, z, w or a scipy Rotation"
"""What is taken, in words."""

ROTATION_TOLERANCE = 0.01
"""A quaternion's length, or a matrix's axes, may be off by this much (rounded figures in a table) and no more."""

LONGEST_ROTATION_VECTOR = 2.0 * np.pi * (1.0 + ROTATION_TOLERANCE)


@dataclass(frozen=True)
class Convention:
    """One way to write an orientation.

    `columns` are the default column names; `angle_unit` is the unit of columns that carry no suffix, None where
    the columns are no angles; `to_matrices` maps (n, k) columns, angles in radians, to (n, 3, 3).
    """

    name: str
    columns: tuple[str, ...]
    angle_unit: str | None
    to_matrices: Callable[[Array], Array]
    description: str


def numbers_of(orientation: OrientationLike) -> Array:
    """Quaternions or matrices as they were handed over, of a scipy `Rotation` its quaternions. Raises `InputError`."""
    return numbers(orientation.as_quat() if hasattr(orientation, "as_quat") else orientation, "orientation")


def from_quat_xyzw(quat_xyzw: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4), scalar last.

    Raises `InputError` naming the first row whose length is off 1 by more than 1 %.
    """
    from scipy.spatial.transform import Rotation

    require_unit(quat_xyzw)
    return np.asarray(Rotation.from_quat(quat_xyzw).as_matrix())


def to_quat_xyzw(R: Array, *, canonical: bool = False) -> Array:
    """Quaternions (n, 4), scalar last, of rotations (n, 3, 3), or of one; `canonical`: the scalar is not negative."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=canonical) if len(R) else np.empty((0, 4)))


def _refuse_first(wrong: ArrayLike, found: Callable[[int], str]) -> None:
    """Raise `InputError` with what was `found` in the first row that is wrong."""
    if np.any(wrong):
        row = int(np.argmax(wrong))
        raise InputError(f"orientation {row} is {found(row)}", row)


def require_unit(quat_xyzw: Array) -> None:
    """Raise `InputError` as `from_quat_xyzw`."""
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quat_xyzw, axis=1)
    expected = "expected 1 within 1 %: check the order of its parts and that none is cut off"
    wrong = ~(np.abs(length - 1.0) <= ROTATION_TOLERANCE)
    _refuse_first(wrong, lambda row: f"a quaternion of length {length[row]:.6g}, {expected}")


def nearest_rotations(matrices: Array) -> Array:
    """The rotations nearest to (n, 3, 3) matrices whose axes are unit and square within 1 %.

    Raises `InputError` naming the first matrix that is no rotation (a mirrored one included).
    """
    if require_rotations(matrices.reshape(-1, 9)) > 1e-12:
        return procrustes(matrices)
    return matrices


def require_rotations(matrices: Array) -> float:
    """How far row-major matrices (n, 9) are from orthonormal at most. Raises `InputError` as `nearest_rotations`."""
    deviation, handedness = off_rotation(matrices)
    wrong = ~((deviation <= 2.0 * ROTATION_TOLERANCE) & (handedness > 0.0))
    expected = "expected orthonormal within 1 % and determinant 1: check the order of its entries"
    off = f"a matrix that is no rotation (columns off orthonormal by {{:.3g}}, determinant {{:.3g}}), {expected}"
    _refuse_first(wrong, lambda row: off.format(deviation[row], handedness[row]))
    return float(deviation.max(initial=0.0))


def off_rotation(matrices: Array) -> tuple[Array, Array]:
    """How far the columns of row-major matrices (n, 9) are from orthonormal, and the determinants: (n,) each."""
    x, y, z = np.ascontiguousarray(matrices.T).reshape(3, 3, -1).swapaxes(0, 1)
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(np.einsum("im,im->m", x, x) - 1.0)
        for a, b, unit in [(y, y, 1.0), (z, z, 1.0), (x, y, 0.0), (x, z, 0.0), (y, z, 0.0)]:
            np.maximum(deviation, np.abs(np.einsum("im,im->m", a, b) - unit), out=deviation)
        across = [x[i] * y[j] - x[j] * y[i] for i, j in ((1, 2), (2, 0), (0, 1))]
        return deviation, np.einsum("im,im->m", across, z)


def rotation_matrices(orientation: OrientationLike) -> tuple[Array, tuple[int, ...]]:
    """`R_base_flange` as (n, 3, 3), and its leading shape: (n,), () of a single one, (b, n) of a batch of sequences.

    `orientation`: rotation matrices (n, 3, 3), quaternions x, y, z, w (n, 4), or a scipy Rotation, each with any
    leading shape in place of n. Raises `InputError` on any other shape, as of poses (n, 4, 4), which are no quaternions
    in fours, and on what is no rotation.
    """
    if hasattr(orientation, "as_matrix"):
        matrices = np.asarray(orientation.as_matrix(), dtype=np.float64)
        return matrices.reshape(-1, 3, 3), matrices.shape[:-2]
    values = numbers(orientation, "orientation")
    if values.shape[-2:] == (3, 3):
        return nearest_rotations(values.reshape(-1, 3, 3)), values.shape[:-2]
    are_poses = values.ndim > 2 and values.shape[-2:] == (4, 4) and (values[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()
    if values.shape[-1:] == (4,) and not are_poses:
        return from_quat_xyzw(values.reshape(-1, 4)), values.shape[:-1]
    raise InputError(f"orientation has shape {values.shape}, expected {ORIENTATIONS}")


def _euler(letters: str) -> Callable[[Array], Array]:
    def to_matrices(angles: Array) -> Array:
        from scipy.spatial.transform import Rotation

        if len(beyond := TURN.outside(angles)):
            row = int(np.argmin(TURN.holds(angles).all(axis=1)))
            raise InputError(f"orientation {row} is an angle of {beyond[0]:g} rad, expected {TURN}", row)
        return np.asarray(Rotation.from_euler(letters, angles).as_matrix())

    return to_matrices


def require_whole_turn(angles: Array) -> None:
    """Raise `InputError` naming the first row of angles (n, k), rad, of which one is beyond a whole turn."""
    expected = "expected at most a whole turn: if these are degrees, read them with --units angle=deg"
    beyond = (np.abs(angles) > LONGEST_ROTATION_VECTOR).any(axis=1)
    _refuse_first(beyond, lambda row: f"an angle of {np.abs(angles[row]).max():.6g} rad, {expected}")


def _from_rotation_vector(vectors: Array) -> Array:
    """Rotations by |v| rad about v. More than a whole turn is refused: such columns hold angles in degrees."""
    from scipy.spatial.transform import Rotation

    with np.errstate(over="ignore"):
        length = np.linalg.norm(vectors, axis=1)
    whose = "say whose (--orientation yaskawa or staubli; contactwrench diagnose tells)"
    expected = f"expected at most a whole turn: if these are angles in degrees, {whose}"
    wrong = ~(length <= LONGEST_ROTATION_VECTOR)
    _refuse_first(wrong, lambda row: f"a rotation vector of {length[row]:.6g} rad, {expected}")
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())


def _from_quat_wxyz(quat_wxyz: Array) -> Array:
    return from_quat_xyzw(quat_wxyz[:, [1, 2, 3, 0]])


def _from_column_major_pose(entries: Array) -> Array:
    """The rotations of 4 x 4 poses. A pose written row by row is refused: read by columns it would be the inverse."""
    poses = entries.reshape(-1, 4, 4).transpose(0, 2, 1)
    wrong = np.abs(poses[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > ROTATION_TOLERANCE
    expected = "expected 0, 0, 0, 1: check that its entries come column by column"
    _refuse_first(
        wrong, lambda row: f"a pose with the last row {', '.join(f'{e:g}' for e in poses[row, 3])}, {expected}"
    )
    return nearest_rotations(poses[:, :3, :3])


SIX = tuple(f"rot6d_{k}" for k in range(6))


def _from_two_columns(entries: Array) -> Array:
    """Rotations of their first two columns, one after the other (Zhou et al., 2019, section 4)."""
    x, y = entries[:, :3], entries[:, 3:]
    return nearest_rotations(np.stack([x, y, np.cross(x, y)], axis=2))


def _from_two_rows(entries: Array) -> Array:
    return _from_two_columns(entries).transpose(0, 2, 1)


CONVENTIONS: dict[str, Convention] = {
    c.name: c
    for c in (
        Convention("quat_xyzw", ("qx", "qy", "qz", "qw"), None, from_quat_xyzw, "quaternion, scalar last (ROS)"),
        Convention("quat_wxyz", ("qw", "qx", "qy", "qz"), None, _from_quat_wxyz, "quaternion, scalar first"),
        Convention("kuka_abc", ("a", "b", "c"), "deg", _euler("ZYX"), "KUKA: Rz(A) Ry(B) Rx(C)"),
        Convention("fanuc_wpr", ("w", "p", "r"), "deg", _euler("xyz"), "FANUC: Rz(R) Ry(P) Rx(W)"),
        Convention("yaskawa", ("rx", "ry", "rz"), "deg", _euler("xyz"), "Yaskawa: Rz(Rz) Ry(Ry) Rx(Rx)"),
        Convention("staubli", ("rx", "ry", "rz"), "deg", _euler("XYZ"), "Staubli: Rx(Rx) Ry(Ry) Rz(Rz)"),
        Convention("kawasaki_oat", ("o", "a", "t"), "deg", _euler("ZYZ"), "Kawasaki: Rz(O) Ry(A) Rz(T)"),
        Convention("nachi", ("r", "p", "y"), "deg", _euler("ZYX"), "Nachi: Rz(r) Ry(p) Rx(y)"),
        Convention("ur_rotvec", ("rx", "ry", "rz"), "rad", _from_rotation_vector, "UR: rotation vector"),
        Convention("abb_quat", ("q1", "q2", "q3", "q4"), None, _from_quat_wxyz, "ABB: quaternion, q1 the scalar"),
        Convention(
            "matrix",
            tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
            None,
            lambda entries: nearest_rotations(entries.reshape(-1, 3, 3)),
            "rotation matrix, row by row",
        ),
        Convention(
            "franka_matrix",
            tuple(f"o_t_ee_{k}" for k in range(16)),
            None,
            _from_column_major_pose,
            "Franka: 4 x 4 pose, column by column",
        ),
        Convention("rot6d", SIX, None, _from_two_columns, "robot learning: the matrix' first two columns"),
        Convention("rot6d_rows", SIX, None, _from_two_rows, "PyTorch3D: the matrix' first two rows"),
        Convention("rpy", ("roll", "pitch", "yaw"), "deg", _euler("xyz"), "Rz(yaw) Ry(pitch) Rx(roll)"),
    )
}

USUAL_NAMES = ("quat_xyzw", "matrix", "kuka_abc", "fanuc_wpr", "ur_rotvec")
RECOGNISED_BY_NAME = (*USUAL_NAMES, "rpy", "franka_matrix")
"""The conventions that a file's column names tell by themselves, without an option; usual names first of all."""


def convention(text: str) -> Convention:
    """The convention that `NAME[:COLUMNS]` asks for, e.g. `quat_wxyz:q0,q1,q2,q3` or `euler:ZYX:deg:a,b,c`.

    Raises `InputError` for an unknown name, Euler letters that scipy does not know, or a wrong number of columns.
    """
    name, _, columns = text.partition(":")
    if name == "euler":
        letters, _, rest = columns.partition(":")
        unit, _, columns = rest.partition(":")
        same_case = letters.isupper() or letters.islower()
        repeats = any(a == b for a, b in pairwise(letters))
        if len(letters) != 3 or not same_case or set(letters.upper()) - set("XYZ") or repeats:
            raise InputError(
                f"orientation {text!r}: found Euler letters {letters!r}, expected three such as ZYX (turned axes) "
                "or xyz (fixed axes)"
            )
        if unit not in ("deg", "rad"):
            raise InputError(f"orientation {text!r}: found unit {unit!r}, expected deg or rad, as in euler:ZYX:deg")
        chosen = Convention("euler", ("e1", "e2", "e3"), unit, _euler(letters), f"Euler {letters}")
    elif name in CONVENTIONS:
        chosen = CONVENTIONS[name]
    else:
        known = ", ".join([*CONVENTIONS, "euler:ZYX:deg"])
        raise InputError(f"orientation {text!r} is not known, expected one of {known}, or auto")
    if not columns:
        return chosen
    names = tuple(c.strip().lower() for c in columns.split(","))
    if len(names) != len(chosen.columns) or not all(names) or len(set(names)) != len(names):
        raise InputError(
            f"orientation {text!r}: found columns {columns!r}, expected {len(chosen.columns)} different names"
        )
    return replace(chosen, columns=names)
