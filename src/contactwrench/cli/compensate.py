"""`contactwrench compensate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .reading import (
    DEFAULT_G,
    CalibrationFile,
    Gravity,
    Reading,
    Recording,
    StandardGravity,
    gravity_direction,
    note_other_reading,
    read_recording,
    three_numbers,
    with_reading_flags,
)


@with_reading_flags
def compensate(
    file: Recording = None,
    *,
    calibration: CalibrationFile,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="OUT.csv", help="Contact wrenches, CSV or .parquet; - is stdout."),
    ],
    output_frame: Annotated[
        str, typer.Option(metavar="sensor|flange|base", help="Axes of the contact wrench.")
    ] = "sensor",
    at: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Point of the torque, sensor axes, m (the TCP). [default: 0,0,0]"),
    ] = None,
    reading: Reading,
    gravity: Gravity = None,
    g: StandardGravity = DEFAULT_G,
) -> None:
    """Subtract weight and bias: one contact wrench, with its standard deviation, for each row of FILE."""
    from ..calibration import Calibration
    from ..contact import contact_wrenches
    from ..files import require_distinct
    from ..recording.writers import write_contact_wrenches

    path = reading.file(file)
    read = {"recording that is read": path, "recording of the poses that is read": reading.layout.pose_file}
    require_distinct(output, {**read, "calibration that is read": calibration})
    loaded = Calibration.load(calibration)
    samples = read_recording(path, reading.layout)
    note_other_reading(loaded.provenance, reading.layout)
    point = None if at is None else three_numbers(at, "--at")
    contact = contact_wrenches(loaded, samples, output_frame, point, gravity_direction(gravity))
    write_contact_wrenches(output, [contact], path)
