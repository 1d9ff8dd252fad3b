"""Arrays of float64 from what users hand over, results that nobody can change, and tables: one row for each sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from datetime import UTC, datetime, timedelta
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
TimesLike: TypeAlias = ArrayLike | Sequence[datetime]
"""Times, s, or dates."""
COARSEST = 0.01
"""s: between neighbouring times of a float type that is taken. 32 bits step by more after a day and a half."""

FLOAT64 = np.dtype(np.float64)
WORDS = {"b": "truth values", "U": "text", "S": "text", "c": "complex numbers", "M": "dates", "m": "durations"}


def numbers(values: ArrayLike | None, name: str) -> Array:
    """What a user hands over, as float64: itself where it is that. `InputError`, by `name`, for what has to be guessed:
    text, truth values, complex numbers, dates, objects, rows of unequal length, masked values.
    """
    if type(values) is np.ndarray and values.dtype is FLOAT64:
        return values
    array = _unmasked(values, name)
    if array.dtype.kind not in "fiu":
        if array.shape == () and array.item() is None:
            raise InputError(f"{name} is None, expected numbers")
        if array.size and hasattr(array.flat[0], "as_quat"):
            raise InputError(f"{name} has Rotations one by one, expected one of them all: Rotation.concatenate(list)")
        found = WORDS.get(array.dtype.kind, "objects")
        raise InputError(f"{name} has {found}, expected numbers: convert them, as by .astype(float)")
    return array.astype(np.float64, copy=False)


def number(values: Any, name: str) -> float:
    """A single one of `numbers`."""
    if type(values) is float:
        return values
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
    """Times, s, as `numbers`; also dates, s since 1970, numpy's, pandas' or Python's, and numpy's durations. One that
    is none is NaN. Of dates without a time zone the clock is taken for UTC, as numpy does. Raises `InputError` also for
    a float type that rounds them by more than `COARSEST`.
    """
    times = _unmasked(values, name)
    if times.dtype.kind == "O" and times.size and all(isinstance(each, datetime) for each in times.flat):
        times = _since_1970(times, name)
    if times.dtype.kind == "M":
        times = times - np.datetime64(0, "s")
    if times.dtype.kind == "f" and times.dtype.itemsize < FLOAT64.itemsize:
        largest = np.max(np.abs(times), where=np.isfinite(times), initial=0)
        if (step := np.spacing(largest)) > COARSEST:
            raise InputError(
                f"{name} is {times.dtype}, which has steps of {step:.3g} s at {largest:.3g} s, expected float64: "
                "convert what it was made of, as these are rounded already"
            )
    return numbers(times / np.timedelta64(1, "s") if times.dtype.kind == "m" else times, name)


def _since_1970(dates: NDArray[Any], name: str) -> Array:
    """Python's dates, of which pandas' are some, as s."""
    begin = datetime(1970, 1, 1, tzinfo=UTC if any(each.tzinfo is not None for each in dates.flat) else None)
    try:
        return np.array([(each - begin) / timedelta(seconds=1) for each in dates.flat]).reshape(dates.shape)
    except TypeError:
        expected = "expected all with one or all without: state it with each, as by .replace(tzinfo=)"
        raise InputError(f"{name} has dates with a time zone and without, {expected}") from None


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
    (n, 6). A column of the kind `object` is kept as a tuple of n; one of the name `t` or `came` takes dates.
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

    A column that is None is left out, where it has a default or its type says so. Raises `InputError` for what is no
    column of numbers (or truth values), and for a shape that does not pair with the first column.
    """

    def __post_init__(self) -> None:
        first, n, table = "", 0, cast(Any, type(self))
        for name, row, kind, may_be_none in _layout(table):
            values = getattr(self, name)
            if kind is None:
                object.__setattr__(self, name, frozen(values))
                continue
            if values is None and may_be_none:
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
        """The rows that a mask, indices or a slice pick, in that order. Raises `InputError` where one is not there."""
        pick = rows if isinstance(rows, slice) else np.asarray(rows)
        if isinstance(pick, np.ndarray) and not pick.size:
            pick = slice(0)

        def picked(values: Any) -> Any:
            if isinstance(values, tuple):
                return tuple(values[place] for place in np.arange(len(values))[pick].tolist())
            return None if values is None else _handed_over(values[pick])

        try:
            columns = {name: picked(getattr(self, name)) for name in _columns(self)}
        except IndexError as error:
            expected = "expected a mask of as many, indices of rows that are there, or a slice"
            raise InputError(f"rows cannot be picked of {len(self)} ({error}), {expected}") from None
        return replace(self, **columns)

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
def _layout(table: type[Rows]) -> tuple[tuple[str, tuple[int, ...], np.dtype[Any] | None, bool], ...]:
    """Name, shape of a row, type of each field (None: it is no column), and whether it may be None."""
    return tuple(
        (
            each.name,
            each.metadata.get("row", ()),
            each.metadata.get("kind"),
            each.default is not MISSING or "None" in str(each.type),
        )
        for each in fields(table)
    )


def _column(values: Any, kind: np.dtype[Any], name: str) -> NDArray[Any]:
    if type(values) is np.ndarray and values.dtype is kind:
        return values
    if kind.kind == "f":
        return seconds(values, name) if name in ("t", "came") else numbers(values, name)
    array = _unmasked(values, name)
    if array.size and array.dtype.kind not in "biu":
        raise InputError(f"{name} has {WORDS.get(array.dtype.kind, 'numbers')}, expected truth values")
    return array


def _columns(rows: Rows) -> list[str]:
    return [name for name, _, kind, _ in _layout(cast(Any, type(rows))) if kind is not None]


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
