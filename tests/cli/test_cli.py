"""The program as its users run it: every verb, exit statuses 0, 1 and 2, and what goes to stdout, stderr and files."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.file import to_json
from contactwrench.calibration.findings import Doubt
from tests.support.recordings import MATRIX, PANDA, WRENCH, Run, beside_its_doubt, csv_text, matrix_table, run, written
from tests.support.rigs import example, noisy
from tests.support.world import random_rotations

Capture = pytest.CaptureFixture[str]
FULL = Path("/dev/full")
MOUNT = ("--model", "mount")
"""Where any calibration will do: a quarter of the time of `auto`."""


@pytest.fixture(scope="module")
def panda_json(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibration") / "panda.json"
    cw.calibrate(cw.read(PANDA), "mount").save(path)
    return path


@pytest.mark.slow
def test_calibrate_prints_the_calibration_and_writes_it(tmp_path: Path, capsys: Capture) -> None:
    target = tmp_path / "tool.json"
    done = run(capsys, "calibrate", PANDA, "-o", target, "--model", "mount")
    loaded = cw.Calibration.load(target)
    assert (done.status, done.err) == (0, "")
    assert done.out == f"{loaded}\nWrote the calibration to {target}\n"
    assert np.array_equal(loaded.parameters, cw.calibrate(cw.read(PANDA), "mount").parameters)


def test_calibrate_keeps_how_the_file_was_read(tmp_path: Path, capsys: Capture) -> None:
    run(capsys, "calibrate", PANDA, "-o", tmp_path / "tool.json", "--orientation", "quat_xyzw", *MOUNT)
    provenance = cw.Calibration.load(tmp_path / "tool.json").provenance
    assert provenance["source"] == str(PANDA)
    assert provenance["orientation"] == "quat_xyzw"
    assert (provenance["wrench_frame"], provenance["sign"]) == ("sensor", "pull")
    assert provenance["inverse_orientation"] is False
    assert provenance["rows"] == 17


@pytest.mark.slow
@pytest.mark.parametrize("flags", [["--json"], ["-o", "-"], ["--json", "-o", "-"]])
def test_the_saved_form_and_nothing_else_goes_to_stdout(tmp_path: Path, capsys: Capture, flags: list[str]) -> None:
    done = run(capsys, "calibrate", PANDA, *flags, *MOUNT)
    assert (done.status, done.err) == (0, "")
    assert to_json(cw.Calibration.load(written(tmp_path, done.out, "tool.json"))) == done.out


@pytest.mark.slow
def test_json_beside_a_file_prints_what_the_file_holds(tmp_path: Path, capsys: Capture) -> None:
    done = run(capsys, "calibrate", PANDA, "--json", "-o", tmp_path / "tool.json", *MOUNT)
    assert done.out == (tmp_path / "tool.json").read_text()


@pytest.mark.usefixtures("undrawn")
def test_calibrate_writes_a_report(tmp_path: Path, capsys: Capture) -> None:
    done = run(capsys, "calibrate", PANDA, "--report", tmp_path / "report.html", *MOUNT)
    assert done.status == 0
    assert done.out.endswith(f"\nWrote the report to {tmp_path / 'report.html'}\n")
    assert (tmp_path / "report.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("model", ["auto", "yaw", "mount", "mount+base", "affine"])
def test_calibrate_fits_the_model_that_is_asked_for(capsys: Capture, model: str) -> None:
    values = json.loads(run(capsys, "calibrate", PANDA, "--model", model, "--json").out)
    assert values["requested_model"] == model
    assert values["model"] == ("mount+base" if model == "auto" else model)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "missed"),
    [
        (["--require-force", "1", "--require-torque", "1"], ""),
        (["--require-force", "1e-3"], "force {force:.3g} N over 0.001"),
        (["--require-torque", "1e-4"], "torque {torque:.3g} N m over 0.0001"),
        (
            ["--require-force", "0", "--require-torque", "0"],
            "force {force:.3g} N over 0 and torque {torque:.3g} N m over 0",
        ),
    ],
)
def test_a_required_accuracy_that_is_missed_exits_1(
    tmp_path: Path, capsys: Capture, flags: list[str], missed: str
) -> None:
    done = run(capsys, "calibrate", PANDA, "--json", "-o", tmp_path / "tool.json", *flags, *MOUNT)
    force, torque = cw.Calibration.load(tmp_path / "tool.json").expected_error
    missed = missed.format(force=force, torque=torque)
    line = f"Required accuracy missed: at a new orientation, {missed}\n"
    assert (done.status, done.err) == ((1, line) if missed else (0, ""))
    assert done.out == (tmp_path / "tool.json").read_text()
    said = " ".join(run(capsys, "calibrate", PANDA, *flags, *MOUNT).out.split())
    assert (f"Verdict doubtful, and misses what is required, {missed}: " in said) == bool(missed)


@pytest.mark.parametrize("gain", [1.0, 1.05])
def test_strict_exits_1_unless_the_verdict_is_good(tmp_path: Path, capsys: Capture, gain: float) -> None:
    """A gain of its own on one axis is doubtful: no rigid tool explains it."""
    rig, R, rng = example(3)
    wrench = noisy(rig, R, rng).wrench * [gain, 1.0, 1.0, 1.0, 1.0, 1.0]
    path = written(tmp_path, matrix_table(wrench, R), "poses.csv")
    done, strict = (run(capsys, "calibrate", path, *flags) for flags in ([], ["--strict"]))
    assert (done.status, done.err, done.out) == (0, "", strict.out)
    assert f"Verdict  {'good' if gain == 1.0 else 'doubtful'}: " in done.out
    line = f"The verdict is doubtful, --strict expects good: {Doubt.MODEL}\n"
    assert (strict.status, strict.err) == ((0, "") if gain == 1.0 else (1, line))


def test_g_turns_the_weight_into_a_mass(capsys: Capture) -> None:
    values = json.loads(run(capsys, "calibrate", PANDA, "--json", "--g", "9.81", *MOUNT).out)
    assert values["mass"] == pytest.approx(values["weight"] / 9.81, rel=1e-12)


def test_show_prints_what_calibrate_printed(panda_json: Path, capsys: Capture) -> None:
    loaded = cw.Calibration.load(panda_json)
    assert run(capsys, "show", panda_json) == Run(0, f"{loaded}\n", "")
    assert run(capsys, "show", panda_json, "--json") == Run(0, panda_json.read_text(), "")


def test_verify_passes_on_the_same_tool_and_fails_on_another(tmp_path: Path, capsys: Capture) -> None:
    rig, R, rng = example(12)
    cw.calibrate(noisy(rig, R, rng), "mount").save(tmp_path / "tool.json")
    again = noisy(rig, random_rotations(10, rng), rng)
    same = written(tmp_path, matrix_table(again.wrench, again.R_base_flange), "same.csv")
    moved = written(tmp_path, matrix_table(again.wrench + 1.0, again.R_base_flange), "moved.csv")

    done = run(capsys, "verify", same, "-c", tmp_path / "tool.json")
    assert (done.status, done.err) == (0, "")
    assert done.out.splitlines()[-1].startswith(
        "PASSED  the residual is no more than the calibration's covariance and noise"
    )
    done = run(capsys, "verify", moved, "-c", tmp_path / "tool.json")
    assert (done.status, done.err) == (1, "")
    assert done.out.splitlines()[-1].startswith("FAILED  the residual is more than the calibration's covariance and")

    done = run(capsys, "verify", moved, "-c", tmp_path / "tool.json", "--json")
    values = json.loads(done.out)
    assert (done.status, done.err, values["passed"]) == (1, "", False)
    assert np.array(values["residuals"]) == pytest.approx(np.ones((10, 6)), abs=0.3)
    assert values["largest_force"] == pytest.approx(np.sqrt(3), abs=0.3)


@pytest.mark.parametrize(
    ("flags", "exceeded"),
    [
        (["--limit-force", "1", "--limit-torque", "1"], ""),
        (["--limit-force", "0.1"], "force {force:.3g} N over 0.1"),
        (["--limit-torque", "0.001"], "torque {torque:.3g} N m over 0.001"),
        (
            ["--limit-force", "0", "--limit-torque", "0"],
            "force {force:.3g} N over 0 and torque {torque:.3g} N m over 0",
        ),
    ],
)
def test_verify_holds_to_the_limits(panda_json: Path, capsys: Capture, flags: list[str], exceeded: str) -> None:
    samples = cw.read(PANDA)
    left = cw.Calibration.load(panda_json).compensate(samples.wrench, samples.R_base_flange)
    force, torque = np.linalg.norm(left[:, :3], axis=1).max(), np.linalg.norm(left[:, 3:], axis=1).max()
    done = run(capsys, "verify", PANDA, "-c", panda_json, *flags)
    assert (done.status, beside_its_doubt(done.err)) == (1 if exceeded else 0, "")
    failed = f"FAILED  largest {exceeded.format(force=force, torque=torque)}"
    assert done.out.splitlines()[-1] == (failed if exceeded else "PASSED  every pose is within the limits")


def test_verify_weighs_hung_loads(tmp_path: Path, capsys: Capture) -> None:
    rig, R, rng = example(12)
    cw.calibrate(noisy(rig, R, rng), "mount").save(tmp_path / "tool.json")
    loads = np.repeat([0.0, 0.2, 0.5], 6)
    turns = random_rotations(len(loads), rng)
    samples = noisy(rig, turns, rng)
    force = np.einsum("nji,j->ni", turns @ rig.R_flange_sensor, rig.down) * (9.80665 * loads)[:, None]
    wrench = samples.wrench + np.column_stack([force, np.cross([0.0, 0.0, 0.1], force)])
    table = np.column_stack([wrench, turns.reshape(-1, 9), 1e3 * loads])
    path = written(tmp_path, csv_text((*WRENCH, *MATRIX, "load_g"), table))

    done = run(capsys, "verify", path, "-c", tmp_path / "tool.json", "--json")
    values = json.loads(done.out)
    assert (done.status, len(values["residuals"])) == (0, 6)
    assert [w["actual"] for w in values["weighings"]] == pytest.approx([0.2, 0.5])
    for weighing in values["weighings"]:
        assert weighing["weighed"] == pytest.approx(weighing["actual"], abs=4 * weighing["std"])
        assert weighing["error"] == pytest.approx(weighing["weighed"] / weighing["actual"] - 1, abs=1e-12)
    done = run(capsys, "verify", path, "-c", tmp_path / "tool.json")
    assert "weighed g" in done.out


def test_diff_says_what_changed_and_exits_0(tmp_path: Path, panda_json: Path, capsys: Capture) -> None:
    samples = cw.read(PANDA)
    shifted = samples.wrench + np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    cw.calibrate(cw.Samples(shifted, samples.R_base_flange), "mount").save(tmp_path / "later.json")

    done = run(capsys, "diff", panda_json, tmp_path / "later.json", "--json")
    values = json.loads(done.out)
    assert (done.status, done.err) == (0, "")
    assert values["significant"] == ["bias_fz"]
    assert values["change"]["bias_fz"] == pytest.approx(3.0, abs=1e-6)
    assert values["change"]["weight"] == pytest.approx(0.0, abs=1e-6)
    done = run(capsys, "diff", panda_json, tmp_path / "later.json")
    assert done.out.splitlines()[-1] == "* more than 3 standard deviations: bias_fz"
    assert run(capsys, "diff", panda_json, panda_json).status == 0


USAGE = [
    ([], "Missing command: try 'contactwrench --help'"),
    (["tare"], "No such command 'tare': try 'contactwrench --help'"),
    (["calibrate"], "Missing argument 'FILE': try 'contactwrench calibrate --help'"),
    (["calibrate", PANDA, "--zzz"], "No such option: --zzz: try 'contactwrench calibrate --help'"),
    (
        ["calibrate", PANDA, "x"],
        "Invalid value: found 2 files, expected one, or --shared mount,gravity: try 'contactwrench calibrate --help'",
    ),
    (["calibrate", PANDA, "--model"], "Option '--model' requires an argument: try 'contactwrench --help'"),
    (["compensate", PANDA, "-o", "-"], "Missing option '--calibration' / '-c': try 'contactwrench compensate --help'"),
    (
        ["live", "--speed", "a\\b"],
        r"Invalid value for '--speed': found 'a\\b', expected a number: try 'contactwrench live --help'",
    ),
    (
        ["simulate", "--seed", "1.5"],
        "Invalid value for '--seed': found '1.5', expected a whole number: try 'contactwrench simulate --help'",
    ),
    (
        ["lab", "--sensor", "foo"],
        "Invalid value for '--sensor': found 'foo', expected one of 'sri', 'netft', 'ft300', 'robotiq', 'lines': try "
        "'contactwrench lab --help'",
    ),
    (["verify", PANDA], "Missing option '--calibration' / '-c': try 'contactwrench verify --help'"),
    (
        ["verify", PANDA, "-c", "x", "--limit-force", "nan"],
        "Invalid value for '--limit-force': found nan, expected 0 to 1e+09 N: try 'contactwrench verify --help'",
    ),
    (
        ["calibrate", PANDA, "--require-torque", "-1"],
        "Invalid value for '--require-torque': found -1, expected 0 to 1e+09 N m: try 'contactwrench calibrate --help'",
    ),
    (
        ["calibrate", PANDA, "--g", "0"],
        "Invalid value for '--g': found 0, expected 0.1 to 100 m/s^2: try 'contactwrench calibrate --help'",
    ),
    (
        ["calibrate", PANDA, "--model", "plane"],
        "model 'plane' is not known, expected one of auto, paper, yaw, mount, mount+base, affine, dynamic",
    ),
    (["calibrate", PANDA, "--gravity", "0,0"], "--gravity is '0,0', expected three numbers X,Y,Z, -1e+06 to 1e+06"),
    (
        ["calibrate", PANDA, "--gravity", "0,0,nan"],
        "--gravity is '0,0,nan', expected three numbers X,Y,Z, -1e+06 to 1e+06",
    ),
    (
        ["calibrate", PANDA, "--gravity", "0,0,0"],
        "--gravity is 0,0,0, expected three finite numbers X,Y,Z that are not all zero",
    ),
    (["calibrate", PANDA, "--sign", "push"], "sign is 'push', expected pull or reaction"),
    (["calibrate", PANDA, "--wrench-frame", "tool"], "wrench_frame is 'tool', expected sensor or base"),
    (
        ["calibrate", "gone.csv"],
        "gone.csv: there is no such file, expected a readable file: check the path",
    ),
    (
        ["calibrate", PANDA, "--known", ""],
        "found an empty argument, expected a file or a value: is a variable of the shell not set?",
    ),
    (["show", "gone.json"], "gone.json: there is no such file, expected a readable file: check the path"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "message"), USAGE)
def test_bad_use_is_one_line_and_status_2(capsys: Capture, arguments: list[str | Path], message: str) -> None:
    assert run(capsys, *arguments).complaint == message


@pytest.mark.parametrize(
    ("rows", "options", "found"),
    [
        (2, (), "cannot separate "),
        (2, ("--model", "affine"), "cannot separate "),
        (2, ("--model", "paper"), "cannot separate "),
        (17, ("--sign", "reaction"), "only a negative weight explains these readings ("),
        (17, ("--model", "mount+base", "--gravity", "0,1,0.2"), "gravity comes out "),
        (17, ("--model", "dynamic"), "found no times, "),
    ],
)
def test_what_readings_cannot_tell_is_said_of_their_file(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, rows: int, options: tuple[str, ...], found: str
) -> None:
    """Of one file, as of each with --shared."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "\n".join(PANDA.read_text().splitlines()[: 4 + rows]))
    said = run(capsys, "calibrate", "poses.csv", *options).complaint
    assert said.startswith(f"poses.csv: {found}")
    assert said.count("poses.csv") == 1


