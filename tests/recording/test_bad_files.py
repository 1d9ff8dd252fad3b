"""Hypothesis writes files that nobody should; the only outcomes are a valid result or one line that names the file."""

import io
import json
import math
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.calibration.file import to_json
from tests.support.recordings import PANDA, PAPER, WRENCH, Run, beside_its_doubt, csv_text, run, run_quietly, written
from tests.support.written import QUAT

PANDA_BYTES, PAPER_BYTES = PANDA.read_bytes(), PAPER.read_bytes()
many = settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
fewer = settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])

JUNK = ["", " ", "nan", "inf", "-inf", "1e999", "1e308", "-1e200", "abc", "1,5", "1;5", "0x10", "1_0", '"', '"1"', '""']
JUNK += ["#", "\0", "é", "½", "١", "-", "+", "1e", "--1", "True", "1e-400", "\ufeff", "\x1c", "\u2028", "9" * 400]
cells = st.sampled_from(JUNK) | st.text(max_size=8) | st.floats().map(repr)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all examples: each overwrites the file."""
    return tmp_path_factory.mktemp("bad")


@cache
def saved(model: str) -> str:
    return to_json(cw.calibrate(cw.read(PAPER if model == "paper" else PANDA), model))


def assert_one_line_that_names(error: cw.ContactWrenchError, path: Path) -> None:
    assert str(error).startswith(f"{path}: ")
    assert_one_line(error)


def assert_one_line(error: cw.ContactWrenchError) -> None:
    assert len(str(error).splitlines()) == 1
    assert len(str(error)) < 2000


def read_or_refuse(path: Path, content: bytes, orientation: str = "auto") -> None:
    path.write_bytes(content)
    try:
        samples = cw.read(path, orientation)
    except cw.ContactWrenchError as error:
        assert_one_line_that_names(error, path)
        return
    assert len(samples) > 0
    assert np.isfinite(samples.wrench).all()
    assert samples.R_base_flange @ samples.R_base_flange.transpose(0, 2, 1) == pytest.approx(
        np.tile(np.eye(3), (len(samples), 1, 1)), abs=1e-9
    )


def load_or_refuse(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        calibration = cw.Calibration.load(path)
    except cw.ContactWrenchError as error:
        assert_one_line_that_names(error, path)
        return
    assert np.isfinite(calibration.predict(np.eye(3))).all()
    assert np.isfinite(calibration.B_covariance).all()
    assert str(calibration)


def run_program(*arguments: str | Path) -> Run:
    """The program in this process; `capsys` cannot be used under Hypothesis."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = run_quietly(arguments)
    return Run(status, out.getvalue(), err.getvalue())


def note_of_the_end(path: Path) -> str:
    """What is said of a table that has no line end."""
    return f"Note: {path}: the last line has no line end: its last number may be cut off\n"


def lines_of_cells(content: bytes) -> list[list[str]]:
    return [line.split(",") for line in content.decode().splitlines()]


def joined(table: list[list[str]], delimiter: str = ",") -> bytes:
    return "\n".join(delimiter.join(row) for row in table).encode(errors="surrogatepass")


@st.composite
def tables_with_junk(draw: st.DrawFn) -> bytes:
    """A good recording in which some cells are replaced by junk."""
    table = lines_of_cells(draw(st.sampled_from([PANDA_BYTES, PAPER_BYTES])))
    for _ in range(draw(st.integers(1, 3))):
        row = draw(st.integers(0, len(table) - 1))
        table[row][draw(st.integers(0, len(table[row]) - 1))] = draw(cells)
    return joined(table, draw(st.sampled_from(",;\t")))


@st.composite
def tables_with_moved_columns(draw: st.DrawFn) -> bytes:
    """A good recording in which columns or single cells are missing, doubled or swapped."""
    table = lines_of_cells(draw(st.sampled_from([PANDA_BYTES, PAPER_BYTES])))
    places = st.integers(0, 12)
    change, one, other = (
        draw(st.sampled_from(["delete", "double", "swap", "rename", "cut"])),
        draw(places),
        draw(places),
    )
    for row in table if change != "cut" else table[-1:]:
        if len(row) <= max(one, other):
            continue
        if change in ("delete", "cut"):
            del row[one]
        elif change == "double":
            row.insert(other, row[one])
        else:
            row[one], row[other] = row[other], row[one]
        if change == "rename":
            break
    return joined(table)


@st.composite
def edited_bytes(draw: st.DrawFn, good: bytes) -> bytes:
    """A good file cut short, with bytes replaced or inserted, or in another encoding."""
    content = bytearray(good[: draw(st.integers(0, len(good)))] if draw(st.booleans()) else good)
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(content)))
        content[at : at + draw(st.integers(0, 5))] = draw(st.binary(max_size=5))
    return bytes(content)


@pytest.mark.slow
@many
@given(content=st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode(errors="surrogatepass")))
def test_recordings_of_random_bytes(folder: Path, content: bytes) -> None:
    read_or_refuse(folder / "poses.csv", content)


@pytest.mark.slow
@many
@given(content=tables_with_junk())
def test_recordings_with_junk_in_their_cells(folder: Path, content: bytes) -> None:
    read_or_refuse(folder / "poses.csv", content)


@pytest.mark.slow
@many
@given(content=tables_with_moved_columns(), orientation=st.sampled_from(["auto", "quat_xyzw", "kuka_abc", "rpy"]))
def test_recordings_with_columns_missing_doubled_or_swapped(folder: Path, content: bytes, orientation: str) -> None:
    read_or_refuse(folder / "poses.csv", content, orientation)


@pytest.mark.slow
@many
@given(content=edited_bytes(PANDA_BYTES) | edited_bytes(PAPER_BYTES))
def test_recordings_that_are_cut_short_or_damaged(folder: Path, content: bytes) -> None:
    read_or_refuse(folder / "poses.csv", content)


