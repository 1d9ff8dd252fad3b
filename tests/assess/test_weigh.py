"""Weighing what the tool holds: against tool and object in world-frame physics, and its std by Monte Carlo."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.assess.weigh import HeldObject, weigh
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.errors import InputError
from tests.support.recordings import MATRIX, WRENCH, csv_text, matrix_table, run, rz, written
from tests.support.rigs import NOISE, example, noise_free, noise_of_a_design, noisy, seeds
from tests.support.world import Array, Rig, random_rotations, readings, tilted_down

G = 9.80665
COM = np.array([0.02, -0.05, 0.12])


def _holding(rig: Rig, mass: float, com: Array, R: Array, g: float = G) -> Array:
    """What the sensor reads (n, 6) when the tool holds a mass: two bodies on one sensor."""
    held = Rig(mass * g, com, np.zeros(6), rig.R_flange_sensor, rig.down)
    both: Array = readings(rig, R) + readings(held, R)
    return both


def _noisy_holding(rig: Rig, mass: float, com: Array, R: Array, rng: np.random.Generator) -> cw.Samples:
    return cw.Samples(_holding(rig, mass, com, R) + NOISE * rng.normal(size=(len(R), 6)), R)


def _down_in_sensor(rig: Rig, R_base_flange: Array) -> Array:
    down: Array = (R_base_flange @ rig.R_flange_sensor).T @ rig.down
    return down


@pytest.mark.slow
@settings(deadline=None, max_examples=8)
@given(seeds, st.sampled_from([2, 3, 7]), st.sampled_from(["mount", "mount+base", "affine"]))
def test_any_object_on_any_mounting_and_any_base(seed: int, poses: int, model: str) -> None:
    rig, R, rng = example(seed, poses=14)
    if model != "affine":
        rig = replace(rig, down=tilted_down(rng.uniform(0.0, 1.2), rng))
    calibration = cw.calibrate(noise_free(rig, R), model, gravity=rig.down if model == "mount" else None)
    mass, com = float(np.exp(rng.uniform(-3.0, 3.0))), 0.2 * rng.normal(size=3)
    at = random_rotations(poses, rng)
    held = weigh(calibration, cw.Samples(_holding(rig, mass, com, at), at))
    assert held.mass == pytest.approx(mass, rel=1e-5)
    assert held.moment == pytest.approx(mass * com, abs=1e-5 * mass)
    assert held.com == pytest.approx(com, abs=1e-5)
    assert held.unknown_along is None
    assert held.poses == poses
    if model == "affine":
        assert held.com_flange is None
    else:
        assert held.com_flange == pytest.approx(rig.R_flange_sensor @ com, abs=1e-5)


@pytest.mark.slow
@settings(deadline=None, max_examples=4)
@given(seeds)
def test_one_pose_gives_the_mass_and_a_line(seed: int) -> None:
    rig, R, rng = example(seed)
    calibration = cw.calibrate(noise_free(rig, R), "mount")
    at = random_rotations(1, rng)
    turned_about_gravity = np.stack([rz(angle) @ at[0] for angle in (0.0, 0.7, 2.0)])
    for poses in (at, turned_about_gravity):
        held = weigh(calibration, cw.Samples(_holding(rig, 1.5, COM, poses), poses))
        down = _down_in_sensor(rig, at[0])
        assert held.mass == pytest.approx(1.5, rel=1e-6)
        assert held.unknown_along == pytest.approx(down, abs=1e-6)
        assert held.com == pytest.approx(COM - down * (down @ COM), abs=1e-6)
        assert held.com_std is None
        assert held.com_flange is None
        assert held.com_covariance is not None
        assert held.com_covariance @ down == pytest.approx(np.zeros(3), abs=1e-9 * np.trace(held.com_covariance))
        assert "tilt the tool to another pose for the rest" in held.warnings[0]


LONG = replace(example(3)[0], weight=6.0, com=np.array([0.15, 0.2, -0.15]))
"""A light and long tool, so that its errors count for much."""


@cache
def _calibrations_of_long() -> list[tuple[cw.Calibration, Array]]:
    """Of 8 poses, each with the noise (3, 6) of poses to weigh at: the covariance of all 11 is that of the noise."""
    _, R, rng = example(3, poses=8)
    free = readings(LONG, R)
    return [
        (cw.calibrate(cw.Samples(free + off[:8], R), "mount", noise=NOISE), off[8:])
        for off in noise_of_a_design(70, 11, rng)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("poses", [1, 2, 3])
def test_std_is_what_the_estimates_scatter_by(poses: int) -> None:
    """Calibration and weighing both repeated."""
    rig, mass, rng = LONG, 1.0, np.random.default_rng((3, poses))
    z_mass, z_com, z_flange, alarms = [], [], [], 0
    for calibration, off in _calibrations_of_long():
        at = random_rotations(poses, rng)
        held = weigh(calibration, cw.Samples(_holding(rig, mass, COM, at) + off[:poses], at))
        alarms += held.probability < 0.01
        z_mass.append((held.mass - mass) / held.mass_std)
        assert held.com is not None
        assert held.com_covariance is not None
        across = np.eye(3)
        if poses == 1:
            across = np.linalg.svd(_down_in_sensor(rig, at[0])[None])[2][1:]
        error = across @ (held.com - across.T @ across @ COM)
        z_com.append(error @ np.linalg.solve(across @ held.com_covariance @ across.T, error) / len(across))
        if held.com_flange is not None and held.com_flange_std is not None:
            z_flange.append((held.com_flange - rig.R_flange_sensor @ COM) / held.com_flange_std)
    assert np.mean(np.square(z_mass)) == pytest.approx(1.0, abs=0.3)
    assert np.mean(z_com) == pytest.approx(1.0, abs=0.3 if poses > 1 else 0.4)
    if poses > 1:
        assert np.mean(np.square(z_flange)) == pytest.approx(1.0, abs=0.3)
    assert alarms <= 3


@pytest.mark.parametrize("seen", [True, False])
def test_orientations_that_are_a_bit_off_turn_the_object_too(seen: bool) -> None:
    """Whether the tool was heavy enough to show it while calibrating, or not; an object that moved is doubted still."""
    doubted, z_mass, z_com, moved = 0, [], [], 0
    for seed in range(6):
        rig, R, rng = example(seed, poses=16)
        rig = replace(rig, weight=20.0 if seen else 2.0)

        def turned(at: Array, rng: np.random.Generator = rng) -> Array:
            """Where the arm truly is, 0.12 deg an axis off."""
            off: Array = at @ Rotation.from_rotvec(0.002 * rng.normal(size=(len(at), 3))).as_matrix()
            return off

        noise = 0.3 * NOISE
        calibration = cw.calibrate(cw.Samples(readings(rig, turned(R)) + noise * rng.normal(size=(16, 6)), R), "mount")
        assert (calibration.orientation_std is not None) == seen
        at = random_rotations(6, rng)
        wrench = _holding(rig, 3.0, COM, turned(at)) + noise * rng.normal(size=(6, 6))
        held = weigh(calibration, cw.Samples(wrench, at))
        doubted += any(finding.kind is Kind.POOR_FIT for finding in held.findings)
        z_mass.append((held.mass - 3.0) / held.mass_std)
        assert held.com is not None
        assert held.com_std is not None
        z_com.append((held.com - COM) / held.com_std)
        wrench[4:] += (_holding(rig, 3.0, COM + 0.03, at) - _holding(rig, 3.0, COM, at))[4:]
        slipped = weigh(calibration, cw.Samples(wrench, at))
        moved += any(finding.kind is Kind.POOR_FIT for finding in slipped.findings)
    assert doubted <= 1
    assert np.sqrt(np.mean(np.square(z_mass))) < 1.6
    assert np.sqrt(np.mean(np.square(z_com))) < 1.6
    assert moved >= 5


def test_gain_and_cross_talk_seen_while_calibrating_misread_the_object_too() -> None:
    """A percent of every element of the sensor's matrix, and an object three times as heavy as the tool."""
    doubted, z = 0, []
    for seed in range(10):
        rig, R, rng = example(400 + seed, poses=16)
        lever = np.repeat([1.0, 0.05], 3)
        matrix = np.eye(6) + 0.01 * rng.normal(size=(6, 6)) * lever[:, None] / lever
        rig = replace(rig, weight=10.0, bias=np.zeros(6))
        free = readings(rig, R) @ matrix.T + NOISE * rng.normal(size=(16, 6))
        at = random_rotations(5, rng)
        wrench = _holding(rig, 3.0, COM, at) @ matrix.T + NOISE * rng.normal(size=(5, 6))
        calibration = cw.calibrate(cw.Samples(free, R), "mount")
        held = weigh(calibration, cw.Samples(wrench, at))
        doubted += any(finding.kind is Kind.POOR_FIT for finding in held.findings)
        loads = cw.Samples(wrench, at, load_mass=np.full(5, 3.0))
        (known,) = verify(calibration, loads).weighings
        z += [(held.mass - 3.0) / held.mass_std, (known.weighed - 3.0) / known.std]
        assert held.mass_std < 0.15
    assert doubted <= 4
    assert np.sqrt(np.mean(np.square(z))) < 1.6


