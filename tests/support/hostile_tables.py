"""Tables, calibrations and robots that nobody should read: small files that state much, point elsewhere, or lie."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from tests.support.recordings import WRENCH

HEADER = ",".join((*WRENCH, "qx", "qy", "qz", "qw"))
ROW = "1,2,3,4,5,6,0,0,0,1"
TABLE = f"{HEADER}\n{ROW}\n{ROW}\n"
EVERY_ROW = "expected a header line and rows of numbers"
NO_CSV = "expected cells of names and numbers: correct it"
NOT_A_COLUMN = "expected columns of a recording: leave out what is none"

TEXTS: dict[str, tuple[str | bytes, str]] = {
    "gzip": (b"\x1f\x8b\x08\0" + TABLE.encode(), "found a gzip file, expected text: unpack it"),
    "xlsx": (
        b"PK\3\4" + bytes(40),
        "found an Excel workbook or a zip file, expected text: export it as CSV, or unpack it",
    ),
    "xls": (b"\xd0\xcf\x11\xe0" + bytes(40), "found an Excel workbook, expected text: export it as CSV"),
    "parquet": (b"PAR1" + bytes(40), "found a Parquet file, expected text: name it .parquet"),
    "hdf5": (b"\x89HDF\r\n\x1a\n", "found an HDF5 file, expected text: name it .h5"),
    "a line of 5 MB": (
        TABLE + "1" * 5_000_000,
        "row 4: found a line of more than 4 MiB, expected a table with a row for each reading: write it so",
    ),
    "a header of 5 MB": (
        "a," * 2_500_000,
        "row 1: found a line of more than 4 MiB, expected a table with a row for each reading: write it so",
    ),
    "many columns": (",".join(f"n{k}" for k in range(10_001)) + "\n", f"found more than 10000 columns, {NOT_A_COLUMN}"),
    "one name many times": ("fx," * 10_000 + "\n", "column fx is there twice, expected once: rename or remove one"),
    "a long name": (f"fx{'1' * 5000},{TABLE}", f"found a column's name of 5002 letters, {NOT_A_COLUMN}"),
    "comments before the header": ("#\n" * 140_000 + TABLE, f"found no row in 131072 lines, {EVERY_ROW}"),
    "empty lines": ("\n" * 140_000, f"found no row in 131072 lines, {EVERY_ROW}"),
    "a quote never closed": (
        f'{TABLE}1,2,3,4,5,6,0,0,0,"1\n{ROW}\n',
        f"row 4: found what is no CSV (a quote is not closed), {NO_CSV}",
    ),
    "a long cell": (
        f"{TABLE}{'1' * 200_000},2,3,4,5,6,0,0,0,1\n",
        f"row 4: found what is no CSV (field larger than field limit (131072)), {NO_CSV}",
    ),
    "digits": (
        f"{TABLE}{'1' * 1000},2,3,4,5,6,0,0,0,1\n",
        f"row 4, column fx: found {'1' * 40}, expected a finite number: leave the row out",
    ),
    "an exponent": (
        f"{TABLE}1e999999,2,3,4,5,6,0,0,0,1\n",
        "row 4, column fx: found 1e999999, expected a finite number: leave the row out",
    ),
    "zeros at the end": (
        TABLE + f"{ROW}\n" * 500 + "\0" * 3000,
        "row 504: found 1 value, expected 10 as in the header: complete the row, and write decimals with a point",
    ),
    "half a letter of UTF-16": (
        TABLE.encode("utf-16") + b"\0",
        "row 4: found 1 value, expected 10 as in the header: complete the row, and write decimals with a point",
    ),
    "cut between columns": (
        TABLE + ROW[:9],
        "row 4: found 5 values, expected 10 as in the header: complete the row, and write decimals with a point",
    ),
}
"""Content of a .csv, and what is said of it."""


def _compact(number: int) -> bytes:
    """A number as Thrift's compact protocol has it: zigzag, seven bits a byte."""
    return _varint((number << 1) ^ (number >> 63))


def _varint(number: int) -> bytes:
    low, rest = number & 0x7F, number >> 7
    return bytes([low | 0x80]) + _varint(rest) if rest else bytes([low])


