"""Motions that are not what they are taken for: positions of other axes, late, too slow, at one place; a tool that is
not rigid; torques of the other sign.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.signal import lfilter

import contactwrench as cw
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.errors import InputError
from contactwrench.estimation.findings_of_motion import of_rate
from contactwrench.estimation.in_motion import as_stamped, with_motion
from contactwrench.estimation.rigidity import positions_read
from contactwrench.samples.flange_motion import flange_motion
from tests.support.in_motion import Moving, moving
from tests.support.world import Array

RATE = 250.0
NOT_RIGID = "of what the motion makes felt follows it as no rigid tool does"


@lru_cache
def arm(seed: int = 7) -> Moving:
    return moving(seed, stops=8, seconds=14.0, rate=RATE)


@lru_cache
def clean(seed: int = 7) -> cw.Samples:
    return arm(seed).samples()


@lru_cache
def calibrated() -> cw.Calibration:
    """Of the clean recording, inertia and all."""
    return cw.calibrate(clean(), "dynamic")


@lru_cache
def at_stops() -> cw.Calibration:
    return cw.calibrate(clean())


def doubts(samples: cw.Samples) -> dict[Kind, str]:
    calibration = calibrated() if samples is clean() else cw.calibrate(samples, "dynamic")
    found = {f.kind: f.text for f in calibration.findings if f.severity is Severity.DOUBTFUL}
    assert (calibration.verdict == "good") == (not found)
    return found


def placed(change: Callable[[Array], Array]) -> cw.Samples:
    samples = clean()
    assert samples.position is not None
    return replace(samples, position=change(samples.position))


def test_a_rigid_tool_and_its_own_positions_are_not_in_doubt() -> None:
    assert doubts(clean()) == doubts(clean(8)) == {}


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([-1.0, 1.0, 1.0]), "-x, y, z of those given"),
        (np.eye(3)[[1, 0, 2]], "y, x, z of those given"),
        (np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), "y, -x, z of those given"),
        (1.25 * np.eye(3), "0.8 times those given"),
    ],
    ids=["mirrored", "exchanged", "turned", "scaled"],
)
def test_positions_of_other_axes_are_told_by_the_forces(matrix: Array, words: str) -> None:
    """And nothing else, which would lead elsewhere."""
    found = with_motion(at_stops(), placed(lambda position: position @ matrix.T), None)
    (text,) = (finding.text for finding in found.findings if finding.severity is Severity.DOUBTFUL)
    assert found.verdict != "good"
    assert text == (
        f"doubtful: the forces in motion go with positions that are {words}: check the columns x, y, z, their unit, "
        "that they are of the same flange, base and time as the orientations, and the tool that of the stops"
    )


@pytest.mark.parametrize("seed", range(3))
def test_any_matrix_between_given_and_true_positions_is_found(seed: int) -> None:
    """Of the stops' calibration: no inertia has been fitted to the wrong positions yet."""
    matrix = np.eye(3) + 0.4 * np.random.default_rng(seed).normal(size=(3, 3))
    samples = as_stamped(placed(lambda position: position @ np.linalg.inv(matrix).T))
    read = positions_read(at_stops(), samples, flange_motion(samples))
    assert read.matrix == pytest.approx(matrix, abs=0.05)


def test_a_column_of_positions_that_stands_is_in_doubt_and_three_are_refused() -> None:
    calibration = with_motion(at_stops(), placed(lambda position: position * [1.0, 1.0, 0.0]), None)
    (said,) = (finding.text for finding in calibration.findings if finding.kind is Kind.POSITIONS_IN_DOUBT)
    assert said == "the position's z never changes: if the arm moves along it, that is not its column"
    assert calibration.verdict == "doubtful"
    with pytest.raises(InputError) as caught:
        with_motion(at_stops(), placed(lambda position: 0.0 * position), None)
    assert str(caught.value) == (
        f"{clean().source}: found positions that are all 0, expected the flange's x, y, z: name their columns, name an "
        "accelerometer with --imu, or take model auto"
    )


