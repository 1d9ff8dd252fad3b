"""`contactwrench show`."""

from __future__ import annotations

from pathlib import Path

from . import options


def show(
    file: Path = options.argument("CAL.json", "Calibration that `calibrate` wrote."),
    json: bool = options.JSON,
) -> None:
    """Print a calibration: every parameter with its standard deviation, the verdict, the warnings."""
    from ..calibration.calibration import Calibration
    from ..calibration.file import to_json
    from ..calibration.text import COLUMNS, describe

    options.print_result(Calibration.load(file), json, to_json, describe, elsewhere=COLUMNS)
