"""Tables: rows a second read and compensated, and how the memory grows with the file."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import contactwrench as cw
from contactwrench.recording import compensate
from contactwrench.recording.options import AS_USUAL
from contactwrench.recording.read import batches, read_streams
from contactwrench.recording.tables.columns import ROWS as BLOCK
from contactwrench.recording.tables.write import write_contact_wrenches
from tests.support.world import Array, noisy_readings, random_rotations

from .accuracy import NOISE, TABLE_V
from .clock import median_seconds
from .speed import MIB
from .table import Row

ROWS = 600_000
"""10 minutes at 1 kHz."""
NAMES = ("t", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw", "x", "y", "z")
FORMAT = ",".join(["%.3f"] + ["%.6f"] * 6 + ["%.9f"] * 4 + ["%.6f"] * 3)
PEAK = """
import re, sys
from pathlib import Path
from benchmarks.tables import compensated
compensated(Path(sys.argv[1]), Path(sys.argv[2]))
print(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])
"""
"""The peak of the process itself: ru_maxrss also knows the one of the process that started it."""


def _columns(n: int) -> Array:
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(7)
    quat_xyzw = Rotation.from_matrix(random_rotations(1000, rng)).as_quat()[np.arange(n) * 1000 // n]
    return np.column_stack([1e-3 * np.arange(n), rng.normal(size=(n, 6)), quat_xyzw, rng.normal(size=(n, 3))])


def _csv(path: Path, columns: Array, gaps: bool = False) -> Path:
    lines = [FORMAT % tuple(row) for row in columns.tolist()]
    if gaps:
        lines = [line if k % 10 == 0 else ",".join(line.split(",")[:7]) + 7 * "," for k, line in enumerate(lines)]
    path.write_text("\n".join([",".join(NAMES), *lines, ""]))
    return path


def _parquet(path: Path, columns: Array) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(dict(zip(NAMES, columns.T, strict=True))), path)
    return path


@cache
def _calibration() -> cw.Calibration:
    rng = np.random.default_rng(1)
    R = random_rotations(24, rng)
    return cw.calibrate(cw.Samples(noisy_readings(TABLE_V, R, NOISE, rng), R), "mount")


def compensated(path: Path, output: Path) -> None:
    """As `contactwrench compensate` does it."""
    rows = compensate.compensated(path, AS_USUAL, _calibration(), compensate.Treatment())
    write_contact_wrenches(output, rows, path)


def _speed(folder: Path, n: int, times: int) -> Iterator[Row]:
    columns = _columns(n)
    files = [_csv(folder / "run.csv", columns)]
    if find_spec("pyarrow") is not None:
        files.append(_parquet(folder / "run.parquet", columns))

    def row(what: str, action: Any, most: float | None = None) -> Row:
        seconds = median_seconds(action, times)
        limit = None if most is None else most * n / ROWS
        return Row(what, seconds, "s", most=limit, remark=f"{n / seconds / 1e3:.0f} thousand rows/s")

    for path in files:
        kind, size = path.suffix[1:], path.stat().st_size / 1e6
        yield row(f"{kind}, {size:.0f} MB: read whole", lambda path=path: cw.read(path))
        yield row(f"{kind}: streams, batch by batch", lambda path=path: sum(len(one.wrench) for one in batches(path)))
        for output in files:
            to = folder / f"out{output.suffix}"
            what = f"{kind}: read, compensated, written as {output.suffix[1:]}"
            yield row(what, lambda path=path, to=to: compensated(path, to), most=5.0)
    gaps = _csv(folder / "gaps.csv", columns, gaps=True)
    yield row("csv with a pose in every tenth row: streams", lambda: read_streams(gaps))


def _memory(folder: Path, n: int) -> Iterator[Row]:
    for kind in ("csv", "parquet") if find_spec("pyarrow") is not None else ("csv",):
        sizes, peaks = [], []
        for k in (1, 4):
            columns = _columns(k * n)
            path = _csv(folder / "run.csv", columns) if kind == "csv" else _parquet(folder / "run.parquet", columns)
            arguments = [sys.executable, "-c", PEAK, str(path), str(folder / f"out.{kind}")]
            done = subprocess.run(arguments, capture_output=True, text=True, check=True, env=os.environ)
            sizes.append(path.stat().st_size)
            peaks.append(int(done.stdout) * 1024)
        remark = " and ".join(
            f"{peak / MIB:.0f} MiB for a file of {size / MIB:.0f}" for size, peak in zip(sizes, peaks, strict=True)
        )
        growth = (peaks[1] - peaks[0]) / (sizes[1] - sizes[0])
        yield Row(f"{kind}: memory for each byte of the file", growth, "bytes", most=0.1, remark=remark)


def tables(quick: bool) -> Iterable[tuple[str, Iterable[Row]]]:
    """Speed of 10 minutes at 1 kHz, and memory for more."""
    n = ROWS // 10 if quick else ROWS
    with tempfile.TemporaryDirectory() as folder:
        title = f"Tables of {n} rows and {len(NAMES)} columns"
        yield title, _speed(Path(folder), n, 3)
        yield "Memory while a table is compensated into one of its kind", _memory(Path(folder), max(n, 4 * BLOCK))
