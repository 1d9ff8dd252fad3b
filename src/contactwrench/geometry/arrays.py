"""Arrays of float64, results that hold them read-only, and tables of them: one row for each sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import Field, dataclass, fields, replace
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..errors import InputError

Array: TypeAlias = NDArray[np.float64]
Vector: TypeAlias = np.ndarray[tuple[int], np.dtype[np.float64]]
Matrix: TypeAlias = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""Types that say how many axes an array has, for a reader of files who has nothing but the type to go by."""


def read_only(values: ArrayLike) -> Array:
    """A float64 copy that cannot be written to."""
    return _handed_over(np.array(values, dtype=np.float64, order="C"))


@dataclass(frozen=True, eq=False)
class Frozen:
    """A base of frozen results: an array in any field becomes a copy that cannot be written to."""

    def __post_init__(self) -> None:
        for each in fields(self):
            values = getattr(self, each.name)
            if isinstance(values, np.ndarray):
                kind = np.float64 if values.dtype.kind == "f" else values.dtype
                object.__setattr__(self, each.name, _frozen(values, np.dtype(kind)))


def column(*row: int, kind: DTypeLike = np.float64) -> dict[str, Any]:
    """Metadata of a field of `Rows` that has a `row` of that shape for each sample: `column()` is (n,), `column(6)` is
    (n, 6). A column of the kind `object` is kept as a tuple of n.
    """
    return {"row": row, "kind": np.dtype(kind)}


@dataclass(frozen=True, eq=False)
class Rows:
    """A base of frozen tables: fields with the metadata of `column` are copied, read-only, and pair row by row.

    A column that is None is left out. Raises `InputError` for a shape that does not pair with the first column.
    """

    def __post_init__(self) -> None:
        first, n = "", 0
        for each in _columns(self):
            values = getattr(self, each.name)
            if values is None:
                continue
            row, kind = each.metadata["row"], each.metadata["kind"]
            owned = tuple(values) if kind.hasobject else _frozen(values, kind)
            shape = (len(owned),) if isinstance(owned, tuple) else owned.shape
            if not first:
                n = shape[0] if shape else 0
            if shape != (n, *row):
                expected = f"({', '.join(['n', *map(str, row)])}{'' if row else ','})"
                pairs = f" with n = {n} as in {first}" if first else ""
                raise InputError(f"{each.name} has shape {shape}, expected {expected}{pairs}")
            first = first or each.name
            object.__setattr__(self, each.name, owned)

    def __len__(self) -> int:
        return next((len(values) for each in _columns(self) if (values := getattr(self, each.name)) is not None), 0)

    def select(self, rows: ArrayLike | slice) -> Self:
        """The rows that a mask, indices or a slice pick, in that order."""
        pick = rows if isinstance(rows, slice) else np.asarray(rows)
        if isinstance(pick, np.ndarray) and not pick.size:
            pick = slice(0)

        def picked(values: Any) -> Any:
            if isinstance(values, tuple):
                return tuple(values[place] for place in np.arange(len(values))[pick].tolist())
            return None if values is None else _handed_over(values[pick])

        return replace(self, **{each.name: picked(getattr(self, each.name)) for each in _columns(self)})

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """All rows, part after part; a column that a part with rows lacks is left out, all else is as in the first."""

        def joined(values: list[Any]) -> Any:
            if any(part is None for part in values):
                return None
            if isinstance(values[0], tuple):
                return tuple(item for part in values for item in part)
            return values[0] if len(values) == 1 else _handed_over(np.concatenate(values))

        if len(parts) == 1:
            return parts[0]
        with_rows = [part for part in parts if len(part)] or parts[:1]
        columns = {each.name: joined([getattr(part, each.name) for part in with_rows]) for each in _columns(parts[0])}
        return replace(parts[0], **columns)


def _columns(rows: Rows) -> list[Field[Any]]:
    return [each for each in fields(rows) if "row" in each.metadata]


def _handed_over(values: NDArray[Any]) -> NDArray[Any]:
    """An array that nobody else holds, made read-only in place."""
    values.flags.writeable = False
    return values


def _frozen(values: ArrayLike, kind: np.dtype[Any]) -> NDArray[Any]:
    """The array itself where nobody can write to it any more, else a read-only copy."""
    if isinstance(values, np.ndarray) and values.dtype == kind and values.base is None and _is_final(values):
        return values
    return _handed_over(np.array(values, dtype=kind, order="C"))


def _is_final(values: NDArray[Any]) -> bool:
    return values.flags.c_contiguous and not values.flags.writeable
