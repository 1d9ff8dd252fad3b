"""The main job on two measured sets that come with the package: what `make demo` runs."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path

from .calibrate import calibrate
from .contact import contact_wrenches
from .recording import read
from .recording.csv import write_contact_wrenches


def demonstrate(folder: Path, say: Callable[[str], None]) -> None:
    """Calibrate and compensate the measured Panda set; files go to `folder`, words to `say`."""
    folder.mkdir(parents=True, exist_ok=True)
    with as_file(files("contactwrench") / "data" / "panda_mini45.csv") as path:
        samples = read(path)
    calibration = calibrate(samples, "mount")
    calibration.save(folder / "panda_mini45.json")
    write_contact_wrenches(folder / "panda_mini45_contact.csv", contact_wrenches(calibration, samples))
    say(str(calibration))
    say(f"Everything is in {folder}")
