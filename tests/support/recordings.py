"""Recordings as text, elementary rotations, and the program run in this process: what the tests of input share."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import typer.main
from numpy.typing import ArrayLike, NDArray

import contactwrench as cw
from contactwrench.cli.main import app, exit_status

Array = NDArray[np.float64]

DATA = Path(cw.__file__).parent / "data"
PANDA = DATA / "panda_mini45.csv"
PAPER = DATA / "paper_six_poses.csv"

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
MATRIX = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))


def rx(angle: float) -> Array:
    """A right-handed turn about x, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def ry(angle: float) -> Array:
    """A right-handed turn about y, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rz(angle: float) -> Array:
    """A right-handed turn about z, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def generic_rotations(n: int, seed: int = 0) -> Array:
    """Rotations (n, 3, 3) by generic angles about all axes."""
    angles = np.random.default_rng(seed).uniform(-np.pi, np.pi, size=(n, 3))
    return np.array([rz(a) @ ry(b) @ rx(c) for a, b, c in angles])


def csv_text(header: Iterable[str], rows: Iterable[ArrayLike], delimiter: str = ",", end: str = "\n") -> str:
    """A table as text, every number in its shortest exact form."""
    numbers: list[list[float]]
    if isinstance(rows, np.ndarray):  # at once: many tests write tens of thousands
        numbers = rows.reshape(len(rows), -1).astype(np.float64).tolist()
    else:
        numbers = [np.ravel(row).astype(np.float64).tolist() for row in rows]
    if numbers and delimiter == "," and np.isfinite([sum(row) for row in numbers]).all():  # in a tenth of the time
        lines = msgspec.json.encode(numbers).decode()[2:-2].split("],[")
    else:
        lines = [delimiter.join(map(repr, row)) for row in numbers]
    return end.join([delimiter.join(header), *lines, ""])


def matrix_table(wrench: Array, R_base_flange: Array) -> str:
    """Readings (n, 6) with their orientations (n, 3, 3) as r11..r33."""
    return csv_text((*WRENCH, *MATRIX), np.column_stack([wrench, R_base_flange.reshape(-1, 9)]))


def written(folder: Path, content: str | bytes, name: str = "poses.csv") -> Path:
    """A file of that content."""
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def wrenches_written(path: Path) -> Array:
    """The contact wrenches (n, 6) of a table that `compensate` wrote."""
    rows: Any = np.genfromtxt(path, delimiter=",", names=True)
    return np.column_stack([rows[name] for name in WRENCH])


@dataclass(frozen=True)
class Run:
    """What the program did."""

    status: int
    out: str
    err: str

    @property
    def complaint(self) -> str:
        """The one line on stderr of a run that was refused, without the program's name."""
        assert self.status == 2
        assert self.out == ""
        assert self.err.startswith("contactwrench: ")
        assert self.err.count("\n") == 1
        assert self.err.endswith("\n")
        return self.err.removeprefix("contactwrench: ").rstrip("\n")


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Run:
    """Run `contactwrench` with these arguments in this process."""
    capsys.readouterr()
    status = run_quietly(arguments)
    captured = capsys.readouterr()
    return Run(status, captured.out, captured.err)


def beside_its_doubt(err: str | bytes) -> str:
    """What is said on stderr, but for why the verdict on the calibration that is used is not good."""
    text = err.decode() if isinstance(err, bytes) else err
    return re.sub(r"^Note: the calibration is (doubtful|weak): .*\n", "", text, count=1, flags=re.MULTILINE)


def run_quietly(arguments: Sequence[str | Path]) -> int:
    """Run `contactwrench` with these arguments in this process: its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["contactwrench", *map(str, arguments)])
        return exit_status(program())


@cache
def program() -> Any:
    """Its verbs and options, which take longer to make than most runs last."""
    return typer.main.get_command(app)
