"""The pages of docs/robots/: their commands identify any tool, mounted anyhow, from what that recorder writes."""

from __future__ import annotations

import io
import shlex
from pathlib import Path

import numpy as np
import pytest

from contactwrench import Calibration
from contactwrench.geometry.wrench import STANDARD_GRAVITY
from tests.cli.test_first_files import assert_the_tool
from tests.support.brands import BRANDS
from tests.support.controllers import READERS, Load
from tests.support.world import Array, Rig, random_rig
from tests.test_docs import COMMAND, ROOT, blocks, folder, run_command

PAGES = ROOT / "docs" / "robots"
WRITTEN_BY_PROGRAM = {
    "kuka-iiwa": "pose.csv",
    "franka": "recording.csv",
    "xarm": "recording.csv",
    "my-own": "poses.csv",
}
"""What a page's own program writes."""


def test_every_page_has_its_recorder() -> None:
    assert {page.stem for page in PAGES.glob("*.md")} == set(BRANDS)


@pytest.mark.parametrize("brand", BRANDS)
def test_a_page_identifies_any_tool_and_its_payload(brand: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(list(BRANDS).index(brand))
    rig = random_rig(rng)
    text = (PAGES / f"{brand}.md").read_text(encoding="utf-8")
    with folder(tmp_path):
        BRANDS[brand](tmp_path, rig, rng)
        if brand in WRITTEN_BY_PROGRAM:
            assert_the_columns(Path(WRITTEN_BY_PROGRAM[brand]), text)
        for _, items in blocks(text):
            for item in items:
                if item.kind == "python" and "recording.csv" in item.source:
                    exec(compile(item.source, brand, "exec"), {})
                elif item.source.startswith((f"{COMMAND} calibrate", f"{COMMAND} compensate")):
                    assert run_command(item.source, io.StringIO()) == 0
                elif item.source.startswith(f"{COMMAND} export"):
                    assert_the_payload(item.source, rig)
        if Path("contact.csv").exists():
            assert_the_push(Path("contact.csv"))
    assert_the_tool(Calibration.load(tmp_path / "tool.json"), rig)


def assert_the_columns(path: Path, text: str) -> None:
    """The recorder writes those of the page's program."""
    header = path.read_text().partition("\n")[0]
    assert header in text or all(f'"{column}"' in text for column in header.split(",") if "O_T_EE" not in column)


def assert_the_push(path: Path) -> None:
    """In one second of working, 8 N along the sensor's -z; nothing in the rest, the arm's moves included."""
    fz = np.genfromtxt(path, delimiter=",", names=True)["fz"]
    assert abs(fz[fz < -4.0].mean() + 8.0) < 0.5
    assert np.abs(fz[fz > -4.0]).mean() < 0.5


def assert_the_payload(command: str, rig: Rig) -> None:
    """What the robot's own reader makes of it is the tool with the sensor that the flags state, within 5 mm and 1 %."""
    words = shlex.split(command)
    flags = dict(zip(words[4::2], words[5::2], strict=True))
    read = READERS.get(flags["--to"])
    if read is None:
        return
    out = io.StringIO()
    assert run_command(f"{command} -o payload.txt", out) == 0, out.getvalue()
    load, hung = read(Path("payload.txt").read_text()), hanging(rig, flags)
    assert abs(load.mass - hung.mass) < 0.01 * hung.mass
    assert np.abs(load.com - hung.com).max() < 0.005


def hanging(rig: Rig, flags: dict[str, str]) -> Load:
    def vector(flag: str) -> Array:
        return np.array([float(part) for part in flags.get(flag, "0,0,0").split(",")])

    tool, sensor = rig.weight / STANDARD_GRAVITY, float(flags["--sensor-mass"])
    com = tool * (vector("--sensor-offset") + rig.R_flange_sensor @ rig.com) + sensor * vector("--sensor-com")
    return Load(tool + sensor, com / (tool + sensor))
