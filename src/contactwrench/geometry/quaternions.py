"""Single unit quaternions x, y, z, w in plain numbers: a sample in its time has none for arrays (0.5 us against 12)."""

from __future__ import annotations

from math import acos, cos, radians, sin, sqrt
from typing import TypeAlias

Quat: TypeAlias = tuple[float, float, float, float]
"""x, y, z, w."""
OFF_UNIT = 0.01
"""By which a length may differ from 1: what senders round away, far below what is no quaternion."""


def unit(q: Quat) -> Quat | None:
    """The quaternion at length 1; None where it is none."""
    x, y, z, w = q
    length = sqrt(x * x + y * y + z * z + w * w)
    return (x / length, y / length, z / length, w / length) if abs(length - 1.0) <= OFF_UNIT else None


def product(p: Quat, q: Quat) -> Quat:
    """Of the rotations: first q, then p."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def inverse(q: Quat) -> Quat:
    """The rotation back."""
    return -q[0], -q[1], -q[2], q[3]


def rotated(q: Quat, v: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector, rotated."""
    qx, qy, qz, qw = q
    tx, ty, tz = 2 * (qy * v[2] - qz * v[1]), 2 * (qz * v[0] - qx * v[2]), 2 * (qx * v[1] - qy * v[0])
    return (
        v[0] + qw * tx + qy * tz - qz * ty,
        v[1] + qw * ty + qz * tx - qx * tz,
        v[2] + qw * tz + qx * ty - qy * tx,
    )


def between(a: Quat, b: Quat, share: float) -> Quat:
    """The orientation at a share of the shortest turn from `a` to `b`; beyond 1: carried on."""
    if a == b:
        return a
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    cosine = ax * bx + ay * by + az * bz + aw * bw
    sign = 1.0 if cosine >= 0.0 else -1.0
    if cosine * sign > 1.0 - 1e-9:
        of_a, of_b = 1.0 - share, sign * share
    else:
        half = acos(cosine * sign)
        of_a, of_b = sin((1.0 - share) * half) / sin(half), sign * sin(share * half) / sin(half)
    x, y, z, w = of_a * ax + of_b * bx, of_a * ay + of_b * by, of_a * az + of_b * bz, of_a * aw + of_b * bw
    length = sqrt(x * x + y * y + z * z + w * w)
    return x / length, y / length, z / length, w / length


def angle_between(a: Quat, b: Quat) -> float:
    """The angle (rad) from one orientation to another."""
    return 2.0 * acos(min(abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]), 1.0))


def from_rotation_vector(x: float, y: float, z: float) -> Quat:
    """Of a turn by its length, rad, about it."""
    angle = sqrt(x * x + y * y + z * z)
    scale = sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return x * scale, y * scale, z * scale, cos(0.5 * angle)


def from_kuka_abc(a: float, b: float, c: float) -> Quat:
    """Of Rz(A) Ry(B) Rx(C), degrees, as `kuka_abc` of orientation.py."""
    sa, ca, sb, cb, sc, cc = (of(radians(0.5 * angle)) for angle in (a, b, c) for of in (sin, cos))
    return (
        ca * cb * sc - sa * sb * cc,
        ca * sb * cc + sa * cb * sc,
        sa * cb * cc - ca * sb * sc,
        ca * cb * cc + sa * sb * sc,
    )
