"""Every convention against products of elementary rotations, and against what the brands themselves publish."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.errors import InputError
from contactwrench.geometry.orientation import CONVENTIONS, convention, nearest_rotations, rotation_matrices
from tests.support.recordings import Array, generic_rotations, rx, ry, rz

DEG = np.pi / 180.0
GENERIC_ANGLES = [(31.0, -52.0, 117.0), (-163.0, 24.0, -71.0), (88.0, 79.0, 12.0), (-12.5, -88.0, 179.0)]


def as_convention(name: str, columns: object) -> Array:
    """The matrix that a convention makes of one row of its columns, angles in radians."""
    matrix: Array = convention(name).to_matrices(np.array([columns], dtype=np.float64))[0]
    return matrix


def quaternion_of_turn(axis: tuple[float, float, float], angle: float) -> tuple[float, float, float, float]:
    """x, y, z, w of a turn by `angle` about a unit axis."""
    x, y, z = np.array(axis) * np.sin(angle / 2.0)
    return x, y, z, np.cos(angle / 2.0)


def product_xyzw(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, float, float, float]:
    """Hamilton's product: the turn q, then the turn p, about fixed axes."""
    v, w = np.array(p[:3]), p[3]
    u, s = np.array(q[:3]), q[3]
    x, y, z = w * u + s * v + np.cross(v, u)
    return x, y, z, w * s - float(v @ u)


@pytest.mark.parametrize("degrees", GENERIC_ANGLES)
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("kuka_abc", lambda a, b, c: rz(a) @ ry(b) @ rx(c)),
        ("fanuc_wpr", lambda w, p, r: rz(r) @ ry(p) @ rx(w)),
        ("yaskawa", lambda x, y, z: rz(z) @ ry(y) @ rx(x)),
        ("staubli", lambda x, y, z: rx(x) @ ry(y) @ rz(z)),
        ("kawasaki_oat", lambda o, a, t: rz(o) @ ry(a) @ rz(t)),
        ("nachi", lambda r, p, y: rz(r) @ ry(p) @ rx(y)),
        ("rpy", lambda roll, pitch, yaw: rz(yaw) @ ry(pitch) @ rx(roll)),
        ("euler:ZYX:deg", lambda a, b, c: rz(a) @ ry(b) @ rx(c)),
        ("euler:zyx:deg", lambda a, b, c: rx(c) @ ry(b) @ rz(a)),
        ("euler:XZY:rad", lambda a, b, c: rx(a) @ rz(b) @ ry(c)),
        ("euler:zxz:rad", lambda a, b, c: rz(c) @ rx(b) @ rz(a)),
    ],
)
def test_angles_are_products_of_elementary_rotations(
    name: str, expected: Callable[[float, float, float], Array], degrees: tuple[float, float, float]
) -> None:
    a, b, c = (angle * DEG for angle in degrees)
    assert as_convention(name, (a, b, c)) == pytest.approx(expected(a, b, c), abs=1e-12)


