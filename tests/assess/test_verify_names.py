"""What verification says where a few poses are off, or the zero changed on the way, and all else agrees; and that the
digits of a table typed by hand are no fault.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.assess.verify import Verification, verify
from contactwrench.calibration.findings import Kind, Severity
from tests.support.rigs import example, noisy
from tests.support.world import Array, Rig, random_rotations

CONTACT = np.array([0.0, 0.0, -2.0, 0.1, 0.0, 0.0])
FIGURES = "([0-9.]+) N and ([0-9.]+) mN m"
NEW_ZERO = "one pose gives the new zero: contactwrench calibrate FILE --prior CAL.json"


@cache
def calibrated() -> tuple[Rig, cw.Calibration]:
    rig, R, rng = example(2, poses=12)
    rig = replace(rig, weight=15.0, com=np.array([0.02, -0.03, 0.09]), bias=np.array([9.0, -4.0, 14.0, 0.5, -0.7, 0.3]))
    return rig, cw.calibrate(noisy(rig, R, rng), "mount")


def verified(seed: int, n: int, change: Array | float = 0.0, digits: int = 9, timed: bool = False) -> Verification:
    """Of n poses whose readings have a `change` (n, 6) and are rounded."""
    rig, calibration = calibrated()
    rng = np.random.default_rng(seed)
    samples = noisy(rig, random_rotations(n, rng), rng)
    t = np.linspace(100.0, 90.0 + 10.0 * n, n) if timed else None
    return verify(calibration, cw.Samples(np.round(samples.wrench + change, digits), samples.R_base_flange, t))


def at(n: int, *poses: int) -> Array:
    """The contact at these poses of n, (n, 6)."""
    return np.where(np.isin(np.arange(n), poses)[:, None], CONTACT, 0.0)


def text_of(result: Verification) -> str:
    assert not result.passed
    (finding,) = result.findings
    assert finding.severity is Severity.WARNING
    return finding.text


def without_figures(text: str, size: Array = CONTACT) -> str:
    """Forces and torques, which are of that size, as N and mN m, and the probability as P."""
    found = np.array(re.findall(FIGURES, text), dtype=np.float64)
    assert found == pytest.approx(
        np.tile([np.linalg.norm(size[:3]), 1e3 * np.linalg.norm(size[3:])], (len(found), 1)), 0.1
    )
    return re.sub("probability [0-9.]+ %", "probability P", re.sub(FIGURES, "N and mN m", text))


@pytest.mark.parametrize("n", [4, 6, 15])
def test_a_pose_in_contact_is_named_and_the_others_are_said_to_agree(n: int) -> None:
    results = [verified(seed, n, at(n, 2)) for seed in range(6)]
    named = [text_of(result).startswith("pose 3 is off by ") for result in results]
    assert all(named)
    assert without_figures(text_of(verified(1, 6, at(6, 2)))) == (
        "pose 3 is off by N and mN m: in contact, bumped, or in the wrong row; the other 5 agree with the "
        "calibration (probability P); take it anew"
    )


def test_two_poses_of_six_are_named_with_their_times_and_rows_exchanged_too() -> None:
    assert without_figures(text_of(verified(2, 6, at(6, 1, 4), timed=True))) == (
        "pose 2 (t = 10 s) is off by N and mN m, pose 5 (t = 40 s) is off by N and mN m: in contact, "
        "bumped, or in the wrong row; the other 4 agree with the calibration (probability P); take them anew"
    )
    rig, calibration = calibrated()
    for seed in range(3):
        rng = np.random.default_rng(seed)
        samples = noisy(rig, random_rotations(6, rng), rng)
        result = verify(calibration, cw.Samples(samples.wrench[[0, 4, 2, 3, 1, 5]], samples.R_base_flange))
        text = text_of(result)
        assert text.startswith("pose 2 is off by ")
        assert ", pose 5 is off by " in text


def test_a_pose_is_named_beside_a_bias_that_moved() -> None:
    moved = np.array([0.3, 0.0, 0.3, 0.0, 0.01, 0.0])
    for seed in range(3):
        text = text_of(verified(seed, 8, at(8, 2) + moved))
        assert text.startswith("pose 3 is off by ")
        assert "; the other 7 agree with the calibration with a bias that moved by 0." in text
        assert text.endswith("; take it anew")


def test_a_zero_that_was_set_anew_on_the_way_is_found_there() -> None:
    change = np.array([4.0, -3.0, 12.0, 0.3, 0.1, -0.2])
    for seed in range(3):
        result = verified(seed, 8, np.where(np.arange(8)[:, None] < 3, 0.0, change))
        assert [finding.kind for finding in result.findings] == [Kind.BIAS_STEPPED]
        assert " between pose 3 and pose 4, by a new zero or a drift; but for that all agree" in text_of(result)
    assert without_figures(text_of(verified(3, 8, np.where(np.arange(8)[:, None] < 3, 0.0, change))), change) == (
        "the bias changed by N and mN m between pose 3 and pose 4, by a new zero or a drift; but for that all "
        f"agree with the calibration (probability P); {NEW_ZERO}"
    )


def test_too_many_poses_off_another_tool_and_a_worse_sensor_name_no_pose() -> None:
    rig, calibration = calibrated()
    said = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        R = random_rotations(6, rng)
        others = (
            noisy(replace(rig, weight=rig.weight + 0.5), R, rng),
            noisy(replace(rig, com=rig.com + np.array([0.0, 0.003, 0.0])), R, rng),
            cw.Samples(noisy(rig, R, rng).wrench + rng.normal(size=(6, 6)) * [1, 1, 1, 0.05, 0.05, 0.05], R),
            cw.Samples(noisy(rig, R, rng).wrench + at(6, 0, 2, 5) * rng.uniform(0.5, 2.0, size=(6, 1)), R),
        )
        results = [verify(calibration, samples) for samples in others]
        assert not any(result.passed for result in results)
        said += [finding.kind in (Kind.POSE_OFF, Kind.BIAS_STEPPED) for each in results for finding in each.findings]
    assert not any(said)


def test_of_poses_that_agree_hardly_one_in_a_hundred_recordings_has_a_name() -> None:
    results = [verified(seed, 6) for seed in range(40)]
    assert np.mean([result.passed for result in results]) >= 0.97
    assert np.mean([bool(result.findings) for result in results]) <= 0.03


def test_a_table_rounded_by_hand_passes_and_a_contact_in_it_is_named() -> None:
    assert np.mean([verified(seed, 6, digits=1).passed for seed in range(20)]) >= 0.95
    named = [text_of(verified(seed, 6, at(6, 2), digits=1)).startswith("pose 3 is off by ") for seed in range(6)]
    assert all(named)
    heavier = 0.6 * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert not any(verified(seed, 6, heavier, digits=1).passed for seed in range(3))
