"""`contactwrench info`."""

from __future__ import annotations

from pathlib import Path

from . import options
from .streams import progress


def info(
    file: Path = options.argument("FILE", "Recording: a ROS bag or a table."),
    json: bool = options.JSON,
) -> int:
    """Say what is in FILE: topics or columns, rates and gaps, what gives the wrench and what the pose."""
    from ..recording.contents import BagContents, contents
    from ..report.text import contents_text, json_text

    with progress(f"reading {file.name}") as advance:
        result = contents(file, advance)
    options.print_result(result, json, json_text, contents_text)
    options.note(*options.doubtful_ends(file))
    return 1 if isinstance(result, BagContents) and result.damage else 0
