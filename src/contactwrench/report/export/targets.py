"""Every format of parameters, by its name."""

from __future__ import annotations

from ...errors import InputError
from . import code, research, robots, ros
from .target import Target

TARGETS = {target.name: target for target in (*ros.TARGETS, *research.TARGETS, *robots.TARGETS, *code.TARGETS)}


def target_named(name: str) -> Target:
    """A format, its name in any case. Raises `InputError`, naming all, for a name that is none."""
    if name.lower() not in TARGETS:
        raise InputError(f"--to is {name!r}, expected one of {', '.join(TARGETS)}: contactwrench export --list")
    return TARGETS[name.lower()]


def list_text() -> str:
    """All formats, each with the program that reads it, and what it needs beside the calibration and loses of it."""
    lines = []
    for target in TARGETS.values():
        needs, loses = f"needs {target.needs}" if target.needs else "", f"loses {target.loses}" if target.loses else ""
        lines += [target.name, *(f"    {said}" for said in (target.program, needs, loses) if said)]
    return "\n".join(lines)