@pytest.mark.parametrize("times", [5.0, 2.5])
def test_a_heavy_object_may_show_a_gain_that_the_tool_does_not(times: float) -> None:
    rig, R, rng = example(21, 16)
    mass = times * rig.weight / G
    samples = _noisy_holding(rig, mass, COM, random_rotations(8, rng), rng)
    held = weigh(cw.calibrate(noisy(rig, R, rng), "mount"), samples)
    text = (
        "the object weighs 5 times the tool, whose weight hardly shows a gain that is off: 0.5 % of it would be "
        f"{5.0 * mass:.0f} g here; contactwrench verify tells with a known load as heavy (load_g)"
    )
    assert [each.text for each in held.findings] == [text] * (times == 5.0)


def test_std_counts_what_the_poses_share() -> None:
    """Hundreds of poses average the readings' noise, not the calibration's errors."""
    rig, R, rng = example(4, poses=8)
    rig = replace(rig, weight=5.0)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE)
    few, many = (weigh(calibration, _noisy_holding(rig, 2.0, COM, random_rotations(n, rng), rng)) for n in (3, 600))
    assert few.mass_std > many.mass_std > 0.05 * few.mass_std
    assert abs(many.mass - 2.0) < 4.0 * many.mass_std
    assert many.com is not None
    assert many.com_std is not None
    assert (np.abs(many.com - COM) < 4.0 * many.com_std).all()


