"""Diagnosis: each way to read a file wrongly is found, a file that is read rightly is left alone.

What judges a diagnosis is what `calibrate`
makes of the file with the flags that it names.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import example as hypothesis_example
from scipy.spatial.transform import Rotation

import contactwrench as cw
from benchmarks.diagnose import few_left_alone
from contactwrench.assess.diagnose import Diagnosis, diagnose
from contactwrench.assess.interpretations import (
    PUSH,
    SEE_BASE,
    SEE_COM,
    OrientationInterpretation,
    WrenchInterpretation,
    as_read,
)
from contactwrench.assess.screening import screen
from contactwrench.recording.interpretations import interpretations
from contactwrench.recording.options import Options
from contactwrench.report.diagnosis import verdict
from tests.support.recordings import MATRIX, PANDA, PAPER, WRENCH, csv_text, run, written
from tests.support.rigs import NOISE, example, seeds
from tests.support.world import Array, noisy_readings, random_rig, random_rotations, tilted_down
from tests.support.written import QUAT, Written, euler, in_base_axes, quat, rotvec

RIGHT, KUKA = Written(QUAT, quat), Written(("a", "b", "c"), euler("ZYX"))

BY_FLAGS = {
    "fanuc as kuka": (Written(("a", "b", "c"), euler("xyz")), "--orientation fanuc_wpr:a,b,c"),
    "staubli as ur": (Written(("rx", "ry", "rz"), euler("XYZ")), "--orientation staubli"),
    "ur as kuka": (Written(("a", "b", "c"), rotvec), "--orientation ur_rotvec:a,b,c"),
    "an order that no brand uses": (Written(("a", "b", "c"), euler("XZX")), "--orientation euler:XZX:deg:a,b,c"),
    "kuka in rad": (Written(("a", "b", "c"), euler("ZYX", degrees=False)), "--orientation euler:ZYX:rad:a,b,c"),
    "scalar first": (Written(QUAT, lambda R: quat(R)[:, [3, 0, 1, 2]]), "--orientation quat_wxyz:qx,qy,qz,qw"),
    "scalar first, as the reaction": (
        Written(QUAT, lambda R: quat(R)[:, [3, 0, 1, 2]], lambda R, wrench: -wrench),
        "--orientation quat_wxyz:qx,qy,qz,qw --sign reaction",
    ),
    "scalar last under a header that puts it first": (
        Written(("qw", "qx", "qy", "qz"), quat),
        "--orientation quat_xyzw:qw,qx,qy,qz",
    ),
    "inverse": (Written(MATRIX, lambda R: R.transpose(0, 2, 1).reshape(-1, 9)), "--inverse-orientation"),
    "reaction": (replace(RIGHT, wrench=lambda R, wrench: -wrench), "--sign reaction"),
    "base axes": (replace(RIGHT, wrench=in_base_axes), "--wrench-frame base"),
    "in N mm": (replace(RIGHT, wrench=lambda R, wrench: wrench * np.repeat([1.0, 1e3], 3)), "--units torque=Nmm"),
    "order, inverse, sign and frame": (
        Written(
            ("a", "b", "c"),
            lambda R: euler("xyz")(R.transpose(0, 2, 1)),
            lambda R, wrench: -in_base_axes(R, wrench),
        ),
        "--orientation fanuc_wpr:a,b,c --inverse-orientation --wrench-frame base --sign reaction",
    ),
}


def found_in(folder: Path, content: str, gravity: Array | None = None, **stated: Any) -> Diagnosis:
    options = Options(**stated)
    return diagnose(interpretations(written(folder, content), options, gravity))


@pytest.mark.slow
@pytest.mark.parametrize("mistake", BY_FLAGS)
def test_flags_that_mend_a_reading_are_found(mistake: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Any tool, any mounting: `calibrate` names `diagnose`, and with the flags of its verdict finds the tool."""
    wrong, flags = BY_FLAGS[mistake]
    rig, R, rng = example(list(BY_FLAGS).index(mistake), poses=15)
    path = written(tmp_path, wrong.text(R, noisy_readings(rig, R, NOISE, rng)))
    quickly = () if mistake == "fanuc as kuka" else ("--model", "mount")
    first = run(capsys, "calibrate", path, *quickly)
    assert "contactwrench diagnose" in first.out + first.err or flags in first.err
    done = run(capsys, "diagnose", path, *quickly)
    assert done.status == 0
    verdict = done.out.splitlines()[0]
    assert verdict.startswith("as given: ")
    assert f"; with `{flags}`: 0." in verdict
    calibration = json.loads(run(capsys, "calibrate", path, "--model", "mount", "--json", *shlex.split(flags)).out)
    assert calibration["weight"] == pytest.approx(rig.weight, abs=0.1)
    left = float(verdict.rpartition(": ")[2].split()[0])
    assert np.linalg.norm(calibration["residual_rms"][:3]) <= 1.1 * left
    assert left == pytest.approx(np.sqrt(3.0) * NOISE[0], rel=0.35)