@pytest.mark.slow
def test_data_that_cannot_give_the_answer_are_one_line_and_status_2(tmp_path: Path, capsys: Capture) -> None:
    lines = PANDA.read_text().splitlines()
    two_poses = written(tmp_path, "\n".join(lines[:6]))
    assert "cannot separate" in run(capsys, "calibrate", two_poses, "-o", tmp_path / "tool.json").complaint
    assert "--sign reaction" in run(capsys, "calibrate", PANDA, "--sign", "reaction").complaint
    assert not (tmp_path / "tool.json").exists()


@pytest.mark.parametrize("flag", ["--help", "-h", "--version"])
def test_help_and_version_exit_0(capsys: Capture, flag: str) -> None:
    done = run(capsys, flag)
    assert (done.status, done.err) == (0, "")
    assert (cw.__version__ if flag == "--version" else "calibrate") in done.out


def test_help_says_each_verb_in_full_and_how_a_file_is_written_last(capsys: Capture) -> None:
    verbs = run(capsys, "--help").out
    assert "..." not in verbs.partition("Commands:")[2]
    assert "a robot, a ROS controller, code." in " ".join(verbs.split())
    sections = run(capsys, "compensate", "--help").out.split("\n\n")[-3:]
    assert [section.partition("\n")[0] for section in sections] == [
        "Arguments:",
        "Options:",
        "How the recording is written (most need none of these):",
    ]
    for option, section in (("--calibration", 1), ("--gravity", 1), ("--help", 1), ("--orientation", 2), ("--rate", 2)):
        assert [option in text for text in sections] == [section == k for k in range(3)]


