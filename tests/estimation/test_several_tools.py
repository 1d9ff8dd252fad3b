"""Several tools on one sensor: what they share is one, as certain as all readings together make it, and honestly so."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from contactwrench.errors import AmbiguityError, InputError, UnobservableError
from contactwrench.estimation.several_tools import calibrate_shared
from tests.support.recordings import matrix_table, run, rx, ry, rz, written
from tests.support.rigs import NOISE, assert_same_tool, noisy, rotation_angle, seeds
from tests.support.world import Array, Rig, derivatives, noisy_readings, random_rig, random_rotations, tilted_down

Capture = pytest.CaptureFixture[str]

BOTH = ("mount", "gravity")
POSES = 10


def two_tools(rng: np.random.Generator, tilt: float = 0.0) -> tuple[Rig, Rig]:
    """A heavy and a light tool on one sensor, mounted anyhow, on a base that leans by `tilt` (rad)."""
    heavy = replace(random_rig(rng), weight=40.0, down=tilted_down(tilt, rng))
    return heavy, replace(heavy, weight=4.0, com=rng.normal(size=3) * 0.05, bias=rng.normal(size=6))


def recorded(rig: Rig, R_base_flange: Array, rng: np.random.Generator, source: str) -> cw.Samples:
    wrench = noisy_readings(rig, R_base_flange, NOISE, rng)
    return cw.Samples(wrench=wrench, R_base_flange=R_base_flange, source=source)


def joint_bound(rigs: tuple[Rig, ...], model: str, poses: tuple[Array, ...]) -> Array:
    """The Cramer-Rao bound of all tools (10 parameters each, in order) and the rotations that they share."""
    whitened = [
        (derivatives(rig, model, R) / NOISE[:, None]).reshape(6 * len(R), -1)
        for rig, R in zip(rigs, poses, strict=True)
    ]
    rotations = whitened[0].shape[1] - 10
    J = np.zeros((sum(len(part) for part in whitened), 10 * len(rigs) + rotations))
    row = 0
    for k, part in enumerate(whitened):
        rows = slice(row, row := row + len(part))
        J[rows, 10 * k : 10 * k + 10] = part[:, :10]
        J[rows, 10 * len(rigs) :] = part[:, 10:]
    covariance: Array = np.linalg.inv(J.T @ J)
    return covariance


def mounting_error(calibration: cw.Calibration, rig: Rig) -> Array:
    """The small rotation (3,) from the mounting found to the true one, sensor axes."""
    assert calibration.R_flange_sensor is not None
    off = calibration.R_flange_sensor.T @ rig.R_flange_sensor
    return 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])


@pytest.mark.slow
@settings(max_examples=2, deadline=None)
@given(seeds)
def test_nearly_perfect_readings_give_every_tool_and_the_base_it_stands_on(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rigs = two_tools(rng, tilt=rng.uniform(0.0, 1.0))
    samples = [noisy(rig, random_rotations(POSES, rng), rng, 1e-5 * NOISE) for rig in rigs]
    for calibration, rig in zip(calibrate_shared(samples, BOTH, "mount+base"), rigs, strict=True):
        assert_same_tool(calibration, rig, 1e-5)


@pytest.mark.slow
@settings(max_examples=1, deadline=None)
@given(seeds)
def test_what_is_shared_is_the_very_same_in_all_and_the_rest_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heavy, light = two_tools(rng, tilt=0.01)
    samples = [recorded(rig, random_rotations(POSES, rng), rng, "a") for rig in (heavy, light)]
    for model, shared in (("auto", BOTH), ("mount+base", ("mount",)), ("mount+base", ("gravity",))):
        a, b = calibrate_shared(samples, shared, model)
        assert a.R_flange_sensor is not None
        assert b.R_flange_sensor is not None
        one_mounting = bool((a.R_flange_sensor == b.R_flange_sensor).all())
        one_gravity = bool((a.gravity_direction == b.gravity_direction).all())
        assert (one_mounting, one_gravity) == ("mount" in shared, "gravity" in shared)
        for name in shared:
            assert a.std[name] == pytest.approx(b.std[name], rel=1e-9)


@pytest.mark.slow
def test_a_light_tool_reaches_the_joint_bound_and_says_so() -> None:
    rng = np.random.default_rng(7)
    rigs = two_tools(rng)
    poses = (random_rotations(POSES, rng), random_rotations(POSES, rng))
    bound = joint_bound(rigs, "mount", poses)
    light = rigs[1]
    apart = joint_bound((light,), "mount", poses[1:])[10:, 10:]
    of_mounting, of_tool, of_both, stated = [], [], [], []
    for _ in range(10):
        samples = [recorded(rig, R, rng, "a") for rig, R in zip(rigs, poses, strict=True)]
        found = calibrate_shared(samples, ("mount",), "mount", noise=NOISE)[1]
        assert found.com is not None
        assert found.weight is not None
        error = mounting_error(found, light)
        own = np.r_[light.weight - found.weight, light.com - found.com, light.bias - found.bias]
        of_mounting.append(error @ np.linalg.solve(bound[20:, 20:], error) / 3.0)
        of_tool.append(own @ np.linalg.solve(bound[10:20, 10:20], own) / 10.0)
        both = np.r_[own, error]
        of_both.append(both @ np.linalg.solve(found.covariance, both) / 13.0)
        stated.append(found.std["mount"] / np.sqrt(np.diag(bound)[20:]))
    assert np.sqrt(np.mean(of_mounting)) == pytest.approx(1.0, abs=0.14)  # as of 20 recordings within 0.1
    assert np.sqrt(np.mean(of_tool)) == pytest.approx(1.0, abs=0.14)
    assert np.mean(stated) == pytest.approx(1.0, abs=0.05)
    assert np.mean(of_both) == pytest.approx(1.0, abs=0.28)
    assert np.sqrt(np.trace(apart) / np.trace(bound[20:, 20:])) > 5.0


@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_poses_that_do_not_fix_a_mounting_alone_profit_from_another_recording(tilt: float) -> None:
    """Three poses about one axis, and the base unknown."""
    rng = np.random.default_rng(11)
    heavy, light = two_tools(rng, tilt)
    few = random_rotations(1, rng) @ np.array([rz(0.3) @ rx(turn) @ rz(-0.3) for turn in (0.0, 1.0, 2.0)])
    samples = [recorded(light, few, rng, "few"), recorded(heavy, random_rotations(12, rng), rng, "many")]
    with pytest.raises(UnobservableError):
        cw.calibrate(samples[0], "mount+base", noise=NOISE)
    found, _ = calibrate_shared(samples, BOTH, "mount+base", noise=NOISE)
    assert found.com is not None
    assert found.weight is not None
    assert np.abs(found.weight - light.weight) < 4.0 * found.std["weight"] < 0.5
    assert (np.abs(found.com - light.com) < 4.0 * found.std["com"]).all()
    assert np.linalg.norm(mounting_error(found, light)) < 4.0 * np.linalg.norm(found.std["mount"])


@pytest.mark.slow
def test_poses_that_do_not_even_fix_the_tool_are_refused_by_the_recording_s_name() -> None:
    rng = np.random.default_rng(3)
    heavy, light = two_tools(rng)
    samples = [
        recorded(heavy, random_rotations(POSES, rng), rng, "many"),
        recorded(light, random_rotations(1, rng), rng, "one"),
    ]
    with pytest.raises(UnobservableError, match=r"^one: cannot separate weight, "):
        calibrate_shared(samples, BOTH)


@pytest.mark.slow
def test_a_prior_is_counted_once() -> None:
    """Four recordings that hardly weigh anything tell of their common tilt what all their rows in one tell."""
    rng = np.random.default_rng(4)
    rig = Rig(0.02, np.zeros(3), rng.normal(size=6), rz(0.5), np.array([0.0, 0.0, -1.0]))
    samples = []
    for _ in range(4):
        R = random_rotations(10, rng)
        samples.append(cw.Samples(noisy_readings(rig, R, NOISE / 50.0, rng), R))
    together = calibrate_shared(samples, BOTH, noise=NOISE / 50.0)
    wrench, R = (np.concatenate([getattr(s, name) for s in samples]) for name in ("wrench", "R_base_flange"))
    in_one = cw.calibrate(cw.Samples(wrench, R), noise=NOISE / 50.0)
    assert together[0].std["gravity"] == pytest.approx(in_one.std["gravity"], rel=0.25)


def test_a_mounting_is_no_surer_than_what_the_others_say_of_it() -> None:
    """Of four poses each, whose variances are uncertain: together they have no more degrees of freedom than in sum."""
    for seed in (8, 9, 12):
        rng = np.random.default_rng(seed)
        heavy, light = two_tools(rng)
        samples = [recorded(rig, random_rotations(4, rng), rng, "few.csv") for rig in (heavy, light, heavy)]
        first, *_ = calibrate_shared(samples, ("mount",), "mount")
        alone = [cw.calibrate(each, "mount").parameter_dof for each in samples]
        in_sum = np.sum([dof for dof in alone if dof is not None], axis=0)
        assert first.parameter_dof is not None
        assert (first.parameter_dof <= in_sum)[10:].all()


@cache
def agreeing() -> tuple[cw.Calibration, ...]:
    """Of three recordings on one mounting and one base."""
    return calibrate_shared(contradicting(0.0), BOTH)


def contradicting(angle: float, seed: int = 5) -> list[cw.Samples]:
    rng = np.random.default_rng(seed)
    heavy, light = two_tools(rng)
    light = replace(light, R_flange_sensor=light.R_flange_sensor @ ry(np.deg2rad(angle)))
    return [
        recorded(heavy, random_rotations(POSES, rng), rng, "heavy.csv"),
        recorded(light, random_rotations(POSES, rng), rng, "light.csv"),
        recorded(heavy, random_rotations(POSES, rng), rng, "again.csv"),
    ]


@pytest.mark.parametrize("count", [2, 3])
def test_a_mounting_that_differs_is_named_with_its_angle(count: int) -> None:
    for calibration in calibrate_shared(contradicting(5.0)[:count], ("mount",), "mount"):
        warning = next(line for line in calibration.warnings if "contradicts" in line)
        head, angle = warning.split(", the mounting by ")
        assert head == f"weak: light.csv contradicts the other recording{'s' if count == 3 else ''}"
        assert float(angle.split(" +- ")[0]) == pytest.approx(5.0, abs=1.0)
        assert angle.endswith(
            "the sensor or the base moved in between, or the tool touched something: calibrate it apart"
        )


def test_recordings_of_one_name_are_told_apart_by_their_number() -> None:
    """Arrays have no other."""
    some = [replace(samples, source="arrays") for samples in contradicting(5.0)[:2]]
    first, second = calibrate_shared(some, ("mount",), "mount")
    assert [line.split(", ")[0] for line in first.warnings if "contradicts" in line] == [
        "weak: arrays 2 contradicts the other recording"
    ]
    assert (first.provenance["shared_with"], second.provenance["shared_with"]) == ("arrays 2", "arrays 1")


@pytest.mark.slow
def test_one_mounting_contradicts_nothing() -> None:
    for calibrations in (calibrate_shared(contradicting(0.0), ("mount",), "mount"), agreeing()):
        for calibration in calibrations:
            assert not [line for line in calibration.warnings if "contradicts" in line]


def test_a_reversed_recording_is_refused_by_its_name() -> None:
    samples = contradicting(0.0)
    samples[1] = cw.Samples(-samples[1].wrench, samples[1].R_base_flange, source="light.csv")
    with pytest.raises(AmbiguityError, match=r"^light\.csv: .*--sign reaction"):
        calibrate_shared(samples, ("mount",), "mount")


@pytest.mark.slow
def test_where_it_comes_from_is_said_and_saved(tmp_path: Path) -> None:
    first, *_ = agreeing()
    assert first.provenance["shared"] == "mount, gravity"
    assert first.provenance["shared_with"] == "light.csv, again.csv"
    first.save(tmp_path / "first.json")
    assert cw.Calibration.load(tmp_path / "first.json").provenance == first.provenance


def test_a_mounting_that_is_known_is_known_once() -> None:
    samples = contradicting(0.0)[:2]
    rng = np.random.default_rng(5)
    R = two_tools(rng)[0].R_flange_sensor
    std = np.deg2rad(1e-3)
    for calibration in calibrate_shared(samples, ("mount",), "mount", known={"mount": (R, std)}):
        assert calibration.R_flange_sensor is not None
        assert rotation_angle(calibration.R_flange_sensor, R) < 4.0 * std
        assert calibration.std["mount"] == pytest.approx(std, rel=0.01)


REFUSED: list[tuple[int, dict[str, Any], str]] = [
    (2, {"shared": ("yaw",)}, "found 'yaw' to share, expected mount or gravity, or both"),
    (2, {"shared": ()}, "found nothing to share, expected mount or gravity, or both"),
    (1, {}, "found 1 recording to share mount and gravity, expected two or more"),
    (2, {"model": "paper"}, "model 'paper' shares nothing, expected one of auto, mount, mount+base"),
    (
        2,
        {"model": "mount"},
        "model mount holds gravity, and gravity is to be shared: share mount alone, or choose auto or mount+base",
    ),
    (
        2,
        {"known": {"weight": (3.0, 0.1)}},
        "known weight is of one tool, and each recording has its own: leave it out, or calibrate them apart",
    ),
]


@pytest.mark.parametrize(("count", "arguments", "message"), REFUSED)
def test_what_cannot_be_shared_is_refused(count: int, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refusal:
        calibrate_shared(contradicting(0.0)[:count], **arguments)
    assert str(refusal.value) == message


# The command line


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    heavy, light, _ = contradicting(0.0)
    return (
        written(tmp_path, matrix_table(heavy.wrench, heavy.R_base_flange), "heavy.csv"),
        written(tmp_path, matrix_table(light.wrench, light.R_base_flange), "light.csv"),
    )


def test_each_recording_gets_its_file_and_all_the_same_mounting(files: tuple[Path, Path], capsys: Capture) -> None:
    folder = files[0].parent / "calibrations"
    done = run(capsys, "calibrate", *files, "--shared", "mount", "--model", "mount", "-o", folder)
    assert (done.status, done.err) == (0, "")
    saved = [folder / "heavy.json", folder / "light.json"]
    assert done.out.splitlines()[-2:] == [f"Wrote the calibration to {path}" for path in saved]
    heavy, light = (cw.Calibration.load(path) for path in saved)
    assert heavy.R_flange_sensor is not None
    assert light.R_flange_sensor is not None
    assert (heavy.R_flange_sensor == light.R_flange_sensor).all()
    assert (round(heavy.weight or 0.0), round(light.weight or 0.0)) == (40, 4)
    assert done.out.count("Calibration, model mount, 10 poses") == 2


@pytest.mark.parametrize("flags", [["--json"], ["-o", "-"]])
def test_json_of_several_is_an_array_and_nothing_else(
    files: tuple[Path, Path], flags: list[str], capsys: Capture
) -> None:
    done = run(capsys, "calibrate", *files, "--shared", "mount", "--model", "mount", *flags)
    assert [one["provenance"]["shared_with"] for one in json.loads(done.out)] == [str(files[1]), str(files[0])]


def test_required_accuracy_is_that_of_each(files: tuple[Path, Path], capsys: Capture) -> None:
    done = run(capsys, "calibrate", *files, "--shared", "mount", "--model", "mount", "--require-force", "0.01")
    assert done.status == 1
    lines = done.err.splitlines()
    assert [line.split(": Required accuracy missed: ")[0] for line in lines] == [str(file) for file in files]


def test_flags_that_do_not_go_together_are_refused(files: tuple[Path, Path], capsys: Capture) -> None:
    heavy, light = files
    (folder := heavy.parent / "elsewhere").mkdir()
    same = written(folder, heavy.read_text(), "heavy.csv")
    hint = ": try 'contactwrench calibrate --help'"
    shared = ("--shared", "mount")
    for arguments, message in (
        ((heavy, light), f"Invalid value: found 2 files, expected one, or --shared mount,gravity{hint}"),
        ((heavy, *shared), "found 1 recording to share mount, expected two or more"),
        ((heavy, light, "--shared", "yaw"), "found 'yaw' to share, expected mount or gravity, or both"),
        (
            (heavy, light, *shared, "--prior", heavy),
            f"Invalid value: --prior is for one file, found --shared too: leave one of them out{hint}",
        ),
        (
            (heavy, light, *shared, "--report", folder / "r.html"),
            f"Invalid value: --report is for one file, found --shared too: leave one of them out{hint}",
        ),
        (
            (heavy, light, *shared, "--known", "mass=1+-0.1"),
            "known mass is of one tool, and each recording has its own: leave it out, or calibrate them apart",
        ),
        (
            (heavy, heavy, *shared),
            f"Invalid value: found {heavy} twice, expected a recording of each tool: leave one out{hint}",
        ),
        (
            (heavy, light, *shared, "-o", heavy),
            f"{heavy}: found a file, expected a folder for 2 calibrations: name one",
        ),
        (
            (heavy, same, *shared, "-o", folder),
            f"{folder / 'heavy.json'}: found two recordings named heavy, expected different names: rename one, or "
            "leave --output out",
        ),
    ):
        assert run(capsys, "calibrate", *arguments).complaint == message
    assert heavy.read_text() == same.read_text()
    assert [path.name for path in folder.iterdir()] == ["heavy.csv"]


def test_a_light_tool_that_is_as_noisy_as_a_heavy_one_is_read_rightly() -> None:
    """0.2 N an axis: under 20 N nobody minds, under 2 N alone it would be a file that is read wrongly."""
    noise, rng = 4.0 * NOISE, np.random.default_rng(5)
    heavy, light = two_tools(rng)
    heavy, light = replace(heavy, weight=20.0), replace(light, weight=2.0)
    samples = [noisy(rig, random_rotations(POSES, rng), rng, noise) for rig in (heavy, light)]
    assert Kind.POOR_FIT in {finding.kind for finding in cw.calibrate(samples[1]).findings}
    for calibration in calibrate_shared(samples, BOTH):
        assert Kind.POOR_FIT not in {finding.kind for finding in calibration.findings}
    misread = replace(samples[1], R_base_flange=samples[1].R_base_flange.transpose(0, 2, 1))
    assert Kind.POOR_FIT in {finding.kind for finding in calibrate_shared([samples[0], misread])[1].findings}
