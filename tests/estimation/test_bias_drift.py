"""A bias that moves: what may have happened beforehand, and what is found of it, down to the last pose."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

import contactwrench as cw
from benchmarks.errors import direction, in_a_cone
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.estimation import outliers, rigid
from contactwrench.estimation.bias_drift import OF_ONE_POSE, STRENGTHS, Drift, Kernels, kernels_of, possible_drifts
from contactwrench.estimation.least_squares import Members
from contactwrench.estimation.one_direction import log_either
from tests.support.rigs import NOISE, example, noisy
from tests.support.world import Array, Rig, derivatives, noisy_readings, random_rig

OF_BIAS = (Kind.BIAS_STEPPED, Kind.BIAS_DRIFTED, Kind.BIAS_WANDERED)


def _drifts(time: Array) -> list[Drift]:
    return possible_drifts(time, len(time))[0]


def test_every_motion_ends_in_the_last_bias_and_begins_one_strength_off_it() -> None:
    time = np.cumsum(np.random.default_rng(1).uniform(1.0, 9.0, 12))
    for drift in _drifts(time):
        covariance = drift.columns @ drift.columns.T
        assert np.abs(covariance[-1]).max() < 1e-12
        assert covariance[0, 0] == pytest.approx(1.0)


def test_a_walk_has_the_covariance_of_brownian_motion_run_backwards() -> None:
    """Of the changes until the end, the less time left of two, over the whole: in many poses too."""
    for n in (12, 450):
        time = np.cumsum(np.random.default_rng(n).uniform(1.0, 9.0, n))
        left = (time[-1] - time) / (time[-1] - time[0])
        (walk,) = (drift.columns @ drift.columns.T for drift in _drifts(time) if drift.kind is Kind.BIAS_WANDERED)
        assert walk == pytest.approx(np.minimum.outer(left, left), abs=0.01)


def _along_one_direction(seed: int, poses: int, cycle: bool) -> tuple[Rig, cw.Samples]:
    """Poses whose bias wanders alike on all axes, by 10 noise std in all: there and back one and a half times, or as a
    walk.
    """
    rig, R, rng = example(seed, poses=poses)
    phase = 3.0 * np.pi * np.linspace(0.0, 1.0, poses) + rng.uniform(0.0, 2.0 * np.pi)
    course = np.sin(phase) if cycle else np.cumsum(rng.normal(size=poses)) / np.sqrt(poses)
    change = 10.0 * np.sqrt(2.0) * NOISE * np.outer(course - course[-1], direction(rng, 6))
    return rig, cw.Samples(noisy_readings(rig, R, NOISE, rng) + change, R, t=10.0 * np.arange(float(poses)))


@pytest.mark.parametrize(("poses", "seed"), [(12, 1), (12, 2), (24, 3), (24, 4)])
def test_a_bias_that_goes_there_and_back_wanders_and_the_last_one_is_within_its_std(poses: int, seed: int) -> None:
    """It was 6 to 8 std off in these, and good: as backlash, or by a walk that took the noise up with the cycle."""
    rig, samples = _along_one_direction(seed, poses, cycle=True)
    calibration = cw.calibrate(samples, "mount")
    assert [f.kind for f in calibration.findings if f.kind in (*OF_BIAS, Kind.TWO_LEVELS)] == [Kind.BIAS_WANDERED]
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("cycle", [True, False])
def test_the_last_of_a_bias_that_wanders_along_one_direction_is_covered(cycle: bool) -> None:
    """By the 95 % intervals of its axes, of all recordings together."""
    off = []
    for poses, seed in product((12, 24), range(40, 44)):
        rig, samples = _along_one_direction(seed, poses, cycle)
        calibration = cw.calibrate(samples, "mount")
        off += np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).tolist()
    assert np.mean(np.array(off) < 1.96) > 0.9
    assert max(off) < 5.0


@pytest.mark.parametrize("seed", [3, 7, 8, 10, 11])
def test_backlash_that_comes_with_the_direction_of_arrival_is_none_of_a_bias_that_wanders(seed: int) -> None:
    """Two levels 9 noise std apart, six of twelve poses near tool-down on each: in these none was found."""
    rng = np.random.default_rng(seed)
    rig, R = random_rig(rng), in_a_cone(12, rng)
    side = rng.permutation(np.repeat([-0.5, 0.5], 6))
    wrench = noisy_readings(rig, R, NOISE, rng) + 9.0 * np.sqrt(6.0) * NOISE * np.outer(side, direction(rng, 6))
    calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(12.0)), "mount")
    assert [f.kind for f in calibration.findings if f.kind in (*OF_BIAS, Kind.TWO_LEVELS)] == [Kind.TWO_LEVELS]
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0


@pytest.mark.parametrize("seed", [0, 6, 13, 19])
def test_backlash_is_found_beside_a_pose_in_contact(seed: int) -> None:
    """Two levels 24 noise std apart and a touch of 40: a bias that wanders, its std too small and good."""
    rig, R, rng = example(seed)
    wrench = noisy_readings(rig, R, NOISE, rng)
    side, apart = rng.choice([-0.5, 0.5], 24), 24.0 * NOISE * direction(rng, 6)
    touched, force = rng.integers(24), direction(rng, 3)
    wrench += np.outer(side, apart)
    wrench[touched] += np.r_[force, np.cross([0.0, 0.0, 0.1], force)] * 40.0 * NOISE[0]
    calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(24.0)))
    assert [f.kind for f in calibration.findings if f.kind in (*OF_BIAS, Kind.TWO_LEVELS)] == [Kind.TWO_LEVELS]
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0


@pytest.mark.parametrize(("share", "is_far"), [(0.15, True), (0.05, False)])
def test_two_zeros_in_rows_of_any_order_are_told_from_backlash_by_how_far_they_are_apart(
    share: float, is_far: bool
) -> None:
    """Two tables joined and sorted: the bias was halfway, by up to 76 std off both, and good."""
    said = "; backlash hardly moves that far: rather two zeros, the bias is halfway: calibrate each alone"
    for seed in (2, 6, 7):
        rng = np.random.default_rng(seed)
        rig, R = random_rig(rng), Rotation.random(16, rng).as_matrix()
        apart = share * rig.weight * np.array([0.6, -0.5, 0.624, 0.02, 0.02, -0.03])
        on_one = rng.permutation(np.repeat([0.0, 1.0], 8))
        calibration = cw.calibrate(cw.Samples(noisy_readings(rig, R, NOISE, rng) + np.outer(on_one, apart), R))
        (text,) = (finding.text for finding in calibration.findings if finding.kind is Kind.TWO_LEVELS)
        assert text.startswith("doubtful: the bias comes back in two levels, ") is is_far
        assert text.endswith(said) is is_far
        assert (calibration.verdict == "doubtful") is is_far


def _one_member(strength: float) -> Members:
    """A walk of that strength, and noise of unit variance."""
    one, axes = np.ones((1, 1)), np.ones((1, 6))
    of_one = np.zeros(1, dtype=np.intp)
    numbers = np.zeros(1), np.zeros((1, 6)), np.array([strength])
    return Members(of_one, of_one, one, one[..., None], axes, axes, *numbers, of_one - 1, np.zeros(1))


@pytest.mark.parametrize("along", [0.0, 1.0, 4.0])
def test_a_direction_that_nobody_knows_is_weighed_as_the_mean_over_many(along: float) -> None:
    """Against the density of twelve readings under each of 400,000 directions drawn at random."""
    rng = np.random.default_rng(3)
    (walk,), n = [d.columns for d in _drifts(np.arange(12.0)) if d.kind is Kind.BIAS_WANDERED], 12
    errors = rng.normal(size=(n, 6)) + along * np.outer(walk @ rng.normal(size=walk.shape[1]), direction(rng, 6) * 2.4)
    contrasts = np.linalg.svd(np.ones((1, n)))[2][1:]  # no constant
    seen = contrasts @ errors
    own = multivariate_normal(np.zeros(n - 1), np.eye(n - 1))
    own_walk = multivariate_normal(np.zeros(n - 1), np.eye(n - 1) + 4.0 * contrasts @ walk @ walk.T @ contrasts.T)
    along_one = multivariate_normal(np.zeros(n - 1), np.eye(n - 1) + 24.0 * contrasts @ walk @ walk.T @ contrasts.T)
    directions = rng.normal(size=(400_000, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    noise_alone = float(np.sum(own.logpdf(seen.T)))
    each = along_one.logpdf(directions @ seen.T) - own.logpdf(directions @ seen.T) + noise_alone
    expected = np.logaddexp.reduce(each) - np.log(len(directions)) - np.sum(own_walk.logpdf(seen.T))
    found = log_either(
        _only(walk, 2.0), _one_member(2.0), errors[None], np.zeros((n, 6, 1)), np.ones(n), np.ones(n, dtype=bool)
    )
    assert found[0] == pytest.approx(np.logaddexp(np.log(0.997), np.log(0.003) + expected), abs=0.5)


def test_a_step_may_have_been_before_any_pose_and_a_steady_bias_is_likelier() -> None:
    drifts, log_prior = possible_drifts(np.arange(12.0), 1.0)
    kernels = kernels_of(12, drifts, log_prior)
    places = {drift.first_after: p for drift, p in zip(drifts, log_prior, strict=True) if drift.first_after}
    assert sorted(places) == list(range(1, 12))
    assert len(set(places.values())) == 2
    assert np.exp([places[1] - places[2], places[11] - places[10]]) == pytest.approx(OF_ONE_POSE)
    assert kernels.drifts[kernels.drift[0]].kind is None
    assert np.exp(kernels.log_prior[1:]).sum() == pytest.approx(np.exp(log_prior).sum())
    assert np.exp(log_prior).sum() < np.exp(kernels.log_prior[0])


def test_of_poses_that_may_be_in_order_the_same_is_looked_for_and_is_as_much_less_likely_and_of_few_nothing() -> None:
    known, log_prior = possible_drifts(np.arange(24.0), 1.0)
    perhaps, log_prior_perhaps = possible_drifts(np.arange(24.0), 0.5)
    assert [drift.first_after for drift in perhaps] == [drift.first_after for drift in known]
    assert np.exp(log_prior_perhaps) == pytest.approx(0.5 * np.exp(log_prior))
    assert possible_drifts(np.arange(3.0), 1.0) == possible_drifts(np.arange(101.0), 0.5) == ([], [])
    steady = kernels_of(24, [], [])
    assert (len(steady.drift), steady.log_prior.tolist()) == (1, [0.0])


@pytest.mark.slow
@pytest.mark.parametrize("before", range(1, 12))
def test_a_step_before_any_pose_leaves_the_last_bias_within_its_std(before: int) -> None:
    """Twelve poses, 20 noise std: found with two poses on either side, and not sure where three or fewer are after."""
    rig, R, rng = example(before, poses=12)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[:before] += 20.0 * NOISE * rng.choice([-1.0, 1.0], 6)
    calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(12.0)), "mount")
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0
    steps = [finding for finding in calibration.findings if finding.kind in OF_BIAS]
    if 2 <= before <= 10:
        assert len(steps) == 1
        assert f"the bias stepped before pose {before + 1} (t = {10 * before} s) by up to " in steps[0].text
    if before >= 9:
        assert calibration.verdict != "good"
    if before == 11:
        assert any("pose 12 (t = 110 s), the last one, was left out: " in text for text in calibration.warnings)


@pytest.mark.parametrize("seed", [12, 54])
def test_a_pose_in_contact_does_not_hide_a_step(seed: int) -> None:
    """All poses after the step were taken for contacts, too, and the bias was the first one, 28 of its std off."""
    rig, R, rng = example(seed)
    wrench = noisy_readings(rig, R, NOISE, rng)
    before, touched, force = rng.integers(16, 20), rng.integers(24), direction(rng, 3)
    wrench[touched] += np.r_[force, np.cross([0.0, 0.0, 0.1], force)] * 30.0 * NOISE[0]
    wrench[:before] += 7.0 * NOISE * rng.choice([-1.0, 1.0], 6)
    calibration = cw.calibrate(cw.Samples(wrench, R))
    assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0
    assert [f"the bias stepped before pose {before + 1}" in text for text in calibration.warnings].count(True) == 1


def test_a_last_pose_that_is_off_is_taken_for_a_contact_rather_than_for_a_step() -> None:
    """As it is in nearly all cases: the bias that is given is not moved towards it."""
    for seed in range(2):
        rig, R, rng = example(seed, poses=12)
        wrench = noisy_readings(rig, R, NOISE, rng)
        wrench[-1] += 20.0 * NOISE * [1.0, -1.0, 1.0, 0.0, 0.5, 0.0]
        calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(12.0)), "mount")
        assert np.abs((calibration.bias - rig.bias) / NOISE).max() < 3.0
        assert any("pose 12 (t = 110 s), the last one, was left out: " in text for text in calibration.warnings)


@pytest.mark.parametrize("pushed", [7, 3])
def test_where_the_bias_hangs_on_the_last_pose_that_is_the_advice(pushed: int) -> None:
    """Half of the push is in the std of the bias, and the model is not at fault; of another pose nothing hangs."""
    rig, R, rng = example(3, poses=8)
    wrench = noisy_readings(rig, R, NOISE, rng)
    wrench[pushed] += [0.0, 0.0, 8.0, 0.0, 0.1, 0.0]
    calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(8.0)), "mount")
    last = "the last pose was left out: if the bias stepped before it, the one given is wrong: record one more pose"
    advice = [finding.text for finding in calibration.findings if finding.kind is Kind.ADVICE]
    assert advice == ([last] if pushed == 7 else [])
    assert (calibration.verdict == "weak") is (pushed == 7)


@pytest.mark.slow
@pytest.mark.parametrize("poses", [12, 24])
@pytest.mark.parametrize("last", [1, 2])
def test_a_step_before_the_last_poses_is_in_the_std_of_the_bias_and_never_good(last: int, poses: int) -> None:
    """Whether the bias stepped or those poses are in contact nobody can know: both are in the mean, and it is said."""
    for seed in range(2):
        rig, R, rng = example(seed, poses=poses)
        wrench = noisy_readings(rig, R, NOISE, rng)
        wrench[:-last] += np.array([0.5, -0.5, 0.7, 0.0, 0.01, 0.0])
        calibration = cw.calibrate(cw.Samples(wrench, R, t=10.0 * np.arange(float(poses))), "mount")
        assert np.abs((calibration.bias - rig.bias) / calibration.std["bias"]).max() < 4.0, seed
        assert calibration.verdict != "good", seed
        doubted = {finding.kind for finding in calibration.findings if finding.severity is Severity.DOUBTFUL}
        assert (Kind.POSE_IN_DOUBT if last == 1 else Kind.BIAS_STEPPED) in doubted, seed


@pytest.mark.slow
def test_a_bias_that_stays_is_hardly_ever_said_to_move() -> None:
    moved = 0
    for seed in range(10):
        rig, R, rng = example(500 + seed, poses=12)
        samples = cw.Samples(noisy_readings(rig, R, NOISE, rng), R, t=10.0 * np.arange(12.0))
        moved += any(finding.kind in OF_BIAS for finding in cw.calibrate(samples, "mount").findings)
    assert moved == 0


def _only(columns: Array, strength: float) -> Kernels:
    """One motion and nothing else, whatever was asked for."""
    drifts = (Drift(None, np.zeros((len(columns), 0))), Drift(Kind.BIAS_WANDERED, columns))
    return Kernels(drifts, np.array([1]), np.array([strength]), np.zeros(1))


@pytest.mark.parametrize("strength", [float(STRENGTHS[1]), float(STRENGTHS[3])])
def test_the_covariance_of_a_bias_that_moved_is_that_of_generalised_least_squares(
    strength: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The whole of it, the last bias included, where only one motion is possible and no pose is outlying."""
    rig, R, rng = example(7, poses=12)
    time = np.cumsum(rng.uniform(1.0, 9.0, 12))
    columns = next(d.columns for d in possible_drifts(time, 12)[0] if d.kind is Kind.BIAS_WANDERED)
    tiny = 1e-4 * NOISE
    walk = columns @ rng.normal(size=(columns.shape[1], 6)) * strength * tiny
    wrench = noisy_readings(rig, R, tiny, rng) + walk
    monkeypatch.setattr(outliers, "PROBABILITY", 1e-12)
    monkeypatch.setattr(rigid, "kernels_of", lambda *_: _only(columns, strength))
    calibration = cw.calibrate(cw.Samples(wrench, R, t=time), "mount", noise=tiny)
    assert len(calibration.fitted_poses) == 12
    covariance = _generalised(
        rig, R, np.asarray(np.kron(np.eye(12) + strength**2 * columns @ columns.T, np.diag(tiny**2)), dtype=np.float64)
    )
    scale = float(calibration.noise[0] / tiny[0]) ** 2
    unit = np.sqrt(scale * np.diag(covariance))
    assert np.abs((calibration.covariance - scale * covariance) / np.outer(unit, unit)).max() < 5e-3


def _generalised(rig: Rig, R: Array, N: Array) -> Array:
    D = derivatives(rig, "mount", R).reshape(6 * len(R), -1)
    covariance: Array = np.linalg.inv(D.T @ np.linalg.solve(N, D))
    return covariance


def test_rows_in_any_order_tell_the_same_where_no_time_is_known_and_the_bias_is_steady() -> None:
    """But for the small share of answers in which the bias moved."""
    rig, R, rng = example(8)
    samples = noisy(rig, R, rng)
    ordered = samples.select(np.argsort(samples.wrench[:, 2]))
    plain, other = cw.calibrate(samples, "mount"), cw.calibrate(ordered, "mount")
    assert np.abs((other.parameters - plain.parameters) / np.sqrt(np.diag(plain.covariance))).max() < 0.1
    assert not [finding for finding in other.findings if finding.kind in OF_BIAS]