def test_repeated_rows_are_one_pose() -> None:
    rig, R, rng = example(5)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    at = np.repeat(random_rotations(3, rng), 40, axis=0)
    held = weigh(calibration, _noisy_holding(rig, 2.0, COM, at, rng))
    assert held.poses == 3
    assert held.mass == pytest.approx(2.0, abs=4.0 * held.mass_std)


def test_nothing_held_and_too_little() -> None:
    rig, R, rng = example(6)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    nothing = weigh(calibration, noisy(rig, random_rotations(4, rng), rng))
    assert nothing.com is None
    assert nothing.com_std is None
    assert nothing.com_flange is None
    assert nothing.warnings == (
        "the mass is not above zero by three standard deviations: nothing is held, or too little for this "
        "calibration; no centre of mass",
    )
    held = weigh(calibration, _noisy_holding(rig, 8.0 * nothing.mass_std, COM, random_rotations(4, rng), rng))
    assert held.warnings == ()


def test_readings_that_no_object_explains_widen_the_std() -> None:
    """Ten times as noisy as the calibration knows, it holds 0.4 kg, or nothing; which is then neither."""
    rig, R, rng = example(13, poses=24)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    z, said = [], set[Kind]()
    for mass in (0.4, 0.0):
        for _ in range(40):
            at = random_rotations(8, rng)
            wrench = _holding(rig, mass, COM, at) + 10.0 * NOISE * rng.normal(size=(8, 6))
            held = weigh(calibration, cw.Samples(wrench, at))
            z.append((held.mass - mass) / held.mass_std)
            said |= {finding.kind for finding in held.findings}
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.3
    assert Kind.POOR_FIT in said
    assert Kind.NEGATIVE_MASS not in said


def test_a_tool_that_lost_weight_is_refused() -> None:
    rig, R, rng = example(7)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    held = weigh(calibration, _noisy_holding(rig, -0.15, COM, random_rotations(4, rng), rng))
    assert held.com is None
    assert held.refused
    assert held.findings == (
        Finding(
            Kind.NEGATIVE_MASS,
            Severity.REFUSED,
            "the mass is below zero: the tool is lighter than when it was calibrated, the sign of the readings differs "
            "(--sign), or the calibration is another tool's",
        ),
    )


