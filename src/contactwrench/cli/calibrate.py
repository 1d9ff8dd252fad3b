"""`contactwrench calibrate`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

from ..files import STDOUT
from ..geometry.arrays import Array
from ..geometry.ranges import LEFT_FORCE, LEFT_TORQUE, TILT_STD_DEG, TURN_DEG
from ..geometry.wrench import STANDARD_GRAVITY
from . import options
from .outputs import NAMES_FOLDER, Writes, output_option
from .recordings import Recordings, with_reading_options

KNOWN_HELP = (
    "What is known, with its std; may be repeated. weight=N, mass=KG, com=X,Y,Z (m) or com_mm=X,Y,Z (sensor axes), "
    "mount=A,B,C (deg, Rz(A) Ry(B) Rx(C)) or nine numbers row by row (R_flange_sensor), gravity=X,Y,Z (base axes); the "
    "std of the last two in deg. Example: weight=12.3+-0.1"
)
LENGTHS = {"weight": (1,), "mass": (1,), "com": (3,), "com_mm": (3,), "mount": (3, 9), "gravity": (3,)}
"""What may be known, and of how many numbers."""


def _calibrations(output: Path, values: Mapping[str, Any]) -> list[Path]:
    from ..report.calibrations import output_files

    return output_files(values["file"] or [], output, values["shared"] is not None)


@with_reading_options
def calibrate(
    *,
    output: Path | None = output_option(
        "CAL.json",
        f"Write the calibration; {options.OUTPUT_HELP} stdout. With --shared: the folder. [default: text on stdout]",
        files=_calibrations,
        suffix=".json",
    ),
    model: str = options.text(
        "M", "auto, paper, yaw, mount, mount+base, affine, or dynamic: auto, and the inertia.", default="auto"
    ),
    shared: str | None = options.text("mount,gravity", "Several tools on one sensor: what the recordings share."),
    mount_tilt_sd: float | None = options.number(
        TILT_STD_DEG, "DEG", "auto: std of the sensor's tilt, an axis. [default: 1.41]"
    ),
    base_tilt_sd: float | None = options.number(
        TILT_STD_DEG, "DEG", "auto: std of the base's tilt, an axis. [default: 0.71]"
    ),
    known: list[str] | None = options.text("NAME=VALUE+-STD", KNOWN_HELP),
    prior: Path | None = options.text(
        "CAL.json", "Earlier calibration of the same tool: one new pose gives its bias anew."
    ),
    sensor_offset: str | None = options.text(
        "X,Y,Z",
        "dynamic: the sensor's origin, m from the flange, or with --imu from the accelerometer, flange axes. "
        "[default: found]",
    ),
    noise: str | None = options.text(
        "N|FX,..,TZ|REST",
        "Std of one pose's reading, one or six, or a recording at rest. [default: from what the fit leaves]",
        mark=NAMES_FOLDER,
    ),
    report: Path | None = options.text("R.html", "Write a report, one HTML file.", mark=Writes(page=True)),
    require_force: float | None = options.number(
        LEFT_FORCE, "N", "Exit 1 if a larger error of the contact force is to be expected."
    ),
    require_torque: float | None = options.number(
        LEFT_TORQUE, "NM", "Exit 1 if a larger error of the torque is to be expected."
    ),
    require_mass: str | None = options.text("LOW,HIGH", "Exit 1 unless the mass, kg, lies inside by its std."),
    force: bool = options.switch(
        "--force", "Replace an existing output, never by a bad fit; write that to a new name."
    ),
    strict: bool = options.switch("--strict", "Exit 1 unless the verdict is good."),
    json: bool = options.JSON,
    recordings: Recordings,
    gravity: str | None = options.GRAVITY,
    g: float | None = options.CALIBRATING_G,
) -> int:
    """Identify weight, centre of mass, bias and mounting from contact-free poses."""
    from ..calibration.calibration import Calibration
    from ..calibration.text import COLUMNS
    from ..report.calibrations import calibrate_recordings

    known = known or []
    if sensor_offset is not None and model != "dynamic":
        raise typer.BadParameter(f"model {model} has no --sensor-offset: take --model dynamic, or leave it out")
    tilts = {"mount_tilt_sd": mount_tilt_sd, "base_tilt_sd": base_tilt_sd}
    _require_compatible(model, gravity, known, prior, tilts)
    masses = None if require_mass is None else _range_of_mass(require_mass, model)
    names = _shared_names(recordings.files, shared, model, known, {"--prior": prior, "--report": report})
    stated_noise = None if noise is None else options.noise_or_file(noise, "a sensor at rest")
    alike = None if prior is None else recordings.as_calibrated(Calibration.load(prior), None)
    recordings = recordings if alike is None else replace(recordings, options=alike.options)
    if g is None:
        g = STANDARD_GRAVITY if alike is None else alike.calibration.g
    stated: dict[str, Any] = {
        "model": model,
        "noise": recordings.beside(stated_noise).read() if isinstance(stated_noise, Path) else stated_noise,
        "gravity": options.gravity_direction(gravity),
        "g": g,
        "known": _known_values(known, g),
        **{name: float(np.deg2rad(sd)) for name, sd in tilts.items() if sd is not None},
    }
    if not names:
        stated["prior"] = None if alike is None else alike.calibration
        stated["sensor_offset"] = options.point(sensor_offset, "--sensor-offset")
    done = calibrate_recordings(
        recordings.files,
        recordings.read,
        names,
        stated,
        output=output,
        report=report,
        required=(require_force, require_torque),
        required_mass=masses,
        force=force,
    )
    options.note(*(() if alike is None else alike.notes))
    if json or str(output) == STDOUT:
        typer.echo(options.visible_lines(done.json), nl=False)
    elif str(report) != STDOUT:
        options.say(done.text, elsewhere=COLUMNS)
        for what, path in done.written:
            options.say(f"Wrote the {what} to {path}")
    failures = done.failures(strict)
    for line in failures:
        options.say(line, err=True)
    return 1 if failures else 0


def _shared_names(
    files: tuple[Path, ...], shared: str | None, model: str, known: list[str], of_one_file: dict[str, Path | None]
) -> tuple[str, ...]:
    """What --shared names, nothing for one file without it. Raises errors for options that do not go together."""
    if shared is None:
        if len(files) > 1:
            raise typer.BadParameter(f"found {len(files)} files, expected one, or --shared mount,gravity")
        return ()
    from ..estimation.several_tools import require_shareable

    for option, value in of_one_file.items():
        if value is not None:
            raise typer.BadParameter(f"{option} is for one file, found --shared too: leave one of them out")
    names = tuple(name.strip() for name in shared.split(","))
    require_shareable(len(files), names, model, {stated.partition("=")[0].strip(): stated for stated in known})
    real: dict[str, Path] = {}
    for file in files:
        first = real.setdefault(os.path.realpath(file), file)
        if first is not file:
            raise typer.BadParameter(f"found {file} twice, expected a recording of each tool: leave one out")
    return names


def _require_compatible(
    model: str, gravity: str | None, known: list[str], prior: Path | None, tilts: dict[str, float | None]
) -> None:
    """Raise typer's error for options that contradict each other, by name."""
    tilt = next((f"--{name.replace('_', '-')}" for name, value in tilts.items() if value is not None), "")
    gravity_known = any(stated.partition("=")[0].strip() == "gravity" for stated in known)
    one, free = "leave one of them out", model in ("auto", "dynamic")
    for contradicts, said in (
        (tilt and not free, f"{tilt} is for model auto, found --model {model}: {one}"),
        (tilt and prior, f"--prior brings its own mounting and base, found {tilt} too: {one}"),
        (prior and not free, f"--prior brings its model, found --model {model}: {one}"),
        (gravity is not None and gravity_known, f"--gravity and --known gravity both state it: {one}"),
        (known and model in ("paper", "affine"), f"model {model} takes nothing as known, found --known: {one}"),
        (
            gravity_known and model in ("yaw", "mount"),
            f"model {model} holds gravity, found --known gravity: take --model auto or mount+base",
        ),
    ):
        if contradicts:
            raise typer.BadParameter(said)


