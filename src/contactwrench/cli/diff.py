"""`contactwrench diff`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options


def diff(
    a: Annotated[Path, typer.Argument(metavar="A.json", help="The earlier calibration.")],
    b: Annotated[Path, typer.Argument(metavar="B.json", help="The later calibration.")],
    json: options.Json = False,
) -> None:
    """What changed between two calibrations, each change with its standard deviation."""
    from ..calibration.calibration import Calibration
    from ..report.text import difference_json, difference_text

    change = Calibration.load(a).diff(Calibration.load(b))
    options.print_result(change, json, difference_json, difference_text)