@pytest.mark.parametrize(("distance", "refused"), [(1.9, False), (2.1, True)])
def test_a_centre_of_mass_outside_anything_that_an_arm_holds_is_refused(distance: float, refused: bool) -> None:
    rig, R, rng = example(7)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    held = weigh(calibration, _noisy_holding(rig, 0.5, np.array([0.0, 0.0, distance]), R, rng))
    assert held.refused == refused
    assert held.warnings == (
        (
            "the centre of mass comes out 2.1 m from the sensor, outside anything that an arm holds: the calibration "
            "is another tool's, its bias moved, or the torques are in N mm; contactwrench verify tells",
        )
        if refused
        else ()
    )


@pytest.mark.parametrize("mass", [-0.5, 0.5])
def test_the_program_refuses_what_no_object_is(tmp_path: Path, capsys: pytest.CaptureFixture[str], mass: float) -> None:
    recording, tool, held = _files(tmp_path, 17, mass, 3)
    done = run(capsys, "weigh", recording, "-c", tool)
    values = run(capsys, "weigh", recording, "-c", tool, "--json")
    assert (done.status, done.err) == (values.status, values.err) == (int(mass < 0.0), "")
    assert json.loads(values.out)["refused"] == held.refused == (mass < 0.0)
    assert (f"REFUSED  {held.warnings[0]}" == done.out.splitlines()[-1]) if mass < 0.0 else "REFUSED" not in done.out
    assert ("\n  mass " in done.out) == (mass > 0.0)


@pytest.mark.parametrize(("factor", "refused"), [(-1.0, True), (1.0 / 4.4482, True), (1.0, False)])
def test_readings_of_another_sign_or_unit_are_no_zero_that_moved(factor: float, refused: bool) -> None:
    """As no zero makes a mass of them; one that did move is said to have."""
    for seed in range(6):
        rig, R, rng = example(500 + seed, 16)
        calibration = cw.calibrate(noisy(rig, R, rng), "mount")
        at = random_rotations(4, rng)
        samples = _noisy_holding(rig, 0.2 * rig.weight, COM, at, rng)
        moved = np.zeros(6) if refused else 20.0 * NOISE
        held = weigh(calibration, cw.Samples(factor * samples.wrench + moved, at))
        kinds = [finding.kind for finding in held.findings if finding.severity is not Severity.NOTE]
        assert kinds == [Kind.NEGATIVE_MASS if refused else Kind.BIAS_SHIFTED]
        assert held.mass < 0.0 or (", whatever the zero is: " in held.warnings[0]) == refused


def _tilted(rng: np.random.Generator, poses: int, deg: float) -> Array:
    """Orientations (n, 3, 3) about a random one, within so many degrees."""
    turns = rng.normal(size=(poses, 3))
    turns *= np.deg2rad(deg) * np.sqrt(rng.uniform(size=(poses, 1))) / np.linalg.norm(turns, axis=1, keepdims=True)
    return np.asarray((Rotation.from_matrix(random_rotations(1, rng)[0]) * Rotation.from_rotvec(turns)).as_matrix())


@pytest.mark.parametrize(("deg", "noises"), [(20.0, 10.0), (20.0, 30.0), (40.0, 10.0), (60.0, 10.0)])
def test_a_zero_that_moved_along_gravity_is_no_mass(deg: float, noises: float) -> None:
    """It is said, or, where the poses do not show it, that they do not; a zero that stayed is neither."""
    said, silent = 0, 0
    for seed in range(10):
        rig, R, rng = example(300 + seed, 16)
        calibration = cw.calibrate(noisy(rig, R, rng), "mount")
        at = _tilted(rng, 6, deg)
        samples = _noisy_holding(rig, 1.0, COM, at, rng)
        assert not any(finding.kind is Kind.BIAS_SHIFTED for finding in weigh(calibration, samples).findings)
        moved = np.r_[_down_in_sensor(rig, at[0]) * noises * NOISE[0], 0.0, 0.0, 0.0]
        held = weigh(calibration, cw.Samples(samples.wrench + moved, at))
        shifts = [finding.text for finding in held.findings if finding.kind is Kind.BIAS_SHIFTED]
        notes = [finding.text for finding in held.findings if finding.kind is Kind.UNCONFIRMED]
        for text in shifts:
            assert text.startswith("doubtful: the zero is another one than the calibration's (probability ")
            grams, std = (float(word) for word in text.partition("poses tell ")[2].partition(" g;")[0].split(" +- "))
            assert abs(grams - 1000.0) < 5.0 * std
        said += bool(shifts)
        silent += not (shifts or notes) and abs(held.mass - 1.0) > 5.0 * held.mass_std
    assert silent == 0
    assert said >= (4 if deg * noises > 300.0 else 0)


