"""The pages of docs/robots/: their commands identify any tool, mounted anyhow, from what that recorder writes."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from contactwrench import Calibration
from tests.cli.test_first_files import assert_the_tool
from tests.support.brands import BRANDS
from tests.support.world import random_rig
from tests.test_docs import COMMAND, ROOT, blocks, folder, run_command

PAGES = ROOT / "docs" / "robots"
CALIBRATE = f"{COMMAND} calibrate "


def test_every_page_has_its_recorder() -> None:
    assert {page.stem for page in PAGES.glob("*.md")} == set(BRANDS)


@pytest.mark.parametrize("brand", BRANDS)
def test_a_page_identifies_any_tool(brand: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(list(BRANDS).index(brand))
    rig = random_rig(rng)
    with folder(tmp_path):
        BRANDS[brand](tmp_path, rig, rng)
        for _, items in blocks((PAGES / f"{brand}.md").read_text(encoding="utf-8")):
            for item in items:
                if item.kind == "python" and "recording.csv" in item.source:
                    exec(compile(item.source, brand, "exec"), {})
                elif item.source.startswith(CALIBRATE):
                    status = run_command(item.source, io.StringIO())
                    assert status == 0
    assert_the_tool(Calibration.load(tmp_path / "tool.json"), rig)


@pytest.mark.parametrize("brand", ["kuka-iiwa", "franka", "xarm", "my-own"])
def test_the_recorder_writes_what_the_pages_program_does(brand: str, tmp_path: Path) -> None:
    text = (PAGES / f"{brand}.md").read_text(encoding="utf-8")
    rng = np.random.default_rng(0)
    BRANDS[brand](tmp_path, random_rig(rng), rng)
    name = {"kuka-iiwa": "pose.csv", "my-own": "poses.csv"}.get(brand, "recording.csv")
    header = (tmp_path / name).read_text().partition("\n")[0]
    assert header in text or all(f'"{column}"' in text for column in header.split(",") if "O_T_EE" not in column)
