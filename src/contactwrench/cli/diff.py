"""`contactwrench diff`."""

from __future__ import annotations

from pathlib import Path

from . import options


def diff(
    a: Path = options.argument("A.json", "The earlier calibration."),
    b: Path = options.argument("B.json", "The later calibration."),
    json: bool = options.JSON,
) -> None:
    """What changed between two calibrations, each change with its standard deviation."""
    from ..calibration.calibration import Calibration
    from ..report.text import difference_json, difference_text

    change = Calibration.load(a).diff(Calibration.load(b))
    options.print_result(change, json, difference_json, difference_text)
