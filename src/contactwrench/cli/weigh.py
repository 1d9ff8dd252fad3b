"""`contactwrench weigh`."""

from __future__ import annotations

import typer

from .reading import (
    CalibrationFile,
    Gravity,
    Json,
    Reading,
    Recording,
    WeighingGravity,
    gravity_direction,
    note_other_reading,
    read_recording,
    with_reading_flags,
)


@with_reading_flags
def weigh(
    file: Recording = None,
    *,
    calibration: CalibrationFile,
    json: Json = False,
    reading: Reading,
    gravity: Gravity = None,
    g: WeighingGravity = None,
) -> None:
    """Mass and centre of mass of an object that the tool holds, from one or more poses."""
    from ..assess.weigh import weigh as weighed
    from ..calibration.calibration import Calibration
    from ..report.text import held_object_json, held_object_text

    path = reading.file(file)
    loaded = Calibration.load(calibration).with_gravity(gravity_direction(gravity))
    samples = read_recording(path, reading.layout)
    note_other_reading(loaded.provenance, reading.layout)
    held = weighed(loaded, samples, g=g)
    typer.echo(held_object_json(held) if json else held_object_text(held))