def started(*arguments: str | Path, stdout: int = subprocess.PIPE) -> subprocess.CompletedProcess[bytes]:
    """The program in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "contactwrench", *arguments], stdout=stdout, stderr=subprocess.PIPE, check=False
    )


@pytest.mark.slow
def test_the_installed_program_runs(tmp_path: Path) -> None:
    program = Path(sysconfig.get_path("scripts")) / "contactwrench"
    if not program.exists():
        pytest.skip("the package is not installed in this environment")
    name = os.fsdecode(os.fsencode(tmp_path) + b"/K\xf6ln.csv") if os.name == "posix" else str(tmp_path / "Köln.csv")
    Path(name).write_bytes(PANDA.read_bytes())
    done = subprocess.run([program, "calibrate", name, "--json"], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads(done.stdout)["model"] == "mount+base"


@pytest.mark.slow
def test_bad_input_is_no_traceback_in_a_process_of_its_own(tmp_path: Path) -> None:
    done = started("calibrate", written(tmp_path, "fx,fy\n1,2\n"))
    assert (done.returncode, done.stdout, done.stderr.count(b"\n")) == (2, b"", 1)
    assert b"found no column fz" in done.stderr


@pytest.mark.slow
def test_a_reader_that_hangs_up_is_no_failed_check(panda_json: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = started("compensate", PANDA, "-c", panda_json, "-o", "-", stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.slow
def test_a_closed_stdout_is_no_traceback(panda_json: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "contactwrench", "compensate", str(PANDA), "-c", str(panda_json)]
    shell = " ".join([*command, "-o", str(tmp_path / "out.csv"), ">&-"])
    done = subprocess.run(["sh", "-c", shell], capture_output=True, check=False)
    assert (done.returncode, beside_its_doubt(done.stderr)) == (0, "")
    assert (tmp_path / "out.csv").exists()


def test_what_is_read_is_never_overwritten(tmp_path: Path, panda_json: Path, capsys: Capture) -> None:
    recording, cal = tmp_path / "run.csv", tmp_path / "cal.json"
    recording.write_bytes(PANDA.read_bytes())
    cal.write_bytes(panda_json.read_bytes())
    other = tmp_path / "x.json"
    for arguments, read in (
        (("calibrate", recording, "-o", recording), recording),
        (("calibrate", recording, "--report", recording), recording),
        (("compensate", recording, "-c", cal, "-o", recording), recording),
        (("compensate", recording, "-c", cal, "-o", cal), cal),
    ):
        said = f"{read}: found what is read as {read}, expected another file to write: name one"
        assert run(capsys, *arguments).complaint == said
        assert run(capsys, *arguments, "--force").complaint == said
    done = run(capsys, "calibrate", recording, "-o", other, "--report", other)
    assert done.complaint == f"{other}: found two outputs in one file, expected one each: name another"
    assert recording.read_bytes() == PANDA.read_bytes()
    assert cal.read_bytes() == panda_json.read_bytes()
    assert not other.exists()


def test_the_local_gravity_changes_no_contact_wrench_and_that_is_said(panda_json: Path, capsys: Capture) -> None:
    plain, stated = (
        run(capsys, "compensate", PANDA, "-c", panda_json, "-o", "-", *more) for more in ((), ("--g", "9.81"))
    )
    assert (plain.out, beside_its_doubt(plain.err)) == (stated.out, "")
    said = beside_its_doubt(stated.err)
    assert said == "Note: --g has no effect: it makes a weight a mass, and that is the calibration's\n"


def test_a_reading_flag_that_differs_from_the_calibrations_is_noted(panda_json: Path, capsys: Capture) -> None:
    done = run(capsys, "compensate", PANDA, "-c", panda_json, "-o", "-")
    assert beside_its_doubt(done.err) == ""
    json = run(capsys, "calibrate", PANDA, "--json", *MOUNT).out
    stored = panda_json.parent / "with_flags.json"
    stored.write_text(json)
    done = run(capsys, "verify", PANDA, "-c", stored, "--sign", "reaction")
    said = "Note: --sign was pull for the calibration and is reaction for this recording\n"
    assert beside_its_doubt(done.err) == said
    assert beside_its_doubt(run(capsys, "verify", PANDA, "-c", stored).err) == ""


@pytest.mark.slow
@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_disk_behind_stdout_is_one_line(panda_json: Path) -> None:
    for arguments in (("show", panda_json), ("compensate", PANDA, "-c", panda_json, "-o", "-")):
        with FULL.open("w") as full:
            done = started(*map(str, arguments), stdout=full.fileno())
        assert done.returncode == 2
        assert done.stderr.decode() == (
            "contactwrench: standard output cannot be written (no space left on device): check where it goes\n"
        )


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_disk_behind_a_file_is_one_line(panda_json: Path, capsys: Capture) -> None:
    message = "/dev/full: cannot be written (no space left on device): check the space on the disk and the permissions"
    assert run(capsys, "calibrate", PANDA, "-o", FULL, *MOUNT).complaint == message
    assert run(capsys, "compensate", PANDA, "-c", panda_json, "-o", FULL).complaint == message
