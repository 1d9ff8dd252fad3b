"""The pictures of docs/moving.md: the report's figures of recordings of the virtual rig.

`python -m tests.support.moving_pictures [FOLDER]`
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import contactwrench as cw
from contactwrench.report.figures import sensor_axes
from contactwrench.report.signals import left_in_motion
from tests.support.in_motion import moving

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "images" / "moving"
RECORDING = ("--trajectory", "stops:8", "--set", "tool.mass=1", "--set", "sensor.ranges=200", "--seed", "1")
"""As the page has it."""


def draw(folder: Path) -> None:
    """The tool of the page's recording, and what is left of one that goes as fast as the arm may, and shakes."""
    with tempfile.TemporaryDirectory() as temporary:
        swing = Path(temporary) / "swing.mcap"
        subprocess.run([sys.executable, "-m", "contactwrench", "simulate", *RECORDING, "-o", swing], check=True)
        tool = sensor_axes(cw.calibrate(cw.read(swing), "dynamic"))
    fast = moving(1, "arm.vibration=[0.1,0.2]", stops=8, seconds=20.0, rate=500.0).samples()
    left = left_in_motion(cw.calibrate(fast, "dynamic"), fast)
    folder.mkdir(parents=True, exist_ok=True)
    for name, svg in (("tool", tool), ("left", left)):
        (folder / f"{name}.svg").write_text(re.sub(r"(\d\.\d{3})\d+", r"\1", svg), encoding="utf-8")


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
