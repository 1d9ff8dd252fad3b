"""Universal Robots' RTDE, version 2: packages of a size, a type and a payload, and the fields of a data package."""

from __future__ import annotations

from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

VERSION, CONTROLLER, OUTPUTS, START, PAUSE, DATA, TEXT = b"VvOSPUM"
HEADER = Struct(">HB")
FORMS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
LONGEST = 2_048
"""Bytes of a package that is no data."""


class Package(NamedTuple):
    """`kind` is its letter's number."""

    kind: int
    payload: bytes


class Recipe:
    """What a data package holds.

    Args:
        number: that the controller gave it.
        names: of the fields.
        types: of the fields, by RTDE's names.

    Attributes:
        places: of each field's numbers among all of a package.
    """

    def __init__(self, number: int, names: Sequence[str], types: Sequence[str]) -> None:
        self.struct = Struct(">" + "".join(FORMS[each] for each in types))
        self.header = HEADER.pack(HEADER.size + 1 + self.struct.size, DATA) + bytes([number])
        self.places: dict[str, slice] = {}
        at = 0
        for name, kind in zip(names, types, strict=True):
            width = int(FORMS[kind][:-1] or 1)
            self.places[name] = slice(at, at + width)
            at += width


def package(kind: int, payload: bytes = b"") -> bytes:
    """As it is sent."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def first(buffer: bytes) -> tuple[Package | None, int]:
    """The package that a buffer begins with, and its bytes; None and 0 while it is not whole.

    Raises `ValueError` where the buffer begins with none.
    """
    if len(buffer) < HEADER.size:
        return None, 0
    size, kind = HEADER.unpack_from(buffer)
    if not HEADER.size <= size <= LONGEST or kind not in (VERSION, CONTROLLER, OUTPUTS, START, PAUSE, DATA, TEXT):
        raise ValueError
    return (Package(kind, buffer[HEADER.size : size]), size) if len(buffer) >= size else (None, 0)


def text_of(payload: bytes) -> str | None:
    """What a text message says; None where it is none: a length, the text, a length, who says it, how grave."""
    end = 1 + payload[0] if payload else 0
    if not payload or len(payload) <= end or len(payload) != end + payload[end] + 2:
        return None
    return payload[1:end].decode("utf-8", "replace")
