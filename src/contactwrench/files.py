"""Read and write files so that a failure is one clear message and never half a file."""

from __future__ import annotations

import errno
import os
import re
import stat
import sys
import tempfile
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from glob import escape, iglob
from io import BufferedReader, RawIOBase
from pathlib import Path
from typing import IO, Any, TextIO

from .errors import FileAccessError, FileFormatError, InputError

STDOUT = STDIN = "-"
MOST_KEPT = 2**32
"""Bytes of standard input: a pipe may never end."""

MOST_BYTES, TEXT_AT_ONCE = 2**25, 2**22
"""Of a file that is held as a whole, of which the calibration of 10,000 poses takes half; of a text that is read at
once, than which no line is longer, and of standard input that is kept in memory, not on the disk.
"""


def read_bytes(path: str | Path) -> bytes:
    """The content of a file. Raises as `open_bytes`, and `FileFormatError` for more than `MOST_BYTES`."""
    with open_bytes(path) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise FileFormatError(f"{name_of(path)}: found more than 32 MiB, expected at most that: name another file")
    return content


def entries(folder: Path) -> list[Path]:
    """What is in a folder. Raises `FileAccessError`."""
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise FileAccessError(f"{folder}: cannot be read ({_reason(error)}): check its permissions") from None


def by_numbers(name: str) -> list[int | str]:
    """A key that sorts names of parts: 2 before 10."""
    return [int(word) if word.isdecimal() else word for word in re.split(r"(\d+)", name)]


def parts_of(folder: str) -> Iterator[str]:
    """What is in a folder as deep as a recording is, LeRobot's data/chunk-000/file-000.parquet; no more of a disk."""
    for depth in ("*", "*/*", "*/*/*"):
        yield from iglob(os.path.join(escape(folder), depth), include_hidden=True)


@contextmanager
def open_bytes(path: str | Path) -> Iterator[BufferedReader[Any]]:
    """A file that is open to be read, `-` standard input, as often as is wanted. Raises `FileAccessError` naming the
    path and why it cannot be read; what is no file is not opened.
    """
    name = name_of(path)
    if "\0" in name:
        raise FileAccessError(f"{name!r}: found a NUL in a name, expected a path: correct it")
    try:
        with BufferedReader(_StandardInput()) if str(path) == STDIN else _opened(Path(path)) as file:
            yield file
    except FileAccessError:
        raise
    except IsADirectoryError:
        if name.lower().endswith(".parquet") and not entries(Path(path)):
            raise FileAccessError(f"{name}: found an empty folder, expected rows in it: nothing was recorded") from None
        raise FileAccessError(f"{name}: found a directory, expected a file: name the file in it") from None
    except FileNotFoundError:
        raise FileAccessError(f"{name}: there is no such file, expected a readable file: check the path") from None
    except OSError as error:
        found = f"cannot be read ({_reason(error)})"
        raise FileAccessError(f"{name}: {found}: check the path and its permissions") from None


def _opened(path: Path) -> BufferedReader[Any]:
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise FileAccessError(f"{path}: found a pipe or a device, expected a file: give it as - on standard input")
    return path.open("rb")


class _StandardInput(RawIOBase):
    """Standard input from its beginning: what was read of it is kept for the next who opens it."""

    def __init__(self) -> None:
        if sys.stdin is None:
            raise FileAccessError("standard input: found it closed, expected a table: name a file, or write one to it")
        self._source, self._kept, self._at = sys.stdin.buffer, _kept_of(sys.stdin), 0

    def readable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._source.fileno()

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """In what was read of it so far."""
        self._kept.seek(self._at)
        self._at = self._kept.seek(offset, whence)
        return self._at

    def readinto(self, buffer: Any) -> int:
        self._kept.seek(self._at)
        content = self._kept.read(len(buffer))
        if not content:
            content = self._source.read(len(buffer))
            if self._at + len(content) > MOST_KEPT:
                raise FileAccessError(
                    "standard input: found over 4 GiB, expected a table that ends: write it to a file"
                )
            self._kept.write(content)
        buffer[: len(content)] = content
        self._at += len(content)
        return len(content)


@cache
def _kept_of(stdin: TextIO) -> IO[bytes]:
    return tempfile.SpooledTemporaryFile(TEXT_AT_ONCE)


