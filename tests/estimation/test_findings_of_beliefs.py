"""What is said of a posterior, word for word: errors that go with the orientation, and a contact force hardly known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.estimation.estimate import Beliefs, RigidEstimate
from contactwrench.estimation.findings import uncertain_parameters
from contactwrench.estimation.findings_of_beliefs import of_beliefs
from contactwrench.estimation.noise import PoseReadings, readings_of
from contactwrench.estimation.priors import Question
from contactwrench.estimation.rigid import estimated
from contactwrench.samples.poses import Pose
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import DOWN, noisy_readings

SAID = {
    Kind.GAIN: "gain or cross-talk of the sensor shows (probability 80 %): it is counted in every std; a calibrated "
    "sensor matrix would mend it",
    Kind.CABLE: "a pull that goes with the orientation shows, as of a cable (probability 80 %): it is counted in every "
    "std; fasten or free the cable",
    Kind.ROBOT: "errors of the robot's orientation show (probability 80 %): they are counted in every std; a "
    "calibrated robot, or more poses, would mend it",
    Kind.TWO_LEVELS: "the bias comes back in two levels, 0.3 N and 40 mN m apart, as backlash makes them (probability "
    "80 %): it is counted in every std; on the smaller side: pose 2, pose 5",
}


@cache
def fitted() -> tuple[RigidEstimate, PoseReadings, tuple[Pose, ...]]:
    rig, R, rng = example(1, poses=12)
    wrench = noisy_readings(replace(rig, weight=10.0), R, NOISE, rng)
    poses = tuple(Pose(*pose, np.zeros((6, 6)), 1, None, None, None) for pose in zip(R, wrench, strict=True))
    readings = readings_of(poses, order_tells=False)
    return estimated(readings, Question("mount", DOWN)), readings, poses


def said(probability: float, kind: Kind) -> list[Finding]:
    estimate, _, poses = fitted()
    levels = np.outer(np.where(np.isin(np.arange(12), (1, 4)), 1.0, -1.0), [0.15, 0.0, 0.0, 0.0, 0.02, 0.0])
    assert isinstance(estimate.beliefs, Beliefs)
    beliefs = replace(estimate.beliefs, with_orientation={kind: probability}, levels=levels)
    return of_beliefs(replace(estimate, beliefs=beliefs), poses, 0.0)


@pytest.mark.parametrize("kind", SAID)
def test_what_goes_with_the_orientation_is_said_where_it_is_likely_and_only_then(kind: Kind) -> None:
    assert said(0.8, kind) == [Finding(kind, Severity.WARNING, SAID[kind])]
    assert said(0.4, kind) == []


def test_a_contact_force_hardly_known_somewhere_is_weak_where_no_parameter_says_so() -> None:
    """A mounting known to 0.2 rad, all else exact."""
    estimate, readings, _ = fitted()
    assert uncertain_parameters(estimate, readings, ()) == []
    turned = np.diag([1e-6] * 10 + [0.04] * 3)
    weak, advice = uncertain_parameters(replace(estimate, covariance=turned), readings, ())
    assert weak == Finding(
        Kind.UNCERTAIN_PARAMETER,
        Severity.WEAK,
        "weak: the contact force has a std of 2.8 N at some orientations, over 10 % of the weight",
    )
    assert advice.kind is Kind.ADVICE


def test_poses_left_out_that_are_all_off_by_the_same_are_in_doubt_and_others_are_not() -> None:
    rig, R, rng = example(31)
    pushes = {"alike": np.tile([2.0, 0.0, 1.0, 0.05, 0.0, 0.1], (4, 1)), "apart": 2.0 * rng.normal(size=(4, 6))}
    for name, pushed in pushes.items():
        wrench = noisy(rig, R, rng).wrench.copy()
        wrench[[3, 9, 14, 20]] += pushed
        calibration = cw.calibrate(cw.Samples(wrench, R), "mount")
        assert sum(pose.rejected is not None for pose in calibration.poses) == 4
        found = [text for text in calibration.warnings if "all off by the same" in text]
        assert [text.startswith("doubtful: the 4 poses left out are all off by the same, ") for text in found] == [
            True
        ] * (name == "alike")


def test_a_mounting_far_off_nominal_by_four_poses_is_in_doubt_and_by_twelve_is_not() -> None:
    rig, R, rng = example(5, poses=12)
    found = []
    for n in (4, 12):
        samples = noisy(rig, R[:n], rng)
        texts = cw.calibrate(samples).warnings
        found.append([text for text in texts if "far off nominal" in text])
    assert found == [
        [
            "doubtful: the mounting is far off nominal by 4 poses alone: with so few, readings of the other sign may "
            "fit another mounting; confirm the sign by a push, or record 6 or more"
        ],
        [],
    ]
