"""Calibrations of a known rig to the last digit, as no fit gives them: what exports are judged on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import contactwrench as cw
from tests.support.rigs import example, noisy
from tests.support.world import Array, Rig, readings


@cache
def _fitted() -> cw.Calibration:
    rig, R, rng = example(5)
    return cw.calibrate(noisy(rig, R, rng), "mount+base")


def exact_calibration(rig: Rig, sign: str = "pull", g: float = 9.80665) -> cw.Calibration:
    """What a perfect fit of `rig` says, with the uncertainty of another one; B from the rig's readings."""
    fitted = _fitted()
    return replace(
        fitted,
        weight=rig.weight,
        mass=rig.weight / g,
        com=rig.com,
        bias=rig.bias,
        R_flange_sensor=rig.R_flange_sensor,
        gravity_direction=rig.down,
        B=_matrix(rig),
        provenance={**fitted.provenance, "sign": sign, "g": g},
    )


def _matrix(rig: Rig) -> Array:
    """B (6, 4) from readings at orientations in which gravity is along the flange's x, y and z."""
    r = np.eye(3)
    turned = readings(rig, np.stack([_rotation_between(each, rig.down) for each in r]))
    return np.column_stack([(turned - rig.bias).T, rig.bias])


def _rotation_between(a: Array, b: Array) -> Array:
    """A rotation with `R @ a == b`, unit vectors (3,)."""
    frames = []
    for v in (a, b):
        aside = np.cross(v, np.eye(3)[int(np.argmin(np.abs(v)))])
        aside /= np.linalg.norm(aside)
        frames.append(np.column_stack([v, aside, np.cross(v, aside)]))
    R: Array = frames[1] @ frames[0].T
    return R
