"""The experiment as one HTML page, as Markdown with its pictures beside it, and as JSON."""

from __future__ import annotations

import re
from base64 import b64decode
from html import escape
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from contactwrench.files import make_folder, write_bytes, write_text
from contactwrench.report.html import figure_html, page, paragraphs_html, table_html, typeset
from contactwrench.statistics import meaningful_digits
from contactwrench.version import __version__

from .part import Measured, Part, Picture, Table

SCHEMA = "contactwrench/experiment/1"
TITLE = "The paper's experiment on a virtual rig"
INTRODUCTION = (
    "A KUKA iiwa 7 R800 with an SRI M8125 at its flange, simulated in MuJoCo, goes through Section IV of Yang, Li, "
    "Gao, Song, Li: Force Perception of Industrial Robot Based on Multi-parameter Coupled Model. What is true is "
    "known, so errors are errors and not residuals. The estimators see readings, the orientations that the robot "
    "states, and times; ours also takes tilts of mounting and base for small unless the readings say otherwise.",
    "Figures in the tables are given +- their standard error over independent data sets, robots or calibrations. "
    "Extremes, ends of intervals, shares beside their interval, and what is known exactly stand alone.",
)
MOST_DIGITS = 4
DATA_URI = re.compile(r'src="data:image/(?P<kind>png|gif);base64,(?P<data>[^"]+)"')


def write_experiment(folder: Path, parts: tuple[Part, ...], scale: float, seed: int) -> None:
    """Write report.html, figures.json, experiment.md and images/ to a folder. Raises `FileAccessError`."""
    images = folder / "images"
    make_folder(images)
    write_text(folder / "report.html", experiment_html(parts, scale, seed))
    write_text(folder / "figures.json", experiment_json(parts, scale, seed))
    write_text(folder / "experiment.md", experiment_markdown(parts, scale, seed))
    for part in parts:
        for picture in part.pictures:
            _write_picture(images, picture)


def experiment_html(parts: tuple[Part, ...], scale: float, seed: int) -> str:
    """One page with everything in it, no network and no script."""
    contents = "".join(f"<li><a href='#{part.key}'>{typeset(part.title)}</a></li>" for part in parts)
    return page(
        TITLE, (*_made(scale, seed), *INTRODUCTION), f"<nav><ol>{contents}</ol></nav>{''.join(map(_part_html, parts))}"
    )


def _made(scale: float, seed: int) -> tuple[str, ...]:
    """How the page was made, and a warning where it is only a look."""
    made = f"Made by python -m reproduction --seed {seed}"
    if scale >= 1.0:
        return (f"{made}.",)
    return (
        f"{made} with {scale:.0%} of the trials: a look at the report, no result. Standard errors of two or three "
        "trials mean nothing, nor do comparisons by them.",
    )


def _part_html(part: Part) -> str:
    pieces = [f"<section id='{part.key}'><h2>{typeset(part.title)}</h2>", paragraphs_html(part.paragraphs)]
    pieces += [figure_html(picture.html, picture.caption) for picture in part.pictures]
    for table in part.tables:
        head = "".join(f"<th>{typeset(column)}</th>" for column in ("", *table.columns))
        rows = "".join(
            f"<tr><th>{typeset(label)}</th>{''.join(map(_cell_html, cells))}</tr>" for label, cells in table.rows
        )
        note = f"<p class='unit'>{typeset(table.note)}</p>" if table.note else ""
        pieces.append(f"<h3>{typeset(table.title)}</h3>{table_html(f'<thead><tr>{head}</tr></thead>{rows}')}{note}")
    return "".join(pieces) + "</section>\n"


def _cell_html(cell: Measured | str | None) -> str:
    if not isinstance(cell, Measured):
        return f"<td>{escape(cell or '')}</td>"
    return f"<td title='{cell.trials} trial{'' if cell.trials == 1 else 's'}'>{typeset(shown(cell))}</td>"


def shown(cell: Measured) -> str:
    """The figure +- its standard error, with the digits that mean something, four of them at most."""
    if not cell.standard_error:
        return f"{cell.value:.4g}"
    value, error = meaningful_digits(cell.value, cell.standard_error)
    if float(value) == 0.0:
        return f"{value.removeprefix('-')} +- {error}"
    most = max(0, MOST_DIGITS - 1 - int(np.floor(np.log10(abs(cell.value)))))
    if len(value.partition(".")[2]) <= most:
        return f"{value} +- {error}"
    return f"{cell.value:.{most}f} +- {cell.standard_error:.2g}"


def experiment_markdown(parts: tuple[Part, ...], scale: float, seed: int) -> str:
    """The same as Markdown, its pictures in images/."""
    blocks = [f"# {TITLE}", *_made(scale, seed), *INTRODUCTION]
    for part in parts:
        blocks += [f"## {part.title}", *part.paragraphs]
        for picture in part.pictures:
            blocks += [f"![{picture.caption}](images/{_file_name(picture)})", f"*{picture.caption}*"]
        for table in part.tables:
            blocks += [f"### {table.title}", _table_markdown(table), *([table.note] if table.note else [])]
    return "\n\n".join(block.replace("+-", "±") for block in blocks) + "\n"


def _table_markdown(table: Table) -> str:
    def line(cells: list[str]) -> str:
        return f"| {' | '.join(cells)} |"

    rows = [
        line([label, *(shown(cell) if isinstance(cell, Measured) else cell or "" for cell in cells)])
        for label, cells in table.rows
    ]
    return "\n".join([line(["", *table.columns]), line(["---", *["---:"] * len(table.columns)]), *rows])


def _file_name(picture: Picture) -> str:
    data = DATA_URI.search(picture.html)
    return f"{picture.name}.{'svg' if data is None else data['kind']}"


def _write_picture(folder: Path, picture: Picture) -> None:
    data = DATA_URI.search(picture.html)
    path = folder / _file_name(picture)
    if data is None:
        write_text(path, picture.html)
    else:
        write_bytes(path, b64decode(data["data"]))


def experiment_json(parts: tuple[Part, ...], scale: float, seed: int) -> str:
    """Every figure under the keys of its part and table and the labels of its row and column."""

    def cell(of: Measured | str | None) -> Any:
        return msgspec.to_builtins(of)

    values = {
        "schema": SCHEMA,
        "version": __version__,
        "seed": seed,
        "scale": scale,
        "parts": {
            part.key: {
                "title": part.title,
                "paragraphs": part.paragraphs,
                "tables": {
                    table.key: {
                        "title": table.title,
                        "note": table.note,
                        "rows": {
                            label: dict(zip(table.columns, map(cell, cells), strict=True))
                            for label, cells in table.rows
                        },
                    }
                    for table in part.tables
                },
            }
            for part in parts
        },
    }
    return msgspec.json.format(msgspec.json.encode(values), indent=2).decode() + "\n"
