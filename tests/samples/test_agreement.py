"""Rows at one orientation belong together as long as they agree: one in contact, or lost, does not spoil the table."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Finding, Kind, Severity
from tests.support.rigs import NOISE, example
from tests.support.world import Array, Rig, noisy_readings, random_rig, random_rotations, readings

CONTACT = np.array([0.0, 0.0, -4.0, 0.2, 0.0, 0.0])
POSES = 12
ROUNDS = np.tile(np.arange(POSES), 2)
"""Every orientation twice, as the guide advises."""


def _table(seed: int, of_row: NDArray[np.intp], noise: Array = NOISE) -> tuple[Rig, cw.Samples]:
    """Rows at random orientations, which have these numbers, on an upright sensor."""
    rig, R, rng = example(seed, POSES)
    rig = replace(rig, weight=15.0, com=np.array([0.004, 0.01, 0.05]), R_flange_sensor=np.eye(3))
    R = R[of_row]
    return rig, cw.Samples(noisy_readings(rig, R, noise, rng), R)


def _moved(samples: cw.Samples, rows: list[int], by: Array = CONTACT) -> cw.Samples:
    wrench = samples.wrench.copy()
    wrench[rows] += by
    return replace(samples, wrench=wrench)


@cache
def _clean(model: str, *of_row: int) -> tuple[Rig, cw.Samples, cw.Calibration]:
    rig, samples = _table(1, np.array(of_row))
    return rig, samples, cw.calibrate(samples, model)


def _apart(calibration: cw.Calibration) -> list[Finding]:
    return [finding for finding in calibration.findings if finding.kind is Kind.ROWS_APART]


def _off(calibration: cw.Calibration, rig: Rig) -> float:
    unseen = random_rotations(60, np.random.default_rng(5))
    return float(np.sqrt(np.mean((calibration.predict(unseen) - readings(rig, unseen))[:, :3] ** 2)))


@pytest.mark.parametrize(
    ("of_row", "bad", "size", "model"),
    [
        (np.r_[0:POSES, 3], [3], 10.0, "mount"),
        (np.r_[0:POSES, 3, 5], [3], 0.25, "auto"),
        (ROUNDS, [5], 0.25, "auto"),
        (ROUNDS, [17], 10.0, "mount"),
        (np.repeat(np.arange(POSES), 3), [13], 10.0, "mount"),
        (np.repeat(np.arange(POSES), 10), [44], 0.25, "mount"),
        (np.repeat(np.arange(POSES), 10), list(range(40, 44)), 10.0, "mount"),
    ],
)
def test_a_row_in_contact_costs_no_more_than_its_pose(
    of_row: NDArray[np.intp], bad: list[int], size: float, model: str
) -> None:
    rig, samples, clean = _clean(model, *of_row.tolist())
    calibration = cw.calibrate(_moved(samples, bad, size * CONTACT), model)
    assert calibration.verdict == clean.verdict == "good"
    assert len(_apart(calibration)) == 1
    assert calibration.noise == pytest.approx(clean.noise, rel=0.5)
    assert calibration.expected_error[0] < 1.5 * clean.expected_error[0]
    assert _off(calibration, rig) < 1.5 * _off(clean, rig) + 0.01


def test_which_rows_are_apart_is_said() -> None:
    (said,) = _apart(cw.calibrate(_moved(_table(2, ROUNDS)[1], [5])))
    assert said.severity is Severity.WARNING
    assert said.text == (
        "row 6 and row 18 have one orientation and are 4 N and 200 mN m apart: they are poses 1 and 7, one in "
        "contact, misread, or of another orientation"
    )


def test_a_row_outvoted_is_left_out_by_name() -> None:
    samples = _table(3, np.repeat(np.arange(POSES), 10))[1]
    lost = samples.wrench.copy()
    lost[16] = 0.0
    calibration = cw.calibrate(replace(samples, wrench=lost), "mount")
    (said,) = _apart(calibration)
    assert said.severity is Severity.REFUSED
    assert said.text.startswith("rows 11 to 20 (9 of them) and row 17 have one orientation and are ")
    assert said.text.endswith(" apart: row 17 left out as in contact, bumped, or lost on the way")
    kept = np.delete(np.arange(len(samples)), 16)
    without = cw.calibrate(samples.select(kept), "mount")
    assert pytest.approx(without.B) == calibration.B


def test_only_the_first_are_named() -> None:
    said = _apart(cw.calibrate(_moved(_table(4, np.repeat(np.arange(POSES), 10))[1], [5, 25, 45, 65, 85]), "mount"))
    assert [finding.severity for finding in said] == 3 * [Severity.REFUSED] + [Severity.WARNING]
    assert said[-1].text == "rows at one orientation are apart 2 times more"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of_row", "fz_tz"),
    [
        (np.r_[0:POSES, 3], 1.0),
        (ROUNDS, 4.0),
        (np.repeat(np.arange(POSES), 3), 4.0),
        (np.repeat(np.arange(POSES), 10), 1.0),
    ],
)
def test_rows_that_agree_stay_together(of_row: NDArray[np.intp], fz_tz: float) -> None:
    for seed in range(2):
        calibration = cw.calibrate(_table(seed, of_row, NOISE * [1.0, 1.0, fz_tz, 1.0, 1.0, fz_tz])[1], "mount")
        assert not _apart(calibration)
        assert len(calibration.poses) == POSES


@pytest.mark.slow
def test_coarse_digits_and_an_arm_that_shakes_at_one_pose_part_nothing() -> None:
    for seed in range(2):
        _, samples = _table(seed, np.repeat(np.arange(POSES), 10))
        coarse = replace(samples, wrench=np.round(samples.wrench / (4.0 * NOISE)) * (4.0 * NOISE))
        shaking = np.random.default_rng(seed).normal(size=(10, 6)) * 2.0 * NOISE
        for each in (coarse, replace(samples, wrench=samples.wrench + np.pad(shaking, ((30, 80), (0, 0))))):
            assert not _apart(cw.calibrate(each, "mount"))


def test_an_arm_that_rings_at_one_of_many_orientations_is_not_in_contact_there() -> None:
    """Four rows at each of 40: those of one are off by eight times the noise to and fro, and it is no accident."""
    rig, R, rng = example(2, 40)
    R = np.repeat(R, 4, axis=0)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[20:24, 2] = readings(rig, R)[20:24, 2] + 8.0 * NOISE[2] * np.array([1.0, 0.0, -1.0, 0.0])
    assert not _apart(cw.calibrate(cw.Samples(wrench, R), "mount"))
    wrench[20, 2] += 8.0 * NOISE[2]
    assert _apart(cw.calibrate(cw.Samples(wrench, R), "mount"))


def test_a_bias_that_moved_between_rounds_parts_nothing() -> None:
    """All rows of the second round are off those of the first."""
    calibration = cw.calibrate(_moved(_table(6, ROUNDS)[1], list(range(POSES, 2 * POSES))), "mount")
    assert not _apart(calibration)
    assert any(finding.kind is Kind.BIAS_STEPPED for finding in calibration.findings)


def test_rows_left_out_are_no_creep_and_no_noise() -> None:
    of_row = np.repeat(np.arange(POSES), 40)
    _, samples = _table(7, of_row)
    timed = replace(samples, t=0.02 * np.arange(len(of_row)) + 20.0 * of_row)
    clean, calibration = (cw.calibrate(each, "mount") for each in (timed, _moved(timed, [47, 205], 10.0 * CONTACT)))
    assert clean.still_noise is not None
    assert calibration.still_noise is not None
    assert calibration.still_noise.std == pytest.approx(clean.still_noise.std, rel=0.1)
    assert calibration.expected_error[0] == pytest.approx(clean.expected_error[0], rel=0.2)


@pytest.mark.parametrize("model", ["auto", "affine"])
def test_a_new_zero_at_the_end_is_no_accident_of_every_orientation(model: str) -> None:
    """Of the last of eight loops: its rows are not outvoted by those of the old zero."""
    rng = np.random.default_rng(2)
    rig, R = random_rig(rng), np.concatenate([random_rotations(12, rng)] * 8)
    wrench = noisy_readings(rig, R, np.array([0.05] * 3 + [0.003] * 3), rng)
    wrench[84:] += [2.0, 0.0, 1.0, 0.0, 0.0, 0.05]
    calibration = cw.calibrate(cw.Samples(wrench, R), model)
    off = np.abs(calibration.bias - rig.bias - [2.0, 0.0, 1.0, 0.0, 0.0, 0.05])
    assert calibration.verdict != "good" or (off < 5.0 * calibration.std["bias"]).all()


def test_a_heavy_tool_turned_by_less_than_counts_reads_otherwise_and_is_not_called_apart() -> None:
    for seed in range(2):
        rng = np.random.default_rng(seed)
        rig, R = replace(random_rig(rng), weight=100.0), random_rotations(20, rng)
        nearly = R[[3, 7]] @ Rotation.from_rotvec([0.17, 0.0, 0.0], degrees=True).as_matrix()
        every = np.concatenate([R, nearly])
        wrench = noisy_readings(rig, every, np.array([0.01] * 3 + [0.0005] * 3), rng)
        findings = cw.calibrate(cw.Samples(wrench, every), "mount").findings
        assert not [finding for finding in findings if finding.kind is Kind.ROWS_APART]
