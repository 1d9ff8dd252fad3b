"""`contactwrench diagnose`."""

from __future__ import annotations

from pathlib import Path

import typer

from ..errors import InputError
from .reading import Gravity, Json, Reading, Recording, gravity_direction, with_reading_flags


@with_reading_flags
def diagnose(
    file: Recording = None,
    *,
    json: Json = False,
    reading: Reading,
    gravity: Gravity = None,
) -> None:
    """Find the reading of FILE that a rigid tool explains, and the flags that make it so.

    Tries every orientation convention, inverse and unit, both signs, wrenches in base axes, exchanged axes, shifted
    rows and torques in N mm. The reading flags say how the file is read as given.
    """
    from ..assess.diagnose import diagnose as rank
    from ..recording.interpretations import interpretations
    from ..report.diagnosis import diagnosis_json, diagnosis_text

    found = rank(interpretations(_one_table(reading, file), reading.layout, gravity_direction(gravity)))
    typer.echo(diagnosis_json(found) if json else diagnosis_text(found))


def _one_table(reading: Reading, file: Path | None) -> Path:
    """The file to read. Raises `InputError` where it is one of two: the rows of two do not belong together as they are
    written, and which belong together is not known before the orientation is.
    """
    path = reading.file(file)
    if reading.layout.pose_file is not None:
        raise InputError(
            f"{path}: found the wrenches of two files, expected one with wrench and orientation in a row: diagnose a "
            "recording of still poses in one table"
        )
    return path
