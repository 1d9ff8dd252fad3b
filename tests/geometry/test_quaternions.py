"""Quaternions in plain numbers are scipy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from contactwrench.geometry.quaternions import (
    Quat,
    angle_between,
    between,
    from_kuka_abc,
    from_rotation_vector,
    inverse,
    product,
    rotated,
    unit,
)


def quat(R: Rotation) -> Quat:
    x, y, z, w = R.as_quat().tolist()
    return x, y, z, w


def angle(q: Quat, R: Rotation) -> float:
    return float((Rotation.from_quat(q).inv() * R).magnitude())


@given(st.integers(0, 10_000), st.floats(0.0, 1.0), st.sampled_from([1.0, -1.0]))
def test_products_and_turns_are_scipys(seed: int, share: float, sign: float) -> None:
    a, b = Rotation.random(2, random_state=seed)
    x, y, z, w = (sign * value for value in quat(b))
    assert angle(product(quat(a), quat(b)), a * b) < 1e-7
    assert angle(product(inverse(quat(a)), quat(a)), Rotation.identity()) < 1e-7
    assert angle(between(quat(a), (x, y, z, w), share), Slerp([0, 1], Rotation.concatenate([a, b]))(share)) < 1e-6
    assert angle_between(quat(a), (x, y, z, w)) == pytest.approx((a.inv() * b).magnitude(), abs=1e-7)
    assert rotated(quat(a), (1.0, -2.0, 3.0)) == pytest.approx(a.apply([1.0, -2.0, 3.0]))
    vector, abc = b.as_rotvec().tolist(), b.as_euler("ZYX", degrees=True).tolist()
    assert angle(from_rotation_vector(*vector), b) < 1e-7
    assert angle(from_kuka_abc(*abc), b) < 1e-7


@pytest.mark.parametrize("length", [0.0, 0.98, 1.02, np.nan, np.inf])
def test_what_is_no_orientation_is_none(length: float) -> None:
    assert unit((0.0, 0.0, 0.0, length)) is None
    assert unit((0.0, 0.0, 0.0, 0.995)) == (0.0, 0.0, 0.0, 1.0)
