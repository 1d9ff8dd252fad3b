"""Tables as people make them: numbers written to a few digits, a sensor with a damaged axis, or one that creeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from benchmarks.errors import in_a_cone, usual_rig
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.estimation.noise import variance_of_digits
from tests.support.rigs import NOISE
from tests.support.world import Array, Rig, noisy_readings, random_rotations, readings

QUIET = 0.1 * NOISE
ALONG_THE_AXES = Rotation.concatenate(
    [Rotation.align_vectors([[0.0, 0.0, -1.0]], [d])[0] for d in (*np.eye(3), *-np.eye(3))]
).as_matrix()
UNSEEN = random_rotations(100, np.random.default_rng(8))
OF_AXIS = " of the load that the other axes tell (chance under 1 %), and beyond these orientations the error grows: "
OF_CREEP = "it is counted in every std, as of a sensor that creeps; rest for longer"


def _written(rig: Rig, R: Array, steps: tuple[float, float], rng: np.random.Generator) -> cw.Samples:
    step = np.repeat(steps, 3)
    return cw.Samples(step * np.rint(noisy_readings(rig, R, QUIET, rng) / step), R)


def _errors(calibration: cw.Calibration, rig: Rig) -> Array:
    """In standard deviations: of weight, com and bias."""
    truth = {"weight": rig.weight, "com": rig.com, "bias": rig.bias}
    return np.hstack([(getattr(calibration, name) - true) / calibration.std[name] for name, true in truth.items()])


@pytest.mark.parametrize("steps", [(1.0, 0.1), (0.25, 0.02), (0.1, 0.01)])
def test_what_is_written_to_a_few_digits_is_believed_to_half_a_step(steps: tuple[float, float]) -> None:
    """Six poses along the axes: readings that are equal are off alike, and four of a kind are no surer than one."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rig = usual_rig(rng)
        calibration = cw.calibrate(_written(rig, ALONG_THE_AXES, steps, rng), "mount")
        assert np.abs(_errors(calibration, rig)).max() < 5.0
        assert calibration.expected_error[0] > 0.4 * steps[0]


def test_digits_show_as_the_coarsest_step_and_in_readings_that_are_alike() -> None:
    rng = np.random.default_rng(3)
    for step in (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01):
        wrench = step * np.rint(rng.normal(size=(24, 6)) * 20.0)
        alike = [np.sum(np.unique(axis, return_counts=True)[1] ** 2) / 24.0 for axis in wrench.T]
        np.testing.assert_allclose(variance_of_digits(wrench), step**2 / 12.0 * np.array(alike))
        many = variance_of_digits(step * np.rint(rng.normal(size=(5_000, 6)) * 20.0))
        assert (many < 6.1 * step**2 / 12.0).all()  # that thousands are equal is no sign that they are off alike


def test_readings_with_all_their_digits_or_next_to_none_show_no_step() -> None:
    rng = np.random.default_rng(4)
    assert not variance_of_digits(rng.normal(size=(6, 6)) * 20.0).any()
    assert not variance_of_digits(rng.normal(size=(24, 6)).astype(np.float32).astype(np.float64)).any()
    assert not variance_of_digits(np.tile([0.0, 0.0, 10.0, 0.0, 0.0, 0.0], (6, 1))).any()
    assert not variance_of_digits(np.zeros((6, 6))).any()


def _of_axis(calibration: cw.Calibration) -> list[Finding]:
    return [finding for finding in calibration.findings if OF_AXIS in finding.text]


@pytest.mark.parametrize("axis", [0, 2])
def test_a_dead_axis_that_a_cone_takes_for_a_noisy_one_is_named(axis: int) -> None:
    rng = np.random.default_rng(1)
    rig, R = usual_rig(rng, 20.0), in_a_cone(24, rng)
    wrench = readings(rig, R)
    wrench[:, axis] = rig.bias[axis]
    calibration = cw.calibrate(cw.Samples(wrench + NOISE * rng.normal(size=(24, 6)), R))
    (found,) = _of_axis(calibration)
    assert (found.kind, found.severity) == (Kind.CROSS_TALK, Severity.DOUBTFUL)
    assert found.text.startswith(f"doubtful: f{'xyz'[axis]} reads ")
    assert found.text.endswith(
        f"{OF_AXIS}a dead or damaged channel, a wrong gain, or something that holds the tool: check that axis"
    )


def test_an_axis_of_half_gain_is_never_good_and_whole_ones_are_never_named() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rig, R = usual_rig(rng, 20.0), in_a_cone(12, rng)
        wrench = noisy_readings(rig, R, NOISE, rng)
        assert _of_axis(cw.calibrate(cw.Samples(wrench, R))) == []
        wrench[:, 2] = rig.bias[2] + 0.5 * (wrench[:, 2] - rig.bias[2])
        assert cw.calibrate(cw.Samples(wrench, R)).verdict != "good"


def _creeping(rig: Rig, R: Array, share: float, rng: np.random.Generator) -> Array:
    load = readings(rig, R) - rig.bias
    late = np.vstack([np.zeros(6), load[:-1] - load[1:]])
    return load + share * late + rig.bias + NOISE * rng.normal(size=load.shape)


@pytest.mark.parametrize("timed", [True, False])
def test_what_a_reading_keeps_of_the_pose_before_is_found_by_the_order_and_makes_no_tool_lighter(timed: bool) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        rig, R = replace(usual_rig(rng), weight=20.0), random_rotations(24, rng)
        t = 15.0 * np.arange(24.0) if timed else None
        calibration = cw.calibrate(cw.Samples(_creeping(rig, R, 0.03, rng), R, t))
        assert np.abs(_errors(calibration, rig)).max() < 4.5
        assert calibration.weight == pytest.approx(20.0, abs=0.1)  # by the poses alone 0.6 N less
        (found,) = [finding for finding in calibration.findings if finding.kind is Kind.CREEP]
        assert found == Finding(
            Kind.CREEP,
            Severity.WARNING,
            f"a part of the load of the pose before shows (probability 99.9 %): {OF_CREEP}",
        )
        off = calibration.predict(UNSEEN) - readings(rig, UNSEEN)
        assert np.sqrt(np.mean(np.sum(off[:, :3] ** 2, axis=1))) < calibration.expected_error[0]


def test_without_creep_or_in_another_order_none_is_found() -> None:
    for seed in range(4):
        rng = np.random.default_rng(100 + seed)
        rig, R = usual_rig(rng), random_rotations(24, rng)
        steady, creeping = _creeping(rig, R, 0.0, rng), _creeping(rig, R, 0.03, rng)
        order = rng.permutation(24)
        for samples in (
            cw.Samples(steady, R, 15.0 * np.arange(24.0)),
            cw.Samples(steady, R),
            cw.Samples(creeping[order], R[order]),
        ):
            assert not [finding for finding in cw.calibrate(samples).findings if finding.kind is Kind.CREEP]