def _struct(*fields: tuple[int, int | bytes | list[bytes]]) -> bytes:
    """Fields by their numbers: integers, texts, a struct in brackets, lists of structs."""
    out, before = b"", 0
    for number, value in fields:
        if isinstance(value, list):
            kind, content = 9, bytes([0xFC]) + _varint(len(value)) + b"".join(value)
        elif isinstance(value, bytes):
            kind, content = (12, value) if value.endswith(b"\0") else (8, _varint(len(value)) + value)
        else:
            kind, content = (6 if value > 2**31 - 1 else 5), _compact(value)
        out, before = out + bytes([(number - before) << 4 | kind]) + content, number
    return out + b"\0"


def parquet_stating(rows: int = 3, rows_of_group: int = 3, size: int = 24, values: int = 3, nested: int = 0) -> bytes:
    """A Parquet file with a column of three numbers, `fx`, that states of itself what is asked for: in a list where
    `values` are more than that, `nested` groups deep.
    """
    is_list = values > 3
    page = _struct((1, 0), (2, 24), (3, 24), (5, _struct((1, 3), (2, 0), (3, 3), (4, 3)))) + struct.pack("<3d", 1, 2, 3)
    leaf = _struct((1, 5), (3, 2 if is_list else 0), (4, b"fx"))
    schema = [_struct((4, b"r"), (5, 1)), *[_struct((3, 0), (4, b"a"), (5, 1))] * nested, leaf]
    where = b"".join([*[_varint(1) + b"a"] * nested, _varint(2) + b"fx"])
    path = bytes([0xF8]) + _varint(nested + 1) + where
    meta = bytes([0x15]) + _compact(5) + bytes([0x19, 0x15]) + _compact(0) + bytes([0x19]) + path
    meta += b"".join(
        bytes([step << 4 | 6]) + _compact(n) for step, n in [(2, values), (1, size), (1, len(page)), (2, 4)]
    )
    meta = meta.replace(bytes([0x26]), bytes([0x15]) + _compact(0) + bytes([0x16]), 1) + b"\0"
    chunk = bytes([0x26]) + _compact(4) + bytes([0x1C]) + meta + b"\0"
    group = (
        bytes([0x19, 0x1C]) + chunk + bytes([0x16]) + _compact(size) + bytes([0x16]) + _compact(rows_of_group) + b"\0"
    )
    foot = bytes([0x15]) + _compact(1) + bytes([0x19, 0xFC]) + _varint(len(schema)) + b"".join(schema)
    foot += bytes([0x16]) + _compact(rows) + bytes([0x19, 0x1C]) + group + b"\0"
    return b"PAR1" + page + foot + struct.pack("<I", len(foot)) + b"PAR1"


def hdf5_files(elsewhere: Path) -> dict[str, tuple[Callable[[Any], None], str, str | None]]:
    """What makes a file hostile, what is said of it, and the datasets that are asked for. Each file has the ten columns
    of a table but `fx`; `elsewhere` has all.
    """
    import h5py

    def linked(file: Any) -> None:
        file["fx"], file["other"] = h5py.ExternalLink(str(elsewhere), "/fx"), h5py.SoftLink("/loop")
        file["loop"], file["beyond"] = h5py.SoftLink("/other"), h5py.ExternalLink(str(elsewhere), "/")

    def virtual(file: Any) -> None:
        layout = h5py.VirtualLayout((3,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(elsewhere), "fx", (3,))
        file.create_virtual_dataset("fx", layout)

    def deep(file: Any) -> None:
        file.create_group("/".join("a" * 35))

    a_link = "found a link, expected a dataset of this file: name what it points at"
    others = "dataset fx: found rows that other files hold, expected them here: copy them into this file"
    never = "dataset fx: found rows that were never written, expected readings: leave them out"
    return {
        "an external link": (linked, f"dataset fx: {a_link}", "wrench=/fx"),
        "links in a circle": (linked, f"dataset other: {a_link}", "wrench=/other"),
        "through another file": (linked, f"dataset beyond/fx: {a_link}", "wrench=/beyond/fx"),
        "external storage": (
            lambda file: file.create_dataset("fx", (3,), "f8", external=[(str(elsewhere), 0, 24)]),
            others,
            None,
        ),
        "a virtual dataset": (virtual, others, None),
        "never written": (lambda file: file.create_dataset("fx", (3,), "f8"), never, None),
        "written in part": (
            lambda file: file.create_dataset("fx", (3,), "f8", chunks=(1,)).write_direct(_ones(1), dest_sel=slice(1)),
            never,
            None,
        ),
        "1e12 rows": (
            lambda file: file.create_dataset("fx", (10**12,), "f8", chunks=(10**6,)),
            "found 1000000000000 rows in fx in a file of {size} bytes, expected at most 1048576: is it damaged, or "
            "were they never written? record or export it again",
            None,
        ),
        "a large chunk": (
            lambda file: file.create_dataset("fx", (3,), "f8", maxshape=(None,), chunks=(10**8,)),
            "found 800000000 bytes in a chunk of fx in a file of {size} bytes, expected at most 134217728: is it "
            "damaged, or were they never written? record or export it again",
            None,
        ),
        "groups in groups": (
            deep,
            "found over 32 groups in each other, expected fewer: export it anew",
            None,
        ),
    }


def _ones(n: int) -> Any:
    import numpy as np

    return np.ones(n)


JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<axis xyz="{axis}"/><origin xyz="{xyz}"/><limit lower="-1" upper="1"/>{more}</joint>'
)


