"""`contactwrench verify`."""

from __future__ import annotations

from typing import Annotated

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
    not_negative,
    note_other_reading,
    read_recording,
)


def verify(
    file: Recording,
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
    orientation: Orientation = "auto",
    wrench_frame: WrenchFrame = "sensor",
    sign: Sign = "pull",
    inverse_orientation: InverseOrientation = False,
    gravity: Gravity = None,
    g: WeighingGravity = None,
) -> int:
    """Hold a second, contact-free recording against a calibration; weigh the loads in its column load_g.

    Exit status 1 if the recording contradicts the calibration.
    """
    from ..calibration import Calibration
    from ..report.text import verification_json, verification_text
    from ..verify import verify as check

    loaded = Calibration.load(calibration).with_gravity(gravity_direction(gravity))
    samples = read_recording(file, orientation, wrench_frame, sign, inverse_orientation)
    note_other_reading(loaded.provenance, wrench_frame, sign, inverse_orientation)
    result = check(loaded, samples, limit_force=limit_force, limit_torque=limit_torque, g=g)
    typer.echo(verification_json(result) if json else verification_text(result))
    return 0 if result.passed else 1
