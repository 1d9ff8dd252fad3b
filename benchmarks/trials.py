"""Trials of a benchmark: many recordings a cell, what became of each, and figures with their standard errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

import contactwrench as cw
from tests.support.world import Array, random_rotations

from .auto import chunks
from .table import Row

BLIND = 20_261_122
DEVELOPMENT = 7
"""Seeds: a full run judges on the blind one, a quick run is for development and never sees it."""

UNSEEN = random_rotations(100, np.random.default_rng(77))

Trial = Callable[[Any, np.random.Generator], dict[str, float]]


@dataclass(frozen=True, eq=False)
class Found:
    """What became of the recordings of a cell, column by column, and how many of them were refused."""

    columns: dict[str, Array]
    refused: int

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def get(self, name: str) -> Array:
        """A column; nothing where all was refused."""
        return self.columns.get(name, np.zeros(0))

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @property
    def remark(self) -> str:
        """How many, and how many were refused."""
        return f"{len(self)} recordings" + (f", {self.refused} refused" if self.refused else "")


def _some(trial: Trial, cell: Any, seed: tuple[int, ...], n: int) -> Found:
    rng = np.random.default_rng(seed)
    outcomes, refused = [], 0
    for _ in range(n):
        try:
            outcomes.append(trial(cell, rng))
        except cw.ContactWrenchError:
            refused += 1
    names = outcomes[0] if outcomes else {}
    return Found({name: np.array([outcome[name] for outcome in outcomes]) for name in names}, refused)


def joined(parts: Iterable[Found]) -> Found:
    """As one; of parts with every recording refused nothing but their number is left."""
    parts = list(parts)
    there = [part.columns for part in parts if part.columns]
    names = there[0] if there else {}
    columns = {name: np.concatenate([part[name] for part in there]) for name in names}
    return Found(columns, sum(part.refused for part in parts))


def run(pool: Executor, trial: Trial, cells: Sequence[Any], n: int, seed: tuple[int, ...]) -> list[Found]:
    """`n` trials of each cell."""
    jobs = [
        [pool.submit(_some, trial, cell, (*seed, k, chunk), m) for chunk, m in enumerate(chunks(n))]
        for k, cell in enumerate(cells)
    ]
    return [joined(job.result() for job in parts) for parts in jobs]


def ratio(above: Array, below: Array) -> tuple[float, float]:
    """Ratio of the RMS of paired squares, and its standard error (delta method on the paired means)."""
    if not len(above):
        return np.nan, np.nan
    value = float(np.sqrt(above.mean() / below.mean()))
    apart = above / above.mean() - below / below.mean()
    return value, 0.5 * value * float(apart.std()) / np.sqrt(len(above))


def ratio_row(what: str, above: Array, below: Array, unit: str, most: float | None = None, remark: str = "") -> Row:
    """A row of a ratio of RMS."""
    value, error = ratio(above, below)
    return Row(what, value, unit, most=most, remark=remark, standard_error=error)


def share_row(
    what: str, of_each: Array, least: float | None = None, most: float | None = None, remark: str = ""
) -> Row:
    """A row of a share in per cent, of a number from 0 to 1 for each recording. The standard error is binomial, and
    never zero: where none of n shows, half a one is taken to (Jeffreys).
    """
    n = len(of_each)
    if not n:
        return Row(what, np.nan, "%", least, most, remark, np.nan)
    supposed = (float(of_each.sum()) + 0.5) / (n + 1.0)
    binomial = np.sqrt(supposed * (1.0 - supposed) / n)
    several = 0.0 < of_each.mean() < 1.0 and not np.isin(of_each, (0.0, 1.0)).all()
    error = float(of_each.std() / np.sqrt(n)) if several else float(binomial)
    return Row(what, 100.0 * float(of_each.mean()), "%", least, most, remark, 100.0 * error)


def verdict(calibration: cw.Calibration) -> str:
    """`good`, `doubtful` or `weak`; of a program without a verdict, by the severities of its findings."""
    said = getattr(calibration, "verdict", None)
    if isinstance(said, str):
        return said.partition(":")[0]
    severities = {str(finding.severity) for finding in calibration.findings}
    return next((word for word in ("weak", "doubtful") if word in severities), "good")


def inside(calibration: cw.Calibration, name: str, truth: Any) -> float:
    """The share of a parameter's axes whose 95 % interval holds the truth."""
    low, high = calibration.interval(name)
    return float(np.mean((low <= truth) & (truth <= high)))


def force_error(calibration: cw.Calibration, truth: Array) -> float:
    """Mean squared error (N^2), a norm, of the predicted free force at the unseen orientations."""
    return float(np.sum((calibration.predict(UNSEEN)[:, :3] - truth[:, :3]) ** 2, axis=1).mean())
