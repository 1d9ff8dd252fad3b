"""`python -m tests_ros.workspace`: a colcon workspace of the node, and of tf2_msgs, which no wheel holds.

The wheels' CMake files name folders of the machine that built them; they are turned into those of this one first.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PREFIX = Path(sys.prefix)
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"
BUILT_ON = f"/opt/python/cp{VERSION.replace('.', '')}-cp{VERSION.replace('.', '')}"
MOVED = {f"{BUILT_ON}/include/python{VERSION}": sysconfig.get_path("include"), f"{BUILT_ON}/lib": f"{PREFIX}/lib"}


def main() -> int:
    """Build into `install` of this environment. Returns colcon's exit status."""
    for path in (PREFIX / "share").rglob("*.cmake"):
        text = path.read_text(encoding="utf-8")
        if BUILT_ON in text:
            for old, new in MOVED.items():
                text = text.replace(old, new)
            path.write_text(text, encoding="utf-8")
    prefix = {name: str(PREFIX) for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH")}
    found_in = {"PATH": f"{PREFIX / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    bases = [f"--{name}-base" for name in ("build", "install")]
    command = ["colcon", "--log-base", str(PREFIX / "log"), "build"]
    command += ["--base-paths", str(ROOT / "ros2"), str(ROOT / "tests_ros")]
    command += [word for base in bases for word in (base, str(PREFIX / base.split("-")[2]))]
    command += ["--cmake-args", f"-DPython3_EXECUTABLE={sys.executable}"]
    return subprocess.run(command, env=os.environ | prefix | found_in, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
