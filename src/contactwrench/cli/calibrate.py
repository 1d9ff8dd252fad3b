"""`contactwrench calibrate`."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

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
    from ..calibration_file import to_json
    from ..files import require_distinct

    require_distinct(output, {"recording that is read": file, "report": report})
    require_distinct(report, {"recording that is read": file})
    samples = read_recording(file, orientation, wrench_frame, sign, inverse_orientation)
    stds = {"mount_tilt_sd": mount_tilt_sd, "base_tilt_sd": base_tilt_sd}
    priors = {name: float(np.deg2rad(std)) for name, std in stds.items() if std is not None}
    if priors and model != "auto":
        flag = next(iter(priors)).replace("_", "-")
        raise typer.BadParameter(f"--{flag} is for model auto, found --model {model}: leave one of them out")
    calibration = fit(samples, model, gravity=gravity_direction(gravity), g=g, **priors)
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
