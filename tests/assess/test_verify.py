"""Verification: seldom a false alarm, a changed tool found, loads weighed with an honest standard deviation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.verify import Weighing, verify
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.errors import InputError
from tests.support.rigs import NOISE, example, noisy, samples_of_a_design
from tests.support.world import DOWN, Array, Rig, noisy_readings, random_rotations, readings


def _loaded(rig: Rig, R: Array, mass: float, g: float = 9.80665) -> Array:
    """Readings (n, 6) with a load hung under the tool: its force points down in the world, its arm is the hook's."""
    R_base_sensor = R @ rig.R_flange_sensor
    force = R_base_sensor.transpose(0, 2, 1) @ (mass * g * rig.down)
    torque = np.cross(np.array([0.0, 0.01, 0.15]), force)
    loaded: Array = readings(rig, R) + np.hstack([force, torque])
    return loaded


@pytest.mark.slow
@pytest.mark.parametrize("given_noise", [True, False])
def test_false_alarms_are_about_one_percent(given_noise: bool) -> None:
    """An alarm every hundredth time: what no alarm at all would be is seen in the test of changed tools."""
    rig, R, rng = example(1, poses=6)
    runs, alarms = 160, 0
    for samples in samples_of_a_design(rig, R, runs, rng):
        calibration = cw.calibrate(samples, "mount", noise=NOISE if given_noise else None)
        alarms += not verify(calibration, noisy(rig, random_rotations(10, rng), rng)).passed
    assert alarms / runs <= 0.033  # 1 % and three standard deviations


@pytest.mark.parametrize(
    "change",
    [
        {"weight": 0.3},
        {"com": np.array([0.0, 0.004, 0.0])},
        {"bias": np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])},
        {"bias": np.array([0.0, 0.0, 0.0, 0.0, 0.01, 0.0])},
    ],
    ids=["weight", "com", "force drift", "torque drift"],
)
def test_a_changed_tool_or_a_drifted_sensor_is_found(change: dict[str, Array | float]) -> None:
    rig, R, rng = example(2)
    rig = replace(rig, weight=10.0)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    changed = replace(rig, **{name: getattr(rig, name) + value for name, value in change.items()})
    result = verify(calibration, noisy(changed, random_rotations(10, rng), rng))
    assert not result.passed
    assert result.probability is not None
    assert result.probability < 0.01
    assert "more than the calibration's covariance and noise explain" in result.reason


def test_a_new_zero_of_a_calibration_whose_robot_errs_passes() -> None:
    """Its noise is of the earlier poses, not of the two that gave the zero: taken for those, half of all failed."""
    passed = 0
    for seed in range(6):
        rig, R, rng = example(seed, poses=24)
        rig, noise = replace(rig, weight=20.0), np.repeat([0.06, 0.0018], 3)

        def held(at: Array, rig: Rig = rig, noise: Array = noise, rng: np.random.Generator = rng) -> cw.Samples:
            off = Rotation.from_rotvec(np.deg2rad(0.3) * rng.normal(size=(len(at), 3))).as_matrix()
            return cw.Samples(noisy_readings(rig, at @ off, noise, rng), at)

        calibration = cw.calibrate(held(R[:2]), prior=cw.calibrate(held(R), "mount"))
        assert calibration.orientation_std is not None
        passed += verify(calibration, held(random_rotations(20, rng))).passed
    assert passed >= 5


def test_a_mounting_that_slipped_shows_beside_a_robot_that_errs() -> None:
    """By 1.4 deg, of a robot that is off by 0.5 deg an axis, whose errors are in the noise; without it all pass."""
    passed, reasons = 0, []
    for seed in range(6):
        rig, R, rng = example(seed)
        rig = replace(rig, weight=20.0)

        def held(rig: Rig, at: Array, rng: np.random.Generator = rng) -> cw.Samples:
            off = Rotation.from_rotvec(np.deg2rad(0.5) * rng.normal(size=(len(at), 3))).as_matrix()
            return cw.Samples(noisy_readings(rig, at @ off, NOISE, rng), at)

        calibration = cw.calibrate(held(rig, R), "mount")
        passed += verify(calibration, held(rig, random_rotations(20, rng))).passed
        slip = Rotation.from_euler("z", 1.4, degrees=True).as_matrix()
        slipped = replace(rig, R_flange_sensor=rig.R_flange_sensor @ slip)
        reasons.append(verify(calibration, held(slipped, random_rotations(20, rng))).reason)
    assert passed == 6
    assert all("more than the calibration's covariance" in reason for reason in reasons)
    hidden = "the part of the residual that another tool, mounting or bias makes is more than"
    assert any(reason.startswith(hidden) for reason in reasons)


