"""`contactwrench calibrate`."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from ..files import STDOUT, make_folder, require_distinct
from .known import KNOWN_HELP, known_values, require_compatible
from .reading import (
    DEFAULT_G,
    RECORDING_HELP,
    Gravity,
    Json,
    Reading,
    StandardGravity,
    above_zero,
    gravity_direction,
    not_negative,
    read_recording,
    with_reading_flags,
)
from .several import json_of, output_files, shared_names

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration


@with_reading_flags
def calibrate(
    given: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FILE", help=f"{RECORDING_HELP} Several with --shared."),
    ] = None,
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="CAL.json", help="Write the calibration; - is stdout. With --shared: the folder."
        ),
    ] = None,
    model: Annotated[str, typer.Option(metavar="M", help="auto, paper, yaw, mount, mount+base or affine.")] = "auto",
    shared: Annotated[
        str | None,
        typer.Option(metavar="mount,gravity", help="Several tools on one sensor: what the recordings share."),
    ] = None,
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
    reading: Reading,
    gravity: Gravity = None,
    g: StandardGravity = DEFAULT_G,
) -> int:
    """Identify weight, centre of mass, bias and mounting from contact-free poses."""
    from ..estimation.priors import BASE_TILT_SD, MOUNT_TILT_SD

    files = reading.files(given)
    require_compatible(model, gravity, known or [], prior, mount_tilt_sd, base_tilt_sd)
    in_common = shared_names(files, shared, model, known or [], prior, report)
    paths = output_files(files, output) if in_common else [output]
    if not in_common:
        read: dict[str, str | Path | None] = {
            "recording that is read": files[0],
            "recording of the poses that is read": reading.layout.pose_file,
        }
        require_distinct(output, {**read, "report": report})
        require_distinct(report, read)
    recordings = [read_recording(file, reading.layout) for file in files]
    stated: dict[str, Any] = {
        "gravity": gravity_direction(gravity),
        "g": g,
        "mount_tilt_sd": MOUNT_TILT_SD if mount_tilt_sd is None else float(np.deg2rad(mount_tilt_sd)),
        "base_tilt_sd": BASE_TILT_SD if base_tilt_sd is None else float(np.deg2rad(base_tilt_sd)),
        "known": known_values(known or [], g),
    }
    if in_common:
        from ..estimation.several_tools import calibrate_shared

        calibrations = calibrate_shared(recordings, in_common, model, **stated)
    else:
        from ..calibration.calibration import Calibration
        from ..estimation.calibrate import calibrate as fit

        calibrations = (fit(recordings[0], model, prior=None if prior is None else Calibration.load(prior), **stated),)
    stated_of_file: dict[str, str | bool | None] = {
        "orientation": reading.layout.orientation,
        "wrench_frame": reading.layout.wrench_frame,
        "sign": reading.layout.sign,
        "inverse_orientation": reading.layout.inverse_orientation,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    calibrations = tuple(replace(one, provenance={**one.provenance, **stated_of_file}) for one in calibrations)
    if in_common and output is not None and str(output) != STDOUT:
        make_folder(output)
    for path, calibration in zip(paths, calibrations, strict=True):
        if path is not None:
            calibration.save(path)
    if report is not None:
        from ..report.html import write_calibration_report

        write_calibration_report(report, calibrations[0], recordings[0])
    _print(calibrations, bool(in_common), json, output)
    if not (json or str(output) == STDOUT):
        for written, what in (*((path, "calibration") for path in paths), (report, "report")):
            if written is not None:
                typer.echo(f"Wrote the {what} to {written}")
    failed = [line for one in calibrations for line in _missed(one, require_force, require_torque, bool(in_common))]
    for line in failed:
        typer.echo(line, err=True)
    return 1 if failed else 0


def _print(calibrations: tuple[Calibration, ...], several: bool, json: bool, output: Path | None) -> None:
    """The text or the JSON on stdout; a single calibration that went there already is not printed again."""
    from ..calibration.file import to_json

    to_stdout = str(output) == STDOUT
    if several and (json or to_stdout):
        typer.echo(json_of(calibrations), nl=False)
    elif json and not to_stdout:
        typer.echo(to_json(calibrations[0]), nl=False)
    elif not to_stdout:
        typer.echo("\n\n".join(map(str, calibrations)))


def _missed(calibration: Calibration, force: float | None, torque: float | None, named: bool) -> list[str]:
    """The line that says which of the required accuracies is missed, if one is."""
    largest, limits = calibration.largest_std, (force, torque)
    missed = [
        f"{name} {value:.3g} {unit} over {limit:g}"
        for name, value, limit, unit in zip(("force", "torque"), largest, limits, ("N", "N m"), strict=True)
        if limit is not None and not value <= limit
    ]
    where = f"{calibration.provenance['source']}: " if named else ""
    return [f"{where}Required accuracy missed: largest std of the contact {' and '.join(missed)}"] if missed else []
