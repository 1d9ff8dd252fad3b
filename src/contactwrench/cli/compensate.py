"""`contactwrench compensate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .progress import progress
from .reading import (
    DEFAULT_G,
    CalibrationFile,
    Gravity,
    Reading,
    Recording,
    StandardGravity,
    gravity_direction,
    note,
    note_other_reading,
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
    from ..recording import pairs_in_batches, read_samples
    from ..recording.writers import write_contact_wrenches

    path = reading.file(file)
    read = {"recording that is read": path, "recording of the poses that is read": reading.layout.pose_file}
    require_distinct(output, {**read, "calibration that is read": calibration})
    loaded = Calibration.load(calibration)
    note_other_reading(loaded.provenance, reading.layout)
    point, direction = None if at is None else three_numbers(at, "--at"), gravity_direction(gravity)
    with progress(f"compensating {path.name}") as advance:
        batches = pairs_in_batches(path, reading.layout, advance=advance)
        samples = iter([read_samples(path, reading.layout, advance, note)]) if batches is None else batches
        contact = (contact_wrenches(loaded, some, output_frame, point, direction) for some in samples)
        write_contact_wrenches(output, contact, path)