def _drifting(rig: Rig, R: Array, rng: np.random.Generator, drift: Array) -> cw.Calibration:
    """A calibration that says, and whose poses show, that the bias drifted by `drift` (6,) up to the last of them."""
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    share = np.linspace(-1.0, 0.0, len(R))
    poses = tuple(
        replace(pose, wrench=pose.wrench + k * drift) for k, pose in zip(share, calibration.poses, strict=True)
    )
    said = Finding(Kind.BIAS_DRIFTED, Severity.WARNING, "the bias drifted")
    return replace(calibration, poses=poses, findings=(said,))


DRIFT = np.array([0.3, -0.2, 0.4, 0.01, 0.0, -0.02])


@pytest.mark.parametrize(
    ("further", "weight", "said", "passed", "remedy"),
    [
        (0.8, 0.0, True, True, "one pose gives the new zero: contactwrench calibrate FILE --prior CAL.json"),
        (3.0, 0.0, True, False, "one pose gives the new zero: contactwrench calibrate FILE --prior CAL.json"),
        (0.8, 0.0, False, False, "one pose gives the new zero: contactwrench calibrate FILE --prior CAL.json"),
        (0.8, 0.5, True, False, "more than the bias changed: calibrate anew"),
        (0.0, 0.0, True, True, None),
    ],
    ids=["as calibrating saw", "much further", "nobody saw it", "another tool as well", "not at all"],
)
def test_a_bias_that_goes_on_moving_breaks_no_calibration(
    further: float, weight: float, said: bool, passed: bool, remedy: str | None
) -> None:
    rig, R, rng = example(21)
    calibration = _drifting(rig, R, rng, DRIFT)
    if not said:
        calibration = replace(calibration, findings=())
    now = replace(rig, weight=rig.weight + weight, bias=rig.bias + further * DRIFT)
    result = verify(calibration, noisy(now, random_rotations(10, rng), rng))
    assert result.passed == passed
    if remedy is None:
        assert result.findings == ()
        return
    (finding,) = result.findings
    assert (finding.kind, finding.severity) == (Kind.BIAS_SHIFTED, Severity.WARNING)
    assert finding.text.startswith("the bias moved by " if weight == 0.0 else "a bias that moved by ")
    assert finding.text.endswith(f"; {remedy}")
    assert (
        result.reason.startswith("the residual less a bias that moves, as seen while calibrating, is no more") == passed
    )
    if weight == 0.0:
        assert result.bias is not None
        assert np.abs((result.bias.shift - further * DRIFT) / result.bias.std).max() < 4.0


@pytest.mark.parametrize("model", ["paper", "yaw", "mount", "mount+base"])
def test_a_mounting_that_slipped_is_none_of_noise_and_no_lack_of_tilt(model: str) -> None:
    """With a new zero; models that hold the mounting cannot tell what it is, and say no more than they know."""
    for seed in range(4):
        rig, R, rng = example(40 + seed, 16)
        rig = replace(rig, R_flange_sensor=Rotation.from_euler("z", rng.uniform(0.0, 6.0)).as_matrix(), down=DOWN)
        calibration = cw.calibrate(noisy(rig, R, rng), model)
        slip = Rotation.from_rotvec([0.05, 0.03, 0.06]).as_matrix()
        slipped = replace(rig, R_flange_sensor=rig.R_flange_sensor @ slip, bias=rig.bias + 5.0 * NOISE)
        (text,) = (f.text for f in verify(calibration, noisy(slipped, random_rotations(20, rng), rng)).findings)
        assert text.endswith("more than the bias changed: calibrate anew")


