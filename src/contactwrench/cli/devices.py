"""`contactwrench devices`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from . import options

if TYPE_CHECKING:
    from ..live.uri import Known

NARROW = 76
"""Columns of a URI's form, in a terminal of 80."""


def devices(json: bool = options.JSON) -> None:
    """Say what `live` can be connected to: every source and sink, how its URI is written, its rate, and what it was
    tested against; those of other packages that are installed too.
    """
    from ..calibration.text import COLUMNS
    from ..live.uri import known_sinks, known_sources
    from ..report.text import json_text

    found = {"sources": known_sources(), "sinks": known_sinks()}
    options.print_result(found, json, json_text, _text, elsewhere=COLUMNS)


def _text(found: dict[str, list[Known]]) -> str:
    lines = []
    for title, what in (("Sources: --sensor and --robot", found["sources"]), ("Sinks: --out", found["sinks"])):
        lines += [title, ""]
        for each in what:
            said = {"": each.about, "Rate: ": each.rate, "Tested against: ": each.tested, "Error: ": each.error}
            lines += [f"  {_broken(each.form)}", *(f"    {label}{text}" for label, text in said.items() if text), ""]
    return "\n".join(lines[:-1])


def _broken(form: str) -> str:
    """The form of a URI that is wider than a terminal, gone on with before one of its options."""
    lines = [""]
    for part in re.split(r"(?=\[[?&])", form):
        if len(lines[-1] + part) > NARROW and lines[-1]:
            lines.append("  ")
        lines[-1] += part
    return "\n  ".join(lines)
