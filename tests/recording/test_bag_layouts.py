"""Numbers are read where rosbags' own decoder finds them, for every type with numbers that is read, in either order."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactwrench.errors import InputError
from contactwrench.recording.bags.message_layout import joined, layout_of_message
from tests.support.bags import JOINT_STATE, ODOMETRY, POSE_STAMPED, ROS1, ROS2, TF, WRENCH_STAMPED, built

TYPES = (
    WRENCH_STAMPED,
    POSE_STAMPED,
    ODOMETRY,
    JOINT_STATE,
    TF,
    "sensor_msgs/msg/CameraInfo",
    "geometry_msgs/msg/Wrench",
)
ENCODINGS = ("ros1", "little", "big")


def _serialized(encoding: str, one: Any, msgtype: str) -> bytes:
    if encoding == "ros1":
        return bytes(ROS1.serialize_ros1(one, msgtype))
    return bytes(ROS2.serialize_cdr(one, msgtype, little_endian=encoding == "little"))


def _decoded(encoding: str, raw: bytes, msgtype: str) -> Any:
    return ROS1.deserialize_ros1(raw, msgtype) if encoding == "ros1" else ROS2.deserialize_cdr(raw, msgtype)


def _leaves(store: Any, msgtype: str, one: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number, array of numbers and text of a message that rosbags decoded, by its path."""
    for name, (node, of) in store.fielddefs[msgtype][1]:
        value, here = getattr(one, name), f"{path}{name}"
        if node.name == "NAME":
            yield from _leaves(store, of, value, f"{here}.")
        elif node.name == "BASE" or isinstance(value, np.ndarray):
            yield here, value
        else:
            for k, inner in enumerate(value):
                if isinstance(inner, str):
                    yield f"{here}.{k}", inner
                else:
                    yield from _leaves(store, of[0][1], inner, f"{here}.{k}.")


@st.composite
def messages(draw: st.DrawFn, msgtype: str, store: Any) -> Any:
    """A message of any numbers, texts and lengths."""

    def fields(name: str) -> dict[str, Any]:
        return {field: value(what) for field, what in store.fielddefs[name][1]}

    def number(kind: str) -> Any:
        if kind == "bool":
            return draw(st.booleans())
        if kind.startswith("float"):
            return draw(st.floats(width=32 if kind == "float32" else 64))
        info = np.iinfo(kind if "int" in kind else "uint8")
        return draw(st.integers(int(info.min), int(info.max)))

    def value(what: Any) -> Any:
        node, of = what[0].name, what[1]
        if node == "NAME":
            return fields(of)
        if node == "BASE":
            return draw(st.text("abcé/_0", max_size=9)) if of[0] == "string" else number(of[0])
        inner, count = of
        return [value(inner) for _ in range(count if node == "ARRAY" else draw(st.integers(0, 3)))]

    return built(store, msgtype, fields(msgtype))


@pytest.mark.parametrize("encoding", ENCODINGS)
@settings(max_examples=30, deadline=None)
@given(data=st.data(), msgtype=st.sampled_from(TYPES))
def test_every_number_and_text_is_where_rosbags_finds_it(encoding: str, data: st.DataObject, msgtype: str) -> None:
    store = ROS1 if encoding == "ros1" else ROS2
    several = data.draw(st.lists(messages(msgtype, store), min_size=1, max_size=4))
    raws = [_serialized(encoding, one, msgtype) for one in several]
    raw = joined(raws)
    for first, message in enumerate(raws):
        layout = layout_of_message(message, msgtype, store.fielddefs, encoding != "ros1")
        as_long = np.flatnonzero(raw.length == len(message))
        rows = as_long[layout.fits(raw[as_long])]
        assert first in rows
        for place, row in enumerate(rows.tolist()):
            expected = dict(_leaves(store, msgtype, _decoded(encoding, raws[row], msgtype)))
            assert expected.keys() == layout.numbers.keys() | layout.texts.keys()
            for path, value in expected.items():
                if isinstance(value, str):
                    assert layout.texts[path] == value
                else:
                    found = raw[rows].values(layout, path)[place]
                    np.testing.assert_array_equal(found, np.atleast_1d(np.asarray(value, dtype=np.float64)))


def test_what_fills_the_gaps_of_cdr_does_not_matter() -> None:
    """Fast CDR leaves in them whatever the memory held."""
    one = built(ROS2, WRENCH_STAMPED, {"header": {"frame_id": "ab"}, "wrench": {"force": {"x": 7.0}}})
    clean = _serialized("little", one, WRENCH_STAMPED)
    gap = slice(4 + 8 + 4 + 3, 4 + 16)
    assert clean[gap] == b"\0" * (gap.stop - gap.start)
    dirty = clean[: gap.start] + b"\xff" * (gap.stop - gap.start) + clean[gap.stop :]
    raw = joined([clean, dirty])
    layout = layout_of_message(clean, WRENCH_STAMPED, ROS2.fielddefs, True)
    assert layout.fits(raw).tolist() == [True, True]
    assert raw.values(layout, "wrench.force.x")[:, 0].tolist() == [7.0, 7.0]


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ENCODINGS)
@settings(max_examples=75, deadline=None)
@given(data=st.data())
def test_any_bytes_are_a_message_or_one_clear_error(encoding: str, data: st.DataObject) -> None:
    msgtype = data.draw(st.sampled_from(TYPES))
    store = ROS1 if encoding == "ros1" else ROS2
    whole = bytearray(_serialized(encoding, data.draw(messages(msgtype, store)), msgtype))
    for _ in range(data.draw(st.integers(0, 3))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    broken = bytes(whole[: data.draw(st.integers(0, len(whole)))])
    with suppress(InputError):
        layout_of_message(broken, msgtype, store.fielddefs, encoding != "ros1")