def test_torques_of_the_other_sign_are_named() -> None:
    samples = clean()
    still = samples.wrench.mean(axis=0)
    other = np.hstack([samples.wrench[:, :3], 2.0 * still[3:] - samples.wrench[:, 3:]])
    with pytest.raises(InputError) as caught:
        cw.calibrate(replace(samples, wrench=other), "dynamic")
    assert str(caught.value) == (
        f"{samples.source}: found moments of inertia below zero, expected those of a body: are the torques' sign and "
        "unit those of the forces?"
    )


def test_poses_too_slow_for_the_motion_are_in_doubt_and_a_hundred_a_second_are_not() -> None:
    slow = doubts(arm().samples(10.0))
    assert slow[Kind.SLOW_POSES].startswith("doubtful: poses came at 10 Hz, and the arm moved at up to ")
    assert slow[Kind.SLOW_POSES].endswith(" Hz or faster, or move more slowly")
    assert doubts(arm().samples(100.0)) == {}
    (just,) = of_rate(arm().samples(25.0), usual=3.15)  # needs 25.2 Hz
    assert just.text.endswith(" record them at 26 Hz or faster, or move more slowly")


def test_what_swings_on_the_tool_is_in_doubt() -> None:
    """0.2 kg that hangs on the tool by a spring of 3 Hz, moved by the arm's own acceleration."""
    samples = clean()
    acceleration = flange_motion(samples).acceleration
    pole = np.exp((-0.1 + 1j) * 2.0 * np.pi * 3.0 / RATE)
    swings = lfilter([abs(1.0 - pole) ** 2], [1.0, -2.0 * pole.real, abs(pole) ** 2], acceleration, axis=0)
    found = doubts(replace(samples, wrench=samples.wrench - 0.2 * np.hstack([swings, 0.0 * swings])))
    assert NOT_RIGID in found[Kind.NOT_RIGID]
    share = float(found[Kind.NOT_RIGID].removeprefix("doubtful: ").partition("%")[0])
    assert 10.0 < share < 30.0


@pytest.mark.parametrize("late", [0.008, -0.012])
def test_a_wrench_that_is_late_by_little_is_aligned_by_the_motion(late: float) -> None:
    """Beside the sensor's own filter, which is one too."""
    samples, of_sensor = clean(), calibrated().delay
    assert samples.t is not None
    assert of_sensor is not None
    behind = np.stack([np.interp(samples.t - late, samples.t, values) for values in samples.wrench.T], axis=1)
    recorded = replace(samples, wrench=behind)
    calibration = cw.calibrate(recorded, "dynamic")
    assert calibration.delay is not None
    assert calibration.delay == pytest.approx(of_sensor + late, abs=2e-4)
    assert calibration.verdict == "good"
    assert calibration.dynamics is not None
    assert calibration.dynamics.residual_rms[:3] == pytest.approx(0.05, rel=0.15)
    put = as_stamped(recorded, calibration)
    left, beside = (
        calibration.compensate(each.wrench, each.R_base_flange, motion=flange_motion(each))[:, :3].std()
        for each in (put, recorded)
    )
    assert left < 0.052 < 0.06 < beside


def test_a_few_positions_that_are_missing_are_bridged() -> None:
    rng = np.random.default_rng(3)
    whole = clean().position
    assert whole is not None
    missing = rng.random(len(whole)) < 0.01
    found = with_motion(at_stops(), placed(lambda position: np.where(missing[:, None], np.nan, position)), None)
    assert found.verdict == "good"
    assert found.inertia == pytest.approx(calibrated().inertia, abs=2e-5)


def test_a_delay_that_the_motion_tells_is_applied_and_said() -> None:
    """Of readings and poses that were paired as they are, or by a delay that is stated: the rest of it."""
    whole = {stated: cw.calibrate(arm().samples(125.0, delay=stated), "dynamic") for stated in (0.0, 0.008)}
    for calibration in whole.values():
        assert calibration.delay == pytest.approx(0.0016, abs=3e-4)
        (said,) = (finding.text for finding in calibration.findings if finding.kind is Kind.DELAY_OF_MOTION)
        assert calibration.delay is not None
        by = f"{1e3 * calibration.delay:.3g} ms later"
        assert said == f"by the motion the wrench is stamped {by} than the orientation: applied"
