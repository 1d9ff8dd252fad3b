"""`contactwrench calibrate`."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from .known import KNOWN_HELP, known_values, require_compatible
from .reading import (
    DEFAULT_G,
    Gravity,
    InverseOrientation,
    Json,
    Orientation,
    Recording,
    Sign,
    StandardGravity,
    WrenchFrame,
    above_zero,
    gravity_direction,
    not_negative,
    read_recording,
)


def calibrate(
    file: Recording,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="CAL.json", help="Write the calibration; - is stdout."),
    ] = None,
    model: Annotated[str, typer.Option(metavar="M", help="auto, paper, yaw, mount, mount+base or affine.")] = "auto",
    mount_tilt_sd: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="auto: std of the sensor's tilt, an axis. [default: 1.41]",
            callback=above_zero,
        ),
    ] = None,
    base_tilt_sd: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="auto: std of the base's tilt, an axis. [default: 0.71]", callback=above_zero),
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE+-STD", help=KNOWN_HELP),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="CAL.json", help="Earlier calibration of the same tool: one new pose gives its bias anew."
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="R.html", help="Write a report, one HTML file.")] = None,
    require_force: Annotated[
        float | None,
        typer.Option(metavar="N", help="Exit 1 if the calibration adds more force error (std).", callback=not_negative),
    ] = None,
    require_torque: Annotated[
        float | None,
        typer.Option(
            metavar="NM", help="Exit 1 if the calibration adds more torque error (std).", callback=not_negative
        ),
    ] = None,
    json: Json = False,
    orientation: Orientation = "auto",
    wrench_frame: WrenchFrame = "sensor",
    sign: Sign = "pull",
    inverse_orientation: InverseOrientation = False,
    gravity: Gravity = None,
    g: StandardGravity = DEFAULT_G,
) -> int:
    """Identify weight, centre of mass, bias and mounting from contact-free poses."""
    from ..calibrate import calibrate as fit
    from ..calibrate.auto import BASE_TILT_SD, MOUNT_TILT_SD
    from ..calibration import Calibration
    from ..calibration_file import to_json
    from ..files import require_distinct

    require_distinct(output, {"recording that is read": file, "report": report})
    require_distinct(report, {"recording that is read": file})
    require_compatible(model, gravity, known or [], prior, mount_tilt_sd, base_tilt_sd)
    samples = read_recording(file, orientation, wrench_frame, sign, inverse_orientation)
    calibration = fit(
        samples,
        model,
        gravity=gravity_direction(gravity),
        g=g,
        mount_tilt_sd=MOUNT_TILT_SD if mount_tilt_sd is None else float(np.deg2rad(mount_tilt_sd)),
        base_tilt_sd=BASE_TILT_SD if base_tilt_sd is None else float(np.deg2rad(base_tilt_sd)),
        known=known_values(known or [], g),
        prior=None if prior is None else Calibration.load(prior),
    )
    reading = {
        "orientation": orientation,
        "wrench_frame": wrench_frame,
        "sign": sign,
        "inverse_orientation": inverse_orientation,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    calibration = replace(calibration, provenance={**calibration.provenance, **reading})
    if output is not None:
        calibration.save(output)
    if report is not None:
        from ..report.html import write_calibration_report

        write_calibration_report(report, calibration)
    to_stdout = str(output) == "-"
    if json and not to_stdout:
        typer.echo(to_json(calibration), nl=False)
    elif not to_stdout:
        typer.echo(str(calibration))
        for path, what in ((output, "calibration"), (report, "report")):
            if path is not None:
                typer.echo(f"Wrote the {what} to {path}")
    force, torque = calibration.largest_std
    failed = [
        f"{name} {value:.3g} {unit} over {limit:g}"
        for name, value, limit, unit in (
            ("force", force, require_force, "N"),
            ("torque", torque, require_torque, "N m"),
        )
        if limit is not None and not value <= limit
    ]
    if failed:
        typer.echo(f"Required accuracy missed: largest std of the contact {' and '.join(failed)}", err=True)
    return 1 if failed else 0
