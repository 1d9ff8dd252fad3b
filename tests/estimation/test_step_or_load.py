"""A step of the bias along gravity in a cone is what another tool makes, too, and said to be; other steps are not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind, Severity
from tests.support.rigs import NOISE
from tests.support.world import Array, Rig, noisy_readings, random_rotations, readings

LOOKS_LIKE = "what is told as a step of the bias may be a load"


def in_a_cone(rng: np.random.Generator) -> Array:
    lean, way = np.deg2rad(30.0) * np.sqrt(rng.uniform(0.0, 1.0, 12)), rng.uniform(0.0, 2.0 * np.pi, 12)
    tilted = Rotation.from_rotvec(np.column_stack([np.cos(way), np.sin(way), 0.0 * way]) * lean[:, None])
    R: Array = (Rotation.from_euler("x", np.pi) * tilted * Rotation.from_euler("z", 2.0 * way[:, None])).as_matrix()
    return R


def changed(seed: int, R: Array, what: str) -> tuple[cw.Calibration, list[str]]:
    """Twelve poses, a change before the seventh; what is said of a load."""
    rng = np.random.default_rng(seed)
    mounting = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    rig = Rig(10.0, np.array([0.01, -0.02, 0.08]), rng.normal(size=6), mounting, np.array([0.0, 0.0, -1.0]))
    wrench = noisy_readings(rig, R, 0.2 * NOISE, rng)
    if what == "tool":
        other = replace(rig, weight=10.5, com=rig.com + np.array([0.0, 0.0, 0.004]))
        wrench[6:] += readings(other, R[6:]) - readings(rig, R[6:])
    else:
        step = np.array([0.0, 0.0, 0.5]) if what == "along z" else 0.5 * np.array([0.6, -0.6, 0.5])
        wrench[6:] += np.r_[step, 0.0, 0.0, 0.0]
    found = cw.calibrate(cw.Samples(wrench, R, 10.0 * np.arange(12.0)))
    said = [each for each in found.findings if each.kind is Kind.WEIGHT_CHANGED and LOOKS_LIKE in each.text]
    assert all(each.severity is Severity.DOUBTFUL for each in said)
    return found, [each.text for each in said]


@pytest.mark.parametrize("seed", [0, 1, 6, 7])
def test_another_tool_in_a_cone_may_be_a_step_and_is_never_good(seed: int) -> None:
    found, said = changed(seed, in_a_cone(np.random.default_rng(seed)), "tool")
    assert found.verdict.split(":")[0] != "good"
    assert any(each.kind is Kind.BIAS_STEPPED for each in found.findings)
    (text,) = said
    told = re.search(r"weighs (\S+) N more from there on", text)
    assert told is not None
    assert float(told[1]) == pytest.approx(0.5, abs=0.2)


@pytest.mark.parametrize("seed", range(4))
def test_a_step_across_gravity_or_among_poses_all_around_is_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for R, what in ((in_a_cone(rng), "across"), (random_rotations(12, rng), "along z")):
        found, said = changed(seed, R, what)
        assert said == []
        assert any(each.kind is Kind.BIAS_STEPPED for each in found.findings)