@pytest.mark.parametrize("degrees", [10.0, 20.0, 60.0])
def test_a_mounting_that_turned_far_is_no_scatter_of_the_poses(degrees: float) -> None:
    rig, R, rng = example(24)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    turned = replace(rig, R_flange_sensor=rig.R_flange_sensor @ Rotation.from_euler("z", degrees, True).as_matrix())
    for unseen in (random_rotations(8, rng), random_rotations(20, rng)):
        result = verify(calibration, noisy(turned, unseen, rng))
        assert not result.passed
        assert all(f.text.endswith("more than the bias changed: calibrate anew") for f in result.findings)


def test_an_axis_that_reads_less_since_an_overload_is_no_contact_in_several_poses() -> None:
    """3 % less of fy: it is neither poses that are off, nor a scatter that no sensor explains."""
    said = []
    for seed in range(8):
        rig, R, rng = example(60 + seed)
        rig = replace(rig, weight=40.0)
        calibration, unseen = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(12, rng)
        samples = noisy(rig, unseen, rng)
        samples = replace(samples, wrench=samples.wrench * [1.0, 0.97, 1.0, 1.0, 1.0, 1.0])
        result = verify(calibration, samples)
        assert not result.passed
        said += [finding.text for finding in result.findings]
    assert not any(" and pose " in text and "take them anew" in text for text in said)
    assert not any("poses differ" in text for text in said)
    assert sum(text.endswith("more than the bias changed: calibrate anew") for text in said) >= 4


def test_a_channel_that_is_dead_since_is_named_and_no_bias_that_changed_between_poses() -> None:
    rig, R, rng = example(2)
    calibration = cw.calibrate(noisy(replace(rig, weight=10.0), R, rng), "mount")
    again = noisy(replace(rig, weight=10.0), random_rotations(10, rng), rng)
    dead = replace(again, wrench=np.where(np.arange(6) == 1, 0.75, again.wrench))
    result = verify(calibration, dead)
    assert not result.passed
    text = (
        "doubtful: fy = 0.75 in all 10 rows, though these tilt the tool: a dead channel, or one that was not recorded?"
    )
    assert [(each.kind, each.text) for each in result.findings] == [(Kind.DEAD_CHANNEL, text)]
    assert Kind.DEAD_CHANNEL not in {each.kind for each in verify(calibration, again).findings}


def test_rows_that_are_means_are_held_to_what_poses_differ_by() -> None:
    """A stream calibrated, with samples of 10 times the noise: a zero 8 std of a pose off is none of a sample's noise.
    Rows that are samples stay so, and no change is a change.
    """
    rig, R, rng = example(25, poses=10)
    rows = 100
    wrench = np.repeat(readings(rig, R), rows, axis=0) + 10.0 * NOISE * rng.normal(size=(10 * rows, 6))
    calibration = cw.calibrate(cw.Samples(wrench, np.repeat(R, rows, axis=0)), "mount")
    moved = replace(rig, bias=rig.bias + 8.0 * NOISE)
    note = (
        "times as much as samples do: they are taken as means of many, and held to what the poses of the calibration "
        "differed by"
    )
    for of_samples in (False, True):
        kinds = []
        for _ in range(10):
            unseen = random_rotations(10, rng)
            same, off = (noisy(world, unseen, rng, (10.0 if of_samples else 1.0) * NOISE) for world in (rig, moved))
            results = verify(calibration, same), verify(calibration, off)
            assert results[0].passed
            assert of_samples or not results[1].passed
            findings = [finding for each in results for finding in each.findings]
            kinds += [finding.kind for finding in findings]
            assert all(finding.text.endswith(note) for finding in findings if finding.kind is Kind.ROWS_OF_MEANS)
        assert kinds.count(Kind.ROWS_OF_MEANS) == (0 if of_samples else 20)


