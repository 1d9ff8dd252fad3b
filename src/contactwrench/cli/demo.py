"""`contactwrench demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for calibrations, contact wrenches and report.")
    ] = Path("contactwrench-demo"),
) -> None:
    """Run the main job on two measured sets that come with the package, and say what the results mean."""
    from .demonstration import demonstrate

    demonstrate(out, typer.echo)
