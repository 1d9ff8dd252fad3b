"""Tables of rows: copied, read-only, paired, selected and joined."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from contactwrench.errors import InputError
from contactwrench.geometry.arrays import Array, Frozen, Rows, column


@dataclass(frozen=True, eq=False)
class _Table(Rows):
    t: Array = field(metadata=column())
    wrench: Array = field(metadata=column(6))
    valid: NDArray[np.bool_] | None = field(default=None, metadata=column(kind=np.bool_))
    reason: tuple[str | None, ...] | None = field(default=None, metadata=column(kind=object))
    source: str = "arrays"


def _table(n: int) -> _Table:
    reasons = tuple(None if k % 2 else f"row {k}" for k in range(n))
    return _Table(np.arange(float(n)), np.arange(6.0 * n).reshape(n, 6), np.arange(n) % 3 == 0, reasons, "here")


def test_columns_are_copies_that_cannot_be_written_to() -> None:
    t, wrench = np.arange(3.0), np.ones((3, 6))
    table = _Table(t, wrench)
    t[0] = wrench[0, 0] = 9.0
    assert (table.t[0], table.wrench[0, 0], len(table)) == (0.0, 1.0, 3)
    for values in (table.t, table.wrench):
        assert not values.flags.writeable
    view = np.ones((3, 6))[::1]
    view.flags.writeable = False
    assert not np.shares_memory(_Table(t, view).wrench, view)


@pytest.mark.parametrize(
    ("t", "wrench", "reason", "message"),
    [
        (np.ones((2, 2)), np.ones((2, 6)), None, "t has shape (2, 2), expected (n,)"),
        (np.array(1.0), np.ones((2, 6)), None, "t has shape (), expected (n,)"),
        (np.ones(2), np.ones((3, 6)), None, "wrench has shape (3, 6), expected (n, 6) with n = 2 as in t"),
        (np.ones(2), np.ones((2, 6)), ("one",), "reason has shape (1,), expected (n,) with n = 2 as in t"),
    ],
)
def test_columns_that_do_not_pair(t: Array, wrench: Array, reason: tuple[str, ...] | None, message: str) -> None:
    with pytest.raises(InputError) as caught:
        _Table(t, wrench, reason=reason)
    assert str(caught.value) == message


@given(st.integers(0, 8), st.data())
def test_selected_rows_are_numpys(n: int, data: st.DataObject) -> None:
    table = _table(n)
    indices = data.draw(st.lists(st.integers(0, n - 1), max_size=10)) if n else []
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)), dtype=bool)
    for rows in (indices, mask, slice(*sorted(data.draw(st.tuples(st.integers(0, 8), st.integers(0, 8)))))):
        pick = rows if isinstance(rows, slice) else np.arange(n)[np.asarray(rows, dtype=bool if rows is mask else int)]
        found = table.select(rows)
        assert np.array_equal(found.t, table.t[pick])
        assert np.array_equal(found.wrench, table.wrench[pick])
        assert found.valid is not None
        assert table.valid is not None
        assert np.array_equal(found.valid, table.valid[pick])
        assert table.reason is not None
        assert found.reason == tuple(table.reason[int(k)] for k in np.arange(n)[pick])
        assert found.source == "here"


@given(st.integers(0, 8), st.integers(0, 8))
def test_parts_joined_are_the_whole(n: int, cut: int) -> None:
    whole = _table(n)
    joined = _Table.concatenate([whole.select(slice(0, cut)), whole.select(slice(cut, None))])
    assert np.array_equal(joined.wrench, whole.wrench)
    assert joined.reason == whole.reason
    assert joined.source == "here"
    assert not joined.wrench.flags.writeable


def test_a_column_that_one_part_lacks_is_left_out() -> None:
    joined = _Table.concatenate([_table(2), _Table(np.zeros(1), np.zeros((1, 6)))])
    assert (len(joined), joined.valid, joined.reason) == (3, None, None)


def test_a_part_without_rows_need_not_have_the_columns_of_the_others() -> None:
    joined = _Table.concatenate([_Table(np.empty(0), np.empty((0, 6)), source="nowhere"), _table(2)])
    assert (len(joined), joined.source) == (2, "nowhere")
    assert joined.valid is not None


@dataclass(frozen=True, eq=False)
class _Result(Frozen):
    values: Array
    flags: NDArray[np.bool_]
    maybe: Array | None
    name: str


def test_a_frozen_result_holds_read_only_copies_of_its_arrays() -> None:
    values: NDArray[Any] = np.arange(3, dtype=np.float32)
    result = _Result(values, np.array([True, False]), None, "x")
    values[0] = 7.0
    assert result.values.dtype == np.float64
    assert result.values.tolist() == [0.0, 1.0, 2.0]
    assert result.flags.dtype == np.bool_
    assert result.maybe is None
    for array in (result.values, result.flags):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