@pytest.mark.parametrize("noisier", [3.0, None])
def test_poses_that_no_tool_explains_are_not_said_to_have_another(noisier: float | None) -> None:
    """Three times as noisy, or with orientations that are read the wrong way round."""
    rig, R, rng = example(23)
    calibration, unseen = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(10, rng)
    wrench = noisy(rig, unseen, rng, (noisier or 1.0) * NOISE).wrench
    samples = cw.Samples(wrench, unseen if noisier else unseen.transpose(0, 2, 1))
    (text,) = (finding.text for finding in verify(calibration, samples).findings)
    assert text.startswith("a bias that moved by ")
    times = text.partition("; no tool, mounting and sensor explain that, poses differ ")[2].partition(" ")[0]
    assert text.endswith(
        f"{times} times as much as when calibrating: look for contact, motion, a base that moved, or a file that is "
        "read otherwise (sign, units, orientation: contactwrench diagnose)"
    )
    assert float(times) == pytest.approx(3.0, rel=0.3) if noisier else float(times) > 20.0


def test_the_parts_of_chi_square_are_those_of_the_textbook() -> None:
    """The bias' part is what a fit of six more numbers takes off, with the full covariance built and inverted."""
    rig, R, rng = example(22)
    calibration, unseen = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(7, rng)
    samples = noisy(replace(rig, bias=rig.bias + DRIFT), unseen, rng)
    J = calibration.error_jacobian(unseen).reshape(42, -1)
    weight = np.linalg.inv(np.diag(np.tile(calibration.noise**2, 7)) + J @ calibration.error_covariance @ J.T)
    e, A = (samples.wrench - calibration.predict(unseen)).ravel(), np.tile(np.eye(6), (7, 1))
    shift = np.linalg.solve(A.T @ weight @ A, A.T @ weight @ e)
    left = e - A @ shift
    bias = verify(calibration, samples).bias
    assert bias is not None
    assert bias.shift == pytest.approx(shift)
    assert bias.std == pytest.approx(np.sqrt(np.diag(np.linalg.inv(A.T @ weight @ A))))
    assert bias.rest_chi2 == pytest.approx(left @ weight @ left)
    assert bias.chi2 + bias.rest_chi2 == pytest.approx(e @ weight @ e)
    assert "the rest has a probability of" in verify(calibration, samples).warnings[0]


def test_poses_alike_do_not_tell_a_bias_from_another_tool() -> None:
    rig, R, rng = example(23)
    drift = DRIFT * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]  # a torque about gravity would tell
    calibration = _drifting(rig, R, rng, drift)
    alike = np.repeat(random_rotations(1, rng), 2, axis=0)
    alike[1] = alike[1] @ Rotation.from_rotvec([0.05, 0.0, 0.0]).as_matrix()
    result = verify(calibration, noisy(replace(rig, bias=rig.bias + drift), alike, rng))
    assert not result.passed
    assert result.warnings[0].endswith("; another tool or mounting would do as well: tilt the tool further")
    once = verify(calibration, noisy(replace(rig, bias=rig.bias + drift), alike[:1], rng))
    assert (once.passed, once.bias, once.findings) == (False, None, ())


def test_a_bias_that_stayed_is_seldom_said_to_have_moved() -> None:
    rig, R, rng = example(24)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE)
    said = [bool(verify(calibration, noisy(rig, random_rotations(6, rng), rng)).findings) for _ in range(50)]
    assert np.mean(said) <= 0.038  # 1 % and two standard deviations


def test_what_is_reported_of_the_residuals() -> None:
    rig, R, rng = example(3)
    calibration, unseen = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(9, rng)
    samples = noisy(rig, unseen, rng)
    result = verify(calibration, samples)
    left = samples.wrench - calibration.predict(unseen)
    assert result.residuals == pytest.approx(left)
    assert result.rms == pytest.approx(np.sqrt(np.mean(left**2, axis=0)))
    assert result.largest_force == pytest.approx(np.linalg.norm(left[:, :3], axis=1).max())
    assert result.largest_torque == pytest.approx(np.linalg.norm(left[:, 3:], axis=1).max())
    assert result.passed
    assert result.chi2 == pytest.approx(1.0, abs=0.6)
    assert result.weighings == ()


def test_chi_square_is_the_textbook_one() -> None:
    """Against the full covariance of all residuals, built and inverted."""
    rig, R, rng = example(4)
    calibration, unseen = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(7, rng)
    samples = noisy(rig, unseen, rng)
    J = calibration.free_wrench_jacobian(unseen).reshape(42, -1)
    C = np.diag(np.tile(calibration.noise**2, 7)) + J @ calibration.covariance @ J.T
    e = (samples.wrench - calibration.predict(unseen)).ravel()
    assert verify(calibration, samples).chi2 == pytest.approx(e @ np.linalg.solve(C, e) / 42)


