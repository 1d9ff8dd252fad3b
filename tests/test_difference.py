"""What changed between two calibrations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from benchmarks.world import Rig, random_rotations, readings
from tests.rigs import example, noise_free, noisy, rotation_angle


def _of(difference: object, name: str) -> tuple[float, float]:
    names = list(difference.names)  # type: ignore[attr-defined]
    k = names.index(name)
    return difference.change[k], difference.std[k]  # type: ignore[attr-defined]


def _pair(seed: int, **changes: object) -> tuple[Rig, Rig, cw.Calibration, cw.Calibration]:
    rig, R, _ = example(seed)
    other = replace(rig, **changes)  # type: ignore[arg-type]
    return rig, other, cw.calibrate(noise_free(rig, R), "mount"), cw.calibrate(noise_free(other, R), "mount")


def test_changes_are_after_less_before() -> None:
    com = np.array([0.01, -0.02, 0.05])
    rig, _, a, b = _pair(1, weight=7.5, com=com)
    change = a.diff(b)
    assert _of(change, "weight")[0] == pytest.approx(7.5 - rig.weight)
    for k, axis in enumerate("xyz"):
        assert _of(change, f"com_{axis}")[0] == pytest.approx(com[k] - rig.com[k], abs=1e-8)
    for axis in ("fx", "fy", "fz", "tx", "ty", "tz"):
        assert _of(change, f"bias_{axis}")[0] == pytest.approx(0.0, abs=1e-7)
    assert dict(zip(change.names, change.units, strict=True))["weight"] == "N"


def test_yaw_changes_the_short_way_round() -> None:
    before, after = (Rotation.from_euler("z", a).as_matrix() for a in (3.1, -3.1))
    rig, R, _ = example(2)
    a, b = (cw.calibrate(noise_free(replace(rig, R_flange_sensor=M), R), "yaw") for M in (before, after))
    assert _of(a.diff(b), "yaw")[0] == pytest.approx(2.0 * np.pi - 6.2, abs=1e-8)


@pytest.mark.parametrize("degrees", [0.001, 5.0, 170.0])
def test_angle_between_two_mountings(degrees: float) -> None:
    rig, _, rng = example(3)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    turned = rig.R_flange_sensor @ turn
    _, _, a, b = _pair(3, R_flange_sensor=turned)
    assert rotation_angle(rig.R_flange_sensor, turned) == pytest.approx(np.deg2rad(degrees))
    assert a.diff(b).mounting_angle == pytest.approx(np.deg2rad(degrees), rel=1e-3)


def test_the_largest_change_of_the_free_wrench() -> None:
    rig, other, a, b = _pair(4, weight=9.0)
    largest = a.diff(b).free_wrench
    somewhere = random_rotations(20_000, np.random.default_rng(4))
    reached = np.abs(readings(other, somewhere) - readings(rig, somewhere)).max(axis=0)
    assert largest == pytest.approx(reached, rel=0.02)
    assert largest[:3] == pytest.approx(np.full(3, abs(9.0 - rig.weight)), rel=0.02)


def test_same_tool_measured_twice_is_not_significant_and_another_is() -> None:
    rig, R, rng = example(5)
    a, b = (cw.calibrate(noisy(rig, R, rng), "mount") for _ in range(2))
    heavier = cw.calibrate(noisy(replace(rig, weight=rig.weight + 1.0), R, rng), "mount")
    assert "weight" not in a.diff(b).significant
    assert "weight" in a.diff(heavier).significant
    assert _of(a.diff(b), "weight")[1] == pytest.approx(np.hypot(a.std["weight"], b.std["weight"]))


def test_models_without_a_tool_have_their_bias_in_common() -> None:
    rig, R, rng = example(6)
    samples = noisy(rig, R, rng)
    change = cw.calibrate(samples, "affine").diff(cw.calibrate(samples, "mount"))
    assert change.names == ("bias_fx", "bias_fy", "bias_fz", "bias_tx", "bias_ty", "bias_tz")
    assert change.mounting_angle is None


def test_a_calibration_does_not_differ_from_itself() -> None:
    rig, R, rng = example(7)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    change = calibration.diff(calibration)
    assert not change.change.any()
    assert not change.free_wrench.any()
    assert change.significant == ()
    assert change.mounting_angle == pytest.approx(0.0, abs=1e-7)


def test_two_bases_are_compared_each_in_its_own() -> None:
    """The same tool on an upright robot and on a wall: nothing changes for the tool that points to the ground."""
    rig, R, rng = example(8)
    turn = random_rotations(1, rng)[0]
    a = cw.calibrate(noise_free(rig, R), "mount")
    b = cw.calibrate(cw.Samples(readings(rig, R), turn @ R), "mount", gravity=turn @ rig.down)
    assert np.abs(_of(a.diff(b), "weight")[0]) < 1e-8
