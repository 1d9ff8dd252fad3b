"""The whole experiment, short: every part is there, the page and the figures hold together, a seed is a seed."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

import contactwrench as cw

pytest.importorskip("mujoco", reason="mujoco is not installed")
pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from contactwrench.errors import MissingExtraError
from contactwrench.report.figures import svg_text
from reproduction import (
    film,
    identification_trials,
    joint_torque_figure,
    methods,
    peg,
    pushing,
    sources_of_error,
    task_trials,
)
from reproduction.methods import METHODS
from reproduction.page import experiment_markdown, shown, write_experiment
from reproduction.part import Measured, Part, Picture, Table, mean, root_mean_square, share, wilson
from reproduction.run import STEPS, run
from reproduction.summary import summary
from tests.support.experiments import undrawn

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.slow  # one run of the whole experiment serves nearly all of them
PIXEL = "data:image/png;base64," + b64encode(b"\x89PNG is what it begins with").decode()


@pytest.fixture(scope="module")
def short() -> Iterator[tuple[Part, ...]]:
    """Two trials of everything, in short motions; two sources of error of one size, all are in their own test, as is
    what `auto` makes of each part. One chart is drawn: the others are in theirs.
    """
    two = list(sources_of_error.SOURCES.items())[:2]
    one_size = {name: replace(source, sizes=source.sizes[:1]) for name, source in two}
    cells = ((sources_of_error.NONE, 0.0), *((name, source.sizes[0]) for name, source in one_size.items()))
    with undrawn(), pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(1) as pool:
        patch.setattr(joint_torque_figure, "svg_text", svg_text)
        patch.setattr(pushing, "SETTLED", 0.3)
        patch.setattr(pushing, "ROUND", 0.2)
        patch.setattr(peg, "LONGEST", 0.2)
        patch.setattr(film, "frames", _nothing)
        patch.setattr(sources_of_error, "SOURCES", one_size)
        patch.setattr(sources_of_error, "CELLS", cells)
        patch.setattr(sources_of_error, "ESTIMATORS", {name: METHODS[name] for name in ("ours", "paper")})
        for calibrating in (methods, identification_trials, task_trials):
            patch.setattr(calibrating, "calibrate", _as_the_rig_is)
        done: list[str] = []
        parts = run(pool, 0.0, 1, done.append)
        assert sorted(done) == sorted(step.name for step in STEPS)
        yield parts


def _as_the_rig_is(samples: cw.Samples, model: str) -> cw.Calibration:
    """With what `auto` has to find out known: a fifth of its time."""
    return _calibrated(samples, model if model == "paper" else "yaw")


_calibrated = lru_cache(maxsize=8)(cw.calibrate)
"""Several methods ask the same of a recording."""


def _nothing(*_: object) -> None:
    raise film.NoPicturesError("no pictures in this test")


def test_every_question_of_the_paper_has_its_part(short: tuple[Part, ...]) -> None:
    assert [part.key for part in short] == [
        *("summary", "identification", "weighing", "planned", "joint_torques", "prior_work", "sources_of_error"),
        *("guarded_move", "pushing", "peg"),
    ]
    for part in short:
        assert part.paragraphs, part.key
        assert part.tables, part.key
        for table in part.tables:
            assert all(len(cells) == len(table.columns) for _, cells in table.rows), table.key
            assert len({label for label, _ in table.rows}) == len(table.rows), table.key


def test_the_headline_is_taken_from_the_parts(short: tuple[Part, ...]) -> None:
    found = {
        (part.key, table.key, label, column): cell
        for part in short
        for table in part.tables
        for label, cells in table.rows
        for column, cell in zip(table.columns, cells, strict=True)
    }
    table = short[0].tables[0]
    headline = {label: dict(zip(table.columns, cells, strict=True)) for label, cells in table.rows}
    assert (
        headline["pegs in the hole, upright face"]["ours"] == found["peg", "peg_upright", "ours", "in the hole (share)"]
    )
    of_planned = headline["force error, six planned poses, N"]
    assert of_planned["tare"] == found["planned", "poses", "tare", "six planned: force, N"]
    assert of_planned["gravity only"] is None
    cells = [cell for row in headline.values() for cell in row.values()]
    assert sum(cell is None for cell in cells) == 2


def test_page_figures_markdown_and_pictures_are_written(short: tuple[Part, ...], tmp_path: Path) -> None:
    parts = (
        *short,
        Part("extra", "<b> & c", ("a < b",), (), (Picture("dot", f'<img src="{PIXEL}" alt="dot">', "A dot"),)),
    )
    write_experiment(tmp_path, parts, 0.0, 1)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "nan" not in re.findall(r">([^<]*)<", page)
    assert "http" not in re.sub(
        r'xmlns(:\w+)?="[^"]*"|<metadata>.*?</metadata>|<!DOCTYPE[^>]*>', "", page, flags=re.DOTALL
    )
    assert "&lt;b&gt; &amp; c" in page
    assert "Made by python -m reproduction --seed 1 with 0% of the trials: a look at the report, no result" in page
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert (figures["schema"], figures["seed"], figures["scale"]) == ("contactwrench/experiment/1", 1, 0.0)
    first = figures["parts"]["identification"]["tables"]["unseen"]["rows"]["ours"]["force, N"]
    assert first["trials"] == 2
    markdown = (tmp_path / "experiment.md").read_text(encoding="utf-8")
    linked = re.findall(r"\]\(images/([^)]+)\)", markdown)
    assert sorted(linked) == sorted(path.name for path in (tmp_path / "images").iterdir())
    assert "dot.png" in linked
    assert (tmp_path / "images" / "dot.png").read_bytes().startswith(b"\x89PNG")


def test_a_claim_that_fails_is_said_to_fail() -> None:
    def one(key: str, table: str, rows: dict[str, dict[str, float]]) -> Part:
        columns = tuple(next(iter(rows.values())))
        cells = tuple((name, tuple(Measured(row[column], None, 1) for column in columns)) for name, row in rows.items())
        return Part(key, key, (), (Table(table, table, columns, cells),))

    force = {"tare": 2.0, "gravity only": 3.0, "paper": 4.0, "ours": 5.0}
    parts = (
        one("identification", "unseen", {method: {"force, N": value} for method, value in force.items()}),
        one(
            "joint_torques",
            "joint_torques_workspace",
            {
                "wrist sensor, ours": {"median": 3.0},
                "wrist sensor, paper": {"median": 2.0},
                "joint torques, any wrench": {"median": 1.0},
            },
        ),
    )
    words = " ".join(summary(parts).paragraphs)
    assert words.count("that did not hold here") == 3
    assert "1.2 times more than the paper's estimator" in words


@pytest.mark.parametrize(
    ("cell", "text"),
    [
        (Measured(0.08612, 0.0082, 40), "0.0861 +- 0.0082"),
        (Measured(-0.00001, 0.003, 40), "0.0000 +- 0.0030"),
        (Measured(1.0, 0.0, 100), "1"),
        (Measured(58.19095, 0.00019, 40), "58.19 +- 0.00019"),
        (Measured(2427.2049, 0.0066, 40), "2427 +- 0.0066"),
        (Measured(2.8341, 0.035, 40), "2.834 +- 0.035"),
        (Measured(789.3, 290.0, 24), "789 +- 290"),
        (Measured(57.657, None, 1), "57.66"),
    ],
)
def test_a_figure_is_shown_with_the_digits_that_mean_something(cell: Measured, text: str) -> None:
    assert shown(cell) == text


def test_standard_errors_are_those_of_means_roots_and_shares() -> None:
    average = mean([1.0, 2.0, 3.0, 4.0])
    assert (average.value, average.trials) == (2.5, 4)
    assert average.standard_error == pytest.approx((5.0 / 12.0) ** 0.5)
    assert root_mean_square([9.0, 9.0]) == Measured(3.0, 0.0, 2)
    assert root_mean_square([1.0, 3.0]).standard_error == pytest.approx(1.0 / (2.0 * 2.0**0.5))
    successes = share([True, False, True, True])
    assert successes.value == 0.75
    assert successes.standard_error == pytest.approx((0.75 * 0.25 / 4.0) ** 0.5)
    low, high = wilson(1.0, 100)
    assert low == pytest.approx(0.9630, abs=1e-4)
    assert high == pytest.approx(1.0)


def test_the_readmes_headline_is_of_the_page() -> None:
    headline = re.compile(r"^\|  \| tare .*?(?=\n\n)", flags=re.MULTILINE | re.DOTALL)
    page, readme = (
        headline.search((ROOT / name).read_text(encoding="utf-8")) for name in ("docs/experiment.md", "README.md")
    )
    assert page is not None
    assert readme is not None
    rows = readme.group().splitlines()
    assert len(rows) >= 5
    assert set(rows) <= set(page.group().splitlines())


def test_without_mujoco_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import builtins

    real = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "mujoco":
            raise ImportError(name)
        return real(name, *args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", without)
    from contactwrench.simulate.rig import import_mujoco

    with pytest.raises(
        MissingExtraError, match=r"the virtual rig needs mujoco, .*: pip install 'contactwrench\[sim\]'"
    ):
        import_mujoco()


def test_markdown_cells_with_nothing_are_empty() -> None:
    part = Part("k", "T", ("Words.",), (Table("t", "Table", ("a", "b"), (("row", (None, "refused")),)),))
    assert "| row |  | refused |" in experiment_markdown((part,), 1.0, 0)