def _range_of_mass(text: str, model: str) -> tuple[float, float]:
    """What --require-mass says, kg. Raises typer's error."""
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        low = high = 0.0
    if not 0.0 < low < high < np.inf:
        raise typer.BadParameter(
            f"found --require-mass {text!r}, expected LOW,HIGH in kg, 0 < LOW < HIGH, as in 0.7,0.9"
        )
    if model == "affine":
        raise typer.BadParameter("model affine has no mass, found --require-mass: leave one of them out")
    return low, high


def _known_values(stated: list[str], g: float) -> dict[str, tuple[Any, Any]]:
    """What `--known` says, as `calibrate` takes it: SI units, the mounting a matrix, std of angles in rad."""
    known: dict[str, tuple[Any, Any]] = {}
    for text in stated:
        quantity, pair = _in_si(*_parsed(text), g)
        if quantity in known:
            raise typer.BadParameter(f"--known says {quantity} twice, expected once: leave one out")
        known[quantity] = pair
    return known


def _parsed(text: str) -> tuple[str, Array, Array]:
    name, _, rest = text.partition("=")
    value, _, std = rest.partition("+-")
    name = name.strip()
    try:
        numbers, spread = (np.array([float(number) for number in part.split(",")]) for part in (value, std))
    except ValueError:
        numbers = spread = np.empty(0)
    finite = np.isfinite(numbers).all() and np.isfinite(spread).all()
    stds = (1, 3) if name in ("com", "com_mm", "mount") else (1,)
    whole = name in LENGTHS and len(numbers) in LENGTHS[name] and len(spread) in stds
    if not (whole and finite and (spread > 0.0).all()):
        raise typer.BadParameter(
            f"found --known {text!r}, expected NAME=VALUE+-STD with a std above 0, as in weight=12.3+-0.1 or "
            f"com_mm=0,0,50+-2; names: {', '.join(LENGTHS)}"
        )
    return name, numbers, spread if len(spread) == 3 else np.full(3, spread[0])


def _in_si(name: str, value: Array, std: Array, g: float) -> tuple[str, tuple[Any, Any]]:
    """The quantity's name and its value and std in SI units."""
    if name in ("weight", "mass"):
        newtons = g if name == "mass" else 1.0
        return "weight", (newtons * float(value[0]), newtons * float(std[0]))
    if name in ("com", "com_mm"):
        per_metre = 1e3 if name == "com_mm" else 1.0
        return "com", (value / per_metre, std / per_metre)
    if name == "gravity":
        return name, (value, float(np.deg2rad(std[0])))
    if len(value) == 9:
        from ..geometry.orientation import nearest_rotations

        return name, (nearest_rotations(value.reshape(1, 3, 3))[0], np.deg2rad(std))
    from scipy.spatial.transform import Rotation

    angles = TURN_DEG.require(value, "known mount", (3,))
    return name, (Rotation.from_euler("ZYX", angles, degrees=True).as_matrix(), np.deg2rad(std))
