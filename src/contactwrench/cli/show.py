"""`contactwrench show`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .reading import Json


def show(
    file: Annotated[Path, typer.Argument(metavar="CAL.json", help="Calibration that `calibrate` wrote.")],
    json: Json = False,
) -> None:
    """Print a calibration: every parameter with its standard deviation, the verdict, the warnings."""
    from ..calibration.calibration import Calibration
    from ..calibration.file import to_json

    calibration = Calibration.load(file)
    typer.echo(to_json(calibration) if json else f"{calibration}\n", nl=False)
