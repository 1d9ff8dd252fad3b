"""`contactwrench export`: where it writes, what it lists, notes and refuses."""

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.report.export.exported import TARGETS, exported
from contactwrench.report.export.target import Setup
from tests.support.exports import unwrapped
from tests.support.recordings import Run, run
from tests.support.rigs import example, noisy

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def tool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rig, R, rng = example(11)
    path = tmp_path_factory.mktemp("calibration") / "tool.json"
    cw.calibrate(noisy(rig, R, rng), "mount").save(path)
    return path


def written(path: Path, name: str, **stated: object) -> str:
    return exported(TARGETS[name], cw.Calibration.load(path), Setup(**stated), str(path)).text  # type: ignore[arg-type]


def test_it_writes_to_stdout_and_to_a_file(tool: Path, tmp_path: Path, capsys: Capture) -> None:
    text = written(tool, "rh20t")
    assert run(capsys, "export", tool, "--to", "rh20t") == Run(0, text, "")
    assert run(capsys, "export", tool, "--to", "rh20t", "-o", "-") == Run(0, text, "")
    assert run(capsys, "export", tool, "--to", "rh20t", "-o", tmp_path / "rh20t.json") == Run(0, "", "")
    assert (tmp_path / "rh20t.json").read_text() == text


def test_what_is_stated_reaches_the_format(tool: Path, capsys: Capture) -> None:
    flags = ["--sensor-offset", "0.01,0,0.07", "--tool-mass", "0.9", "--sensor-name", "RightHand"]
    done = run(capsys, "export", tool, "--to", "mc_rtc", *flags)
    stated = {"sensor_offset": np.array([0.01, 0.0, 0.07]), "tool_mass": 0.9, "sensor_name": "RightHand"}
    assert done.out == written(tool, "mc_rtc", **stated)
    assert "\nNote: with these parameters the contact force is off by up to " in done.err
    flags = ["--sensor-frame", "wrist", "--base-frame", "world"]
    done = run(capsys, "export", tool, "--to", "admittance_controller", *flags)
    assert done.out == written(tool, "admittance_controller", sensor_frame="wrist", base_frame="world")


def test_what_is_lost_is_noted_where_it_is_more_than_the_calibration_s_own_error(tool: Path, capsys: Capture) -> None:
    done = run(capsys, "export", tool, "--to", "admittance_controller")
    first, said = done.err.splitlines()
    assert first.startswith("Note: the bias is not in here, this program has no parameter for it: `offset` of force_")
    assert f"# {said.removeprefix('Note: ')}" in unwrapped(done.out).splitlines()
    bias = float(np.linalg.norm(cw.Calibration.load(tool).bias[:3]))
    assert f"off by up to {bias:.4g} N" in said


def test_a_format_s_name_is_taken_in_any_case(tool: Path, capsys: Capture) -> None:
    assert run(capsys, "export", tool, "--to", "RH20T").out == written(tool, "rh20t")


def test_what_a_format_does_not_use_is_said(tool: Path, capsys: Capture) -> None:
    flags = ["--sensor-mass", "0.3", "--sensor-frame", "wrist", "--base-frame", "world"]
    done = run(capsys, "export", tool, "--to", "ft_tools_ros2", *flags)
    assert done.out == written(tool, "ft_tools_ros2", sensor_frame="wrist")
    assert "Note: not used by ft_tools_ros2: --sensor-mass, --base-frame" in done.err.splitlines()


def test_every_format_is_listed(capsys: Capture) -> None:
    done = run(capsys, "export", "--list")
    lines = done.out.splitlines()
    assert (done.status, done.err) == (0, "")
    assert [line for line in lines if line[0] != " "] == list(TARGETS)
    programs = [lines[lines.index(name) + 1].strip() for name in TARGETS]
    assert programs == [target.program for target in TARGETS.values()]
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "expected CAL.json and --to FORMAT: contactwrench export --list names the formats"),
        (["TOOL"], "expected CAL.json and --to FORMAT: contactwrench export --list names the formats"),
        (["TOOL", "--to", "ros"], "--to is 'ros', expected one of NAMES: contactwrench export --list"),
        (["TOOL", "--to", "rh20t", "-o", "TOOL"], "TOOL: found what is read as TOOL, expected another file to write: "
         "name one"),
        (["TOOL", "--to", "mc_rtc", "--sensor-offset", "1,2"],
         "--sensor-offset is '1,2', expected three numbers X,Y,Z, -2 to 2 m (is it in mm?)"),
        (["TOOL", "--to", "mc_rtc", "--sensor-com", "a,b,c"],
         "--sensor-com is 'a,b,c', expected three numbers X,Y,Z, -2 to 2 m (is it in mm?)"),
        (["TOOL", "--to", "rh20t", "--sensor-name", "my sensor"], "--sensor-name is 'my sensor', expected a name of "
         "letters, digits and _ . / -"),
        (["TOOL", "--to", "rh20t", "--tool-mass", "0"], "Invalid value for '--tool-mass': found 0, expected 1e-06 "
         "to 200 kg (is it in g?): try 'contactwrench export --help'"),
        (["TOOL", "--to", "rh20t", "--sensor-mass", "-1"], "Invalid value for '--sensor-mass': found -1, expected 0 "
         "to 50 kg (is it in g?): try 'contactwrench export --help'"),
        (["TOOL", "--to", "ur", "--sensor-mass", "350"],
         "Invalid value for '--sensor-mass': found 350, expected 0 to 50 kg (is it in g?): try 'contactwrench export "
         "--help'"),
        (["TOOL", "--to", "ur", "--tool-mass", "1e308"],
         "Invalid value for '--tool-mass': found 1e+308, expected 1e-06 to 200 kg (is it in g?): try 'contactwrench "
         "export --help'"),
        (["TOOL", "--to", "mc_rtc", "--sensor-offset", "0,0,45"],
         "--sensor-offset is '0,0,45', expected three numbers X,Y,Z, -2 to 2 m (is it in mm?)"),
        (["TOOL", "--to", "ur", "--sensor-com", "0,-1e300,2"],
         "--sensor-com is '0,-1e300,2', expected three numbers X,Y,Z, -2 to 2 m (is it in mm?)"),
    ],
)  # fmt: skip
def test_bad_use_is_one_line(arguments: list[str], complaint: str, tool: Path, capsys: Capture) -> None:
    done = run(capsys, "export", *[each.replace("TOOL", str(tool)) for each in arguments])
    assert done.complaint == complaint.replace("TOOL", str(tool)).replace("NAMES", ", ".join(TARGETS))


def test_a_file_that_is_no_calibration_is_refused(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "none.json"
    path.write_text("{}")
    assert run(capsys, "export", path, "--to", "rh20t").complaint == (
        f"{path}: found schema None, expected 'contactwrench/calibration/1': name a file that calibrate wrote"
    )
