"""`contactwrench diff`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .reading import Json


def diff(
    a: Annotated[Path, typer.Argument(metavar="A.json", help="The earlier calibration.")],
    b: Annotated[Path, typer.Argument(metavar="B.json", help="The later calibration.")],
    json: Json = False,
) -> None:
    """What changed between two calibrations, each change with its standard deviation."""
    from ..calibration.calibration import Calibration
    from ..report.text import difference_json, difference_text

    change = Calibration.load(a).diff(Calibration.load(b))
    typer.echo(difference_json(change) if json else difference_text(change))
