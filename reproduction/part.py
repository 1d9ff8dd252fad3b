"""A part of the experiment: what was asked, the figures with their standard errors, and what they say."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Measured:
    """A figure from `trials` independent trials, with its standard error (None: exact, or from one trial)."""

    value: float
    standard_error: float | None
    trials: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", float(self.value))
        if self.standard_error is not None:
            object.__setattr__(self, "standard_error", float(self.standard_error))


@dataclass(frozen=True)
class Table:
    """Figures in one unit for each column. `key` is the table's name in the JSON, and so are the labels of the rows and
    the columns; a cell that is text is said as it stands.
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Measured | str | None, ...]], ...]
    note: str = ""


@dataclass(frozen=True)
class Picture:
    """An SVG, or an `img` with its data inside, as it goes into the page; `name` is its file's name in docs/images."""

    name: str
    html: str
    caption: str


@dataclass(frozen=True)
class Part:
    """One section of the report. `paragraphs` are plain words that hold for the figures as they came out."""

    key: str
    title: str
    paragraphs: tuple[str, ...]
    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...] = ()


def mean(values: ArrayLike) -> Measured:
    """The mean of one figure a trial (n,), with its standard error."""
    array = np.asarray(values, dtype=np.float64)
    error = None if len(array) < 2 else float(array.std(ddof=1) / np.sqrt(len(array)))
    return Measured(float(array.mean()), error, len(array))


def root_mean_square(squares: ArrayLike) -> Measured:
    """The root of the mean of one square a trial (n,); its standard error by propagation of the mean's."""
    of = mean(squares)
    root = float(np.sqrt(of.value))
    error = None if of.standard_error is None or root == 0.0 else of.standard_error / (2.0 * root)
    return Measured(root, error, of.trials)


def share(successes: Iterable[bool]) -> Measured:
    """The share of successes (0 to 1), with the binomial standard error."""
    outcomes = np.array(list(successes), dtype=bool)
    p = float(outcomes.mean())
    return Measured(p, float(np.sqrt(p * (1.0 - p) / len(outcomes))), len(outcomes))


def wilson(p: float, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % interval of a share `p` of `trials` (Wilson 1927): within 0 and 1, and right at both ends."""
    centre = (p + z * z / (2.0 * trials)) / (1.0 + z * z / trials)
    half = z * np.sqrt(p * (1.0 - p) / trials + z * z / (4.0 * trials**2)) / (1.0 + z * z / trials)
    return float(centre - half), float(centre + half)