SHIFTED = "each orientation belonging to the {} row's wrench"


def exchanged(*order: int) -> Callable[[Array, Array], Array]:
    return lambda R, wrench: wrench[:, order]


IN_WORDS = {
    "fy, fz": (exchanged(0, 2, 1, 3, 4, 5), "fy and fz exchanged"),
    "tx, ty": (exchanged(0, 1, 2, 4, 3, 5), "tx and ty exchanged"),
    "force, torque": (exchanged(3, 4, 5, 0, 1, 2), "force and torque exchanged"),
    "force axes": (exchanged(1, 2, 0, 3, 4, 5), "fx, fy, fz written as fy, fz, fx"),
}


def test_each_change_from_what_was_stated_is_one_in_twenty(tmp_path: Path) -> None:
    """The same file, once with its sign stated: without that it takes one change, which its odds count."""
    rig, R, rng = example(11, poses=8)
    content = replace(RIGHT, wrench=lambda R, wrench: -wrench).text(R, noisy_readings(rig, R, NOISE, rng))
    found, stated = found_in(tmp_path, content).best, found_in(tmp_path, content, sign="reaction").best
    assert found.interpretation.options == stated.interpretation.options == ("--sign reaction",)
    assert found.weight == pytest.approx(stated.weight)
    assert found.odds - stated.odds == pytest.approx(-2.0 * np.log(1.0 / 20.0))


@pytest.mark.slow
@pytest.mark.parametrize("mistake", IN_WORDS)
def test_what_no_flag_mends_is_said_in_words(mistake: str, tmp_path: Path) -> None:
    spoil, words = IN_WORDS[mistake]
    rig, R, rng = example(5)
    diagnosis = found_in(tmp_path, replace(RIGHT, wrench=spoil).text(R, noisy_readings(rig, R, NOISE, rng)))
    assert not diagnosis.read_rightly
    assert (diagnosis.best.interpretation.options, diagnosis.best.interpretation.mends) == ((), (words,))
    assert diagnosis.best.com == pytest.approx(rig.com, abs=2e-3)
    assert diagnosis.best.explained


@pytest.mark.parametrize(
    ("shift", "whose", "rows"), [(1, "next", 1), (-1, "previous", 40)], ids=["a row a pose", "many rows a pose"]
)
def test_orientations_shifted_by_a_pose_are_found(shift: int, whose: str, rows: int, tmp_path: Path) -> None:
    """`next`: the orientation in a row is that of the next pose's wrench."""
    rig, R, rng = example(6)
    wrench = noisy_readings(rig, R, NOISE, rng)
    late = np.roll(wrench, shift, axis=0)[1:-1]
    content = RIGHT.text(np.repeat(R[1:-1], rows, axis=0), np.repeat(late, rows, axis=0))
    diagnosis = found_in(tmp_path, content)
    assert diagnosis.n == 22
    assert diagnosis.best.interpretation.mends == (SHIFTED.format(whose),)
    assert diagnosis.best.weight == pytest.approx(rig.weight, abs=0.1)