def test_limits() -> None:
    rig, R, rng = example(5)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    samples = noisy(rig, R, rng)
    result = verify(calibration, samples)
    over, under = 1.01, 0.99
    assert verify(calibration, samples, limit_force=over * result.largest_force).passed
    assert verify(calibration, samples, limit_torque=over * result.largest_torque).passed
    failed = verify(calibration, samples, limit_force=under * result.largest_force, limit_torque=1.0)
    assert not failed.passed
    assert "force" in failed.reason
    assert "torque" not in failed.reason
    failed = verify(calibration, samples, limit_force=1.0, limit_torque=under * result.largest_torque)
    assert "largest torque" in failed.reason


def test_limits_judge_instead_of_the_statistics() -> None:
    rig, R, rng = example(6)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    heavier = noisy(replace(rig, weight=rig.weight + 0.5), R, rng)
    assert not verify(calibration, heavier).passed
    assert verify(calibration, heavier, limit_force=2.0, limit_torque=1.0).passed


def test_repeated_rows_count_as_one_pose() -> None:
    """A hundred rows at each of few orientations, with errors that the rows share, raise no alarm."""
    rig, R, rng = example(7)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    alarms = 0
    for _ in range(40):
        unseen = random_rotations(5, rng)
        shared = np.repeat(noisy_readings(rig, unseen, NOISE, rng), 50, axis=0)
        rows = cw.Samples(shared + 0.1 * NOISE * rng.normal(size=shared.shape), np.repeat(unseen, 50, axis=0))
        alarms += not verify(calibration, rows).passed
    assert alarms <= 2


def test_single_readings_that_jump_are_left_out_as_in_a_calibration() -> None:
    rig, R, rng = example(7)
    calibration, seen = cw.calibrate(noisy(rig, R, rng), "mount"), np.repeat(random_rotations(4, rng), 200, axis=0)
    wrench = noisy_readings(rig, seen, NOISE, rng)
    clean = cw.Samples(wrench, seen, 0.01 * np.arange(800.0))
    wrench[50::100, 2] += 300.0
    found = verify(calibration, cw.Samples(wrench, seen, 0.01 * np.arange(800.0)))
    assert [finding.kind for finding in found.findings] == [Kind.SPIKES]
    assert found.passed
    assert not verify(calibration, clean).findings


@pytest.mark.slow
def test_loads_are_weighed_with_an_honest_std() -> None:
    rig, R, rng = example(8, poses=8)
    masses = np.array([0.1, 0.2, 0.5, 1.0])
    z = []
    for _ in range(25):
        calibration = cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE)
        poses, load = random_rotations(4, rng), masses
        wrench = np.vstack([_loaded(rig, poses[k : k + 1], m) for k, m in enumerate(masses)])
        wrench += NOISE * rng.normal(size=wrench.shape)
        result = verify(calibration, cw.Samples(wrench, poses, load_mass=load))
        assert [w.actual for w in result.weighings] == pytest.approx(masses)
        z.append([(w.weighed - w.actual) / w.std for w in result.weighings])
    assert np.mean(np.square(z)) == pytest.approx(1.0, abs=0.35)  # two and a half std of 100 squares


def test_the_mean_of_sixteen_weighings_is_four_times_as_sure_as_one_reading() -> None:
    """Where the calibration is far surer than a reading: sigma / (g sqrt(n))."""
    rig, R, rng = example(14, poses=200)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE)
    held = random_rotations(16, rng)
    wrench = _loaded(rig, held, 0.5) + NOISE * rng.normal(size=(16, 6))
    (weighing,) = verify(calibration, cw.Samples(wrench, held, load_mass=np.full(16, 0.5))).weighings
    assert weighing.n == 16
    assert weighing.std == pytest.approx(NOISE[0] / (4.0 * 9.80665), rel=0.3)


