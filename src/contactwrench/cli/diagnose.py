"""`contactwrench diagnose`."""

from __future__ import annotations

import typer

from .reading import (
    Gravity,
    InverseOrientation,
    Json,
    Orientation,
    Recording,
    Sign,
    WrenchFrame,
    gravity_direction,
)


def diagnose(
    file: Recording,
    json: Json = False,
    orientation: Orientation = "auto",
    wrench_frame: WrenchFrame = "sensor",
    sign: Sign = "pull",
    inverse_orientation: InverseOrientation = False,
    gravity: Gravity = None,
) -> None:
    """Find the reading of FILE that a rigid tool explains, and the flags that make it so.

    Tries every orientation convention, inverse and unit, both signs, wrenches in base axes, exchanged axes, shifted
    rows and torques in N mm. The reading flags say how the file is read as given.
    """
    from ..diagnose import diagnose as rank
    from ..recording.readings import readings
    from ..report.diagnosis import diagnosis_json, diagnosis_text

    found = rank(
        readings(
            file,
            orientation,
            wrench_frame,
            sign,
            inverse_orientation=inverse_orientation,
            gravity=gravity_direction(gravity),
        )
    )
    typer.echo(diagnosis_json(found) if json else diagnosis_text(found))
