"""The result: it cannot be changed, says what it knows, and its standard deviations are those of what it predicts."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.text import verdict_sentences
from contactwrench.errors import InputError
from contactwrench.statistics import meaningful_digits, two_digits
from tests.support.recordings import PANDA
from tests.support.rigs import NOISE, example, noise_free, noisy, samples_of_a_design
from tests.support.world import DOWN, Array, Rig, cramer_rao, derivatives, random_rotations, readings, tilted_down

MODELS = ("paper", "yaw", "mount", "mount+base", "affine")


def _calibration(model: str, seed: int = 1) -> cw.Calibration:
    rig, R, rng = example(seed)
    rig = dataclasses.replace(rig, R_flange_sensor=Rotation.from_euler("z", 0.9).as_matrix())
    return cw.calibrate(noisy(rig, R, rng), model)


@pytest.mark.parametrize("model", MODELS)
def test_nothing_of_it_can_be_changed(model: str) -> None:
    calibration = _calibration(model)
    with pytest.raises(dataclasses.FrozenInstanceError):
        calibration.weight = 1.0  # type: ignore[misc]
    arrays = [getattr(calibration, field.name) for field in dataclasses.fields(calibration)]
    arrays += [calibration.observability.singular_values, *calibration.std.values()]
    for array in arrays:
        if isinstance(array, np.ndarray):
            assert array.dtype == np.float64
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0.0


def test_it_does_not_follow_the_arrays_that_it_was_made_from() -> None:
    rig, R, rng = example(2)
    wrench, orientations = noisy(rig, R, rng).wrench.copy(), R.copy()
    calibration = cw.calibrate(cw.Samples(wrench, orientations), "mount")
    before = calibration.poses[0].wrench.copy()
    wrench[:] = 0.0
    orientations[:] = 0.0
    assert np.array_equal(calibration.poses[0].wrench, before)


@pytest.mark.parametrize("model", MODELS)
def test_predictions_take_every_kind_of_orientation(model: str) -> None:
    calibration, rng = _calibration(model), np.random.default_rng(3)
    R = random_rotations(5, rng)
    rotation = Rotation.from_matrix(R)
    expected = np.column_stack([np.einsum("nji,j->ni", R, calibration.gravity_direction), np.ones(5)]) @ calibration.B.T
    for many in (R, rotation.as_quat(), rotation):
        assert calibration.predict(many) == pytest.approx(expected)
        assert calibration.wrench_std(many).shape == (5, 6)
        assert calibration.wrench_covariance(many).shape == (5, 6, 6)
    for single in (R[2], rotation.as_quat()[2], rotation[2]):
        assert calibration.predict(single) == pytest.approx(expected[2])
        assert calibration.wrench_std(single).shape == (6,)
        assert calibration.wrench_covariance(single).shape == (6, 6)


@pytest.mark.parametrize("model", ["yaw", "mount", "mount+base"])
def test_parameters_stand_in_the_order_of_the_design(model: str) -> None:
    calibration = _calibration(model)
    linear = ["weight", "com_x", "com_y", "com_z", *(f"bias_{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz"))]
    mount, gravity = ["mount_x", "mount_y", "mount_z"], ["gravity_a", "gravity_b"]
    rest = {"yaw": ["yaw"], "mount": mount, "mount+base": mount + gravity}[model]
    assert list(calibration.parameter_names) == linear + rest
    assert calibration.parameters[0] == calibration.weight
    assert calibration.parameters[1:4] == pytest.approx(calibration.com)
    assert calibration.parameters[4:10] == pytest.approx(calibration.bias)
    if model == "yaw":
        assert calibration.parameters[10] == calibration.yaw
    else:
        assert np.all(calibration.parameters[10:] == 0.0)


@pytest.mark.parametrize("model", ["yaw", "mount"])
def test_standard_deviations_are_roots_of_the_covariance(model: str) -> None:
    calibration = _calibration(model)
    std = np.sqrt(np.diag(calibration.covariance))
    assert set(calibration.std) == {"weight", "com", "bias", "yaw", "mount", "gravity", "inertia", "sensor_offset"}
    assert calibration.std["weight"] == pytest.approx(std[0])
    assert calibration.std["com"] == pytest.approx(std[1:4])
    assert calibration.std["bias"] == pytest.approx(std[4:10])
    assert calibration.std["gravity"] is None
    if model == "yaw":
        assert calibration.std["mount"] is None
        assert calibration.std["yaw"] == pytest.approx(std[10])
    else:
        assert calibration.std["mount"] == pytest.approx(std[10:])
        assert calibration.std["yaw"] == pytest.approx(std[12], rel=0.05)  # a small tilt: about z alone


@pytest.mark.parametrize("model", ["mount", "mount+base"])
def test_std_of_the_wrench_is_the_bound_carried_through_the_physics(model: str) -> None:
    """Where noise is tiny, so that the estimate is the truth: from numerical derivatives of world-frame physics. That a
    bias may have moved or a gain be off is in the mean too, and adds little.
    """
    rig, R, rng = example(4)
    rig = dataclasses.replace(rig, down=tilted_down(0.5, rng) if model == "mount+base" else DOWN)
    noise, unseen = 1e-6 * NOISE, random_rotations(30, rng)
    calibration = cw.calibrate(noisy(rig, R, rng, noise), model, noise=noise)
    J, covariance = derivatives(rig, model, unseen), cramer_rao(rig, model, R, noise)
    scale = (calibration.noise[0] / noise[0]) ** 2
    expected = scale * J @ covariance @ J.transpose(0, 2, 1)
    found = calibration.wrench_covariance(unseen)
    assert found == pytest.approx(expected, rel=0.02, abs=0.02 * float(np.abs(expected).max()))
    assert calibration.wrench_std(unseen) == pytest.approx(np.sqrt(np.einsum("nii->ni", found)))


@pytest.mark.parametrize("model", ["paper", "yaw", "mount", "affine"])
def test_covariance_of_b_gives_the_same_std_of_the_wrench(model: str) -> None:
    calibration, rng = _calibration(model), np.random.default_rng(5)
    for R in random_rotations(10, rng):
        D = np.kron(np.eye(6), np.r_[R.T @ calibration.gravity_direction, 1.0])
        of_B = calibration.B_covariance
        of_B = of_B if calibration.gain_covariance is None else of_B + calibration.gain_covariance
        covariance = calibration.wrench_covariance(R)
        unit = np.sqrt(np.diag(covariance))
        off = (D @ of_B @ D.T - covariance) / np.outer(unit, unit)
        assert np.abs(off).max() < 2e-4


@cache
def _of_a_design() -> tuple[Rig, list[cw.Calibration]]:
    rig, R, rng = example(6, poses=6)
    return rig, [cw.calibrate(samples, "mount", noise=NOISE) for samples in samples_of_a_design(rig, R, 38, rng)]


@pytest.mark.slow
def test_std_of_the_wrench_covers_the_error_of_the_prediction() -> None:
    rig, calibrations = _of_a_design()
    unseen, squared = random_rotations(20, np.random.default_rng(6)), []
    for calibration in calibrations:
        squared.append(((calibration.predict(unseen) - readings(rig, unseen)) / calibration.wrench_std(unseen)) ** 2)
    assert np.mean(squared) == pytest.approx(1.0, abs=0.2)


def test_intervals_are_students() -> None:
    rig, R, rng = example(7, poses=6)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE)
    for level in (0.5, 0.95, 0.99):
        reach = stats.t.ppf(0.5 + level / 2.0, 6 * 6 - 13)
        assert calibration.t_quantile(level, 6 * 6 - 13) == pytest.approx(reach)
        assert calibration.t_quantile(level) == pytest.approx(reach, rel=0.02)
        low, high = calibration.interval("com", level)
        assert high - low == pytest.approx(2.0 * reach * calibration.std["com"], rel=0.02)
        assert (high + low) / 2.0 == pytest.approx(calibration.com)
    low, high = calibration.interval("yaw")
    assert (low + high) / 2.0 == pytest.approx(calibration.yaw)


def test_yaw_of_a_tilted_and_of_a_flipped_sensor() -> None:
    rig, R, _ = example(8)
    tilt = Rotation.from_rotvec([0.4, -0.2, 0.0]).as_matrix()
    turn = Rotation.from_euler("z", 2.2).as_matrix()
    for flip, along in ((np.eye(3), True), (np.diag([1.0, -1.0, -1.0]), False)):
        mounted = dataclasses.replace(rig, R_flange_sensor=tilt @ flip @ turn)
        calibration = cw.calibrate(noise_free(mounted, R), "mount")
        assert calibration.yaw == pytest.approx(2.2, abs=1e-7)
        assert calibration.sensor_z_along_flange is along


@pytest.mark.slow
def test_std_of_yaw_is_that_of_monte_carlo() -> None:
    yaws, stds = [], []
    for calibration in _of_a_design()[1]:
        assert calibration.yaw is not None
        yaws.append(calibration.yaw)
        stds.append(calibration.std["yaw"])
    spread = np.std(np.unwrap(yaws))
    assert np.mean(stds) == pytest.approx(spread, rel=0.2)


@pytest.mark.parametrize("model", MODELS)
def test_printed_it_shows_every_parameter_with_its_std(model: str) -> None:
    calibration = _calibration(model)
    text = str(calibration)
    names = ["bias_fx", "bias_fy", "bias_fz", "bias_tx", "bias_ty", "bias_tz"]
    names += [] if model == "affine" else ["weight", "mass", "com_x", "com_y", "com_z", "yaw"]
    for name in names:
        line = next(line for line in text.splitlines() if line.split()[:1] == [name])
        assert "+-" in line
    assert f"model {model}" in text
    in_one_line = " ".join(text.split())
    assert f"Verdict {calibration.verdict}: " in in_one_line
    for finding in calibration.findings:
        assert f"{finding.label} {finding.text}" in in_one_line


@pytest.mark.slow
def test_printed_sentences_go_on_under_their_first_word() -> None:
    """Nothing is wider than eighty columns but a path, which is not broken."""
    text = str(cw.calibrate(cw.read(PANDA)))
    assert max(len(line) for line in text.splitlines() if str(PANDA) not in line) <= 80
    said = text[text.index("Verdict") :].splitlines()
    assert len(said) > 3
    assert all(line[:9] in ("Verdict  ", "Warning  ", "Note     ", " " * 9) and line[9] != " " for line in said)


def test_the_verdict_states_the_error_to_expect_and_the_largest_std() -> None:
    calibration = _calibration("mount")
    said = verdict_sentences(calibration)[-1]
    for force, torque in (calibration.expected_error, calibration.largest_std):
        assert f"{two_digits(force)} N and {two_digits(1e3 * torque)} mN m" in said


def _same_free_wrench(a: cw.Calibration, b: cw.Calibration, R_a: Array, R_b: Array) -> bool:
    return bool(np.abs(a.predict(R_a) - b.predict(R_b)).max() < 1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_the_same_tool_on_a_base_that_stands_otherwise(model: str) -> None:
    calibration, rng = _calibration(model), np.random.default_rng(10)
    turn, R = random_rotations(1, rng)[0], random_rotations(6, rng)
    moved = calibration.with_gravity(5.0 * turn @ calibration.gravity_direction)
    assert _same_free_wrench(calibration, moved, R, turn @ R)
    assert np.linalg.norm(moved.gravity_direction) == pytest.approx(1.0)
    assert moved.wrench_std(turn @ R).shape == (6, 6)
    if model != "mount+base":
        assert moved.wrench_std(turn @ R) == pytest.approx(calibration.wrench_std(R))
    else:
        assert moved.std["gravity"] is None
    assert calibration.with_gravity(None) is calibration


def test_provenance_says_where_it_comes_from() -> None:
    rig, R, rng = example(11)
    samples = noisy(rig, np.repeat(R, 3, axis=0), rng)
    calibration = cw.calibrate(dataclasses.replace(samples, source="tool.csv"), "mount", g=9.81)
    assert calibration.provenance["software"] == f"contactwrench {cw.__version__}"
    assert calibration.provenance["source"] == "tool.csv"
    assert calibration.provenance["rows"] == 72
    assert calibration.provenance["g"] == 9.81
    assert len(calibration.poses) == 24


def test_g_is_what_turned_the_weight_into_the_mass() -> None:
    rig, R, rng = example(5)
    samples = noisy(rig, R, rng)
    for model in ("mount", "affine"):
        assert cw.calibrate(samples, model, g=9.7803).g == 9.7803
    by_hand = dataclasses.replace(cw.calibrate(samples, "mount", g=9.7803), provenance={})
    assert by_hand.g == pytest.approx(9.7803, rel=1e-12)
    assert dataclasses.replace(cw.calibrate(samples, "affine", g=9.7803), provenance={}).g == 9.80665


@pytest.mark.parametrize("name", ["mount", "gravity", "inertia", "sensor_offset", "mass", ""])
def test_what_has_no_interval_is_said(name: str) -> None:
    with pytest.raises(InputError) as raised:
        _calibration("mount").interval(name)
    assert str(raised.value) == (
        f"model mount has no interval of {name!r}, expected one of weight, com, bias, yaw, inertia, sensor_offset"
    )


@pytest.mark.parametrize(
    ("level", "said"),
    [
        ("a", "level has text, expected numbers: convert them, as by .astype(float)"),
        (None, "level is None, expected numbers"),
        (95.0, "level is 95.0, expected between 0 and 1, as in 0.95"),
        (np.nan, "level is nan, expected between 0 and 1, as in 0.95"),
    ],
)
def test_a_level_is_a_probability(level: float, said: str) -> None:
    calibration = _calibration("mount")
    for ask in (lambda: calibration.interval("weight", level), lambda: calibration.t_quantile(level)):
        with pytest.raises(InputError) as raised:
            ask()
        assert str(raised.value) == said


def test_a_calibration_is_saved_under_a_path() -> None:
    for path, found in ((None, "None"), (3, "3"), ([], "a list")):
        with pytest.raises(InputError) as raised:
            _calibration("mount").save(path)  # type: ignore[arg-type]
        assert str(raised.value) == f"path is {found}, expected a str or a Path: name a file"


def test_every_number_of_an_affine_model_is_printed_with_its_std_and_unit() -> None:
    calibration = cw.calibrate(cw.read(PANDA), "affine")
    lines = str(calibration).splitlines()
    shown = {line.split()[0]: line for line in lines if " +- " in line}
    std = np.sqrt(np.diag(calibration.covariance))
    for name, value, spread in zip(calibration.parameter_names, calibration.parameters, std, strict=True):
        axis = name[2:4]
        unit = "N" if axis[0] == "f" else "N m"
        of_name, *of_rest = shown[f"bias_{axis}" if name.endswith("_1") else name].split()
        assert of_name in (name, f"bias_{axis}")
        assert " ".join(of_rest) == f"{' +- '.join(meaningful_digits(value, spread))} {unit}"
    assert max(map(len, lines[2:26])) <= 80
