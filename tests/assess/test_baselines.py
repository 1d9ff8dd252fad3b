"""What is left over without a full compensation, in the paper's terms."""

from __future__ import annotations

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.assess.verify import LeftOver, compare
from tests.support.rigs import example, noise_free, noisy

TABLE_6 = np.array(
    [
        [0.155, 0.434, -1.177, 0.054, 0.032, 0.003],
        [0.105, 0.638, -0.560, 0.065, 0.157, 0.001],
        [0.154, 0.359, -1.005, 0.087, 0.235, 0.002],
        [0.155, 0.437, -1.107, 0.055, 0.073, 0.004],
        [0.134, 0.584, -0.980, 0.056, 0.121, 0.002],
        [0.151, 0.383, -1.201, 0.081, 0.243, 0.005],
    ]
)
ZERO_OF_TABLE_5 = np.array([3.769, -6.903, 57.657, 2.228, 0.963, -0.002])


def test_table_7_is_the_mean_and_maximum_of_table_6() -> None:
    left = LeftOver("full", TABLE_6)
    assert left.mean_abs == pytest.approx([0.142, 0.472, 1.005, 0.066, 0.144, 0.003], abs=6e-4)
    printed_maximum = np.array([0.155, 0.638, 1.177, 0.087, 0.243, 0.005])
    printed_maximum[2] = 1.201  # 1.177 printed: the maximum of the first five rows
    assert left.max_abs == pytest.approx(printed_maximum)


def test_table_8_is_table_6_with_the_zero_left_in() -> None:
    left = LeftOver("gravity only", TABLE_6 + ZERO_OF_TABLE_5)
    assert left.mean_abs == pytest.approx([3.911, 6.431, 56.652, 2.294, 1.107, 0.001], abs=1.1e-3)
    printed_maximum = np.array([3.924, 6.544, 57.097, 2.301, 1.206, 0.003])
    printed_maximum[3] = 2.315  # 2.301 printed
    assert left.max_abs == pytest.approx(printed_maximum, abs=1.1e-3)


def test_rms_is_of_the_norms() -> None:
    left = LeftOver("raw", np.array([[3.0, 4.0, 0.0, 0.0, 0.0, 2.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    assert left.rms == pytest.approx((5.0 / np.sqrt(2.0), 2.0 / np.sqrt(2.0)))


def test_a_tare_removes_the_first_reading() -> None:
    rig, R, _ = example(1, poses=6)
    calibration = cw.calibrate(noise_free(rig, R), "mount")
    left = compare(calibration, calibration.poses)[1].wrench
    assert np.all(left[0] == 0.0)
    weight = rig.weight * np.einsum("nji,j->ni", R @ rig.R_flange_sensor, rig.down)
    assert left[:, :3] == pytest.approx(weight - weight[0])


def test_gravity_alone_leaves_the_bias() -> None:
    rig, R, _ = example(2)
    calibration = cw.calibrate(noise_free(rig, R), "mount")
    left = compare(calibration, calibration.poses)[2].wrench
    assert left == pytest.approx(np.tile(rig.bias, (24, 1)), abs=1e-8)


def test_side_by_side_on_the_poses_of_a_calibration() -> None:
    rig, R, rng = example(3)
    samples = noisy(rig, R, rng)
    calibration = cw.calibrate(samples, "mount")
    full, tare, gravity_only, raw = compare(calibration, calibration.poses)
    assert [left.name for left in (full, tare, gravity_only, raw)] == ["full", "tare", "gravity only", "raw"]
    assert raw.wrench == pytest.approx(samples.wrench)
    assert np.sqrt(np.mean(full.wrench**2, axis=0)) == pytest.approx(calibration.residual_rms, rel=0.02)
    assert full.rms[0] < 0.1 * min(tare.rms[0], gravity_only.rms[0], raw.rms[0])
