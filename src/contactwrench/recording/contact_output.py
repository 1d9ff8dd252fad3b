"""Where contact wrenches go: a table, or a copy of the bag that they are of; and a page about the contacts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..compensate.contact_wrenches import ContactWrenches
from ..errors import InputError
from ..geometry.arrays import Array
from ..report.contacts import ContactLog, summary, write_contact_report
from .bags.copy import write_bag_with
from .bags.open import SUFFIXES_OF_BAGS
from .options import Layout, is_bag
from .tables.parquet import SUFFIXES as SUFFIXES_OF_PARQUET
from .tables.write import write_contact_wrenches

SUFFIXES_OF_TABLES = (".csv", ".tsv", ".txt", ".dat", "", *SUFFIXES_OF_PARQUET)


def require_writable(output: Path, path: Path, layout: Layout) -> None:
    """Raise `InputError` for an output that is neither a table nor, of a bag, a bag."""
    suffix = output.suffix.lower()
    if suffix in SUFFIXES_OF_TABLES or (suffix in SUFFIXES_OF_BAGS and is_bag(path, layout)):
        return
    more = ", or a bag" if is_bag(path, layout) else ""
    raise InputError(f"{output}: found the suffix {suffix}, expected .csv or .parquet{more}: name it so")


def write_contacts(
    output: Path,
    recording: Iterator[ContactWrenches],
    path: Path,
    layout: Layout,
    output_frame: str,
    judged: bool,
    report: Path | None,
) -> str | None:
    """Write what was made of the recording at `path`; what there is to say of it, where it was judged.

    A bag's suffix, or none where the recording is a folder, makes a copy of the bag with the contact wrench beside each
    reading; `-` is a table on stdout. Raises what the writers raise.
    """
    log = ContactLog()
    rows = log.watched(recording) if judged else recording
    like_folder = path.is_dir() and not output.suffix and str(output) != "-"
    if is_bag(path, layout) and (output.suffix.lower() in SUFFIXES_OF_BAGS or like_folder):
        frame = None if output_frame == "sensor" else output_frame
        write_bag_with(path, output, _wrenches(rows), wrench_topic=layout.wrench_topic, frame=frame)
    else:
        write_contact_wrenches(output, rows, path)
    if report is None:
        return summary(log) if judged else None
    write_contact_report(report, "Contact report", log, (str(path),))
    return f"{summary(log)}\nWrote the report to {report}"


def _wrenches(rows: Iterator[ContactWrenches]) -> Iterator[Array]:
    return (batch.wrench for batch in rows)
