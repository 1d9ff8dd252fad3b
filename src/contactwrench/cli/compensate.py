"""`contactwrench compensate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from ..errors import InputError
from .progress import progress
from .reading import (
    DEFAULT_G,
    CalibrationFile,
    Gravity,
    Reading,
    Recording,
    StandardGravity,
    gravity_direction,
    not_negative,
    note,
    note_other_reading,
    read_recording,
    three_numbers,
    with_reading_flags,
)

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..compensate.filters import LowPass
    from ..geometry.arrays import Array


@with_reading_flags
def compensate(
    file: Recording = None,
    *,
    calibration: CalibrationFile,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            help="Contact wrenches: .csv, .parquet, or, of a bag, a copy of it with a topic more; - is CSV on stdout.",
        ),
    ],
    output_frame: Annotated[
        str, typer.Option(metavar="sensor|flange|base", help="Axes of the contact wrench.")
    ] = "sensor",
    at: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Point of the torque, sensor axes, m (the TCP). [default: 0,0,0]"),
    ] = None,
    contact: Annotated[
        bool, typer.Option("--contact", help="Judge every sample: columns valid, contact and reason.")
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option(metavar="R.html", help="Write a page with every contact, one HTML file; judges every sample."),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="N|FREE",
            help="Judging: std of a free tool's reading, its motion's inertia included, or a recording of such motion. "
            "[default: the noise at rest]",
        ),
    ] = None,
    drift: Annotated[
        float | None,
        typer.Option(
            metavar="N",
            help="Judging: follow the bias in free space, a random walk with this std after an hour; 0.05 is typical.",
            callback=not_negative,
        ),
    ] = None,
    sensor_filter: Annotated[
        str | None,
        typer.Option(
            metavar="HZ[:ORDER]",
            help="The sensor's own low-pass, done to the model too; judges every sample. First order unless said.",
        ),
    ] = None,
    lowpass: Annotated[
        str | None,
        typer.Option(
            metavar="HZ[:ORDER]", help="Smooth the contact wrench both ways, Butterworth of order 1 to 4. [order: 2]"
        ),
    ] = None,
    delay: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="By how much later than the pose the wrench is stamped. [default: the calibration's]"
        ),
    ] = None,
    reading: Reading,
    gravity: Gravity = None,
    g: StandardGravity = DEFAULT_G,
) -> None:
    """Subtract weight and bias: one contact wrench, with its standard deviation, for each reading of FILE."""
    from ..calibration.calibration import Calibration
    from ..files import require_distinct
    from ..recording.compensate import Treatment, compensated, require_writable, write_compensated
    from ..report.contacts import ContactLog, summary, write_contact_report

    path = reading.file(file)
    read = {"recording that is read": path, "recording of the poses that is read": reading.layout.pose_file}
    require_distinct(output, {**read, "calibration that is read": calibration, "report": report})
    require_distinct(report, {**read, "calibration that is read": calibration})
    require_writable(output, path, reading.layout)
    loaded = Calibration.load(calibration)
    note_other_reading(loaded.provenance, reading.layout)
    judging = (noise, drift, sensor_filter, report)
    treatment = Treatment(
        output_frame=output_frame,
        point=None if at is None else three_numbers(at, "--at"),
        gravity=gravity_direction(gravity),
        delay=delay,
        low_pass=_low_pass(lowpass, "--lowpass", 2),
        judged=contact or any(flag is not None for flag in judging),
        sensor_filter=_low_pass(sensor_filter, "--sensor-filter", 1),
        drift=_six(drift),
        noise=None if noise is None else _noise(noise, reading, loaded.with_gravity(gravity_direction(gravity))),
    )
    notes: list[str] = []
    log = ContactLog()
    with progress(f"compensating {path.name}") as advance:
        rows = compensated(path, reading.layout, loaded, treatment, advance, notes.append)
        rows = log.watched(rows) if treatment.judged else rows
        write_compensated(output, rows, path, reading.layout, output_frame)
    for sentence in notes:
        note(sentence)
    if report is not None:
        write_contact_report(report, "Contact report", log, (str(path),))
    if treatment.judged:
        typer.echo(summary(log), err=str(output) == "-")
    if report is not None:
        typer.echo(f"Wrote the report to {report}", err=str(output) == "-")


def _low_pass(text: str | None, flag: str, usual_order: int) -> LowPass | None:
    """`HZ` or `HZ:ORDER`. Raises `InputError` naming the flag."""
    from ..compensate.filters import LowPass

    if text is None:
        return None
    cutoff, colon, order = text.partition(":")
    try:
        return LowPass(float(cutoff), int(order) if colon else usual_order)
    except InputError as error:
        raise InputError(f"{flag} {text}: {error}") from None
    except ValueError:
        raise InputError(f"{flag} is {text!r}, expected HZ or HZ:ORDER, as in 20 or 20:4") from None


def _noise(text: str, reading: Reading, calibration: Calibration) -> Array:
    """Std (6,) of a sample, or what compensation leaves (n, 6) of a recording of a free tool."""
    from ..compensate.noise import with_torques

    try:
        std = float(text)
    except ValueError:
        free = read_recording(Path(text), replace(reading.layout, pose_file=None))
        return calibration.compensate(free.wrench, free.R_base_flange)
    if not 0.0 < std < np.inf:
        raise InputError(f"--noise is {text}, expected N above 0, or a recording of a free tool")
    return with_torques(std)


def _six(force: float | None) -> Array | None:
    from ..compensate.noise import with_torques

    return None if force is None else with_torques(force)
