"""Arrays of float64 from what users hand over, results that nobody can change, and tables: one row for each sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, NoReturn, Self, TypeAlias, cast

import numpy as np
from numpy.ma import MaskedArray, is_masked
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..errors import InputError

Array: TypeAlias = NDArray[np.float64]
Vector: TypeAlias = np.ndarray[tuple[int], np.dtype[np.float64]]
Matrix: TypeAlias = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""Types that say how many axes an array has, for a reader of files who has nothing but the type to go by."""


FLOAT64 = np.dtype(np.float64)
WORDS = {"b": "truth values", "U": "text", "S": "text", "c": "complex numbers", "M": "dates", "m": "durations"}


def numbers(values: ArrayLike, name: str) -> Array:
    """What a user hands over, as float64: itself where it is that. `InputError`, by `name`, for what has to be guessed:
    text, truth values, complex numbers, dates, objects, rows of unequal length, masked values.
    """
    if type(values) is np.ndarray and values.dtype is FLOAT64:
        return values
    array = _unmasked(values, name)
    if array.dtype.kind not in "fiu":
        found = WORDS.get(array.dtype.kind, "objects")
        raise InputError(f"{name} has {found}, expected numbers: convert them, as by .astype(float)")
    return array.astype(np.float64, copy=False)


def number(values: Any, name: str) -> float:
    """A single one of `numbers`."""
    array = numbers(values, name)
    if array.shape:
        raise InputError(f"{name} has shape {array.shape}, expected one number")
    return float(array)


def _unmasked(values: Any, name: str) -> NDArray[Any]:
    """An array of whatever type. Raises `InputError` where a part is masked, or rows are of unequal length."""
    if type(values) is np.ndarray:
        return values
    parts = values if isinstance(values, list | tuple) else (values,)
    if any(isinstance(part, MaskedArray) and is_masked(part) for part in parts):
        raise InputError(f"{name} has masked values, expected none: leave such samples out, or fill them")
    try:
        return np.asarray(values)
    except (TypeError, ValueError):
        raise InputError(f"{name} has rows of unequal length, expected an array of numbers") from None


def seconds(values: Any, name: str = "t") -> Array:
    """Times, s, as `numbers`; also numpy's dates, s since 1970, and its durations. One that is none is NaN."""
    times = _unmasked(values, name)
    if times.dtype.kind == "M":
        times = times - np.datetime64(0, "s")
    return numbers(times / np.timedelta64(1, "s") if times.dtype.kind == "m" else times, name)


def read_only(values: ArrayLike) -> Array:
    """A float64 copy that cannot be written to."""
    return _handed_over(np.array(values, dtype=np.float64, order="C"))


class ReadOnlyDict(dict[str, Any]):
    """A dict that cannot be changed; one made of it can."""

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("a result cannot be changed: change a copy, dict(...)")

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return ReadOnlyDict, (dict(self),)


def frozen(values: Any) -> Any:
    """The same that nobody can change: read-only copies of arrays, tuples for lists, `ReadOnlyDict`s; else as it is."""
    if isinstance(values, np.ndarray):
        return _frozen(values, FLOAT64 if values.dtype.kind == "f" else values.dtype)
    if type(values) in (list, tuple):
        return tuple(map(frozen, values))
    if isinstance(values, Mapping):
        return ReadOnlyDict({key: frozen(value) for key, value in values.items()})
    return values


