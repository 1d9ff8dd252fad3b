"""Some ten seconds of `make fuzz`, the same at every run, in two parts, so that the workers share them."""

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
GROUPS = (("ROS 1", "JSON", "URDF", "CSV", "HDF5"), ("MCAP", "sqlite3", "folder", "Parquet"))
MUTATIONS = 4
"""Of each kind, so that each of its variants is damaged: some ten seconds in all. Hostile files have tests of
their own.
"""


@pytest.mark.slow
@pytest.mark.parametrize("kinds", GROUPS, ids=", ".join)
def test_damaged_files_of_every_kind(tmp_path: Path, kinds: tuple[str, ...]) -> None:
    paths = os.pathsep.join([str(ROOT), *sys.path])
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz", f"--mutations={MUTATIONS}", "--seed=20261122", "--at-once=1", *kinds],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": paths},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for kind in kinds:
        assert f"| {kind} | {MUTATIONS} |" in done.stdout


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
