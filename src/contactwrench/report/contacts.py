"""A recording's contact wrenches written, and the page about them: over time, every contact, what was wrong."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ..calibration.calibration import Calibration
from ..compensate.contact_wrenches import TOUCHING, Contact, ContactWrenches
from ..errors import InputError
from ..files import STDOUT, write_text
from ..geometry.arrays import Array
from ..recording.bags.copy import write_bag_with
from ..recording.bags.open import SUFFIXES_OF_BAGS
from ..recording.compensate import Treatment, compensated
from ..recording.compensate_set import compensated_set
from ..recording.options import Options
from ..recording.read import begins_with_pairs, read_as_bag
from ..recording.tables.columns import Advance, Tell, unheard
from ..recording.tables.csv import SUFFIXES as SUFFIXES_OF_TEXT
from ..recording.tables.parquet import SUFFIXES as SUFFIXES_OF_PARQUET
from ..recording.tables.parquet import is_parquet
from ..recording.tables.write import write_contact_wrenches
from ..statistics import counted, meaningful_digits
from .figures import AXIS_COLOURS, WIDTH, drawing, svg_text
from .html import figure_html, page, paragraphs_html, plain_table
from .signals import Envelope, envelope, outline

SHADE, FAULT = "#f3d9a4", "#b3541e"
MOST_LISTED = 200
"""Contacts in the page's table."""
MOST_SHADED = 1000
MOST_NAMED = 3
"""Reasons why samples are not valid, in the summary."""


class ContactLog:
    """What a page needs to know of a recording that goes by in batches: a few thousand numbers, whatever its length."""

    def __init__(self) -> None:
        self.rows = self.faults = self.touching = 0
        self.start = self.end = np.nan
        self.envelope: Envelope | None = None
        self.contacts: list[Contact] = []
        self.reasons: dict[str, tuple[int, float]] = {}

    def noted(self, recording: Iterable[ContactWrenches], every: bool = True) -> Iterator[ContactWrenches]:
        """The same batches, each noted as it goes by; without `every` their rows are counted, no more."""
        for batch in recording:
            self.rows += len(batch)
            if every:
                self._note(batch)
            yield batch

    def _note(self, batch: ContactWrenches) -> None:
        self.contacts += batch.contacts
        if batch.t is None or not len(batch):
            return
        if not np.isfinite(self.start):
            self.start = float(batch.t[0])
        self.end = float(batch.t[-1])
        self.touching += int(np.sum(batch.contact == TOUCHING))
        self.envelope = envelope(batch.t, batch.wrench, self.envelope)
        for row in np.flatnonzero(~batch.valid).tolist():
            reason = batch.reason[row]
            if reason is not None:
                count, first = self.reasons.get(reason.kind, (0, float(batch.t[row])))
                self.reasons[reason.kind] = count + 1, first
        self.faults += int(np.sum(~batch.valid))


def require_writable(output: Path, path: Path, options: Options) -> None:
    """Raise `InputError` for an output that is neither a table nor, of a bag, a bag."""
    suffix, is_bag = output.suffix.lower(), read_as_bag(path, options)
    if suffix in (*SUFFIXES_OF_TEXT, *SUFFIXES_OF_PARQUET) or (is_bag and suffix in SUFFIXES_OF_BAGS):
        return
    more = ", or a bag" if is_bag else ""
    raise InputError(f"{output}: found the suffix {suffix}, expected .csv or .parquet{more}: name it so")


def compensate_recording(
    path: Path,
    options: Options,
    calibration: Calibration,
    treatment: Treatment,
    output: Path,
    report: Path | None,
    advance: Advance = unheard,
    episodes: Sequence[int] = (),
    *,
    accept_damaged: bool = False,
) -> tuple[list[str], list[str]]:
    """Compensate a recording, of a set each of its `episodes` by itself, and write what comes out to `output`: a table,
    a copy of the bag, or `-`, CSV on stdout; and a `report` about every contact, which the treatment must have judged.
    `accept_damaged`: of a set, leave out what cannot be compensated. Gives what to say: what was found and written, and
    notes on how. Raises as reading, pairing, compensating and writing do.
    """
    notes: list[str] = []
    log = ContactLog()
    if episodes:
        begins_with_pairs(path, options)  # raises where none can be read, before one of them is named
        rows = compensated_set(
            path, options, calibration, treatment, episodes, advance, notes.append, accept_damaged=accept_damaged
        )
    else:
        rows = compensated(path, options, calibration, treatment, advance, notes.append)
    noted = log.noted(rows, treatment.judged)
    topic = _write(output, noted, path, options, treatment.output_frame, notes.append)
    lines = [summary(log, len(episodes))] if treatment.judged else []
    if str(output) != STDOUT:
        what = counted(log.rows, "row") if topic is None else f"{counted(log.rows, 'message')} of {topic}"
        lines.append(f"Wrote the contact wrenches, {what}, to {output}")
    if report is not None:
        write_contact_report(report, "Contact report", log, (str(path),))
        lines += [f"Wrote the report to {report}"] if str(report) != STDOUT else []
    return lines, notes