def test_weighing_at_a_gravity_of_ones_own_and_several_poses() -> None:
    rig, R, rng = example(9)
    calibration, poses = cw.calibrate(noisy(rig, R, rng), "mount", g=9.7803), random_rotations(6, rng)
    wrench = _loaded(rig, poses, 0.5, g=9.7803) + NOISE * rng.normal(size=(6, 6))
    samples = cw.Samples(wrench, poses, load_mass=np.full(6, 0.5))
    (weighing,) = verify(calibration, samples).weighings
    assert weighing.n == 6
    assert abs(weighing.weighed - 0.5) < 4 * weighing.std
    assert weighing.std < 0.006
    (elsewhere,) = verify(calibration, samples, g=2.0 * 9.7803).weighings
    assert elsewhere.weighed == pytest.approx(0.5 * weighing.weighed)


def test_free_and_loaded_poses_in_one_recording() -> None:
    """The free poses are judged, the loaded ones weighed."""
    rig, R, rng = example(10)
    calibration, poses = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(8, rng)
    load = np.repeat([0.0, 0.3], 4)
    wrench = np.vstack([readings(rig, poses[:4]), _loaded(rig, poses[4:], 0.3)]) + NOISE * rng.normal(size=(8, 6))
    result = verify(calibration, cw.Samples(wrench, poses, load_mass=load))
    assert result.residuals.shape == (4, 6)
    assert result.passed
    assert [w.n for w in result.weighings] == [4]


def test_loads_alone_are_held_against_their_masses() -> None:
    rig, R, rng = example(11)
    calibration, poses = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(5, rng)
    wrench = _loaded(rig, poses, 0.5) + NOISE * rng.normal(size=(5, 6))
    assert verify(calibration, cw.Samples(wrench, poses, load_mass=np.full(5, 0.5))).passed
    wrong = verify(calibration, cw.Samples(wrench, poses, load_mass=np.full(5, 0.55)))
    assert not wrong.passed
    assert "error of the weighings" in wrong.reason


def test_the_error_column_of_the_papers_table_9() -> None:
    for measured, actual, error in [(94.3, 100, 5.70), (191.5, 200, 4.25), (480.8, 500, 3.84), (971.1, 1000, 2.89)]:
        weighing = Weighing(actual=actual / 1e3, weighed=measured / 1e3, std=0.001, n=1)
        assert -100.0 * weighing.error == pytest.approx(error, abs=0.005)
        assert weighing.error_std == pytest.approx(1.0 / actual)


def test_nothing_to_judge_by() -> None:
    rig, R, rng = example(12)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    with pytest.raises(InputError, match="found no samples, expected contact-free poses"):
        verify(calibration, cw.Samples(np.empty((0, 6)), np.empty((0, 3, 3))))
    loaded = cw.Samples(_loaded(rig, R, 0.5), R, load_mass=np.full(24, 0.5))
    with pytest.raises(InputError, match="found poses with a load only, expected free ones to hold to a limit"):
        verify(calibration, loaded, limit_force=1.0)


def test_a_load_that_is_not_what_its_label_says_fails_beside_good_free_poses() -> None:
    rig, R, rng = example(12, poses=12)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    at = random_rotations(12, rng)
    R_base_sensor = at @ rig.R_flange_sensor
    hung = 1.0 * 9.80665 * (R_base_sensor.transpose(0, 2, 1) @ rig.down)
    wrench = noisy(rig, at, rng).wrench.copy()
    wrench[6:, :3] += hung[6:]
    label = np.repeat([0.0, 1.0], 6)
    assert verify(calibration, cw.Samples(wrench, at, load_mass=label)).passed
    wrong = verify(calibration, cw.Samples(wrench, at, load_mass=0.5 * label))
    assert not wrong.passed
    assert wrong.reason.startswith("the error of the weighings is more than")


def test_one_row_a_pose_is_not_held_to_the_noise_of_an_average() -> None:
    """Calibrated on averages of 100 rows that scatter by ten times the noise between poses."""
    rig, R, rng = example(13, poses=10)
    many = np.repeat(R, 100, axis=0)
    scatter = np.array([0.5, 0.5, 0.5, 0.02, 0.02, 0.02])
    calibration = cw.calibrate(noisy(rig, many, rng, scatter), "mount")
    passed = [verify(calibration, noisy(rig, random_rotations(8, rng), rng, scatter)).passed for _ in range(40)]
    assert np.mean(passed) > 0.9
