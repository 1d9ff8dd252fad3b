"""Every format of parameters, by its name."""

from __future__ import annotations

from ...errors import InputError
from . import code, research, robots, ros
from .target import Target

TARGETS = {target.name: target for target in (*ros.TARGETS, *research.TARGETS, *robots.TARGETS, *code.TARGETS)}


def target_named(name: str) -> Target:
    """A format. Raises `InputError`, naming all, for a name that is none."""
    if name not in TARGETS:
        raise InputError(f"--to is {name!r}, expected one of {', '.join(TARGETS)}: contactwrench export --list")
    return TARGETS[name]


def list_text() -> str:
    """All formats in columns: name, file, what it needs beside the calibration, what it loses, and the program."""
    rows = [("format", "file", "needs", "cannot express", "program")]
    rows += [(t.name, t.suffix or "-", t.needs or "-", t.loses or "-", t.program) for t in TARGETS.values()]
    width = [max(len(row[k]) for row in rows) for k in range(4)]
    return "\n".join("  ".join(f"{cell:<{w}}" for cell, w in zip(row, [*width, 0], strict=True)) for row in rows)
