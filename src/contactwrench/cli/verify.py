"""`contactwrench verify`."""

from __future__ import annotations

from typing import Annotated

import typer

from .reading import (
    CalibrationFile,
    Gravity,
    Json,
    Reading,
    Recording,
    WeighingGravity,
    gravity_direction,
    not_negative,
    note_other_reading,
    read_recording,
    with_reading_flags,
)


@with_reading_flags
def verify(
    file: Recording = None,
    *,
    calibration: CalibrationFile,
    limit_force: Annotated[
        float | None,
        typer.Option(metavar="N", help="Largest contact force that may be left in a pose.", callback=not_negative),
    ] = None,
    limit_torque: Annotated[
        float | None,
        typer.Option(metavar="NM", help="Largest contact torque that may be left in a pose.", callback=not_negative),
    ] = None,
    json: Json = False,
    reading: Reading,
    gravity: Gravity = None,
    g: WeighingGravity = None,
) -> int:
    """Hold a second, contact-free recording against a calibration; weigh the loads in its column load_g.

    Exit status 1 if the recording contradicts the calibration.
    """
    from ..assess.verify import verify as check
    from ..calibration.calibration import Calibration
    from ..report.text import verification_json, verification_text

    path = reading.file(file)
    loaded = Calibration.load(calibration).with_gravity(gravity_direction(gravity))
    samples = read_recording(path, reading.layout)
    note_other_reading(loaded.provenance, reading.layout)
    result = check(loaded, samples, limit_force=limit_force, limit_torque=limit_torque, g=g)
    typer.echo(verification_json(result) if json else verification_text(result))
    return 0 if result.passed else 1
