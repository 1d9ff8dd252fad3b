"""What the program says is a line that a terminal shows, and that still says what to do, however long names are."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.errors import LONGEST
from contactwrench.recording.read import read_streams
from tests.support.recordings import PANDA, WRENCH, csv_text, run, written
from tests.support.rigs import NOISE, example
from tests.support.world import Array, noisy_readings
from tests.support.written import QUAT, quat

Capture = pytest.CaptureFixture[str]
NAMES = ("x", "my data my data m", 38 * "y", "left wrist/" * 5, 150 * "z")
HEADERS = {
    "no orientation": (*WRENCH, "{} a", "{} b"),
    "a list of four": (*WRENCH, *(f"{{}}[{k}]" for k in range(4))),
    "many columns": (*WRENCH, *(f"{k}{{}}({k})" for k in range(40))),
    "no wrench": ("{} a", *QUAT),
    "no torque": (*WRENCH[:3], *(f"{{}}.p{axis}" for axis in "xyz"), *QUAT),
    "two wrenches": (*(f"{sensor}{{}}.force.{axis}" for sensor in "ab" for axis in "xyz"), *WRENCH[3:], *QUAT),
    "an unknown unit": (*(f"{part}_{{}} [furlong]" for part in WRENCH), *QUAT),
    "degrees of a UR": (*WRENCH, *(f"{{}}.r{axis} [deg]" for axis in "xyz")),
    "an estimate": (*(f"{{}}.O_F_ext_hat_K[{k}]" for k in range(6)), *QUAT),
}
FLAGS = (
    (),
    ("--time-column", "{}"),
    ("--orientation", "quat_xyzw:{0}1,{0}2,{0}3,{0}4"),
    ("--wrench-columns", "{}[0:6]"),
)


def _said(capsys: Capture, *arguments: str | Path) -> str:
    """The one line of a run that was refused, which a terminal shows."""
    complaint = run(capsys, *arguments).complaint
    assert len(f"contactwrench: {complaint}") <= LONGEST
    return complaint


@pytest.mark.parametrize("header", HEADERS)
def test_of_a_table(tmp_path: Path, capsys: Capture, header: str) -> None:
    for k, (file, name) in enumerate((*product(NAMES[3:], NAMES[1::3]), (NAMES[0], NAMES[2]), (NAMES[1], NAMES[3]))):
        names = [each.format(name) for each in HEADERS[header]]
        path = written(tmp_path, csv_text(names, np.eye(len(names))), f"{file.replace('/', '-')}.csv")
        said = _said(capsys, "calibrate", path, *(flag.format(name) for flag in FLAGS[k % len(FLAGS)]))
        assert ": " in said.partition(", expected ")[2]


def _recordings() -> Iterator[tuple[Array, Array]]:
    """Orientations (n, 3, 3) and readings (n, 6) that are reversed, inverse, next to nothing, or of few poses."""
    for weight, poses in ((0.3, 9), (20.0, 3)):
        rig, R, rng = example(1, poses=poses)
        wrench = noisy_readings(replace(rig, weight=weight), R, NOISE, rng)
        yield R, -wrench
        yield R.transpose(0, 2, 1), wrench
        yield R, 1e-12 * wrench
        yield R[:1] @ Rotation.from_euler("z", np.arange(poses)[:, None]).as_matrix(), wrench


def test_of_signs_and_poses(tmp_path: Path, capsys: Capture) -> None:
    found = set()
    for (R, wrench), model in zip(_recordings(), cycle(("mount+base", "yaw")), strict=False):
        for columns, numbers in (((*QUAT,), quat(R)), (("a", "b", "c"), Rotation.from_matrix(R).as_euler("ZYX"))):
            path = written(tmp_path, csv_text((*WRENCH, *columns), np.column_stack([wrench, numbers])))
            done = run(capsys, "calibrate", path, "--model", model, "--gravity", "0.0123457,-0.0234568,-0.987654")
            if done.status == 2:
                assert len(done.err) <= LONGEST + 1
                assert "…" not in done.err or "likely in radians" in done.err
                name, said = done.err.split(": ")[1:3]
                assert name in (str(path), path.name)
                found.add(said[:20])
    assert len(found) > 2


def _of_its_own(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The program in a process of its own, as only there its streams take what is no text."""
    command = [sys.executable, "-m", "contactwrench", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.skipif(sys.platform != "linux", reason="names of any bytes")
def test_a_name_that_is_no_text_is_read_and_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    pytest.importorskip("mujoco")
    name = "\udcff"
    (tmp_path / f"{name}.csv").write_text("qx,qy,qz,qw\n0,1,0,0\n")
    monkeypatch.chdir(tmp_path)
    simulated = run(capsys, "simulate", "-o", "out.mcap", "--poses", f"{name}.csv")
    assert (simulated.status, simulated.err) == (0, "")
    assert json.loads((tmp_path / "out.truth.json").read_text())["command"]["poses"] == "\\xff.csv"
    (tmp_path / "out.mcap").rename(tmp_path / f"{name}.mcap")
    done = _of_its_own(tmp_path, "info", f"{name}.mcap", "--json")
    assert (done.stderr, json.loads(done.stdout)["path"]) == ("", "\\xff.mcap")
    streams = read_streams(tmp_path / f"{name}.mcap")
    read = [each.source.encode().rpartition(b"/")[2] for each in (streams.wrench, streams.orientation)]
    assert read == [b"wrench", b"pose"]


@pytest.mark.skipif(sys.platform != "linux", reason="arguments of any bytes")
def test_a_text_that_is_no_text_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "calibrate", PANDA, "--base-frame", "\udcff", "-o", "tool.json").complaint == (
        "found '\\udcff', which is not UTF-8, expected a text that is: write it so"
    )
    done = _of_its_own(tmp_path, "live", "--sensor", "udp://\udcff:1")
    assert (done.returncode, done.stderr) == (
        2,
        "contactwrench: udp://\\udcff:1: found no URI ('utf-8' codec can't encode character '\\udcff' in position 0: "
        "surrogates not allowed), expected one like sri://192.168.0.108:4008\n",
    )
    assert not any(tmp_path.iterdir())
