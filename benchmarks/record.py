"""The figures of every full run, line after line in a file, so that a change shows what it did to them."""

from __future__ import annotations

import csv
import subprocess
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import contactwrench as cw

from .table import Row

RESULTS = Path(__file__).parent / "results.csv"
HEADER = ("date", "version", "commit", "table", "what", "value", "unit", "target", "met", "standard_error")


def append(title: str, rows: Iterable[Row], path: Path = RESULTS) -> None:
    """Add the figures of a table, with the date (UTC), the version and the commit that they were measured at."""
    new = not path.exists()
    stamp = (datetime.now(UTC).strftime("%Y-%m-%d"), cw.__version__, commit())
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(HEADER)
        for row in rows:
            met = "" if not row.has_target else "yes" if row.met else "no"
            error = "" if row.standard_error is None else f"{row.standard_error:.2g}"
            writer.writerow((*stamp, title, row.what, f"{row.value:.6g}", row.unit, row.target, met, error))


def commit() -> str:
    """The commit that is checked out, short; empty where there is no git or no repository."""
    try:
        command = ["git", "rev-parse", "--short", "HEAD"]
        found = subprocess.run(command, cwd=RESULTS.parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return found.stdout.strip()
