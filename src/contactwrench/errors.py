"""What can go wrong, by kind. Every message is one line: what was found, what was expected, what to do."""

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import Any

LONGEST, LONGEST_ADVICE = 299, 150
"""Characters of a message on a terminal; and of its last clause, what to do, up to which that stays whole."""
BEFORE = "contactwrench: "
_LONG = (
    (r"\S{100,}", 60),
    (r"\((?:[^()]|\([^()]*\)){60,}\)", 40),
    ("[^:,;]{120,}", 60),
    ("/[^:,;()]{40,}|\\S{40,}", 30),
    ("[^:;]{80,}", 60),
    (f".{{{LONGEST - LONGEST_ADVICE},}}", LONGEST - LONGEST_ADVICE - 1),
)
"""What is made shorter in a message that is too long, down to how many characters, in this order: a long name, a list
in brackets, a name with blanks, any path or name; then the longest part, and the whole.
"""
_INVISIBLE = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


class ContactWrenchError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(ContactWrenchError, ValueError):
    """Values that cannot be what they are given as: a shape, a NaN, a matrix that is no rotation.

    Attributes:
        row: index of the first row that is wrong, where there is one.
    """

    def __init__(self, message: str, row: int | None = None) -> None:
        super().__init__(message)
        self.row = row


def refuse(*cases: tuple[object, str]) -> None:
    """Raise `InputError` with the message of the first case that holds."""
    for holds, message in cases:
        if holds:
            raise InputError(message)


class FileFormatError(InputError):
    """A file that cannot be read; the message names the file, and the row and column where there is one."""


class FileAccessError(ContactWrenchError, OSError):
    """A file that cannot be opened, read or written."""


class UnobservableError(ContactWrenchError, ArithmeticError):
    """The poses cannot separate the parameters that the message names."""


class AmbiguityError(ContactWrenchError, ValueError):
    """Free-air data fit two interpretations; the message names both, and the option that decides."""


@contextmanager
def naming(source: str) -> Iterator[None]:
    """What the readings of a recording cannot tell, or contradict, begins with its name: with its folder where that
    leaves all words on a terminal.
    """
    try:
        yield
    except (UnobservableError, AmbiguityError) as error:
        said = str(error).removeprefix(f"{source}: ")
        whole = len(f"{BEFORE}{source}: {said}") <= LONGEST
        raise type(error)(f"{source if whole else source.rpartition('/')[2]}: {said}") from None


class MissingExtraError(ContactWrenchError, ImportError):
    """An optional dependency is not installed; the message gives the command that installs it."""


def of_extra(module: str, what: str, extra: str) -> Any:
    """A module that `what` needs. Raises `MissingExtraError` without the package, or what it needs, of that extra."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        said = " ".join(str(error).split())[:200]
        why = "is not installed" if error.name in (package, module) else f"cannot be loaded ({said})"
        raise MissingExtraError(f"{what} needs {package}, which {why}: pip install 'contactwrench[{extra}]'") from None


def has_compiler() -> bool:
    """Whether numba is installed, and not switched off, as its NUMBA_DISABLE_JIT does."""
    return find_spec("numba") is not None and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")


def visible(text: str) -> str:
    """Text from a file in one line that a terminal shows and does not obey: what controls it or turns the direction of
    writing is escaped, as in JSON.
    """
    return _INVISIBLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def some_of(names: Iterable[str], most: int = 12) -> str:
    """Names for a message."""
    known = list(names)
    return ", ".join(known[:most]) + (", ..." if len(known) > most else "")


def shortened(message: str, rules: Sequence[tuple[str, int]] = _LONG) -> str:
    """A message that is short enough: without the middle of long names and lists, of our words only where it must, and
    of what to do, its last clause, last of all.
    """
    advice = message[message.rfind(": ") :] if ": " in message[-LONGEST_ADVICE:] else ""
    found = message.removesuffix(advice)
    for which, least in rules:
        while (excess := len(found + advice) - LONGEST) > 0 and (long := re.findall(which, found)):
            longest = max(long, key=len)
            found = found.replace(longest, _without_middle(longest, max(len(longest) - excess, least)), 1)
    return found + advice


def with_room_for(message: str, *more: str, end: str = "") -> str:
    """A message, those of the further parts, the most useful first, that leave all words on a terminal, and its end."""
    for part in more:
        short = shortened(f"{BEFORE}{message}{part}{end}", _LONG[:4])
        if len(short) <= LONGEST and part in short:
            message += part
    return message + end


def _without_middle(text: str, most: int) -> str:
    return f"{text[: (most - 1) // 2]}…{text[len(text) - most // 2 :]}"
