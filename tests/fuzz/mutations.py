"""What happens to a file on its way, and what somebody might do to it on purpose, by a seed."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Rng = np.random.Generator

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
EXTREMES = (b"nan", b"-inf", b"1e308", b"-1e400", b"5e-324", b"0", b"-1", b"18446744073709551615", b"1" * 400, b'""')
INTEGERS = (0, 1, 0x7F, 0xFF, 0x7FFF_FFFF, 0xFFFF_FFFF, 0x7FFF_FFFF_FFFF_FFFF, 0xFFFF_FFFF_FFFF_FFFF)
TOKENS = (
    b",",
    b";",
    b'"',
    b"\n",
    b"\r",
    b"\t",
    b"#",
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    b"{",
    b"]",
    b"<",
    b"&x;",
    b"\x1b[2J",
)


def _place(rng: Rng, content: bytes) -> int:
    """Anywhere, as often near one of the ends, where headers and indexes are."""
    size = max(len(content), 1)
    near = min(size, 400)
    return int(rng.choice([rng.integers(size), rng.integers(near), size - 1 - rng.integers(near)]))


def _span(rng: Rng, content: bytes) -> tuple[int, int]:
    begin = _place(rng, content)
    return begin, min(len(content), begin + int(2.0 ** rng.uniform(0.0, 12.0)))


def flip(rng: Rng, content: bytes) -> bytes:
    """A few bits."""
    changed = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        if changed:
            changed[_place(rng, content)] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def integer(rng: Rng, content: bytes) -> bytes:
    """A length, an offset or a count that cannot be."""
    width = int(rng.choice([1, 2, 4, 8]))
    begin = _place(rng, content)
    value = int(rng.choice(np.array(INTEGERS, np.uint64))) & ((1 << 8 * width) - 1)
    return content[:begin] + value.to_bytes(width, "little") + content[begin + width :]


def nudge(rng: Rng, content: bytes) -> bytes:
    """A byte one more, or one less."""
    begin = _place(rng, content)
    if not content:
        return content
    return content[:begin] + bytes([(content[begin] + int(rng.choice([1, 255]))) % 256]) + content[begin + 1 :]


def cut(rng: Rng, content: bytes) -> bytes:
    """A copy that ended early."""
    return content[: _place(rng, content)]


def lost(rng: Rng, content: bytes) -> bytes:
    """A piece that is not there."""
    begin, end = _span(rng, content)
    return content[:begin] + content[end:]


def zeroed(rng: Rng, content: bytes) -> bytes:
    """A block that was never written."""
    begin, end = _span(rng, content)
    return content[:begin] + bytes(end - begin) + content[end:]


def twice(rng: Rng, content: bytes) -> bytes:
    """A piece that was written twice."""
    begin, end = _span(rng, content)
    return content[:end] + content[begin:end] + content[end:]


def moved(rng: Rng, content: bytes) -> bytes:
    """A piece that stands elsewhere."""
    begin, end = _span(rng, content)
    rest = content[:begin] + content[end:]
    to = _place(rng, rest)
    return rest[:to] + content[begin:end] + rest[to:]


def noise(rng: Rng, content: bytes) -> bytes:
    """A block of anything."""
    begin, end = _span(rng, content)
    return content[:begin] + rng.bytes(end - begin) + content[end:]


def extreme(rng: Rng, content: bytes) -> bytes:
    """Of text: a number that is none, or too large."""
    found = list(NUMBER.finditer(content))
    if not found:
        return flip(rng, content)
    match = found[int(rng.integers(len(found)))]
    return content[: match.start()] + EXTREMES[int(rng.integers(len(EXTREMES)))] + content[match.end() :]


def token(rng: Rng, content: bytes) -> bytes:
    """Of text: a mark where none belongs."""
    begin = _place(rng, content)
    return content[:begin] + TOKENS[int(rng.integers(len(TOKENS)))] + content[begin + int(rng.integers(2)) :]


def line(rng: Rng, content: bytes) -> bytes:
    """Of text: a line that is missing, comes twice, or is somewhere else."""
    lines: list[bytes] = content.split(b"\n")
    one = lines.pop(int(rng.integers(len(lines))))
    for _ in range(int(rng.integers(3))):
        lines.insert(int(rng.integers(len(lines) + 1)), one)
    return b"\n".join(lines)


OF_BYTES: tuple[Callable[[Rng, bytes], bytes], ...] = (flip, integer, nudge, cut, lost, zeroed, twice, moved, noise)
OF_TEXT = (*OF_BYTES, extreme, extreme, token, token, line)


def mutated(content: bytes, rng: Rng, *, text: bool) -> tuple[bytes, str]:
    """The content changed in one way, seldom in two, and in which."""
    ways = OF_TEXT if text else OF_BYTES
    chosen = [ways[int(rng.integers(len(ways)))] for _ in range(1 + int(rng.random() < 0.15))]
    for way in chosen:
        content = way(rng, content)
    return content, "+".join(way.__name__ for way in chosen)
