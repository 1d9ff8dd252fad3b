"""The report: one HTML file with everything in it, no network and no script."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from ..assess.verify import LeftOver, compare
from ..calibration.calibration import Calibration
from ..calibration.findings import BIAS_MOVED
from ..calibration.observability import LEVER
from ..calibration.text import alternative_rows, fit_facts, fit_rows, headline, parameter_rows, verdict_sentences
from ..estimation.findings_of_recording import contact_free
from ..files import write_text
from ..model import AXES
from ..samples.recorded_poses import is_stream
from ..samples.samples import Samples
from ..samples.still_segments import still_segments
from ..statistics import three_digits
from ..version import __version__
from . import figures, signals

HEAD = {"source": "file", "created": "calibrated", "robot": "robot", "wrench_topic": "sensor", "live_robot": "robot",
        "live_sensor": "sensor"}  # fmt: skip
"""What the head says of the provenance, as far as anybody stated it."""


@dataclass(frozen=True)
class Section:
    """A calibration with its figures, under a title and plain words; the `samples` it was made from, to be drawn."""

    title: str
    paragraphs: tuple[str, ...]
    calibration: Calibration
    samples: Samples | None = None
    missed: str = ""


def write_calibration_report(
    path: str | Path, calibration: Calibration, samples: Samples | None = None, missed: str = ""
) -> None:
    """Write the report of one calibration, with a picture of the `samples` that it was made from where they are a
    stream, and what it `missed`. Raises `FileAccessError`, and `MissingExtraError` without matplotlib.
    """
    write_report(path, "Calibration report", (), (Section(headline(calibration), (), calibration, samples, missed),))


def write_report(path: str | Path, title: str, introduction: tuple[str, ...], sections: tuple[Section, ...]) -> None:
    """Write a report of several calibrations, one after the other."""
    write_text(path, page(title, introduction, "".join(_section(section) for section in sections)))


def page(title: str, introduction: tuple[str, ...], body: str) -> str:
    """A whole page: `body` is HTML, the rest plain text."""
    style = (files(__package__) / "style.css").read_text(encoding="utf-8")
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{escape(title)}</title>\n'
        f"<style>\n{style}</style>\n</head>\n<body>\n<header><h1>{escape(title)}</h1>{paragraphs_html(introduction)}</header>"
        f"\n{body}<footer>contactwrench {__version__}</footer>\n</body>\n</html>\n"
    )


def _section(section: Section) -> str:
    c = section.calibration
    many = "<p>The fit has more than 10,000 poses; their moments are kept, so no pose is drawn.</p>"
    stated = [(name, str(c.provenance[key])) for key, name in HEAD.items() if c.provenance.get(key)]
    head = " · ".join(f"{name} <b>{escape(value).replace('+00:00', ' UTC')}</b>" for name, value in stated)
    drawn = figures.sensor_axes(c)
    axes = "The sensor's axes, the flange's (dotted), the centre of mass, and the weight in the first pose."
    axes += figures.CAPTION_OF_BODY if c.ellipsoid is not None else ""
    return (
        f"<section><h2>{escape(section.title)}</h2><p class='unit'>{head}</p>{paragraphs_html(section.paragraphs)}"
        f"{_verdict(c, section.missed)}"
        f"<div class='side-by-side'><div><h3>Parameters</h3>{_parameters(c)}</div>"
        f"<div>{figure_html(drawn, axes) if drawn else ''}{_principal(c)}</div></div>"
        f"<h3>Fit</h3>{_fit(c)}{_assumptions(c)}{_alternatives(c)}{_signals(c, section.samples)}"
        f"{_in_motion(c, section.samples)}{_left_out(c)}"
        f"{''.join(_poses(c)) if c.fitted_poses else many}{_provenance(c)}</section>\n"
    )


def _poses(c: Calibration) -> list[str]:
    methods = compare(c, c.fitted_poses)
    some_left_out = len(c.fitted_poses) < len(c.poses)
    shaded, hollow = (f" {mark}: poses that were left out." * some_left_out for mark in ("Shaded", "Hollow"))
    purposes = "".join(f"<li><b>{name}</b>: {escape(said)}</li>" for name, (_, _, said) in figures.METHODS.items())
    return [
        "<h3>What is left in each contact-free pose</h3>",
        "<p>Nothing touches the tool in these poses, so the contact wrench should be zero. What is left of it by each "
        f"method of compensation:</p><ul>{purposes}</ul>",
        paragraphs_html(_bias_moved(c)),
        figure_html(
            figures.left_over_per_pose(c, methods),
            f"Norm of what each method leaves, log scale, pose by pose in the order of time.{shaded}",
        ),
        _methods(methods),
        _pose_table(c, methods),
        "<h3>Residuals</h3>",
        figure_html(
            figures.residuals_per_pose(c, methods[0]),
            "What the fit leaves, axis by axis. The band is two standard deviations of the noise of a pose's reading."
            + shaded,
        ),
        "<h3>Directions of gravity that the poses covered, and the std of the contact wrench over all</h3>",
        figure_html(
            figures.std_over_orientations(c),
            "Gravity as seen from the flange, on the two halves of the sphere, equal areas. Dots: poses; those that "
            f"differ by a turn about the vertical fall on one point.{hollow} Colour: what the calibration's own std "
            "does, on a scale that ends where it is called weak: at 10 % of the weight, for the torque at a lever of "
            f"{1e3 * LEVER:.0f} mm.",
        ),
    ]


def _verdict(c: Calibration, missed: str) -> str:
    """The verdict in a box, which is green where it is good and nothing was missed; the warnings below it."""
    head, *reasons = verdict_sentences(c, missed)
    quality = "missed" if missed else c.verdict
    said = f"<strong>{escape(_sentence(head))}</strong> {escape(' '.join(map(_sentence, reasons)))}"
    return f'<div class="verdict {quality}">{said}</div>{_list(c.warnings) if c.warnings else ""}'


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + "."


def _bias_moved(c: Calibration) -> list[str]:
    """How the left-overs are to be read where the bias moved."""
    moved = [finding.kind.value.replace("_", " ") for finding in c.findings if finding.kind in BIAS_MOVED]
    return [
        f"But the {how}. The calibration holds the last bias; the poses before are drawn against it, and their "
        "residuals show by how much theirs was another."
        for how in moved
    ]


def _assumptions(c: Calibration) -> str:
    if not c.assumptions:
        return ""
    return f"<h3>What was assumed</h3>{_list(_sentence(assumption) for assumption in c.assumptions)}"


def _list(sentences: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{typeset(sentence)}</li>' for sentence in sentences)}</ul>"


def _alternatives(c: Calibration) -> str:
    """What other models make of the same poses."""
    if not c.alternatives:
        return ""
    head = ("", "weight, N", "left, N", "left, mN m", "change, N")
    said = (
        "Left: root mean square norm of what the model leaves in a pose, its parameters counted. Change: by how much "
        "the contact force would be another one, at the worst orientation."
    )
    table = plain_table(head, alternative_rows(c))
    return f"<h3>What other models make of the same poses</h3>{table}<p class='unit'>{said}</p>"


def _signals(c: Calibration, samples: Samples | None) -> str:
    """The recording over time, of a stream."""
    if samples is None or not is_stream(samples):
        return ""
    free, _ = contact_free(samples)
    still = still_segments(free)  # as the poses were made
    seconds = sum(stretch.t_end - stretch.t_start for stretch in still.accepted)
    hatched = signals.left_out_spans(c, still)
    numbered = " Hatched: stretches that were left out, by the numbers below." if hatched else ""
    return "<h3>The recording</h3>" + figure_html(
        signals.signals_over_time(c, free, still),
        f"Green: the {len(still.accepted)} stretches, {seconds:.3g} s in all, in which arm and reading were still; "
        f"those at one orientation are one pose.{numbered} The angle is that from where the arm began.",
    )


def _in_motion(c: Calibration, samples: Samples | None) -> str:
    """What is left while the arm moves, of a calibration that knows the inertia."""
    if samples is None or c.dynamics is None or samples.t is None:
        return ""
    free = contact_free(samples)[0]
    told = "poses tell accelerations" if c.dynamics.accelerometer is None else "orientations tell their own"
    said = (
        "What is left of the readings, less weight and bias alone, and less the inertia too; the spectrum is of the "
        f"whole recording. {c.dynamics.seconds:.3g} s of motion told the inertia; the {told} up to "
        f"{c.dynamics.bandwidth:.2g} Hz."
    )
    drawn = signals.left_in_motion(c, free)
    return "<h3>In motion</h3>" + figure_html(drawn, said)


def _left_out(c: Calibration) -> str:
    """The poses that were left out, why, and what the calibration leaves in them."""
    poses = [(k + 1, c.poses[k]) for k in figures.in_order_of_time(c) if c.poses[k].rejected is not None]
    if not poses:
        return ""
    timed = any(pose.t_start is not None for _, pose in poses)
    rows = []
    for number, pose in poses:
        left = c.compensate(pose.wrench, pose.R_base_flange)
        at = [] if not timed else [""] if pose.t_start is None else [f"{pose.t_start - c.first_time:.6g}"]
        norms = [three_digits(float(np.linalg.norm(part))) for part in (left[:3], 1e3 * left[3:])]
        rows.append([str(number), *at, *norms, pose.rejected or ""])
    table = plain_table(["pose", *(["time, s"] if timed else []), "left, N", "left, mN m", "why"], rows, "said")
    last = ", with the last bias" if _bias_moved(c) else ""
    said = f"{len(poses)} of {len(c.poses)} poses did not take part in the fit. Left: what compensation leaves{last}."
    return f"<h3>Poses that were left out</h3><p>{said}</p>{table}"


def _parameters(c: Calibration) -> str:
    rows = ([name, value, f"+- {std}" if std else "", unit] for name, value, std, unit in parameter_rows(c))
    return plain_table(["", "value", "std", "unit"], rows, "unit")


def _principal(c: Calibration) -> str:
    """Of the ellipsoid the moments and semi-axes, where the inertia is known."""
    return "" if c.ellipsoid is None else plain_table(figures.PRINCIPAL, figures.principal_rows(c.ellipsoid))


def _fit(c: Calibration) -> str:
    trade_offs = [f"trading off: {pair}" for pair in c.observability.trade_offs[:4]]
    return f"{plain_table(['N and mN m', *AXES], fit_rows(c))}{_list([*fit_facts(c), *trade_offs])}"


def _methods(methods: tuple[LeftOver, ...]) -> str:
    rows = (
        [method.name, kind, *map(three_digits, [*values[:3], *(1e3 * values[3:])])]
        for method in methods
        for kind, values in (("mean", method.mean_abs), ("largest", method.max_abs))
    )
    said = "Absolute values over the poses, N and mN m, as in the paper's Tables VII and VIII."
    return f"{plain_table(['', '', *AXES], rows)}<p class='unit'>{said}</p>"


def _pose_table(c: Calibration, methods: tuple[LeftOver, ...]) -> str:
    parts = [scale * method.wrench[:, k : k + 3] for k, _, scale in figures.PARTS for method in methods]
    norms = iter(np.linalg.norm(parts, axis=2).T)
    rows = [
        [str(k), *(["left out"] if pose.rejected is not None else map(three_digits, next(norms)))]
        for k, pose in enumerate(c.poses, start=1)
    ]
    head = ["pose", *(f"{method.name}, {unit}" for unit in ("N", "mN m") for method in methods)]
    table = plain_table(head, [rows[k] for k in figures.in_order_of_time(c)])
    return f"<details><summary>Every pose in numbers</summary>{table}</details>"


def _provenance(c: Calibration) -> str:
    rows = ([name, str(value)] for name, value in c.provenance.items())
    return f"<details><summary>Where this comes from</summary>{plain_table((), rows, 'said')}</details>"


def plain_table(head: Sequence[str], rows: Iterable[Sequence[str]], last: str = "") -> str:
    """A table of plain text, the first cell of a row its name; `last` is the last column's class in the style sheet."""
    body = "".join(_row(row, "td", last) for row in rows)
    return table_html(f"<thead>{_row(head, 'th', last)}</thead>{body}" if head else body)


def _row(cells: Sequence[str], kind: str, last: str) -> str:
    classes = [""] * (len(cells) - 1) + [f" class='{last}'" if last else ""]
    kinds = ["th", *[kind] * (len(cells) - 1)]
    each = (f"<{kind}{of}>{typeset(cell)}</{kind}>" for cell, kind, of in zip(cells, kinds, classes, strict=True))
    return f"<tr>{''.join(each)}</tr>"


def table_html(rows: str) -> str:
    """Rows of HTML in a box of their own, which scrolls where the page is narrower than the table."""
    return f"<div class='scroll'><table>{rows}</table></div>"


def figure_html(svg: str, caption: str) -> str:
    """An SVG or an `img` with a caption of plain text."""
    return f"<figure><div class='scroll'>{svg}</div><figcaption>{escape(caption)}</figcaption></figure>"


def paragraphs_html(paragraphs: Iterable[str]) -> str:
    """Plain text as paragraphs."""
    return "".join(f"<p>{typeset(paragraph)}</p>" for paragraph in paragraphs)


def typeset(text: str) -> str:
    """Plain text as HTML."""
    return escape(text).replace("+-", "±")
