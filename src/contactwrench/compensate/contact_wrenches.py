"""What compensation gives: contact wrenches, one or a table of them, contacts, a new zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..geometry.arrays import Array, Frozen, Rows, column, read_only
from .line_of_action import LineOfAction, line_of_action

NOT_KNOWN = read_only(np.full(6, np.nan))
"""The std of a wrench that cannot be computed."""
NOT_GIVEN: Any = None
"""Of a column: left out, or filled in."""
NOT_JUDGED, FREE, TOUCHING = -1, 0, 1
"""Of the column `contact`."""


@dataclass(frozen=True, eq=False)
class ContactWrench:
    """The contact wrench of one sample: `wrench` (6,), N and N m, sensor axes, and its `std` (6,), at `t` s.

    `valid` is False where something is wrong with the sample, and `reason` says what, a short word first. Where nothing
    can be computed the wrench is NaN. `contact`: whether something touches; None where that cannot be judged.
    """

    wrench: Array
    std: Array
    t: float
    valid: bool
    reason: str | None
    contact: bool | None


@dataclass(frozen=True, eq=False)
class Contact(Frozen):
    """One contact, from `onset` to `release` s (None: it lasts).

    `peak` (6,): the wrench that stood out most; `mean` (6,) with its `covariance` (6, 6). `onset_seen` is False where
    the tool had not been seen free before, so that a bias that moved looks the same.
    """

    onset: float
    release: float | None
    peak: Array
    mean: Array
    covariance: Array
    onset_seen: bool

    @cached_property
    def line(self) -> LineOfAction:
        """Where the mean force acts."""
        return line_of_action(self.mean, self.covariance)


@dataclass(frozen=True, eq=False)
class ContactWrenches(Rows):
    """Contact wrenches of n samples: `wrench` and its `std` (n, 6), N and N m, at `t` (n,) s; NaN where there is none.

    Where the samples were `judged` one by one, `valid` (n,) is False where something is wrong with one, and `reason`
    (n) says what; `contact` (n,) is 1 in contact, 0 free, -1 where that was not or cannot be judged. Else all are
    valid, and -1. `contacts`: those that ended in these samples, in sensor axes.

    From a `Compensator` there are also `statistic` (n,), which the test compares with `threshold` (n,), before
    hysteresis, and `covariance` (m, 6, 6), the wrench's, one after the other, of which `covariance_of` (n,) is each
    sample's.
    """

    wrench: Array = field(metadata=column(6))
    std: Array = field(metadata=column(6))
    t: Array | None = field(default=None, metadata=column())
    judged: bool = False
    valid: NDArray[np.bool_] = field(default=NOT_GIVEN, metadata=column(kind=np.bool_))
    reason: tuple[str | None, ...] = field(default=NOT_GIVEN, metadata=column(kind=object))
    contact: NDArray[np.int8] = field(default=NOT_GIVEN, metadata=column(kind=np.int8))
    contacts: tuple[Contact, ...] = ()
    statistic: Array = field(default=NOT_GIVEN, metadata=column(kind=np.float64))
    threshold: Array = field(default=NOT_GIVEN, metadata=column(kind=np.float64))
    covariance_of: NDArray[np.intp] = field(default=NOT_GIVEN, metadata=column(kind=np.intp))
    covariance: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.wrench)
        blank = {"valid": np.ones(n, np.bool_), "reason": (None,) * n, "contact": np.full(n, NOT_JUDGED, np.int8)}
        for name, values in blank.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, values)
        super().__post_init__()

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """All rows and contacts, part after part, without the covariances."""
        plain: dict[str, Any] = {"covariance_of": None, "covariance": None}
        joined = super().concatenate([replace(part, **plain) for part in parts])
        return replace(joined, contacts=tuple(contact for part in parts for contact in part.contacts))


@dataclass(frozen=True, eq=False)
class Zero(Frozen):
    """A new zero: by how much (6,) free readings had moved, N and N m, and the `std` (6,) of that as an estimate of how
    far the bias moved since the calibration, whose own error at this orientation is in it.
    """

    shift: Array
    std: Array