def test_poses_all_round_need_no_note_about_the_zero() -> None:
    rig, R, rng = example(8, 16)
    held = weigh(
        cw.calibrate(noisy(rig, R, rng), "mount"), _noisy_holding(rig, 1.5, COM, random_rotations(8, rng), rng)
    )
    assert held.findings == ()


@pytest.mark.parametrize("poses", [1, 4])
def test_a_touch_is_noticed(poses: int) -> None:
    """A push of 1 N across gravity in the first pose; without it there is no such warning."""
    rig, R, rng = example(8)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    at = random_rotations(poses, rng)
    samples = _noisy_holding(rig, 2.0, COM, at, rng)
    push = np.zeros((poses, 6))
    push[0, :3] = np.cross(_down_in_sensor(rig, at[0]), [1.0, 0.0, 0.0])
    push[0, :3] /= np.linalg.norm(push[0, :3])
    touched = weigh(calibration, cw.Samples(samples.wrench + push, at))
    assert touched.probability < 0.01
    assert touched.warnings[-1].startswith(
        "doubtful: a rigid object that hangs free does not explain the readings (chi-square "
    )
    assert touched.warnings[-1].endswith(
        "it or the tool touched something, it moved between the poses, or the calibration no longer holds"
    )
    assert not [w for w in weigh(calibration, samples).warnings if "rigid" in w]


def test_an_object_that_slips_in_the_grip_is_noticed() -> None:
    rig, R, rng = example(9)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    at = random_rotations(6, rng)
    before, after = (_noisy_holding(rig, 2.0, com, at, rng).wrench for com in (COM, COM + np.array([0.0, 0.01, 0.0])))
    held = weigh(calibration, cw.Samples(np.vstack([before[:3], after[3:]]), at))
    assert "it moved between the poses" in held.warnings[0]


def test_g_is_the_calibrations_unless_given() -> None:
    rig, R, _ = example(10)
    calibration = cw.calibrate(noise_free(rig, R), "mount", g=9.7803)
    samples = cw.Samples(_holding(rig, 1.0, COM, R, g=9.7803), R)
    assert weigh(calibration, samples).mass == pytest.approx(1.0)
    assert weigh(calibration, samples).g == 9.7803
    assert weigh(calibration, samples, g=2.0 * 9.7803).mass == pytest.approx(0.5)


def test_rows_without_the_load_are_left_out() -> None:
    rig, R, rng = example(11)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    at = random_rotations(8, rng)
    wrench = np.vstack([noisy(rig, at[:3], rng).wrench, _noisy_holding(rig, 0.5, COM, at[3:], rng).wrench])
    held = weigh(calibration, cw.Samples(wrench, at, load_mass=np.repeat([0.0, 0.5], [3, 5])))
    assert held.poses == 5
    assert held.mass == pytest.approx(0.5, abs=4.0 * held.mass_std)
    assert held.warnings == ("3 rows without a load were left out",)
    unlabelled = weigh(calibration, cw.Samples(wrench[3:], at[3:], load_mass=np.zeros(5)))
    assert unlabelled.mass == held.mass
    assert unlabelled.warnings == ()


REFUSALS: list[tuple[str, Array | None, int, float | None]] = [
    (
        "arrays: found loads of 100 g, 200 g, expected one object: weigh several with verify, or split the recording",
        np.repeat([0.0, 0.1, 0.2], 2),
        6,
        None,
    ),
    (
        "arrays: found loads of 100 g, 200 g, 300 g, 400 g, ..., expected one object: weigh several with verify, or "
        "split the recording",
        np.arange(1, 7) / 10.0,
        6,
        None,
    ),
    ("arrays: found no samples, expected poses in which the object is held", None, 0, None),
    ("g is 0, expected 0.1 to 100 m/s^2", None, 6, 0.0),
]


@pytest.mark.parametrize(("message", "load", "rows", "g"), REFUSALS)
def test_refusals(message: str, load: Array | None, rows: int, g: float | None) -> None:
    rig, R, _ = example(12)
    calibration = cw.calibrate(noise_free(rig, R), "mount")
    samples = cw.Samples(readings(rig, R)[:rows], R[:rows], load_mass=load)
    with pytest.raises(InputError) as refused:
        weigh(calibration, samples, g=g)
    assert str(refused.value) == message