@pytest.mark.slow
def test_angles_under_a_wrong_unit_are_renamed(tmp_path: Path) -> None:
    rig, R, rng = example(7)
    wrong = Written(("a_deg", "b_deg", "c_deg"), euler("ZYX", degrees=False))
    diagnosis = found_in(tmp_path, wrong.text(R, noisy_readings(rig, R, NOISE, rng)))
    assert diagnosis.best.interpretation.options == ("--orientation kuka_abc",)
    assert diagnosis.best.interpretation.mends == (
        "the angles in rad (rename a_deg, b_deg, c_deg to a_rad, b_rad, c_rad)",
    )


def test_a_torque_that_is_not_in_nmm_as_stated(tmp_path: Path) -> None:
    rig, R, rng = example(8)
    text = RIGHT.text(R, noisy_readings(rig, R, NOISE, rng)).replace("tx,ty,tz", "tx_nmm,ty_nmm,tz_nmm", 1)
    diagnosis = found_in(tmp_path, text)
    words = "the torque in N m (rename tx_nmm, ty_nmm, tz_nmm to tx, ty, tz)"
    assert diagnosis.best.interpretation.mends == (words,)
    assert diagnosis.best.com == pytest.approx(rig.com, abs=2e-3)


# Files without a mistake


@pytest.mark.slow
@settings(max_examples=2, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=seeds)
@hypothesis_example(seed=10930)
def test_a_file_that_is_read_rightly_is_left_alone(seed: int, tmp_path: Path) -> None:
    """Five poses or more, a tool that weighs next to nothing, a base that leans a little, a pose in contact."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    trouble = rng.integers(4)
    R = random_rotations(int(rng.integers(5, 25)), rng)
    if trouble == 1:
        rig = replace(rig, weight=0.3)
    if trouble == 2:
        rig = replace(rig, down=tilted_down(np.deg2rad(2.0), rng))
    wrench = noisy_readings(rig, R, NOISE, rng)
    if trouble == 3:
        wrench[0] += rng.normal(size=6) * np.repeat([3.0, 0.3], 3)
    diagnosis = found_in(tmp_path, (KUKA if rng.random() < 0.5 else RIGHT).text(R, wrench))
    best = diagnosis.best.interpretation
    assert (best.options, best.mends) == ((), ())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [51, 1500, 1706])
def test_right_files_of_few_poses_are_left_alone(seed: int, tmp_path: Path) -> None:
    """Light tools, noise, a pose in contact: of the 2,000 that the benchmark makes, those that were once mended."""
    assert few_left_alone(seed, tmp_path)


def test_stated_flags_that_are_right_are_left_alone(tmp_path: Path) -> None:
    rig, R, rng = example(9)
    ceiling = replace(rig, down=np.array([0.0, 0.0, 1.0]))
    wrench = noisy_readings(ceiling, R, NOISE, rng)
    content = replace(RIGHT, wrench=lambda R, wrench: -in_base_axes(R, wrench)).text(R, wrench)
    diagnosis = found_in(tmp_path, content, ceiling.down, sign="reaction", wrench_frame="base")
    assert diagnosis.read_rightly
    assert diagnosis.best.weight == pytest.approx(rig.weight, abs=0.1)
    assert diagnosis.best.interpretation.options == ("--wrench-frame base", "--sign reaction", "--gravity 0,0,1")


# What free air cannot tell


def _names(diagnosis: Diagnosis) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    return [(reading.options, reading.mends) for reading in diagnosis.alike]


@pytest.mark.slow
def test_a_ceiling_a_reaction_and_a_mirror_are_one_class(tmp_path: Path) -> None:
    rig, R, rng = example(10)
    wrench = noisy_readings(rig, R, NOISE, rng)
    diagnosis = found_in(tmp_path, replace(RIGHT, wrench=lambda R, wrench: -wrench).text(R, wrench))
    likely = _names(diagnosis)[: diagnosis.likely]
    assert (("--gravity 0,0,1",), ()) in likely
    assert ((), ("fz reversed", "tz reversed")) in likely
    assert ((), ("fx and fy exchanged", "tx and ty exchanged")) in likely
    assert diagnosis.observations == (PUSH, SEE_COM, SEE_BASE)
    for reading in diagnosis.alike[: diagnosis.likely]:
        R_read, wrench_read = as_read(interpretations(tmp_path / "poses.csv"), reading)
        down = [0.0, 0.0, 1.0] if reading.reversed_gravity else [0.0, 0.0, -1.0]
        calibration = cw.calibrate(cw.Samples(wrench_read, R_read), "mount", gravity=down)
        assert calibration.residual_rms == pytest.approx(NOISE, rel=0.6)


def test_a_push_tells_readings_from_negated_ones_and_the_base_how_gravity_lies(tmp_path: Path) -> None:
    """The reaction, or a robot on the ceiling: the first shows where one pushes, the second by how it stands."""
    rig, R, rng = example(13, poses=8)
    file = interpretations(written(tmp_path, RIGHT.text(R, noisy_readings(rig, R, NOISE, rng))))
    given, reaction = file.interpretation(0, 0, 0), file.interpretation(0, 0, 1)
    hanging = file.interpretation(0, 0, 1, by_gravity=True)
    assert file.observations(given, [reaction], leans=False) == (PUSH,)
    assert file.observations(given, [hanging], leans=False) == (SEE_BASE,)
    assert file.observations(reaction, [hanging], leans=False) == (PUSH, SEE_BASE)
    assert file.observations(given, [given], leans=False) == ()


def test_a_reversed_torque_is_a_mirrored_com_and_left_alone(tmp_path: Path) -> None:
    rig, R, rng = example(11)
    wrench = noisy_readings(rig, R, NOISE, rng) * np.repeat([1.0, -1.0], 3)
    diagnosis = found_in(tmp_path, RIGHT.text(R, wrench))
    assert diagnosis.read_rightly
    assert ((), ("tx, ty and tz reversed",)) in _names(diagnosis)
    assert diagnosis.best.com == pytest.approx(-rig.com, abs=2e-3)


def test_poses_that_are_one_by_a_convention_that_is_not_theirs_stay_two(tmp_path: Path) -> None:
    """Right angles, as poses are set by hand: in radians, which they are not, some come out alike."""
    rig, _, rng = example(2)
    quarter_turns = Rotation.create_group("O")[rng.permutation(24)]
    R = (quarter_turns * Rotation.from_rotvec(np.deg2rad(0.005) * rng.normal(size=(24, 3)))).as_matrix()
    wrong = Written(("roll_rad", "pitch_rad", "yaw_rad"), euler("xyz"))
    diagnosis = found_in(tmp_path, wrong.text(R, noisy_readings(rig, R, NOISE, rng)))
    assert diagnosis.n == 24
    assert diagnosis.best.force_left < 3.0 * float(np.linalg.norm(NOISE[:3]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "down"),
    [
        (RIGHT, [-1.0, 0.0, 0.001]),
        (KUKA, [0.0, 1.0, -0.001]),
        (Written(("rx", "ry", "rz"), rotvec), [1.0, 0.0, 0.01]),
    ],
    ids=["quaternion on -x", "kuka on +y", "ur on +x"],
)
def test_a_robot_on_a_wall_looks_like_two_wrong_flags(
    way: Written, down: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As given is kept, as `auto` finds the wall, on either side of the right angle; the flags are named, and what
    decides.
    """
    rig, R, rng = example(12)
    rig = replace(rig, down=np.array(down) / np.linalg.norm(down))
    diagnosis = found_in(tmp_path, way.text(R, noisy_readings(rig, R, NOISE, rng)))
    as_given = diagnosis.best
    assert diagnosis.read_rightly
    assert np.rad2deg(as_given.lean) == pytest.approx(90.0, abs=1.5)
    assert as_given.weight == pytest.approx(rig.weight, abs=0.1)
    assert diagnosis.likely or way is not KUKA
    assert SEE_BASE in diagnosis.observations
    leaning = f"as given, the base leaning {np.rad2deg(as_given.lean):.1f} deg"
    assert leaning in run(capsys, "diagnose", tmp_path / "poses.csv").out


