"""`contactwrench compensate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .reading import (
    DEFAULT_G,
    CalibrationFile,
    Gravity,
    InverseOrientation,
    Orientation,
    Recording,
    Sign,
    StandardGravity,
    WrenchFrame,
    gravity_direction,
    note_other_reading,
    read_recording,
    three_numbers,
)


def compensate(
    file: Recording,
    calibration: CalibrationFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="OUT.csv", help="Contact wrenches; - is stdout.")],
    output_frame: Annotated[
        str, typer.Option(metavar="sensor|flange|base", help="Axes of the contact wrench.")
    ] = "sensor",
    at: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Point of the torque, sensor axes, m (the TCP). [default: 0,0,0]"),
    ] = None,
    orientation: Orientation = "auto",
    wrench_frame: WrenchFrame = "sensor",
    sign: Sign = "pull",
    inverse_orientation: InverseOrientation = False,
    gravity: Gravity = None,
    g: StandardGravity = DEFAULT_G,
) -> None:
    """Subtract weight and bias: one contact wrench, with its standard deviation, for each row of FILE."""
    from ..calibration import Calibration
    from ..contact import contact_wrenches
    from ..files import require_distinct
    from ..recording.writers import write_contact_wrenches

    require_distinct(output, {"recording that is read": file, "calibration that is read": calibration})
    loaded = Calibration.load(calibration)
    samples = read_recording(file, orientation, wrench_frame, sign, inverse_orientation)
    note_other_reading(loaded.provenance, wrench_frame, sign, inverse_orientation)
    point = None if at is None else three_numbers(at, "--at")
    contact = contact_wrenches(loaded, samples, output_frame, point, gravity_direction(gravity))
    write_contact_wrenches(output, [contact], file)
