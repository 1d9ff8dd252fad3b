"""`contactwrench weigh`."""

from __future__ import annotations

import typer

from .reading import (
    CalibrationFile,
    Gravity,
    InverseOrientation,
    Json,
    Orientation,
    Recording,
    Sign,
    WeighingGravity,
    WrenchFrame,
    gravity_direction,
    note_other_reading,
    read_recording,
)


def weigh(
    file: Recording,
    calibration: CalibrationFile,
    json: Json = False,
    orientation: Orientation = "auto",
    wrench_frame: WrenchFrame = "sensor",
    sign: Sign = "pull",
    inverse_orientation: InverseOrientation = False,
    gravity: Gravity = None,
    g: WeighingGravity = None,
) -> None:
    """Mass and centre of mass of an object that the tool holds, from one or more poses."""
    from ..calibration import Calibration
    from ..report.text import held_object_json, held_object_text
    from ..weigh import weigh as weighed

    loaded = Calibration.load(calibration).with_gravity(gravity_direction(gravity))
    samples = read_recording(file, orientation, wrench_frame, sign, inverse_orientation)
    note_other_reading(loaded.provenance, wrench_frame, sign, inverse_orientation)
    held = weighed(loaded, samples, g=g)
    typer.echo(held_object_json(held) if json else held_object_text(held))
