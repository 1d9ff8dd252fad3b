"""Small files that would cost much, or hold something else than they say: each is refused in one line, and cheaply."""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.file import to_json
from contactwrench.errors import FileFormatError
from contactwrench.recording.contents import contents
from contactwrench.recording.urdf import read_urdf
from tests.support.hostile_tables import TABLE, TEXTS, URDFS, hdf5_files, parquet_stating, robot
from tests.support.recordings import PANDA, written

MOST_SECONDS, MOST_MEMORY = 5.0, 600 * 2**10
"""CPU of one file, and KiB of all of them."""


@pytest.fixture(autouse=True)
def _bounded() -> Iterator[None]:
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    yield
    assert time.process_time() - start < MOST_SECONDS
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_MEMORY


def refusal(path: Path, **options: str) -> str:
    with pytest.raises(FileFormatError) as caught:
        cw.read(path, **options)  # type: ignore[arg-type]
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert len(message.removeprefix(str(path))) < 300
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize("name", TEXTS)
def test_text(tmp_path: Path, name: str) -> None:
    content, message = TEXTS[name]
    assert refusal(written(tmp_path, content)) == message


def test_comments_and_quotes_of_an_honest_table_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, "# a comment\n" * 5_000 + TABLE + '1,2,3,4,5,6,0,0,0,"1"\n')
    assert cw.read(path).wrench[:, 0] == pytest.approx([1.0, 1.0, 1.0])


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_long_table_is_read_in_blocks_whatever_its_line_ends(tmp_path: Path, ends: str, encoding: str) -> None:
    head, row, *_ = TABLE.split("\n")
    rows = [f"{k % 1000:04d}{row[1:]}{' ' * 400}" for k in range(6_000 if encoding == "utf-16" else 12_000)]
    read = cw.read(written(tmp_path, ends.join([head, *rows, ""]).encode(encoding)))
    assert np.array_equal(read.wrench[:, 0], np.arange(len(rows)) % 1000)


SAYS_MORE = "expected at most {most}: is it damaged, or were they never written? record or export it again"


@pytest.mark.parametrize(
    ("stated", "found", "most"),
    [
        ({"rows": 2**60}, "1152921504606846976 rows", 2**20),
        ({"rows_of_group": 2**60}, "1152921504606846976 rows", 2**20),
        ({"size": 2**60}, "1152921504606846976 bytes", 2**27),
        ({"values": 2**60}, "1152921504606846976 numbers", 2**24),
    ],
)
def test_parquet_that_states_more_than_it_can_hold(
    tmp_path: Path, stated: dict[str, int], found: str, most: int
) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    content = parquet_stating(**stated)
    message = f"found {found} in a file of {len(content)} bytes, {SAYS_MORE.format(most=most)}"
    assert refusal(written(tmp_path, content, "run.parquet")) == message


def test_parquet_with_fewer_rows_than_it_states(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    path = written(tmp_path, parquet_stating(rows=5), "run.parquet")
    with pytest.raises(FileFormatError) as caught:
        contents(path)
    assert str(caught.value) == f"{path}: found 3 rows, expected the 5 stated: write it anew"
    found = contents(written(tmp_path, parquet_stating(), "run.parquet"))
    assert getattr(found, "rows", None) == 3


def test_parquet_nested_deep_or_wide(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    said = refusal(written(tmp_path, parquet_stating(nested=10_000), "run.parquet"))
    assert said.startswith("cannot be read as Parquet (")


def filled(path: Path, skip: str = "") -> Path:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    names = TABLE.partition("\n")[0].split(",")
    with h5py.File(path, "w") as file:
        for name in names:
            if name != skip:
                file[name] = np.full(3, float(name == "qw"))
    return path


HDF5_CASES = list(hdf5_files(Path("unused")))


@pytest.mark.parametrize("name", HDF5_CASES)
def test_hdf5(tmp_path: Path, name: str) -> None:
    import h5py

    elsewhere = filled(tmp_path / "elsewhere.h5")
    make, message, asked = hdf5_files(elsewhere)[name]
    path = filled(tmp_path / "run.h5", "fx")
    with h5py.File(path, "a") as file:
        make(file)
    options = {} if asked is None else {"hdf5": asked}
    assert refusal(path, **options) == message.format(size=path.stat().st_size)
    assert len(cw.read(elsewhere)) == 3


@pytest.fixture(scope="module")
def saved() -> str:
    return to_json(cw.calibrate(cw.read(PANDA), "mount"))


def test_calibrations(tmp_path: Path, saved: str) -> None:
    again = "expected a saved calibration: calibrate again or restore the file"
    cases = {
        saved.replace(
            '"dof":', '"dof": 1.0, "dof":'
        ): f"no whole JSON file (a key is there twice beside 'schema'), {again}",
        saved.replace('"dof":', '"dof": NaN, "x":'): "Expected `float`, got NaN - at `$.dof`, expected a saved ",
        saved.replace('"dof":', '"dof": 1e999999, "x":'): "no whole JSON file (Number out of range - at `$[...]`), ",
        saved.replace('"dof":', f'"dof": {"[" * 100_000}'): "no whole JSON file (maximum recursion depth exceeded",
        saved.replace(
            '"bias": [', f'"bias": [{"0," * 100_000}'
        ): "found bias of another shape, expected (6,): calibrate again",
    }
    for content, message in cases.items():
        assert content != saved
        path = written(tmp_path, content, "tool.json")
        with pytest.raises(FileFormatError) as caught:
            cw.Calibration.load(path)
        assert str(caught.value).startswith(f"{path}: {message}")
    with path.open("wb") as file:
        file.truncate(2**25 + 1)
    with pytest.raises(FileFormatError) as caught:
        cw.Calibration.load(path)
    assert str(caught.value) == f"{path}: found more than 32 MiB, expected at most that: name another file"


@pytest.mark.parametrize("name", URDFS)
def test_robots(tmp_path: Path, name: str) -> None:
    content, message = URDFS[name]
    path = written(tmp_path, content, "arm.urdf")
    with pytest.raises(FileFormatError) as caught:
        read_urdf(path)
    assert str(caught.value) == f"{path}: {message}"


def test_a_robot_of_nothing_but_joints_that_go_round(tmp_path: Path) -> None:
    from tests.support.hostile_tables import joint

    path = written(tmp_path, robot([joint("a", "x", "y"), joint("b", "y", "x")]), "arm.urdf")
    with pytest.raises(FileFormatError, match=r"found links that go round in a circle \(y, x, y\), expected a tree: "):
        read_urdf(path)