@pytest.mark.parametrize("degrees", GENERIC_ANGLES)
def test_quaternions_are_products_of_elementary_ones_in_the_order_that_the_name_states(
    degrees: tuple[float, float, float],
) -> None:
    a, b, c = (angle * DEG for angle in degrees)
    about_z, about_y = quaternion_of_turn((0.0, 0.0, 1.0), a), quaternion_of_turn((0.0, 1.0, 0.0), b)
    x, y, z, w = product_xyzw(product_xyzw(about_z, about_y), quaternion_of_turn((1.0, 0.0, 0.0), c))
    expected = rz(a) @ ry(b) @ rx(c)
    assert as_convention("quat_xyzw", (x, y, z, w)) == pytest.approx(expected, abs=1e-12)
    assert as_convention("quat_wxyz", (w, x, y, z)) == pytest.approx(expected, abs=1e-12)
    assert as_convention("abb_quat", (w, x, y, z)) == pytest.approx(expected, abs=1e-12)
    assert as_convention("quat_xyzw", (-x, -y, -z, -w)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("degrees", GENERIC_ANGLES)
def test_a_rotation_vector_turns_about_itself_by_its_length(degrees: tuple[float, float, float]) -> None:
    a, b, angle = (part * DEG for part in degrees)
    to_axis = rz(a) @ ry(b)
    vector = angle * to_axis[:, 2]
    assert as_convention("ur_rotvec", vector) == pytest.approx(to_axis @ rz(angle) @ to_axis.T, abs=1e-12)


def test_matrix_entries_come_row_by_row_and_franka_poses_column_by_column() -> None:
    R = rz(0.3) @ ry(-1.1) @ rx(2.0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, (0.4, -0.2, 0.7)
    assert as_convention("matrix", R.ravel()) == pytest.approx(R, abs=1e-12)
    assert as_convention("franka_matrix", pose.T.ravel()) == pytest.approx(R, abs=1e-12)
    assert as_convention("rot6d", np.r_[R[:, 0], R[:, 1]]) == pytest.approx(R, abs=1e-12)
    assert as_convention("rot6d_rows", R[:2].ravel()) == pytest.approx(R, abs=1e-12)


def test_six_numbers_that_are_no_two_axes_are_refused() -> None:
    with pytest.raises(InputError) as caught:
        as_convention("rot6d", np.array([1.0, 0.0, 0.0, 0.6, 0.8, 0.0]))
    assert str(caught.value) == (
        "orientation 0 is a matrix that is no rotation (columns off orthonormal by 0.6, determinant 0.64), expected "
        "orthonormal within 1 % and determinant 1: check the order of its entries"
    )


def test_a_franka_pose_written_row_by_row_is_refused_and_not_read_as_its_inverse() -> None:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rz(0.3) @ ry(-1.1), (0.4, -0.2, 0.7)
    with pytest.raises(InputError) as caught:
        as_convention("franka_matrix", pose.ravel())
    assert str(caught.value) == (
        "orientation 0 is a pose with the last row 0.4, -0.2, 0.7, 1, expected 0, 0, 0, 1: check that its entries "
        "come column by column"
    )


@pytest.mark.parametrize(
    ("quaternion", "expected"),
    [
        ((1.0, 0.0, 0.0, 0.0), np.eye(3)),
        ((0.707, 0.0, 0.707, 0.0), np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])),
        ((0.965926, 0.0, 0.258819, 0.0), ry(30.0 * DEG)),
    ],
)
def test_abb_worked_examples(quaternion: tuple[float, ...], expected: Array) -> None:
    """ABB, Technical reference manual, RAPID instructions, functions and data types: data type `orient`.

    Example 1: the tool's z along the wrist's x, so x' = -z, y' = y, z' = x, is [0.707, 0, 0.707, 0]. Example 2: a
    tool turned by 30 degrees about the wrist's y, x' = (cos 30, 0, -sin 30), is [0.965926, 0, 0.258819, 0].
    """
    assert as_convention("abb_quat", quaternion) == pytest.approx(expected, abs=1e-6)


def test_universal_robots_worked_example() -> None:
    """Universal Robots, Script Manual, `rotvec2rpy([3.14,1.57,0])` returns roll, pitch, yaw [-2.80856, -0.16202, 0.9].

    https://www.universal-robots.com/manuals/EN/HTML/SW10_7/Content/prod-scriptmanual/G5/rotvec2rpy_rotation_vector.htm
    Its roll-pitch-yaw is Rz(yaw) Ry(pitch) Rx(roll).
    """
    roll, pitch, yaw = -2.80856, -0.16202, 0.9
    vector = as_convention("ur_rotvec", (3.14, 1.57, 0.0))
    assert vector == pytest.approx(rz(yaw) @ ry(pitch) @ rx(roll), abs=2e-5)
    assert as_convention("rpy", (roll, pitch, yaw)) == pytest.approx(vector, abs=2e-5)


