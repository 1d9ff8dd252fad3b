"""Pages of Parquet and chunks of HDF5 that unpack to much more than they weigh: refused before they are unpacked, or by
the program, when they take more memory than a file of their size may.
"""

from __future__ import annotations

import os
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import FileFormatError
from tests.support.hostile_pages import (
    BYTE_ARRAY,
    COLUMNS,
    GZIP,
    PLAIN,
    RLE_DICTIONARY,
    Chunk,
    Page,
    beside,
    constant,
    leveled,
    packed,
    run,
    zeros,
)
from tests.support.recordings import written

pytest.importorskip("pyarrow", reason="pyarrow is not installed")
h5py = pytest.importorskip("h5py", reason="h5py is not installed")

ONE = Page(2, 1, PLAIN, struct.pack("<d", 1.0), 8)
MUCH, MANY = 200_000_000, 10**9
ROW_OF_MANY = leveled(run(1, b"\0") + run(MANY - 1, b"\1")) + leveled(run(MANY, b"\1")) + b"\1" + run(MANY, b"\0")
PAGES: dict[str, tuple[Callable[[], tuple[Chunk, ...]], int, str]] = {
    "a page of gzip": (
        lambda: (Chunk("fx", (Page(0, 3, PLAIN, zeros(MUCH), MUCH),), 3, 100, codec=GZIP),),
        3,
        "200000000 bytes in pages",
    ),
    "a dictionary of gzip": (
        lambda: (Chunk("fx", (Page(2, 1, PLAIN, zeros(MUCH), MUCH), constant("", 3).pages[1]), 3, 100, codec=GZIP),),
        3,
        "200000000 bytes in pages",
    ),
    "a page that only says so": (
        lambda: (Chunk("fx", (Page(0, 3, PLAIN, packed(b"abc"), 2**31 - 1),), 3, 100, codec=GZIP),),
        3,
        "2147483647 bytes in pages",
    ),
    "a run of a milliard": (
        lambda: (Chunk("fx", (ONE, Page(0, MANY, RLE_DICTIONARY, b"\1" + run(MANY, b"\0"), 7)), 3, 100),),
        3,
        "1000000001 numbers in pages",
    ),
    "a run that the foot states": (
        lambda: (Chunk("fx", (ONE, Page(0, MANY, RLE_DICTIONARY, b"\1" + run(MANY, b"\0"), 7)), MANY, 100),),
        3,
        "1000000027 numbers",
    ),
    "a list of a milliard in one row": (
        lambda: (
            Chunk("list", (ONE, Page(0, MANY, RLE_DICTIONARY, ROW_OF_MANY, len(ROW_OF_MANY))), 3, 100, repetition=2),
        ),
        3,
        "1000000041 numbers in pages",
    ),
    "a milliard of rows": (tuple, MANY, "1000000000 rows"),
    "a thousand columns of a million": (
        lambda: tuple(constant(f"c{k}", 10**6) for k in range(1000)),
        10**6,
        "1010000000 numbers",
    ),
}
"""What makes the columns of a file of so many rows, and what is found in it."""
MOST = {"bytes": 2**27, "numbers": 2**24, "rows": 2**20}


@pytest.mark.parametrize("name", PAGES)
def test_parquet(tmp_path: Path, name: str) -> None:
    chunks, rows, found = PAGES[name]
    content = beside(*chunks(), rows=rows)
    path = written(tmp_path, content, "run.parquet")
    with pytest.raises(FileFormatError) as caught:
        cw.read(path)
    most = MOST[found.split()[1]]
    assert str(caught.value) == (
        f"{path}: found {found} in a file of {len(content)} bytes, expected at most {most}: is it damaged, or were "
        "they never written? record or export it again"
    )


def test_a_page_without_its_header(tmp_path: Path) -> None:
    path = written(tmp_path, beside().replace(b"PAR1", b"PAR1\x15\x0e" + b"\x1c" * 5000, 1), "run.parquet")
    with pytest.raises(FileFormatError, match=r"run\.parquet: cannot be read as Parquet \("):
        cw.read(path)


def test_an_honest_file_of_the_same_writer_is_read(tmp_path: Path) -> None:
    assert len(cw.read(written(tmp_path, beside(rows=3000), "run.parquet"))) == 3000


def hdf5(path: Path, filters: Any, content: bytes) -> Path:
    with h5py.File(path, "w") as file:
        for name in COLUMNS[1:]:
            file[name] = np.full(3, float(name == "qw"))
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((3,))
        filters(plist)
        space = h5py.h5s.create_simple((3,))
        h5py.h5d.create(file.id, b"fx", h5py.h5t.NATIVE_DOUBLE, space, plist).write_direct_chunk((0,), content)
    return path


def _shuffled(plist: Any) -> None:
    plist.set_shuffle()
    plist.set_deflate(9)


def _twice(plist: Any) -> None:
    plist.set_deflate(9)
    plist.set_filter(h5py.h5z.FILTER_DEFLATE, 0, (9,))


TOO_MUCH = "found a chunk that unpacks to more than the 24 bytes that it states, expected as many: write it anew"
FILTERS = "found rows packed by filters {}, expected gzip or LZF, alone or after shuffle: write it anew"


@cache
def _much_in_little() -> bytes:
    return zlib.compress(bytes(MUCH), 1)


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        (lambda plist: plist.set_deflate(9), TOO_MUCH),
        (_shuffled, TOO_MUCH),
        (_twice, FILTERS.format("1, 1")),
        (lambda plist: plist.set_scaleoffset(h5py.h5z.SO_INT, 0), FILTERS.format("6")),
    ],
    ids=["gzip", "shuffled", "gzip twice", "a filter that states its own size"],
)
def test_hdf5(tmp_path: Path, filters: Any, message: str) -> None:
    path = hdf5(tmp_path / "run.h5", filters, _much_in_little())
    with pytest.raises(FileFormatError) as caught:
        cw.read(path)
    assert str(caught.value) == f"{path}: dataset fx: {message}"


def test_hdf5_whose_units_are_thousands_of_texts(tmp_path: Path) -> None:
    """Each of them may be the same long one: they are not asked for."""
    with h5py.File(path := tmp_path / "run.h5", "w") as file:
        for name in COLUMNS:
            file[name] = np.full(3, float(name == "qw"))
        file["fx"].attrs["units"] = np.full(1000, 7)
    assert len(cw.read(path)) == 3


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux")
def test_texts_that_a_dictionary_repeats_take_no_more_memory_than_their_file_is_worth(tmp_path: Path) -> None:
    """No page states how long its texts become; the program holds itself to what a file of that size is worth."""
    rows, length = 10**6, 800_000
    entry, runs = struct.pack("<I", length) + bytes(length), b"\1" + run(rows, b"\0")
    pages = (
        Page(2, 1, PLAIN, packed(entry), len(entry)),
        Page(0, rows, RLE_DICTIONARY, packed(runs), len(runs)),
    )
    text = Chunk("fx", pages, rows, len(entry) + 100, kind=BYTE_ARRAY, codec=GZIP)
    path = written(tmp_path, beside(text, rows=rows), "run.parquet")
    command = [sys.executable, "-m", "contactwrench", "calibrate", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=dict(os.environ))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "run.parquet: needs more memory than there is, or than a whole file of its size, expected " in done.stderr
    assert peak < 1.5e6  # KiB