def make_folder(path: Path) -> None:
    """Make a folder and those above it; one that is there is fine. Raises `FileAccessError`."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileAccessError(f"{path}: cannot be made a folder ({_reason(error)}): name another") from None


def write_text(path: str | Path, pieces: str | Iterable[str]) -> None:
    """Write UTF-8 text, other bytes escaped, as `write_bytes`; `-` is standard output. Raises `FileAccessError`."""
    pieces = [pieces] if isinstance(pieces, str) else pieces
    if str(path) == STDOUT:
        if sys.__stdout__ is None:
            raise FileAccessError("standard output is closed, expected one that can be written: name a file")
        for piece in pieces:
            sys.stdout.write(piece)
        sys.stdout.flush()
    else:
        write_bytes(path, (piece.encode(errors="backslashreplace") for piece in pieces))


def write_bytes(path: str | Path, content: bytes | Iterable[bytes]) -> None:
    """Write a binary file, whole or piece by piece, by `new_place`, so that the file is whole or untouched. Devices and
    pipes are written directly, and not waited for. Raises `FileAccessError`, also for a pipe that nobody reads.
    """
    pieces = [content] if isinstance(content, bytes) else content
    target = target_of(path)
    if target.exists() and not target.is_file():
        with cause_named(path), os.fdopen(os.open(target, os.O_WRONLY | os.O_NONBLOCK), "wb") as device:
            os.set_blocking(device.fileno(), True)
            device.writelines(pieces)
    else:
        with new_place(path) as made, made.open("wb") as file:
            file.writelines(pieces)


@contextmanager
def new_place(path: str | Path) -> Iterator[Path]:
    """Where a file, or a folder of files, is to be made, beside its place: at the end it is moved there, after an error
    nothing is left. A link stays and what it points at is replaced; permissions stay those of the file that is there,
    owner and group as far as the process may give files away.

    Raises `FileAccessError`: it cannot be written; a folder, a device or a pipe is there, or a file in `KEPT`.
    """
    target = file_of(path)
    with cause_named(path), tempfile.TemporaryDirectory(prefix=".contactwrench-", dir=target.parent) as beside:
        made = Path(beside) / target.name
        yield made
        for file in [made] if made.is_file() else sorted(made.iterdir()):
            with file.open("rb+") as written:
                os.fsync(written.fileno())
        if made.is_dir() and target.exists():
            raise FileAccessError(f"{path}: found a file or a folder, expected a new name for a folder: name another")
        if made.is_file() and target in KEPT.get():
            _take_name(made, target)
        elif target.exists():
            there = target.stat()
            for owner, group in ((-1, there.st_gid), (there.st_uid, -1)):
                with suppress(OSError):
                    os.chown(made, owner, group)
            made.chmod(stat.S_IMODE(there.st_mode))
        made.replace(target)


def _take_name(made: Path, target: Path) -> None:
    """Raises `FileExistsError` where it is taken already."""
    try:
        os.link(made, target)
    except OSError:  # taken, or a file system without hard links
        target.touch(exist_ok=False)


KEPT: ContextVar[Collection[Path]] = ContextVar("KEPT", default=())
"""Places at which there was no file when that was decided: one that has appeared since is not replaced."""


def target_of(path: str | Path) -> Path:
    """The place that is written under a name, through links; a pipe behind /dev/stdout has no other name. Raises
    `FileAccessError` for a folder, and for what can be no file's name.
    """
    with cause_named(path), suppress(FileNotFoundError):
        mode = Path(path).stat().st_mode
        if stat.S_ISDIR(mode):
            raise FileAccessError(f"{path}: found a folder, expected a new name: name another, or a file in it")
        if not stat.S_ISREG(mode):
            return Path(path)
    return Path(os.path.realpath(path))


def file_of(path: str | Path) -> Path:
    """As `target_of`, of a file that is to be replaced. Raises `FileAccessError` also for a device or a pipe."""
    target = target_of(path)
    if target.exists() and not target.is_file():
        raise FileAccessError(f"{path}: found a device or a pipe, expected a file to write: name another")
    return target


@contextmanager
def cause_named(path: str | Path) -> Iterator[None]:
    """Whatever the system says against writing becomes `FileAccessError`. Raises `InputError` for what is no path."""
    name_of(path)
    try:
        yield
    except FileAccessError:
        raise
    except FileExistsError:
        raise already_there(path) from None
    except OSError as error:
        folder = Path(os.path.realpath(path)).parent
        if isinstance(error, FileNotFoundError) and not folder.exists():
            raise FileAccessError(f"{path}: found no folder {folder}, expected one: make it first") from None
        if error.errno == errno.ENXIO:
            raise FileAccessError(f"{path}: found a pipe without a reader, expected one: start it first") from None
        is_name = error.errno in (errno.ENAMETOOLONG, errno.ENOTDIR, errno.ELOOP)
        advice = "name another" if is_name else "check the space on the disk and the permissions"
        raise FileAccessError(f"{path}: cannot be written ({_reason(error)}): {advice}") from None


def already_there(path: str | Path) -> FileAccessError:
    """The error for a file that a person may still need."""
    return FileAccessError(
        f"{path}: found a file there already, expected a new name: name another, or replace it with --force"
    )


def name_of(path: str | Path) -> str:
    """A path as text, whatever bytes it has; of `-` what is read there. Raises `InputError` for what is no path."""
    if not isinstance(path, str | os.PathLike):
        found = repr(path) if isinstance(path, int | bytes | None) else f"a {type(path).__name__}"
        raise InputError(f"path is {found}, expected a str or a Path: name a file")
    return "standard input" if str(path) == STDIN else os.fsencode(path).decode(errors="backslashreplace")


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def identity(path: str | Path) -> tuple[int, int] | str:
    """What all names of a file have in common, links of both kinds too; of one that is not there its place."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return os.path.realpath(path)
    return found.st_dev, found.st_ino