@pytest.mark.parametrize(("o", "a", "t"), GENERIC_ANGLES)
def test_kawasaki_published_conversion(o: float, a: float, t: float) -> None:
    """Roboception, rc_visard manual, "Kawasaki XYZ-OAT format": the quaternion of O, A, T in closed form.

    https://doc.rc-visard.com/latest/en/pose_format_kawasaki.html
    """
    (co, so), (ca, sa), (ct, st) = ((np.cos(angle * DEG / 2), np.sin(angle * DEG / 2)) for angle in (o, a, t))
    quat_xyzw = (
        co * sa * st - so * sa * ct,
        co * sa * ct + so * sa * st,
        so * ca * ct + co * ca * st,
        co * ca * ct - so * ca * st,
    )
    expected = as_convention("quat_xyzw", quat_xyzw)
    assert as_convention("kawasaki_oat", np.array([o, a, t]) * DEG) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", ["fanuc_wpr", "yaskawa"])
@pytest.mark.parametrize(("x", "y", "z"), GENERIC_ANGLES)
def test_fanuc_and_yaskawa_published_conversion(name: str, x: float, y: float, z: float) -> None:
    """Roboception, rc_visard manual, "FANUC XYZ-WPR format" and "Yaskawa Pose Format": the quaternion in closed form.

    https://docs.baslerweb.com/stereovisard/rc_cube/en/pose_format_yaskawa
    """
    (cx, sx), (cy, sy), (cz, sz) = ((np.cos(angle * DEG / 2), np.sin(angle * DEG / 2)) for angle in (x, y, z))
    quat_xyzw = (
        cz * cy * sx - sz * sy * cx,
        cz * sy * cx + sz * cy * sx,
        sz * cy * cx - cz * sy * sx,
        cz * cy * cx + sz * sy * sx,
    )
    expected = as_convention("quat_xyzw", quat_xyzw)
    assert as_convention(name, np.array([x, y, z]) * DEG) == pytest.approx(expected, abs=1e-12)


def test_every_convention_is_tested_here() -> None:
    assert set(CONVENTIONS) == {
        *("quat_xyzw", "quat_wxyz", "abb_quat", "matrix", "franka_matrix", "ur_rotvec", "rpy"),
        *("rot6d", "rot6d_rows"),
        *("kuka_abc", "fanuc_wpr", "yaskawa", "staubli", "kawasaki_oat", "nachi"),
    }


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("form", ["matrices", "quaternions", "Rotation", "lists"])
def test_orientations_are_taken_in_every_form_that_is_promised(form: str, single: bool) -> None:
    R = generic_rotations(5)
    rotation = Rotation.from_matrix(R)
    forms = {"matrices": R, "quaternions": rotation.as_quat(), "Rotation": rotation, "lists": R}
    given = forms[form][2] if single else forms[form]
    matrices, was_single = rotation_matrices(given.tolist() if form == "lists" else given)
    assert (was_single == ()) is single
    assert matrices == pytest.approx(R[[2]] if single else R, abs=1e-12)


def test_rounded_figures_become_the_nearest_rotation() -> None:
    R = generic_rotations(20)
    matrices, _ = rotation_matrices(np.round(R, 3))
    assert matrices @ matrices.transpose(0, 2, 1) == pytest.approx(np.tile(np.eye(3), (20, 1, 1)), abs=1e-12)
    assert matrices == pytest.approx(R, abs=1.5e-3)
    assert nearest_rotations(R) == pytest.approx(R, abs=1e-12)


def test_a_rotation_vector_of_more_than_a_turn_is_refused_as_angles_in_degrees() -> None:
    assert as_convention("ur_rotvec", (0.0, 0.0, 6.2)) == pytest.approx(rz(6.2), abs=1e-12)
    with pytest.raises(InputError) as caught:
        as_convention("ur_rotvec", (179.0, -3.0, 44.0))
    assert caught.value.row == 0
    assert str(caught.value) == (
        "orientation 0 is a rotation vector of 184.353 rad, expected at most a whole turn: if these are angles in "
        "degrees, say whose (--orientation yaskawa or staubli; contactwrench diagnose tells)"
    )


NO_ROTATION = "is a matrix that is no rotation (columns off orthonormal by"
CHECK_ENTRIES = "expected orthonormal within 1 % and determinant 1: check the order of its entries"
CHECK_PARTS = "expected 1 within 1 %: check the order of its parts and that none is cut off"
SHAPES = "expected (n, 3, 3) rotation matrices, (n, 4) quaternions x, y, z, w or a scipy Rotation"


