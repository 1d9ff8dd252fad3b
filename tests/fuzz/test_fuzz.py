"""Some ten seconds of `make fuzz`, the same at every run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.mutations import OF_TEXT, mutated
from tests.fuzz.originals import rows_of_text
from tests.fuzz.runs import Run

ROOT = Path(__file__).parents[2]
KINDS = {"ROS 1": 3, "MCAP": 3, "sqlite3": 2, "folder": 4, "CSV": 2, "Parquet": 3, "HDF5": 2, "JSON": 2, "URDF": 2}
"""How many are damaged: two, or each of the variants. Hostile files have tests of their own."""


@pytest.mark.slow
def test_damaged_files_of_every_kind(tmp_path: Path) -> None:
    paths = os.pathsep.join([str(ROOT), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", "--mutations=2", "--seed=20261122", "--at-once=1", *KINDS],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": paths},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for kind, damaged in KINDS.items():
        assert f"| {kind} | {damaged} |" in done.stdout


def test_every_way_of_damaging_changes_something() -> None:
    rng, content = np.random.default_rng(1), b"t,fx\n" + b"".join(b"%d,1.5\n" % k for k in range(200))
    for way in dict.fromkeys(OF_TEXT):
        assert any(way(rng, content) != content for _ in range(20)), way.__name__
        way(rng, b"")
    assert mutated(content, np.random.default_rng(3), text=True) == mutated(
        content, np.random.default_rng(3), text=True
    )


@pytest.mark.parametrize(
    ("status", "out", "err", "faults"),
    [
        (0, "fine\n", "Note: the last line has no line end\n", []),
        (1, "", "The fit is bad: 3 N are left\n", []),
        (2, "", "contactwrench: a.csv: found nothing, expected rows: add them\n", []),
        (2, "", "", ["more than a line"]),
        (2, "", "contactwrench: one\ncontactwrench: two\n", ["more than a line"]),
        (0, "", "numpy said something\n", ["more than a line"]),
        (0, "\x1b[2J", "", ["control characters"]),
        (3, "", "", ["status"]),
        (None, "", "", ["hang"]),
        (1, "", "Traceback (most recent call last):\n  ValueError\n", ["traceback", "more than a line"]),
        (2, "", f"contactwrench: {'x' * 400}\n", ["long line"]),
    ],
)
def test_what_is_a_fault(status: int | None, out: str, err: str, faults: list[str]) -> None:
    assert Run((), status, out, err, 0.1, 10**8).faults == faults
    assert Run((), status, out, err, 0.1, 2 * 10**9).faults[-1] == "memory" or faults


def test_rows_of_a_damaged_table_are_counted() -> None:
    assert rows_of_text(b"a,b\n1,2\r\n\n# no row\r3,4\n  \n5,6") == 3
