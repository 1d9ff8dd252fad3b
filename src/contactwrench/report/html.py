"""The report."""

from pathlib import Path

from ..calibration import Calibration


def write_calibration_report(path: Path, calibration: Calibration) -> None:
    """Write it."""
