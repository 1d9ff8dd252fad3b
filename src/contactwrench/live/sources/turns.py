"""Single orientations as quaternions x, y, z, w, in plain numbers: a sample has no time for arrays."""

from __future__ import annotations

from math import cos, radians, sin, sqrt

from ..source import Four, Three


def from_rotation_vector(x: float, y: float, z: float) -> Four:
    """Of a turn by its length, rad, about it."""
    angle = sqrt(x * x + y * y + z * z)
    scale = sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return x * scale, y * scale, z * scale, cos(0.5 * angle)


def from_kuka_abc(a: float, b: float, c: float) -> Four:
    """Of Rz(A) Ry(B) Rx(C), degrees, as `kuka_abc` of geometry/orientation.py."""
    sa, ca, sb, cb, sc, cc = (of(radians(0.5 * angle)) for angle in (a, b, c) for of in (sin, cos))
    return (
        ca * cb * sc - sa * sb * cc,
        ca * sb * cc + sa * cb * sc,
        sa * cb * cc - ca * sb * sc,
        ca * cb * cc + sa * sb * sc,
    )


def product(p: Four, q: Four) -> Four:
    """Of the rotations: first q, then p."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return (
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
        pw * qw - px * qx - py * qy - pz * qz,
    )


def inverse(q: Four) -> Four:
    """The turn back."""
    return -q[0], -q[1], -q[2], q[3]


def turned(q: Four, v: Three) -> Three:
    """A vector, turned."""
    qx, qy, qz, qw = q
    tx, ty, tz = 2 * (qy * v[2] - qz * v[1]), 2 * (qz * v[0] - qx * v[2]), 2 * (qx * v[1] - qy * v[0])
    return (
        v[0] + qw * tx + qy * tz - qz * ty,
        v[1] + qw * ty + qz * tx - qx * tz,
        v[2] + qw * tz + qx * ty - qy * tx,
    )
