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
    from ..recording.contents import bag_contents, table_contents
    from ..recording.options import is_bag
    from ..report.text import contents_text, json_text

    with progress(f"reading {file.name}") as advance:
        contents = bag_contents(file, advance) if is_bag(file) else table_contents(file)
    typer.echo(json_text(contents) if json else contents_text(contents))