def _write(
    output: Path, recording: Iterable[ContactWrenches], path: Path, options: Options, output_frame: str, note: Tell
) -> str | None:
    """Write the batches of a recording, in the axes `output_frame`: `-` is a table on stdout; a bag's suffix, or none
    where the recording is a folder, a copy of the bag. Gives the topic in which that has it; `note` is told what a
    damaged one lacks.
    """
    like_folder = os.path.isdir(path) and not output.suffix and str(output) != STDOUT
    if read_as_bag(path, options) and (output.suffix.lower() in SUFFIXES_OF_BAGS or like_folder):
        frame = None if output_frame == "sensor" else output_frame
        wrenches = (batch.wrench for batch in recording)
        topic, accept = options.wrench_topic, options.accept_damaged
        return write_bag_with(path, output, wrenches, wrench_topic=topic, frame=frame, accept_damaged=accept, note=note)
    beside = is_parquet(path) and output.suffix.lower() in SUFFIXES_OF_PARQUET
    every_row = beside and begins_with_pairs(path, options)
    write_contact_wrenches(output, recording, path, options, every_row=every_row)
    return None


def write_contact_report(path: str | Path, title: str, log: ContactLog, paragraphs: tuple[str, ...]) -> None:
    """Write the page. Raises `FileAccessError`, and `MissingExtraError` without matplotlib."""
    figure = figure_html(
        contact_signals(log),
        "Contact wrench over time, x red, y green, z blue: the band between the least and the most reading. "
        "Shaded: contact. Marks at the foot: the first sample of each kind that has something wrong.",
    )
    body = f"{paragraphs_html((summary(log),))}{figure}{_contacts(log)}{_faults(log)}"
    write_text(path, page(title, paragraphs, f"<section>{body}</section>"))


def summary(log: ContactLog, episodes: int = 0) -> str:
    """The recording in a sentence, or so many of a set."""
    contacts = "no contact"
    if log.contacts:
        contacts = f"{counted(len(log.contacts), 'contact')}, {log.touching / log.rows:.1%} of the time"
    most = sorted(log.reasons.items(), key=lambda reason: -reason[1][0])[:MOST_NAMED]
    why = ", ".join(f"{count} {kind}" for kind, (count, _) in most) + ", ..." * (len(log.reasons) > len(most))
    faults = f"{log.faults} not valid ({why})" if log.faults else "all valid"
    span = f"over {log.end - log.start if log.rows else 0.0:.4g} s"
    within = f"in {counted(episodes, 'episode')}" if episodes else span
    return f"{log.rows} samples {within}: {contacts}; {faults}."


def contact_signals(log: ContactLog) -> str:
    """Force and torque over the time from the first sample."""
    t, lines = outline(log.envelope or envelope(np.empty(0), np.empty((0, 6))))
    t -= log.start if np.isfinite(log.start) else 0.0
    with drawing(1, (WIDTH, 5.0), rows=2) as (figure, axes):
        for ax, part, name in zip(axes, (0, 3), ("force, N", "torque, N m"), strict=True):
            for contact in log.contacts[:MOST_SHADED]:
                end = log.end if contact.release is None else contact.release
                ax.axvspan(contact.onset - log.start, end - log.start, color=SHADE, lw=0)
            ax.axhline(0.0, color="#9aa2a9", lw=0.6)
            for k in range(3):
                ax.plot(t, lines[:, part + k], color=AXIS_COLOURS[k], alpha=0.85, lw=0.7)
            for _, first in log.reasons.values():
                ax.plot(first - log.start, 0.0, "|", color=FAULT, ms=8, transform=ax.get_xaxis_transform())
            ax.set(ylabel=name, xlim=(0.0, max(log.end - log.start, 1e-9) if log.rows else 1.0))
        axes[0].set_xticklabels([])
        axes[1].set_xlabel("time, s")
        return svg_text(figure)


def _contacts(log: ContactLog) -> str:
    if not log.contacts:
        return "<h3>Contacts</h3><p>None.</p>"
    rows = []
    for number, contact in enumerate(log.contacts[:MOST_LISTED], start=1):
        line = contact.line
        std = np.sqrt(np.diag(contact.covariance)[:3])
        force = np.linalg.norm(contact.mean[:3])
        f = contact.mean[:3] / force if force > 0.0 else contact.mean[:3]
        along = float(np.sqrt(f @ contact.covariance[:3, :3] @ f)) if force > 0.0 else float(std.max())
        lasts = "lasts" if contact.release is None else f"{contact.release - contact.onset:.3f}"
        cells = [
            str(number),
            f"{contact.onset - log.start:.3f}",
            lasts,
            " ± ".join(meaningful_digits(float(force), along)),
            f"{np.linalg.norm(contact.peak[:3]):.2f}",
            " ".join(f"{round(part, 2) + 0.0:.2f}" for part in line.direction) if line.reason is None else "-",
            line.reason or _place(line.point, line.point_covariance),
        ]
        rows.append(cells)
    point = "nearest point of its line to the sensor's origin, mm"
    table = plain_table(["", "onset, s", "length, s", "mean force, N", "peak, N", "direction", point], rows, "said")
    cut = f"<p>And {len(log.contacts) - MOST_LISTED} more.</p>" if len(log.contacts) > MOST_LISTED else ""
    said = (
        "Means over the whole contact in the sensor's axes, which turn with the arm. The line of action is that of one "
        "force; ± is one std of the mean, what the arm turned meanwhile left out."
    )
    return f"<h3>Contacts</h3>{table}{cut}<p class='unit'>{said}</p>"


def _place(point: Array, covariance: Array) -> str:
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return ", ".join(" ± ".join(meaningful_digits(1e3 * x, 1e3 * spread)) for x, spread in zip(point, std, strict=True))


def _faults(log: ContactLog) -> str:
    if not log.reasons:
        return ""
    in_time = sorted(log.reasons.items(), key=lambda item: item[1][1])
    rows = ([kind, str(count), f"{first - log.start:.3f}"] for kind, (count, first) in in_time)
    return f"<h3>Samples with something wrong</h3>{plain_table(['', 'samples', 'first at, s'], rows)}"
