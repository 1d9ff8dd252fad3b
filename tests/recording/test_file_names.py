"""The file that was named is the file that is read, and written, whatever its name: a decoy stands beside it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileAccessError, InputError
from contactwrench.recording.bags.copy import write_bag_with
from contactwrench.recording.contents import contents
from contactwrench.recording.read import read_streams
from tests.support.bags import bag_streams, recording, write_bag

pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
h5py = pytest.importorskip("h5py", reason="h5py is not installed")

BAGS = (".db3", "", ".mcap", ".bag")
SUFFIXES = (*BAGS, ".csv", ".parquet", ".parquet folder", ".h5")
COLUMNS = ("t", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
ASKED, DECOY = 12, 5

NAMES = st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=40)


def _write(path: Path, suffix: str, count: int) -> Path:
    """A recording of so many readings, under a name that nobody can take for another."""
    table = np.column_stack([np.arange(count), np.ones((count, 6)), np.tile([0, 0, 0, 1], (count, 1))]).astype(float)
    if suffix in BAGS:
        write_bag(path, recording(count, every=1)[0])
    elif suffix == ".csv":
        np.savetxt(path, table, delimiter=",", header=",".join(COLUMNS), comments="")
    elif suffix == ".h5":
        with h5py.File(path, "w") as file:
            for name, column in zip(COLUMNS, table.T, strict=True):
                file[name] = column
    else:
        from pyarrow import parquet

        if suffix.endswith("folder"):
            path.mkdir()
            path /= "a.parquet"
        parquet.write_table(pa.table(dict(zip(COLUMNS, table.T, strict=True))), path)
    return path


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, int], Path]:
    folder = tmp_path_factory.mktemp("written")
    made = {}
    for k, suffix in enumerate(SUFFIXES):
        for count in (ASKED, DECOY):
            path = folder / f"{k}_{count}{suffix.partition(' ')[0] if 'folder' not in suffix else ''}"
            _write(path, suffix, count)
            made[suffix, count] = path
    return made


def _copied(source: Path, target: Path) -> None:
    (shutil.copytree if source.is_dir() else shutil.copy)(source, target)


def _misread(name: str) -> set[str]:
    """What a name could be taken for."""
    as_uri = unquote_to_bytes(name.encode(errors="surrogateescape")).decode(errors="surrogateescape")
    parts = {
        as_uri,
        name.partition("?")[0],
        name.partition("#")[0],
        name.rpartition(":")[2],
        name.strip(),
        name.lower(),
    }
    return {part for part in parts if part not in ("", ".", "..", name) and not {"/", "\0"} & set(part)}


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=4)
@example("run%42")
@example("a#b")
@example("a?mode=memory")
@example("file:x")
@example("s3:b")
@example("-\n'\"*[a]{b}\\ ")
@example("~")
@example("%s%d")
@example("\udcff")
@given(name=NAMES)
def test_the_file_that_was_named_is_read(
    tmp_path_factory: pytest.TempPathFactory, written: dict[tuple[str, int], Path], suffix: str, name: str
) -> None:
    folder = tmp_path_factory.mktemp("named")
    name += "" if "folder" in suffix else suffix
    assume(len(name.encode(errors="surrogateescape")) < 200 and name not in (".", ".."))
    assume(suffix != "" or "." not in name)
    _copied(written[suffix, ASKED], folder / name)
    for decoy in _misread(name):
        if not (folder / decoy).exists():
            _copied(written[suffix, DECOY], folder / decoy)
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        for path in (Path(name), folder / name):
            assert len(read_streams(path).wrench) == ASKED
            contents(path)
        if suffix in BAGS:
            before = {path.name for path in folder.iterdir()}
            out = Path(f"{'out' if suffix else ''}{name}out{suffix}")
            write_bag_with(name, out, [np.zeros((ASKED, 6))])
            assert {path.name for path in folder.iterdir()} - before == {out.name}
            assert len(bag_streams(out, wrench_topic="/wrench/contact").wrench) == ASKED


@pytest.mark.parametrize("suffix", [*BAGS, ".csv", ".parquet", ".h5"])
@pytest.mark.parametrize("name", ["x" * 5000, "x/" * 2500])
def test_names_that_no_file_has(suffix: str, name: str) -> None:
    for read in (read_streams, contents):
        with pytest.raises(FileAccessError, match=r": cannot be read \(file name too long\): check the path"):
            read(f"{name}{suffix}")


def test_a_path_that_is_too_long_for_sqlite(tmp_path: Path) -> None:
    folder = tmp_path / Path(*["d" * 200] * 3)
    folder.mkdir(parents=True)
    path = folder / "run.db3"
    shutil.copy(write_bag(tmp_path / "run.db3", recording(5)[0]), path)
    with pytest.raises(ContactWrenchError) as caught:
        read_streams(path)
    assert str(caught.value) == (
        f"{path}: cannot be read as a ROS 2 sqlite3 bag (a path of {len(bytes(path))} bytes, of which sqlite takes "
        "500), expected a whole one: record or copy it again"
    )


@pytest.mark.parametrize("suffix", [".DB3", ".MCAP", ".BAG", ".Csv", ".PARQUET", ".H5"])
def test_suffixes_in_capitals(tmp_path: Path, written: dict[tuple[str, int], Path], suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    shutil.copy(written[suffix.lower(), ASKED], path)
    assert len(read_streams(path).wrench) == ASKED
    contents(path)
    if suffix.lower() in BAGS:
        out = tmp_path / f"out{suffix}"
        write_bag_with(path, out, [np.zeros((ASKED, 6))])
        assert len(bag_streams(out, wrench_topic="/wrench/contact").wrench) == ASKED


@pytest.mark.parametrize(
    ("path", "found"),
    [(None, "None"), (3, "3"), (b"run.csv", "b'run.csv'"), (np.zeros((99, 6)), "a ndarray"), (["a.csv"], "a list")],
    ids=["None", "3", "bytes", "array", "list"],
)
@pytest.mark.parametrize("reads", [cw.read, cw.Calibration.load])
def test_what_is_no_path_is_refused_in_one_line(reads: Callable[[Any], Any], path: Any, found: str) -> None:
    with pytest.raises(InputError) as caught:
        reads(path)
    assert str(caught.value) == f"path is {found}, expected a str or a Path: name a file"