def test_a_result_cannot_be_written_to() -> None:
    rig, R, _ = example(13)
    held = weigh(cw.calibrate(noise_free(rig, R), "mount"), cw.Samples(_holding(rig, 1.0, COM, R), R))
    for values in (held.moment, held.covariance, held.com, held.com_std, held.com_flange, held.residual_rms):
        assert values is not None
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0


# The command line


def _files(folder: Path, seed: int, mass: float, poses: int) -> tuple[Path, Path, HeldObject]:
    rig, R, rng = example(seed)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    calibration.save(folder / "tool.json")
    samples = _noisy_holding(rig, mass, COM, random_rotations(poses, rng), rng)
    recording = written(folder, matrix_table(samples.wrench, samples.R_base_flange), "held.csv")
    return recording, folder / "tool.json", weigh(calibration, samples)


def test_the_program_prints_mass_and_com(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, tool, held = _files(tmp_path, 14, 2.0, 6)
    done = run(capsys, "weigh", recording, "-c", tool)
    assert (done.status, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == "Held object, weighed in 6 poses, g 9.80665 m/s^2"
    name, mass, _, std, unit = lines[2].split()
    assert (name, unit) == ("mass", "kg")
    assert float(mass) == pytest.approx(held.mass, abs=0.06 * held.mass_std)
    assert float(std) == pytest.approx(held.mass_std, rel=0.05)
    assert lines[4].split() == ["sensor", "axes", "flange", "axes", "mm,", "from", "the", "sensor's", "origin"]
    assert held.com is not None
    assert held.com_flange is not None
    assert held.com_std is not None
    for k, line in enumerate(lines[5:8]):
        name, in_sensor, _, std, in_flange, _, _ = line.split()
        assert name == f"com_{'xyz'[k]}"
        assert float(in_sensor) == pytest.approx(1e3 * held.com[k], abs=0.06)
        assert float(std) == pytest.approx(1e3 * held.com_std[k], rel=0.06)
        assert float(in_flange) == pytest.approx(1e3 * held.com_flange[k], abs=0.06)
    assert lines[-1].startswith("  chi-square ")
    std_g = f"{500.0 * held.mass_std:.1f}"
    assert run(capsys, "weigh", recording, "-c", tool, "--g", "19.6133").out.splitlines()[2].split()[2:] == [
        "+-",
        std_g,
        "g",
    ]


def test_the_program_prints_a_line_for_one_pose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, tool, _ = _files(tmp_path, 15, 0.5, 1)
    lines = run(capsys, "weigh", recording, "-c", tool).out.splitlines()
    assert lines[0] == "Held object, weighed in 1 pose, g 9.80665 m/s^2"
    assert lines[2].endswith(" g")
    assert lines[3].startswith("  com    on the line (")
    assert lines[3].endswith(" across, sensor axes")
    assert lines[-2:] == [
        "Note     gravity had one direction in sensor axes, so the centre of mass is known across it only: tilt the "
        "tool to another pose for the rest",
        "Note     the mass counts from the calibration's zero: by themselves the poses do not tell it; verify the "
        "empty tool just before, or tilt it further",
    ]


def test_json_is_the_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, tool, held = _files(tmp_path, 16, 2.0, 3)
    values = json.loads(run(capsys, "weigh", recording, "-c", tool, "--json").out)
    assert values["mass"] == pytest.approx(held.mass, rel=1e-9)
    assert values["com"] == pytest.approx(held.com, rel=1e-9)
    assert values["com_std"] == pytest.approx(held.com_std, rel=1e-9)
    assert np.shape(values["covariance"]) == (4, 4)
    assert values["unknown_along"] is None
    assert values["warnings"] == []


def test_the_program_refuses_several_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, tool, _ = _files(tmp_path, 17, 2.0, 3)
    table = np.column_stack([np.zeros((2, 6)), np.tile(np.eye(3).ravel(), (2, 1)), [100.0, 200.0]])
    path = written(tmp_path, csv_text((*WRENCH, *MATRIX, "load_g"), table))
    assert run(capsys, "weigh", path, "-c", tool).complaint == (
        f"{path}: found loads of 100 g, 200 g, expected one object: weigh several with verify, or split the recording"
    )