@pytest.mark.parametrize(
    ("orientation", "message"),
    [
        ([[0, 0, 0, 1], [0, 0, 0, 0]], f"orientation 1 is a quaternion of length 0, {CHECK_PARTS}"),
        ([0, 0, 0, 1.011], f"orientation 0 is a quaternion of length 1.011, {CHECK_PARTS}"),
        ([0, 0, 0, 0.989], f"orientation 0 is a quaternion of length 0.989, {CHECK_PARTS}"),
        ([0, 0, np.nan, 1], f"orientation 0 is a quaternion of length nan, {CHECK_PARTS}"),
        ([0, 0, 1e300, 1], f"orientation 0 is a quaternion of length inf, {CHECK_PARTS}"),
        (np.diag([1.0, 1.0, -1.0]), f"orientation 0 {NO_ROTATION} 0, determinant -1), {CHECK_ENTRIES}"),
        (np.eye(3) * 1.02, f"orientation 0 {NO_ROTATION} 0.0404, determinant 1.06), {CHECK_ENTRIES}"),
        (np.zeros((3, 3)), f"orientation 0 {NO_ROTATION} 1, determinant 0), {CHECK_ENTRIES}"),
        (np.full((3, 3), np.inf), f"orientation 0 {NO_ROTATION} inf, determinant nan), {CHECK_ENTRIES}"),
        (np.zeros(3), f"orientation has shape (3,), {SHAPES}"),
        (np.zeros((7, 3)), f"orientation has shape (7, 3), {SHAPES}"),
    ],
)
def test_what_is_no_orientation_is_refused(orientation: Array, message: str) -> None:
    with pytest.raises(InputError) as caught:
        rotation_matrices(orientation)
    assert str(caught.value) == message


def test_the_first_wrong_row_is_named() -> None:
    R = generic_rotations(6)
    R[[3, 5]] *= 1.5
    with pytest.raises(InputError) as caught:
        rotation_matrices(R)
    assert caught.value.row == 3
    assert str(caught.value).startswith("orientation 3 is ")


KNOWN = (
    "expected one of quat_xyzw, quat_wxyz, kuka_abc, fanuc_wpr, yaskawa, staubli, kawasaki_oat, nachi, ur_rotvec, "
    "abb_quat, matrix, franka_matrix, rot6d, rot6d_rows, rpy, euler:ZYX:deg, or auto"
)
LETTERS = "expected three such as ZYX (turned axes) or xyz (fixed axes)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("kuka", f"orientation 'kuka' is not known, {KNOWN}"),
        ("", f"orientation '' is not known, {KNOWN}"),
        ("euler", f"orientation 'euler': found Euler letters '', {LETTERS}"),
        ("euler:ZYW:deg", f"orientation 'euler:ZYW:deg': found Euler letters 'ZYW', {LETTERS}"),
        ("euler:ZyX:deg", f"orientation 'euler:ZyX:deg': found Euler letters 'ZyX', {LETTERS}"),
        ("euler:ZZX:deg", f"orientation 'euler:ZZX:deg': found Euler letters 'ZZX', {LETTERS}"),
        ("euler:ZYX", "orientation 'euler:ZYX': found unit '', expected deg or rad, as in euler:ZYX:deg"),
        ("kuka_abc:a,b", "orientation 'kuka_abc:a,b': found columns 'a,b', expected 3 different names"),
        ("kuka_abc:a,b,a", "orientation 'kuka_abc:a,b,a': found columns 'a,b,a', expected 3 different names"),
        ("kuka_abc:a,,c", "orientation 'kuka_abc:a,,c': found columns 'a,,c', expected 3 different names"),
    ],
)
def test_what_is_no_convention_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        convention(text)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("quat_wxyz:q0,q1,q2,q3", ("q0", "q1", "q2", "q3")),
        ("quat_wxyz: Q0 , Q1,Q2,Q3", ("q0", "q1", "q2", "q3")),
        ("euler:ZYX:deg:yaw,pitch,roll", ("yaw", "pitch", "roll")),
        ("staubli", ("rx", "ry", "rz")),
    ],
)
def test_columns_are_those_that_are_named_or_the_usual_ones(text: str, columns: tuple[str, ...]) -> None:
    assert convention(text).columns == columns
