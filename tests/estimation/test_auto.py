"""`auto`: near nominal it is as good as the rung that was told, and it leaves nominal where the readings say so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from contactwrench.errors import AmbiguityError, InputError, UnobservableError
from tests.support.poses import POSE_SETS
from tests.support.rigs import NOISE, example, noise_free, noise_of_a_design, noisy, rotation_angle, seeds
from tests.support.world import DOWN, Array, Rig, random_rotations, readings, tilted_down

SPREAD = POSE_SETS["6 spread"]


def _tilted(rig: Rig, mount_deg: float, base_deg: float, rng: np.random.Generator, flipped: bool = False) -> Rig:
    """The rig with its sensor's z off the flange's, at any yaw, and its base off level, to random sides."""
    side = rng.uniform(0.0, 2.0 * np.pi)
    tilt = Rotation.from_rotvec(np.deg2rad(mount_deg) * np.array([np.cos(side), np.sin(side), 0.0])).as_matrix()
    yaw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    flip = np.diag([1.0, -1.0, -1.0]) if flipped else np.eye(3)
    return replace(rig, R_flange_sensor=tilt @ flip @ yaw, down=tilted_down(np.deg2rad(base_deg), rng))


def _off(calibration: cw.Calibration, rig: Rig) -> Array:
    """Errors of the predicted force, N, at orientations that were not recorded."""
    unseen = random_rotations(50, np.random.default_rng(99))
    error: Array = (calibration.predict(unseen) - readings(rig, unseen))[:, :3]
    return error


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mount_deg", "base_deg", "weight"),
    [(0.0, 0.0, 2.0), (0.0, 0.0, 50.0), (2.0, 0.0, 2.0), (0.0, 1.0, 50.0), (2.0, 1.0, 2.0), (2.0, 1.0, 50.0)],
)
def test_near_nominal_it_is_about_as_good_as_the_best_rung(mount_deg: float, base_deg: float, weight: float) -> None:
    """A light tool, or a heavy one with the sensor against the flange."""
    flipped = weight > 10.0
    rig, _, rng = example(11)
    rig = replace(rig, weight=weight)
    squares: dict[str, list[float]] = {}
    for _ in range(3):
        truth = _tilted(rig, mount_deg, base_deg, rng, flipped)
        calibration = cw.calibrate(noisy(truth, SPREAD, rng, 0.7 * NOISE))
        free = readings(truth, SPREAD)
        squares.setdefault("auto", []).append(float(np.mean(_off(calibration, truth) ** 2)))
        for rung in calibration.alternatives[:3]:
            predicted = (SPREAD.transpose(0, 2, 1) @ rung.gravity_direction) @ rung.B[:, :3].T + rung.B[:, 3]
            squares.setdefault(rung.model, []).append(float(np.mean((predicted - free)[:, :3] ** 2)))
    rms = {model: float(np.sqrt(np.mean(of_model))) for model, of_model in squares.items()}
    assert rms.pop("auto") < 2.0 * min(rms.values()) + 0.02


@pytest.mark.slow
@settings(deadline=None, max_examples=4)
@given(seed=seeds)
def test_any_mounting_and_any_base_up_to_a_wall_are_found(seed: int) -> None:
    rig, R, rng = example(seed, poses=12)
    rig = replace(rig, weight=max(rig.weight, 5.0), down=tilted_down(rng.uniform(0.0, np.deg2rad(85.0)), rng))
    calibration = cw.calibrate(noisy(rig, R, rng))
    assert calibration.R_flange_sensor is not None
    assert rotation_angle(calibration.R_flange_sensor, rig.R_flange_sensor) < np.deg2rad(3.0)
    assert np.linalg.norm(calibration.gravity_direction - rig.down) < np.deg2rad(3.0)


@pytest.mark.slow
def test_a_wall_is_found_though_gravity_lies_right_at_the_limit() -> None:
    for seed in range(8):
        rig, R, rng = example(seed, poses=12)
        wall = replace(rig, weight=10.0, down=tilted_down(np.pi / 2.0, rng))
        calibration = cw.calibrate(noisy(wall, R, rng), "mount+base")
        assert np.linalg.norm(calibration.gravity_direction - wall.down) < 0.05


def test_a_sensor_at_45_deg_on_a_wall_leaves_both_priors_and_says_why() -> None:
    rig, R, rng = example(12)
    calibration = cw.calibrate(noisy(_tilted(replace(rig, weight=10.0), 45.0, 80.0, rng), R, rng))
    of_mounting, of_base = calibration.assumptions
    assert of_mounting.startswith("mounting: sensor's z is 45")
    assert of_mounting.endswith(" deg off the flange's, not within 1.41 deg an axis (probability 99.9 %)")
    assert of_base.startswith(("base: gravity is 80", "base: gravity is 79.9"))
    assert of_base.endswith(" deg off the stated direction, not within 0.71 deg an axis (probability 99.9 %)")


def test_near_nominal_it_keeps_both_priors_and_says_so() -> None:
    rig, R, rng = example(13)
    rig = _tilted(replace(rig, weight=30.0), 0.0, 0.0, rng, flipped=True)
    calibration = cw.calibrate(noisy(rig, R, rng))
    of_mounting, of_base = calibration.assumptions
    assert of_mounting.startswith("mounting: sensor's z against the flange's, +- 1.41 deg an axis; found 0.0")
    assert of_base.startswith("base: gravity in the stated direction, +- 0.71 deg an axis; found 0.0")
    assert float(of_mounting.split()[-2]) > 80
    assert float(of_base.split()[-2]) > 80


def test_only_the_prior_that_the_readings_contradict_is_left() -> None:
    rig, R, rng = example(14)
    calibration = cw.calibrate(noisy(_tilted(replace(rig, weight=20.0), 30.0, 0.0, rng), R, rng))
    assert "mounting: sensor's z is 30.0 deg off the flange's, not within 1.41" in calibration.assumptions[0]
    assert "stated direction, +- 0.71" in calibration.assumptions[1]


def test_the_std_counts_tilts_within_their_priors() -> None:
    """Six poses near the vertical cannot tell a tilt: the prior does, and a wider one leaves a larger std, though never
    that of whoever knows nothing of it.
    """
    for seed in range(15, 17):
        rig, _, rng = example(seed)
        samples = noisy(_tilted(replace(rig, weight=2.0), 0.0, 0.0, rng), POSE_SETS["paper's 6"], rng)
        narrow, usual, wide = (
            cw.calibrate(samples, mount_tilt_sd=np.deg2rad(sd), base_tilt_sd=np.deg2rad(0.5 * sd)).largest_std[0]
            for sd in (0.1, 1.41, 3.0)
        )
        told, free = (cw.calibrate(samples, model).largest_std[0] for model in ("yaw", "mount+base"))
        assert narrow == pytest.approx(told, rel=0.02)
        assert 1.05 * narrow < usual < wide < free


@pytest.mark.slow
def test_errors_are_those_that_the_std_states() -> None:
    """Truth drawn from the priors: mean squared errors in stds near 1 for weight, com and bias."""
    rng = np.random.default_rng(16)
    squares = []
    for off in noise_of_a_design(40, len(SPREAD), rng):
        rig, _, _ = example(int(rng.integers(1000)))
        rig = replace(rig, weight=5.0)
        mount, base = np.deg2rad(1.41) * rng.normal(size=2), np.deg2rad(0.71) * rng.normal(size=2)
        tilt = Rotation.from_rotvec([*mount, 0.0]).as_matrix()
        yaw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
        rig = replace(rig, R_flange_sensor=tilt @ yaw, down=Rotation.from_rotvec([*base, 0.0]).as_matrix() @ DOWN)
        calibration = cw.calibrate(cw.Samples(readings(rig, SPREAD) + off, SPREAD), noise=NOISE)
        errors = [
            np.atleast_1d((getattr(calibration, name) - getattr(rig, name)) / calibration.std[name])
            for name in ("weight", "com", "bias")
        ]
        squares.append(np.concatenate(errors) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.25)


@pytest.mark.slow
def test_a_mounting_that_is_nearly_parallel_is_not_sure_to_be_exactly_so() -> None:
    """By tenths of a degree, as parts are made, which the noise hides: 6 std off, RMS, if it is exact or widely off."""
    off = []
    for seed in range(10):
        rig, R, rng = example(seed, poses=16)
        truth = _tilted(replace(rig, weight=20.0), 0.25, 0.1, rng)
        calibration = cw.calibrate(noisy(truth, R, rng, 4.0 * NOISE))
        assert calibration.R_flange_sensor is not None
        turn = Rotation.from_matrix(calibration.R_flange_sensor @ truth.R_flange_sensor.T).as_rotvec()
        off.append(np.linalg.norm(turn[:2]) / np.linalg.norm(calibration.std["mount"][:2]))
    assert np.sqrt(np.mean(np.square(off))) < 3.5, off


@pytest.mark.slow
def test_the_std_does_not_depend_on_how_the_base_is_turned() -> None:
    """Base axes turned about the vertical are other names for the same: the std of every contact wrench stays."""
    for seed in range(3):
        rig, _, rng = example(seed)
        rig = _tilted(replace(rig, weight=6.0), 0.5, 0.5, rng)
        samples = noisy(rig, POSE_SETS["paper's 6"], rng)
        turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
        turned = cw.Samples(samples.wrench, turn @ samples.R_base_flange)
        R = random_rotations(20, rng)
        as_it_is, other = cw.calibrate(samples), cw.calibrate(turned)
        assert other.wrench_std(turn @ R) == pytest.approx(as_it_is.wrench_std(R), rel=1e-3)


@pytest.mark.slow
def test_noise_free_readings_return_the_tool() -> None:
    rig, R, rng = example(17)
    for truth in (_tilted(rig, 0.0, 0.0, rng), _tilted(rig, 45.0, 60.0, rng)):
        calibration = cw.calibrate(noise_free(truth, R))
        assert np.abs(_off(calibration, truth)).max() < 1e-4


def test_other_rungs_are_those_that_are_asked_for_alone() -> None:
    rig, R, rng = example(18)
    samples = noisy(_tilted(replace(rig, weight=8.0), 0.0, 0.0, rng), R, rng)
    calibration = cw.calibrate(samples)
    assert len(calibration.fitted_poses) == len(samples)
    assert [rung.model for rung in calibration.alternatives] == ["yaw", "mount", "mount+base", "affine"]
    for rung in calibration.alternatives:
        alone = cw.calibrate(samples, rung.model)
        std = alone.std["weight"]
        assert rung.weight == (None if alone.weight is None else pytest.approx(alone.weight, abs=0.1 * std))
        assert rung.weight_std == (None if alone.weight is None else pytest.approx(std, rel=0.1))
        off = np.abs(rung.B - alone.B).ravel() / np.sqrt(np.diag(alone.B_covariance) + 1e-30)
        assert off[np.diag(alone.B_covariance) > 1e-20].max() < 0.1


def test_rungs_that_the_poses_cannot_tell_are_left_out() -> None:
    rig, R, rng = example(19, poses=3)
    calibration = cw.calibrate(noisy(_tilted(replace(rig, weight=20.0), 0.0, 0.0, rng), R, rng), noise=NOISE)
    assert "mount+base" not in [rung.model for rung in calibration.alternatives]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 104))
def test_three_poses_never_state_a_noise_of_nothing(seed: int) -> None:
    """With every tilt free three poses can fit all forces exactly: refused, or an honest std."""
    rig, R, rng = example(seed, poses=3)
    rig = _tilted(replace(rig, weight=20.0), 0.0, 0.0, rng)
    try:
        calibration = cw.calibrate(noisy(rig, R, rng))
    except UnobservableError:
        return
    assert calibration.std["weight"] > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torques_that_any_tool_fits_leave_no_noise_and_are_refused(sign: float) -> None:
    """Of three poses they may be fitted exactly: what is left of them is rounding."""
    rig, R, rng = example(1, poses=3)
    with pytest.raises(UnobservableError, match="expected 4 or more"):
        cw.calibrate(cw.Samples(sign * noisy(rig, R, rng).wrench, R), "mount+base")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_three_poses_at_any_mounting_are_refused_or_right_and_their_sign_is_not_confirmed(seed: int) -> None:
    """A base that is likely level leaves `auto` a noise, yet three directions of gravity lie in one plane."""
    rig, R, rng = example(seed, poses=3)
    try:
        calibration = cw.calibrate(noisy(rig, R, rng))
    except UnobservableError:
        return
    assert float(np.sqrt(np.mean(np.sum(_off(calibration, rig) ** 2, axis=1)))) < 3.0 * calibration.expected_error[0]
    kinds = [finding.kind for finding in calibration.findings]
    assert calibration.verdict == "weak" or Kind.SIGN_NOT_CONFIRMED in kinds


@pytest.mark.slow
def test_two_perfect_poses_are_refused_and_nothing_worse() -> None:
    for seed in range(2):
        rig, R, _ = example(seed, poses=2)
        with pytest.raises(cw.ContactWrenchError):
            cw.calibrate(noise_free(rig, R), noise=NOISE)


def test_only_auto_has_assumptions_and_alternatives() -> None:
    rig, R, rng = example(20)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    assert (calibration.assumptions, calibration.alternatives) == ((), ())


def test_assumptions_and_alternatives_are_saved(tmp_path: object) -> None:
    rig, R, rng = example(21)
    calibration = cw.calibrate(noisy(rig, R, rng))
    path = f"{tmp_path}/tool.json"
    calibration.save(path)
    loaded = cw.Calibration.load(path)
    assert loaded.assumptions == calibration.assumptions
    assert [rung.model for rung in loaded.alternatives] == [rung.model for rung in calibration.alternatives]
    assert pytest.approx(calibration.alternatives[0].B, abs=0.0) == loaded.alternatives[0].B
    assert np.array_equal(loaded.parameter_dof, calibration.parameter_dof)  # type: ignore[arg-type]


def test_the_reaction_is_refused_with_both_readings() -> None:
    rig, R, rng = example(0)
    samples = noisy(rig, R, rng)
    with pytest.raises(AmbiguityError, match=r"--sign reaction.*--gravity 0,0,1"):
        cw.calibrate(cw.Samples(-samples.wrench, R))


@pytest.mark.slow
def test_poses_about_one_axis_are_refused() -> None:
    rig, _, rng = example(22)
    R = np.array([Rotation.from_euler("z", turn).as_matrix() for turn in np.linspace(0.0, 3.0, 8)])
    with pytest.raises(UnobservableError, match="cannot separate"):
        cw.calibrate(noisy(rig, R, rng))


@pytest.mark.parametrize("name", ["mount_tilt_sd", "base_tilt_sd"])
def test_a_tilt_that_is_no_std_is_refused(name: str) -> None:
    rig, R, rng = example(23)
    with pytest.raises(InputError, match=f"^{name} is 0, expected 1e-06 to 3.14159 rad$"):
        cw.calibrate(noisy(rig, R, rng), **{name: 0.0})  # type: ignore[arg-type]
