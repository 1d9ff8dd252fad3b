"""`contactwrench info`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .progress import progress
from .reading import Json


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording: a ROS bag or a table.")],
    json: Json = False,
) -> None:
    """Say what is in FILE: topics or columns, rates and gaps, what gives the wrench and what the pose."""
    from ..recording.contents import contents
    from ..report.contents import contents_json, contents_text

    with progress(f"reading {file.name}") as advance:
        found = contents(file, advance)
    typer.echo(contents_json(found) if json else contents_text(found))