@pytest.mark.slow
@many
@given(
    header=st.lists(st.sampled_from(["fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw", "a", "t", "x", ""])),
    rows=st.lists(st.lists(st.floats(-2, 2).map(repr) | cells, max_size=14), max_size=4),
)
def test_recordings_with_random_headers_and_rows(folder: Path, header: list[str], rows: list[list[str]]) -> None:
    read_or_refuse(folder / "poses.csv", joined([header, *rows]))


@pytest.mark.slow
@many
@given(
    text=st.text(max_size=30)
    | st.lists(st.sampled_from(["euler", "kuka_abc", ":", "ZYX", "deg", ",", "a"])).map("".join)
)
def test_random_names_of_an_orientation(folder: Path, text: str) -> None:
    path = folder / "paper.csv"
    path.write_bytes(PAPER_BYTES)
    try:
        cw.read(path, text)
    except cw.ContactWrenchError as error:
        assert_one_line(error)


def places(value: Any) -> list[tuple[str | int, ...]]:
    """The path to every value in a JSON document, lists by their first two and last elements."""
    if isinstance(value, dict):
        inner = list(value.items())
    elif isinstance(value, list):
        inner = [(k, value[k]) for k in sorted({0, 1, len(value) - 1}) if 0 <= k < len(value)]
    else:
        return [()]
    return [(), *((key, *path) for key, part in inner for path in places(part))]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=2),
    max_leaves=4,
)


@st.composite
def edited_calibrations(draw: st.DrawFn) -> bytes:
    """A saved calibration in which keys are missing and values are replaced or scaled."""
    document = json.loads(saved(draw(st.sampled_from(["paper", "mount", "mount+base", "affine"]))))
    for _ in range(draw(st.integers(1, 2))):
        path = draw(st.sampled_from([path for path in places(document) if path]))
        parent: Any = document
        for key in path[:-1]:
            parent = parent[key]
        change = draw(st.sampled_from(["delete", "replace", "scale"]))
        old = parent[path[-1]]
        if change == "delete":
            del parent[path[-1]]
        elif change == "scale" and isinstance(old, float) and not isinstance(old, bool):
            parent[path[-1]] = old * draw(st.sampled_from([-1.0, 0.0, 1.0 + 1e-6, 2.0, 1e9, 1e200]))
        else:
            parent[path[-1]] = draw(json_values)
    return json.dumps(document).encode()


@pytest.mark.slow
@many
@given(content=edited_calibrations())
def test_calibrations_with_keys_missing_and_values_changed(folder: Path, content: bytes) -> None:
    load_or_refuse(folder / "tool.json", content)


@many
@given(content=st.deferred(lambda: edited_bytes(saved("mount").encode())) | st.binary(max_size=200))
def test_calibrations_that_are_cut_short_or_damaged(folder: Path, content: bytes) -> None:
    load_or_refuse(folder / "tool.json", content)


def assert_done_or_one_line(done: Run, *paths: Path) -> None:
    if done.status == 2:
        assert any(str(path) in done.complaint for path in paths) or "poses" in done.complaint or "--" in done.complaint
    else:
        assert done.status in (0, 1)
        assert beside_its_doubt(done.err) in ("", *(note_of_the_end(path) for path in paths))


@pytest.mark.slow
@fewer
@given(content=tables_with_junk() | tables_with_moved_columns() | edited_bytes(PANDA_BYTES))
def test_the_program_on_bad_recordings(folder: Path, content: bytes) -> None:
    path, tool, target = folder / "poses.csv", folder / "good.json", folder / "contact.csv"
    path.write_bytes(content)
    tool.write_text(saved("mount"))
    target.write_text("old")
    done = run_program("compensate", path, "-c", tool, "-o", target)
    assert_done_or_one_line(done, path)
    assert (done.status, target.read_text() == "old") in ((0, False), (2, True))
    assert_done_or_one_line(run_program("verify", path, "-c", tool), path)


@pytest.mark.slow
@fewer
@given(content=edited_calibrations())
def test_the_program_on_bad_calibrations(folder: Path, content: bytes) -> None:
    tool = folder / "tool.json"
    tool.write_bytes(content)
    for verb in (("show", tool), ("show", tool, "--json"), ("verify", PANDA, "-c", tool), ("diff", tool, tool)):
        assert_done_or_one_line(run_program(*map(str, verb)), tool)


@pytest.mark.slow
@fewer
@given(content=edited_bytes(PANDA_BYTES) | tables_with_moved_columns() | tables_with_junk())
def test_calibrate_on_bad_recordings_answers_or_refuses_in_one_line(folder: Path, content: bytes) -> None:
    path = folder / "poses.csv"
    path.write_bytes(content)
    done = run_program("calibrate", path, "--json")
    if done.status == 2:
        assert done.complaint
    else:
        values = json.loads(done.out)
        said = done.err.replace(note_of_the_end(path), "")
        fits_badly = said.startswith("The fit is bad: ") and said.count("\n") == 1
        assert (done.status, said == "") == ((1, False) if fits_badly else (0, True))
        assert math.isfinite(values["weight"])


@pytest.mark.parametrize("end", ["", "\n"])
def test_a_noise_that_may_be_cut_off_is_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str) -> None:
    rows = np.random.default_rng(0).normal(scale=0.1, size=(50, 6))
    text = csv_text((*WRENCH, *QUAT), np.column_stack([rows, np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))]))
    path = written(tmp_path, text.rstrip("\n") + end, "rest.csv")
    said = "" if end else f"Note: {path}: the last line has no line end: its last number may be cut off\n"
    assert run(capsys, "calibrate", PANDA, "--noise", path).err == said
