"""Parquet files, page by page, whose pages hold much more than they weigh: written from the format's definition
(apache/parquet-format, src/main/thrift/parquet.thrift), as no library writes such.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from tests.support.recordings import WRENCH

DOUBLE, BYTE_ARRAY, FIXED = 5, 6, 7
"""Types of a column."""
PLAIN, RLE, DELTA_BYTE_ARRAY, RLE_DICTIONARY = 0, 3, 7, 8
UNCOMPRESSED, GZIP = 0, 2
COLUMNS = (*WRENCH, "qx", "qy", "qz", "qw")


def varint(number: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    low, rest = number & 0x7F, number >> 7
    return bytes([low | 0x80]) + varint(rest) if rest else bytes([low])


def zigzag(number: int) -> bytes:
    """A signed number of Thrift's compact protocol."""
    return varint((number << 1) ^ (number >> 63))


def message(**fields: bytes) -> bytes:
    """A struct of Thrift: `_3=...` is field 3; each value begins with the letter of its type."""
    out, before = b"", 0
    for name, value in fields.items():
        number = int(name[1:])
        out += bytes([(number - before) << 4 | value[0]]) + value[1:]
        before = number
    return out + b"\0"


def whole(number: int) -> bytes:
    """An i32 as a field."""
    return b"\x05" + zigzag(number)


def long(number: int) -> bytes:
    """An i64 as a field."""
    return b"\x06" + zigzag(number)


def text(content: str) -> bytes:
    """A text as a field."""
    return b"\x08" + varint(len(content)) + content.encode()


def nested(content: bytes) -> bytes:
    """A struct as a field."""
    return b"\x0c" + content


def listed(kind: int, items: Sequence[bytes]) -> bytes:
    """A list as a field, of items of a type."""
    return b"\x09" + bytes([0xF0 | kind]) + varint(len(items)) + b"".join(items)


@dataclass(frozen=True)
class Page:
    """A page: its kind (0 data, 2 dictionary), how many `values` it states, their `encoding`, and its content, of which
    it states that it unpacks to `unpacked` bytes.
    """

    kind: int
    values: int
    encoding: int
    packed: bytes
    unpacked: int

    @property
    def written(self) -> bytes:
        """With its header."""
        of_kind = {"_1": whole(self.values), "_2": whole(self.encoding)}
        if self.kind == 0:
            of_kind |= {"_3": whole(RLE), "_4": whole(RLE)}
        fields = {"_1": whole(self.kind), "_2": whole(self.unpacked), "_3": whole(len(self.packed))}
        return message(**fields, **{"_5" if self.kind == 0 else "_7": nested(message(**of_kind))}) + self.packed


@dataclass(frozen=True)
class Chunk:
    """A column of one row group: its pages, and what the footer states of it: `values`, bytes that it unpacks to."""

    name: str
    pages: tuple[Page, ...]
    values: int
    unpacked: int
    kind: int = DOUBLE
    repetition: int = 0
    codec: int = UNCOMPRESSED
    length: int = 0


def parquet(chunks: Sequence[Chunk], rows: int) -> bytes:
    """A file of one row group."""
    body, groups, schema = b"PAR1", [], [message(_4=text("schema"), _5=whole(len(chunks)))]
    for chunk in chunks:
        start, pages = len(body), [page.written for page in chunk.pages]
        body += b"".join(pages)
        first = chunk.pages[0].kind == 2
        places = {"_9": long(start + (len(pages[0]) if first else 0))} | ({"_11": long(start)} if first else {})
        meta = message(
            _1=whole(chunk.kind),
            _2=listed(5, [zigzag(RLE), zigzag(RLE_DICTIONARY), zigzag(PLAIN)]),
            _3=listed(8, [varint(len(chunk.name)) + chunk.name.encode()]),
            _4=whole(chunk.codec),
            _5=long(chunk.values),
            _6=long(chunk.unpacked),
            _7=long(sum(map(len, pages))),
            **places,
        )
        groups.append(message(_2=long(start), _3=nested(meta)))
        of_length = {"_2": whole(chunk.length)} if chunk.length else {}
        schema.append(message(_1=whole(chunk.kind), **of_length, _3=whole(chunk.repetition), _4=text(chunk.name)))
    group = message(_1=listed(12, groups), _2=long(sum(chunk.unpacked for chunk in chunks)), _3=long(rows))
    foot = message(_1=whole(1), _2=listed(12, schema), _3=long(rows), _4=listed(12, [group]))
    return body + foot + struct.pack("<I", len(foot)) + b"PAR1"


def run(count: int, value: bytes) -> bytes:
    """A value so many times, as one run of RLE."""
    return varint(count << 1) + value


def leveled(content: bytes) -> bytes:
    """Levels of repetition or definition before the values of a page."""
    return struct.pack("<I", len(content)) + content


def packed(content: bytes) -> bytes:
    """By gzip."""
    deflate = zlib.compressobj(9, zlib.DEFLATED, 31)
    return deflate.compress(content) + deflate.flush()


@cache
def zeros(count: int) -> bytes:
    """So many bytes 0, by gzip, without having them all at once."""
    deflate, block = zlib.compressobj(1, zlib.DEFLATED, 31), bytes(2**24)
    pieces = [deflate.compress(block[: min(count - start, 2**24)]) for start in range(0, count, 2**24)]
    return b"".join(pieces) + deflate.flush()


def constant(name: str, rows: int, value: float = 1.0) -> Chunk:
    """A column that is one number, as a dictionary of one and a run of it."""
    dictionary = Page(2, 1, PLAIN, struct.pack("<d", value), 8)
    data = b"\x01" + run(rows, b"\0")
    return Chunk(name, (dictionary, Page(0, rows, RLE_DICTIONARY, data, len(data))), rows, 8 + len(data) + 60)


def doubles(name: str, values: np.ndarray) -> Chunk:
    """An honest column of numbers."""
    content = values.astype("<f8").tobytes()
    return Chunk(name, (Page(0, len(values), PLAIN, content, len(content)),), len(values), len(content) + 60)


def beside(*others: Chunk, rows: int = 3) -> bytes:
    """A table of readings, all of them 1, in which others take the place of columns, or stand beside them."""
    named = {chunk.name: chunk for chunk in others}
    columns = [named.pop(name, constant(name, rows, float(name not in ("qx", "qy", "qz")))) for name in COLUMNS]
    return parquet([*columns, *named.values()], rows)
