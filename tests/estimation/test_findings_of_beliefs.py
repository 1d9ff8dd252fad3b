"""What is said of a posterior, word for word: errors that go with the orientation, and a contact force hardly known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import contactwrench as cw
from benchmarks.errors import NOISE as OF_MEAN
from benchmarks.errors import Course, poses, tilted
from benchmarks.inference import Setting
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.estimation.bias_drift import Drift
from contactwrench.estimation.estimate import Beliefs, RigidEstimate, Rival
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
    Kind.CREEP: "a part of the load of the pose before shows (probability 80 %): it is counted in every std, as of a "
    "sensor that creeps; rest for longer",
    Kind.CABLE: "a pull that goes with the orientation shows, as of a cable (probability 80 %): it is counted in every "
    "std; fasten or free the cable",
    Kind.ROBOT: "the robot's orientations are off by about 0.12 deg an axis (probability 80 %): it is counted in every "
    "std, and in what a new orientation reads; a calibrated robot would mend it, where it is "
    "not the sensor that has hysteresis",
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


def said(probability: float, kind: Kind, low: tuple[int, ...] = (1, 4), timed: bool = False) -> list[Finding]:
    estimate, _, poses = fitted()
    if timed:
        poses = tuple(replace(pose, t_start=10.0 * k, t_end=10.0 * k + 1.0) for k, pose in enumerate(poses))
    levels = np.outer(np.where(np.isin(np.arange(12), low), 1.0, -1.0), [0.15, 0.0, 0.0, 0.0, 0.02, 0.0])
    assert isinstance(estimate.beliefs, Beliefs)
    beliefs = replace(estimate.beliefs, with_orientation={kind: probability}, backlash=levels, turn=0.0021)
    return of_beliefs(replace(estimate, beliefs=beliefs), poses, 0.0, False)


@pytest.mark.parametrize("kind", SAID)
def test_what_goes_with_the_orientation_is_said_where_it_is_likely_and_only_then(kind: Kind) -> None:
    assert said(0.8, kind) == [Finding(kind, Severity.WARNING, SAID[kind])]
    assert said(0.4, kind) == []


def test_two_levels_that_are_two_parts_of_the_rows_are_said_to_be_where_no_times_tell() -> None:
    parts = "; split in the order of the rows, as by a new zero before {}: give their times (a column t)"
    for low, first in (((0, 1, 2, 3, 4), "pose 6"), ((0, 1), "pose 3"), ((10, 11), "pose 11")):
        (found,) = said(0.8, Kind.TWO_LEVELS, low)
        assert found.text.endswith(parts.format(first))
        assert "split in the order" not in said(0.8, Kind.TWO_LEVELS, low, timed=True)[0].text
    other: tuple[tuple[int, ...], ...] = ((0,), (11,), (0, 1, 2, 3, 5), (4, 5, 6), (0, 11))
    for few in other:
        assert "split in the order" not in said(0.8, Kind.TWO_LEVELS, few)[0].text


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


@pytest.mark.parametrize(
    ("exact", "off", "base", "texts"),
    [
        (0.893, 2.6, 0.0, ["the sensor's z is exactly parallel to the flange's"]),
        (0.893, 0.0, 2.6, ["gravity is exactly in the stated direction"]),
        (0.893, 1.9, 1.9, []),
        (0.981, 3.6, 3.4, ["the sensor's z is exactly parallel to the flange's"]),
        (0.019, 3.4, 3.6, ["gravity is exactly in the stated direction"]),
    ],
)
def test_a_tilt_that_decides_the_answer_is_in_doubt(exact: float, off: float, base: float, texts: list[str]) -> None:
    estimate, _, poses = fitted()
    assert isinstance(estimate.beliefs, Beliefs)
    beliefs = replace(estimate.beliefs, mounting_exact=exact, base_exact=exact, off_by_mounting=off, off_by_base=base)
    assert of_beliefs(replace(estimate, beliefs=beliefs), poses, 0.0, False) == [
        Finding(
            Kind.TILT_IN_DOUBT,
            Severity.DOUBTFUL,
            f"doubtful: whether {text} decides the answer, with a probability of {100.0 * exact:.1f} % that it is: the "
            f"other way the answer is {max(off, base):.1f} std off; tilt the tool further, about more than one axis, "
            "or state it with --known",
        )
        for text in texts
    ]


def test_a_tilt_is_in_doubt_where_a_cone_hides_it_and_not_where_poses_are_spread() -> None:
    """0.3 deg of 30 N are 0.2 N of bias, which poses in a cone cannot tell from it."""
    doubted = {"12 cone": 0, "12 random": 0}
    for seed in range(14, 20):
        for name in doubted:
            rng = np.random.default_rng(seed)
            rig = tilted(np.deg2rad([0.3, 0.15]), np.zeros(2), 30.0, rng)
            R = poses(name, rng)
            calibration = cw.calibrate(cw.Samples(noisy_readings(rig, R, OF_MEAN, rng), R))
            said = [f for f in calibration.findings if f.kind is Kind.TILT_IN_DOUBT]
            assert not said or calibration.verdict == "doubtful"
            doubted[name] += len(said)
    assert doubted["12 cone"] >= 2
    assert doubted["12 random"] == 0


@pytest.mark.parametrize(
    ("kind", "probability", "off", "moved"),
    [
        (Kind.BIAS_STEPPED, 0.004, 3.6, "stepped before pose 5"),
        (Kind.BIAS_WANDERED, 0.06, 2.1, "wandered"),
        (Kind.BIAS_DRIFTED, 0.06, 2.1, "drifted"),
        (Kind.BIAS_STEPPED, 0.004, 3.4, None),
        (Kind.BIAS_DRIFTED, 0.06, 1.9, None),
    ],
)
def test_a_drift_that_is_unlikely_is_in_doubt_where_it_decides(
    kind: Kind, probability: float, off: float, moved: str | None
) -> None:
    estimate, _, poses = fitted()
    assert isinstance(estimate.beliefs, Beliefs)
    rival = Rival(Drift(kind, np.zeros((12, 1)), 4 if kind is Kind.BIAS_STEPPED else None), probability, off)
    text = (
        f"doubtful: the bias may have {moved}, with a probability of {100.0 * probability:.3g} %: the answer would be "
        f"{off:.1f} std off; record more poses"
    )
    expected = [Finding(Kind.DRIFT_IN_DOUBT, Severity.DOUBTFUL, text)] if moved else []
    beliefs = replace(estimate.beliefs, furthest=rival)
    assert of_beliefs(replace(estimate, beliefs=beliefs), poses, 0.0, False) == expected


def test_a_step_that_a_turning_robot_explains_better_is_in_doubt_and_none_is_where_nothing_stepped() -> None:
    """Of six poses in a cone: the bias is 7 std off, as turns that go on from pose to pose take up the step."""
    rng = np.random.default_rng([7, 4, 10, 254])
    rig, R, t, wrench = Setting("paper's 6", bool(rng.integers(2)), Course("step")).drawn(rng)
    change, _ = Course("step", 0.3).drawn(t, rng, int(rng.integers(1, 6)))
    doubted = {}
    for name, moved in (("stepped", change), ("steady", np.zeros_like(change))):
        calibration = cw.calibrate(cw.Samples(wrench + moved, R, t))
        said = {finding.kind for finding in calibration.findings}
        doubted[name] = calibration.verdict == "doubtful" and Kind.DRIFT_IN_DOUBT in said
        assert doubted[name] or np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0
    assert doubted == {"stepped": True, "steady": False}
