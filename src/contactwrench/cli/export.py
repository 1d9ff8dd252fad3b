"""`contactwrench export`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import typer

from ..errors import InputError
from ..files import STDOUT
from ..geometry.ranges import SENSOR_MASS, TOOL_MASS
from . import options
from .outputs import output_option


def export(
    file: Path | None = options.argument("CAL.json", "Calibration that `calibrate` wrote.", default=None),
    to: str | None = options.text("FORMAT", "Whose parameters; --list names all."),
    output: Path = output_option("FILE", f"Where to; {options.OUTPUT_HELP} stdout.", Path(STDOUT)),
    list_formats: bool = options.switch("--list", "The formats, what each needs and loses."),
    tool_mass: float | None = options.number(
        TOOL_MASS, "KG", "The tool's mass as weighed, in place of the identified one."
    ),
    sensor_mass: float | None = options.number(SENSOR_MASS, "KG", "The sensor's own, with adapters."),
    sensor_com: str | None = options.text("X,Y,Z", "The sensor's centre of mass from the flange, m, flange axes."),
    sensor_offset: str | None = options.text("X,Y,Z", "The sensor's origin from the flange's, m, flange axes."),
    sensor_name: str | None = options.text("NAME", "The sensor's, in that program. [default: ft_sensor]"),
    sensor_frame: str | None = options.text("NAME", "Its frame's, in that program. [default: ft_frame]"),
    base_frame: str | None = options.text(
        "NAME", "The base's, in that program. [default: the recording's, or base_link]"
    ),
) -> None:
    """Write a calibration as the parameters of another program: a robot, a ROS controller, code."""
    from ..calibration.calibration import Calibration
    from ..files import write_text
    from ..report.export.exported import exported, list_text, target_named
    from ..report.export.target import Setup

    if list_formats:
        typer.echo(list_text())
        return
    if file is None or to is None:
        raise InputError("expected CAL.json and --to FORMAT: contactwrench export --list names the formats")
    target = target_named(to)
    every = {
        "tool_mass": tool_mass,
        "sensor_mass": sensor_mass,
        "sensor_com": options.point(sensor_com, "--sensor-com"),
        "sensor_offset": options.point(sensor_offset, "--sensor-offset"),
        "sensor_name": _name(sensor_name, "--sensor-name"),
        "sensor_frame": _name(sensor_frame, "--sensor-frame"),
        "base_frame": _name(base_frame, "--base-frame"),
    }
    stated: dict[str, Any] = {name: value for name, value in every.items() if value is not None}
    done = exported(target, Calibration.load(file), Setup(**stated), str(file))
    write_text(output, done.text)
    unused = [f"--{name.replace('_', '-')}" for name in stated if name not in ("tool_mass", *target.uses)]
    options.note(*done.notes, *([f"not used by {target.name}: {', '.join(unused)}"] if unused else []))


def _name(name: str | None, option: str) -> str | None:
    from ..report.export.target import NAME

    if name is not None and not re.fullmatch(NAME, name):
        raise InputError(f"{option} is {name!r}, expected a name of letters, digits and _ . / -")
    return name