def joint(name: str = "a", parent: str = "base", child: str = "tool0", **others: str) -> str:
    """A joint of a URDF."""
    usual = {"kind": "revolute", "axis": "0 0 1", "xyz": "0 0 1", "more": ""}
    return JOINT.format(name=name, parent=parent, child=child, **(usual | others))


def robot(joints: Iterable[str]) -> str:
    """A URDF of joints."""
    return f"<robot>{''.join(joints)}</robot>"


LAUGHS = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12))
CHAIN = (joint(f"j{k}", f"l{k}", f"l{k + 1}") for k in range(2001))
NO_XML = "expected a URDF"
LENGTH = "expected length 1"

URDFS: dict[str, tuple[str, str]] = {
    "a billion laughs": (
        f'<!DOCTYPE r [<!ENTITY a0 "ha">{LAUGHS}]><robot>&a11;</robot>',
        "found no XML (limit on input amplification factor (from DTD and entities) breached: line 1, column 656), "
        "expected a URDF",
    ),
    "an external entity": (
        '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]><robot>&a;</robot>',
        "found no XML (undefined entity &a;: line 1, column 63), expected a URDF",
    ),
    "an encoding that nobody knows": (
        '<?xml version="1.0" encoding="mbcs"?><robot/>',
        "found no XML (unknown encoding: mbcs), expected a URDF",
    ),
    "an encoding of more than a byte": (
        '<?xml version="1.0" encoding="shift_jis"?><robot/>',
        "found no XML (multi-byte encodings are not supported), expected a URDF",
    ),
    "an encoding that decodes nothing": (
        '<?xml version="1.0" encoding="undefined"?><robot/>',
        "found no XML (decoding with 'undefined' codec failed (UnicodeError: undefined encoding)), expected a URDF",
    ),
    "elements in elements": (
        robot(["<a>" * 100_000, "</a>" * 100_000]),
        "found no joint, expected a URDF (of a xacro file, run xacro on it first)",
    ),
    "a long chain": (robot(CHAIN), "found 2001 joints, expected at most 2000: leave some out"),
    "a circle": (
        robot([joint("a", "x", "tool0"), joint("b", "tool0", "x")]),
        "found links that go round in a circle (tool0, x, tool0), expected a tree: correct the parent of one of them",
    ),
    "two parents": (
        robot([joint("a"), joint("b", "other")]),
        "found 2 joints that carry tool0, expected one: rename or remove the others",
    ),
    "two joints of a name": (
        robot([joint("a", child="x"), joint("a", "x")]),
        "found 2 joints named a, expected one: rename or remove the others",
    ),
    "a mimic": (
        robot([joint("a", child="x"), joint("b", "x", more='<mimic joint="a"/>')]),
        "joint b is a mimic of a, expected revolute joints from root to tool0: name the arm's flange, as in "
        "arm.urdf:LINK",
    ),
    "an axis of nothing": (
        robot([joint(axis="0 0 1e-320")]),
        "joint a has the axis 0 0 9.99989e-321, expected length 1",
    ),
    "a long axis": (
        robot([joint(axis="0 0 1e308")]),
        "joint a: axis xyz is '0 0 1e308', expected 3 numbers, at most 1e+06",
    ),
    "far away": (
        robot([joint(xyz="0 0 -1e300")]),
        "joint a: origin xyz is '0 0 -1e300', expected 3 numbers, at most 1e+06",
    ),
    "no place": (robot([joint(xyz="0 0 nan")]), "joint a: origin xyz is '0 0 nan', expected 3 numbers, at most 1e+06"),
    "no type": (
        robot([joint(kind="")]),
        "joint a is , expected revolute joints from root to tool0: name the arm's flange, as in arm.urdf:LINK",
    ),
}
"""Content of a .urdf, and what is said of it."""