class Sealed:
    """A base of frozen results: one from a pickle, or a copy, is as frozen."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update({name: frozen(value) for name, value in state.items()})


@dataclass(frozen=True, eq=False)
class Frozen(Sealed):
    """A base of frozen results in which every field is `frozen`."""

    def __post_init__(self) -> None:
        self.__setstate__(vars(self))


def column(*row: int, kind: DTypeLike = np.float64) -> dict[str, Any]:
    """Metadata of a field of `Rows` that has a `row` of that shape for each sample: `column()` is (n,), `column(6)` is
    (n, 6). A column of the kind `object` is kept as a tuple of n; one of the name `t` takes dates.
    """
    return {"row": row, "kind": np.dtype(kind)}


def shaped(*shape: int | str, least: float | None = None) -> dict[str, Any]:
    """Metadata of a field that has an array of that `shape`, of which a letter stands for a size that another field
    has, and of numbers from `least` on; for what is read from a file.
    """
    return {"shape": shape, "least": least}


@dataclass(frozen=True, eq=False)
class Rows(Frozen):
    """A base of frozen tables: fields with the metadata of `column` are copied, read-only, and pair row by row.

    A column that is None is left out. Raises `InputError` for what is no column of numbers (or truth values), and for a
    shape that does not pair with the first column.
    """

    def __post_init__(self) -> None:
        first, n, table = "", 0, cast(Any, type(self))
        for name, row, kind in _layout(table):
            values = getattr(self, name)
            if kind is None:
                object.__setattr__(self, name, frozen(values))
                continue
            if values is None:
                continue
            owned = tuple(values) if kind.hasobject else _frozen(_column(values, kind, name), kind)
            shape = (len(owned),) if isinstance(owned, tuple) else owned.shape
            if not first:
                n = shape[0] if shape else 0
            if shape != (n, *row):
                expected = f"({', '.join(['n', *map(str, row)])}{'' if row else ','})"
                pairs = f" with n = {n} as in {first}" if first else ""
                raise InputError(f"{name} has shape {shape}, expected {expected}{pairs}")
            first = first or name
            object.__setattr__(self, name, owned)

    def __len__(self) -> int:
        return next((len(values) for name in _columns(self) if (values := getattr(self, name)) is not None), 0)

    def select(self, rows: ArrayLike | slice) -> Self:
        """The rows that a mask, indices or a slice pick, in that order."""
        pick = rows if isinstance(rows, slice) else np.asarray(rows)
        if isinstance(pick, np.ndarray) and not pick.size:
            pick = slice(0)

        def picked(values: Any) -> Any:
            if isinstance(values, tuple):
                return tuple(values[place] for place in np.arange(len(values))[pick].tolist())
            return None if values is None else _handed_over(values[pick])

        return replace(self, **{name: picked(getattr(self, name)) for name in _columns(self)})

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
        columns = {name: joined([getattr(part, name) for part in with_rows]) for name in _columns(parts[0])}
        return replace(parts[0], **columns)


@cache
def _layout(table: type[Rows]) -> tuple[tuple[str, tuple[int, ...], np.dtype[Any] | None], ...]:
    """Name, shape of a row, and type of each field; None: it is no column."""
    return tuple((each.name, each.metadata.get("row", ()), each.metadata.get("kind")) for each in fields(table))


def _column(values: Any, kind: np.dtype[Any], name: str) -> NDArray[Any]:
    if type(values) is np.ndarray and values.dtype is kind:
        return values
    if kind.kind == "f":
        return seconds(values, name) if name == "t" else numbers(values, name)
    array = _unmasked(values, name)
    if array.size and array.dtype.kind not in "biu":
        raise InputError(f"{name} has {WORDS.get(array.dtype.kind, 'numbers')}, expected truth values")
    return array


def _columns(rows: Rows) -> list[str]:
    return [name for name, _, kind in _layout(cast(Any, type(rows))) if kind is not None]


def _handed_over(values: NDArray[Any]) -> NDArray[Any]:
    """An array that nobody else holds, read-only for good: of a view whose base is, numpy makes none that is not."""
    values.flags.writeable = False
    return values.view()


def _frozen(values: ArrayLike, kind: np.dtype[Any]) -> NDArray[Any]:
    """The array itself where nobody can write to it any more, else a read-only copy."""
    if isinstance(values, np.ndarray) and values.dtype == kind and _is_final(values, values.base):
        return values
    return _handed_over(np.array(values, dtype=kind, order="C"))


def _is_final(values: NDArray[Any], base: Any) -> bool:
    """Whether `values` are all of a base that is read-only: of a part, all of it would stay in memory."""
    sealed = type(base) is np.ndarray and not base.flags.writeable and base.base is None and base.size == values.size
    return sealed and values.flags.c_contiguous and not values.flags.writeable