def test_a_base_that_leans_is_no_wrong_reading(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, R, rng = example(12)
    rig = replace(rig, weight=20.0, down=tilted_down(np.deg2rad(20.0), rng))
    diagnosis = found_in(tmp_path, RIGHT.text(R, noisy_readings(rig, R, NOISE, rng)))
    assert diagnosis.read_rightly
    assert np.rad2deg(diagnosis.best.lean) == pytest.approx(20.0, abs=0.5)
    rows = run(capsys, "diagnose", tmp_path / "poses.csv").out.splitlines()[5:7]
    assert rows[1].strip() == f"as given, the base leaning {np.rad2deg(diagnosis.best.lean):.1f} deg"


@pytest.mark.parametrize("poses", [6, 12])
@pytest.mark.parametrize("seed", range(4))
def test_a_pose_in_contact_that_leaves_nearly_all_is_named(poses: int, seed: int, tmp_path: Path) -> None:
    rig, R, rng = example(seed, poses)
    rig = replace(rig, weight=20.0)
    wrench, pushed = noisy_readings(rig, R, NOISE, rng), int(rng.integers(poses))
    assert found_in(tmp_path, RIGHT.text(R, wrench)).best.pose_off is None
    wrench[pushed] += [0.0, 4.0, -7.0, 0.3, 0.1, 0.0]
    diagnosis = found_in(tmp_path, RIGHT.text(R, wrench))
    assert (diagnosis.read_rightly, diagnosis.best.pose_off) == (True, pushed + 1)
    without = f" N without pose {pushed + 1}, which may be in contact; no other interpretation explains it better"
    assert without in verdict(diagnosis)
    assert diagnosis.best.force_without < 0.3


def test_screening_is_exact_without_noise() -> None:
    """The right reading leaves nothing, the negated one leaves the forces that no weight above zero can make."""
    rig, R, rng = example(13)
    wrench = noisy_readings(rig, R, np.zeros(6), rng)
    orientation = OrientationInterpretation((), (), 0.0, R, slice(None))
    wrenches = [WrenchInterpretation((), (), 0.0, sign * np.eye(6), in_base=False) for sign in (1.0, -1.0)]
    squares, dof = screen([orientation], wrenches, wrench, rig.down)
    root_mean_square = np.sqrt(squares / dof)[0]
    assert root_mean_square == pytest.approx(root_mean_square[::-1, ::-1])
    assert root_mean_square[0, 0, 0] < 1e-5 * rig.weight
    assert root_mean_square[0, 0, 1] < 1e-5
    assert root_mean_square[0, 1, 0] > 0.2 * rig.weight


# The program


@pytest.mark.slow
def test_the_verdict_stands_first(capsys: pytest.CaptureFixture[str]) -> None:
    right = run(capsys, "diagnose", PANDA)
    assert right.status == 0
    assert right.out.splitlines()[:5] == [
        "as given: 0.26 N left; no other interpretation explains it better: it is read rightly, units apart",
        "",
        f"17 poses, 1248 interpretations tried, {PANDA}",
        "",
        "    N left  mN m left  weight N          com mm          interpretation",
    ]
    assert "Free air cannot tell these from the first:" not in right.out
    for flags, expected in {
        "--sign reaction": "as given: 10 N left; without `--sign reaction`: 0.26 N left",
        "--orientation quat_wxyz:qx,qy,qz,qw": "as given: 7.8 N left; with `--orientation quat_xyzw`: 0.26 N left",
        "--gravity 0,0,1": "as given: 10 N left; with `--sign reaction --gravity 0,0,1`: 0.26 N left",
    }.items():
        assert run(capsys, "diagnose", PANDA, *flags.split()).out.splitlines()[0] == expected


@pytest.mark.slow
def test_a_file_that_nothing_explains_well(capsys: pytest.CaptureFixture[str]) -> None:
    lines = run(capsys, "diagnose", PAPER).out.splitlines()
    assert lines[0] == (
        "as given: 0.74 N left, 12 % of the weight; no other interpretation explains it better, "
        "and none explains it well"
    )
    assert (
        "Likely causes: poses that hardly tilt the tool, a pose in contact, a sensor that was zeroed during the "
        "recording, an arm that still moved, a cable that pulls, a tool too light for the sensor, or a "
        "controller that already subtracts its payload (record what the sensor itself reads)."
    ) in " ".join(lines)


def test_numbers_that_are_no_orientation_as_stated_are_diagnosed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, R, rng = example(15, poses=12)
    wrench = noisy_readings(rig, R, NOISE, rng)
    path = written(tmp_path, Written(("rx", "ry", "rz"), euler("xyz")).text(R, wrench))
    lines = run(capsys, "diagnose", path).out.splitlines()
    assert lines[0].startswith("as given: cannot be read; with `--orientation yaskawa`: 0.")
    assert lines[2].startswith(f"As given: {path}: row ")
    assert lines[2].endswith(
        "if these are angles in degrees, say whose (--orientation yaskawa or staubli; contactwrench diagnose tells)"
    )


def test_columns_that_auto_does_not_know_are_diagnosed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig, R, rng = example(16, poses=12)
    path = written(tmp_path, Written(("o", "a", "t"), euler("ZYZ")).text(R, noisy_readings(rig, R, NOISE, rng)))
    first = run(capsys, "diagnose", path).out.splitlines()[0]
    assert first.startswith("as given: cannot be read; with `--orientation kawasaki_oat`: 0.")


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(run(capsys, "diagnose", PANDA, "--inverse-orientation", "--json").out)
    assert found["verdict"] == "as given: 8.8 N left; without `--inverse-orientation`: 0.26 N left"
    assert found["given"]["flags"] == ["--inverse-orientation"]
    assert found["best"]["flags"] == []
    assert found["best"]["weight"] == pytest.approx(7.73, abs=0.01)
    assert found["ranked"][0] == found["best"]
    assert found["read_rightly"] is False
    assert found["explained"] is True


NO_ORIENTATION = "fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n"


def test_what_cannot_be_diagnosed_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a long path would be shortened
    path = written(Path(), NO_ORIENTATION)
    assert run(capsys, "diagnose", path).complaint == run(capsys, "calibrate", path).complaint
    rig, R, rng = example(17, poses=4)
    path = written(Path(), RIGHT.text(R, noisy_readings(rig, R, NOISE, rng)))
    assert run(capsys, "diagnose", path).complaint == (
        f"{path}: found 4 distinct orientations, expected 5 or more to tell one interpretation from another: record "
        "six or more that tilt the tool about two axes"
    )
    path = written(Path(), Written(QUAT, lambda R: 0.5 * quat(R)).text(random_rotations(6, rng), np.ones((6, 6))))
    assert run(capsys, "diagnose", path).complaint == (
        f"{path}: row 2, columns qx,qy,qz,qw: found a quaternion of length 0.5, expected 1 within 1 %: check the order "
        "of its parts and that none is cut off; no other convention makes rotations of these columns either: check "
        "that they hold an orientation"
    )
    path = written(Path(), csv_text((*WRENCH, *QUAT, "load_g"), [[1.0] * 6 + [0.0, 0.0, 0.0, 1.0, 5.0]]))
    assert run(capsys, "diagnose", path).complaint == (
        f"{path}: found no contact-free samples, expected poses without a load"
    )
    path = written(Path(), NO_ORIENTATION, "poses.xls")
    assert run(capsys, "diagnose", path).complaint == run(capsys, "calibrate", path).complaint
    assert run(capsys, "diagnose", PANDA, "--sign", "push").complaint == "sign is 'push', expected pull or reaction"
