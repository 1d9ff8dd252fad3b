"""Which parameters the poses separate: what is refused, in which words, and what is only weak."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import UnobservableError
from tests.support.rigs import NOISE, example, noise_free, noisy
from tests.support.world import DOWN, Array, noisy_readings, random_rotations, tilted_down

ALL_MODELS = ("paper", "yaw", "mount", "mount+base", "affine")
RIGID = ("yaw", "mount", "mount+base")


def _about(axis: Array, angles: Array) -> Array:
    matrices: Array = Rotation.from_rotvec(np.outer(angles, axis / np.linalg.norm(axis))).as_matrix()
    return matrices


def _refusal(model: str, R: Array, seed: int = 1) -> str:
    rig, _, rng = example(seed)
    with pytest.raises(UnobservableError) as refused:
        cw.calibrate(noisy(rig, R, rng), model)
    message = str(refused.value)
    assert "\n" not in message
    return message


def _upright(seed: int) -> Array:
    """A flange some way from the identity."""
    upright: Array = random_rotations(1, np.random.default_rng(seed))[0]
    return upright


@pytest.mark.parametrize("model", ALL_MODELS)
@pytest.mark.parametrize("rows", [1, 50])
def test_all_poses_equal(model: str, rows: int) -> None:
    message = _refusal(model, np.repeat(_upright(1)[None], rows, axis=0))
    assert message.startswith(("arrays: cannot separate", "arrays: 1 poses give"))
    if model == "paper":
        assert "expected 3 or more" in message
    elif message.startswith("arrays: cannot"):
        assert message.endswith(
            ": all poses at rest have one orientation; record 6 or more that tilt the tool, or take --prior"
        )


@pytest.mark.parametrize("model", RIGID)
def test_all_poses_equal_names_what_one_reading_cannot_split(model: str) -> None:
    message = _refusal(model, np.repeat(_upright(2)[None], 20, axis=0))
    for name in ("weight", "com_x", "com_y", "com_z", "bias_fx", "bias_fy", "bias_fz", "bias_tx", "bias_ty", "bias_tz"):
        assert name in message.split("(rank")[0]


def test_equal_orientations_with_readings_that_scatter_along_a_line_are_refused_too() -> None:
    """A logger that repeats one orientation while the tool turns: readings differ, but only by gravity."""
    rig, R, _ = example(3, poses=12)
    stuck = np.repeat(R[:1], 12, axis=0)
    with pytest.raises(UnobservableError, match="all poses at rest have one orientation"):
        cw.calibrate(cw.Samples(noise_free(rig, R).wrench, stuck), "mount")


@pytest.mark.parametrize("model", ALL_MODELS)
def test_turns_about_the_vertical_only(model: str) -> None:
    poses = _about(DOWN, np.linspace(0.0, 5.0, 12)) @ _upright(3)
    if model == "mount+base":  # whose vertical is not known
        assert "turn about a single axis; turn the tool about a second one" in _refusal(model, poses)
    else:
        assert "differ by turns about the vertical only; tilt the tool between poses" in _refusal(model, poses)


@pytest.mark.parametrize("model", [m for m in ALL_MODELS if m != "paper"])
def test_two_poses(model: str) -> None:
    message = _refusal(model, random_rotations(2, np.random.default_rng(4)))
    assert "2 poses give" in message or (
        "there are two distinct poses; record at least 6 that tilt the tool about two axes" in message
    )


@pytest.mark.parametrize("model", RIGID)
def test_two_orientations_with_many_rows(model: str) -> None:
    message = _refusal(model, np.repeat(random_rotations(2, np.random.default_rng(5)), 40, axis=0))
    assert "there are two distinct poses; record at least 6 that tilt the tool about two axes" in message
    assert "(rank " in message


@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
def test_one_axis_cannot_give_the_direction_of_gravity(tilt: float) -> None:
    """Turns about a single fixed axis: gravity along that axis is a bias, at any tilt."""
    axis = Rotation.from_euler("x", tilt, degrees=True).as_matrix() @ np.array([1.0, 0.0, 0.0])
    poses = _about(axis, np.linspace(0.0, 5.5, 16)) @ _upright(6)
    assert "turn about a single axis; turn the tool about a second one" in _refusal("mount+base", poses)


def test_turns_about_a_slanted_axis_separate_the_mounting_but_not_the_base() -> None:
    rig, _, rng = example(7)
    poses = _about(np.array([1.0, 0.3, 0.6]), np.linspace(0.0, 5.5, 16)) @ _upright(7)
    with pytest.raises(UnobservableError, match="gravity_"):
        cw.calibrate(noisy(rig, poses, rng), "mount+base")


@pytest.mark.slow
@pytest.mark.parametrize("model", RIGID)
def test_poses_that_hardly_tilt_are_refused_with_their_tilt(model: str) -> None:
    rng = np.random.default_rng(9)
    wobble = Rotation.from_rotvec(np.deg2rad(0.1) * rng.normal(size=(12, 3))).as_matrix()
    spin = _about(DOWN, rng.uniform(0.0, 6.0, 12))
    message = _refusal(model, spin @ wobble @ np.diag([1.0, -1.0, -1.0]))
    assert "deg from the flange's z in all 12 poses; add poses that tilt the tool further" in message or (
        "turns about the vertical only" in message
    )


def test_rank_condition_and_tilt_of_a_good_set() -> None:
    rig, R, rng = example(10)
    for model in RIGID:
        seen = cw.calibrate(noisy(replace(rig, R_flange_sensor=np.eye(3)), R, rng), model).observability
        assert seen.rank == len(seen.singular_values)
        assert seen.condition == pytest.approx(seen.singular_values[0] / seen.singular_values[-1])
        assert np.all(np.diff(seen.singular_values) <= 0.0)
        assert seen.condition < 10.0
        angle = np.arccos(np.clip(-R[:, 2, 2], -1.0, 1.0))
        assert seen.tilt_range == pytest.approx([angle.min(), angle.max()], abs=0.1)


def _tilted_by_at_most(degrees: float, n: int, rng: np.random.Generator) -> Array:
    tilt = _about_sides(np.deg2rad(degrees) * np.sqrt(rng.uniform(size=n)), rng)
    spin = _about(DOWN, rng.uniform(0.0, 6.0, n))
    poses: Array = spin @ tilt @ np.diag([1.0, -1.0, -1.0])
    return poses


def _about_sides(angles: Array, rng: np.random.Generator) -> Array:
    side = rng.uniform(0.0, 2.0 * np.pi, len(angles))
    vectors = np.stack([np.cos(side), np.sin(side), np.zeros_like(side)], axis=1) * angles[:, None]
    matrices: Array = Rotation.from_rotvec(vectors).as_matrix()
    return matrices


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("tilt", [8.0, 25.0, 90.0])
def test_warnings_are_there_when_a_parameter_is_weak_and_only_then(seed: int, tilt: float) -> None:
    rng = np.random.default_rng(seed)
    rig = replace(example(seed)[0], weight=8.0, R_flange_sensor=Rotation.from_euler("z", 0.6).as_matrix())
    calibration = cw.calibrate(noisy(rig, _tilted_by_at_most(tilt, 16, rng), rng, 2.0 * NOISE), "yaw", noise=NOISE)
    assert calibration.weight is not None
    std, weight = calibration.std, calibration.weight
    expected = {"weight"} if std["weight"] > 0.1 * weight else set()
    expected |= {f"com_{x}" for x, s in zip("xyz", std["com"], strict=True) if s > 0.010}
    expected |= {f"bias_f{x}" for x, s in zip("xyz", std["bias"], strict=False) if s > 0.1 * weight}
    weak = [warning.removeprefix("weak: ").split()[0] for warning in calibration.warnings if "weak: " in warning]
    assert set(weak) == expected
    assert (calibration.verdict == "weak") == bool(expected)


def test_a_tool_that_stays_near_the_vertical_has_a_weak_weight() -> None:
    rng = np.random.default_rng(1)
    rig = replace(example(1)[0], weight=4.0, R_flange_sensor=Rotation.from_euler("z", -2.0).as_matrix())
    calibration = cw.calibrate(noisy(rig, _tilted_by_at_most(10.0, 12, rng), rng, 4.0 * NOISE), "yaw", noise=NOISE)
    (of_weight,) = (text for text in calibration.warnings if text.startswith("weak: weight"))
    assert "over 10 %" in of_weight
    assert "weight and bias_fz: correlation" in of_weight
    assert any("contactwrench plan --from FILE" in text for text in calibration.warnings)
    assert any(pair.startswith("weight and bias_fz") for pair in calibration.observability.trade_offs)


@pytest.mark.parametrize("model", RIGID)
def test_nothing_is_weak_in_a_good_set(model: str) -> None:
    rig, R, rng = example(12)
    rig = replace(rig, weight=10.0, R_flange_sensor=Rotation.from_euler("z", 1.0).as_matrix())
    calibration = cw.calibrate(noisy(rig, R, rng), model)
    assert calibration.warnings == ()
    assert calibration.verdict.startswith("good")


def test_a_light_tool_has_a_weak_centre_of_mass() -> None:
    rig, R, rng = example(13)
    light, heavy = replace(rig, weight=0.5), replace(rig, weight=20.0)
    noise = np.r_[0.01, 0.01, 0.01, 0.03, 0.03, 0.03]
    weak, good = (cw.calibrate(noisy(r, R, rng, noise), "mount") for r in (light, heavy))
    for axis in "xyz":
        assert any(f"com_{axis}" in w and "mm, over 10 mm" in w for w in weak.warnings)
    assert not any("com_" in w for w in good.warnings)


def test_stated_largest_std_is_not_exceeded_anywhere() -> None:
    rng = np.random.default_rng(14)
    rig = replace(example(14)[0], down=tilted_down(0.2, rng))
    R = _tilted_by_at_most(60.0, 12, rng)
    calibration = cw.calibrate(cw.Samples(noisy_readings(rig, R, NOISE, rng), R), "mount+base")
    std = calibration.wrench_std(random_rotations(5000, rng))
    force, torque = np.linalg.norm(std[:, :3], axis=1).max(), np.linalg.norm(std[:, 3:], axis=1).max()
    assert force <= 1.01 * calibration.largest_std[0]
    assert torque <= 1.01 * calibration.largest_std[1]
    assert calibration.largest_std[0] <= 1.1 * force
