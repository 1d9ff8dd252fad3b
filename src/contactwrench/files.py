"""Read and write files so that a failure is one clear message and never half a file."""

from __future__ import annotations

import codecs
import errno
import os
import stat
import sys
import tempfile
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from io import BufferedReader
from itertools import islice
from pathlib import Path

from .errors import FileAccessError

STDOUT = "-"


def read_bytes(path: str | Path) -> bytes:
    """The content of a file. Raises `FileAccessError` naming the path and why it cannot be read."""
    with open_bytes(path) as file:
        return file.read()


def blocks_of_lines(path: str | Path, lines: int) -> Iterator[tuple[bytes, float]]:
    """The content of a text file, so many lines at a time, each block with the part of the file, 0 to 1, that ends with
    it; NaN for a pipe. What begins with the mark of UTF-16 comes as UTF-8. Raises `FileAccessError` naming the path and
    why it cannot be read.
    """
    with open_bytes(path) as file:
        size, so_far = os.fstat(file.fileno()).st_size, 0
        wide = file.peek(2)[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        rows = codecs.EncodedFile(file, "utf-8", "utf-16", "replace") if wide else file
        while block := b"".join(islice(rows, lines)):
            so_far += len(block) * (2 if wide else 1)
            yield block, min(so_far / size, 1.0) if size else float("nan")


@contextmanager
def open_bytes(path: str | Path) -> Iterator[BufferedReader]:
    """A file that is open to be read. Raises `FileAccessError` naming the path and why it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            yield file
    except IsADirectoryError:
        raise FileAccessError(f"{path}: found a directory, expected a file: name the file in it") from None
    except FileNotFoundError:
        raise FileAccessError(f"{path}: there is no such file, expected a readable file: check the path") from None
    except OSError as error:
        raise FileAccessError(
            f"{path}: cannot be read ({_reason(error)}): check the path and its permissions"
        ) from None


def make_folder(path: Path) -> None:
    """Make a folder and those above it; one that is there is fine. Raises `FileAccessError`."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileAccessError(f"{path}: cannot be made a folder ({_reason(error)}): name another") from None


def write_text(path: str | Path, pieces: str | Iterable[str]) -> None:
    """Write UTF-8 text, as `write_bytes`; `-` is standard output. Raises `FileAccessError`."""
    pieces = [pieces] if isinstance(pieces, str) else pieces
    if str(path) == STDOUT:
        if sys.__stdout__ is None:
            raise FileAccessError("standard output is closed, expected one that can be written: name a file")
        for piece in pieces:
            sys.stdout.write(piece)
        sys.stdout.flush()
    else:
        write_bytes(path, (piece.encode() for piece in pieces))


def write_bytes(path: str | Path, content: bytes | Iterable[bytes]) -> None:
    """Write a binary file, whole or piece by piece, by `new_place`, so that the file is whole or untouched. Devices and
    pipes are written directly. Raises `FileAccessError`.
    """
    pieces = [content] if isinstance(content, bytes) else content
    target = target_of(path)
    if target.exists() and not target.is_file():
        with _cause_named(path), target.open("wb") as device:
            device.writelines(pieces)
    else:
        with new_place(path) as made, made.open("wb") as file:
            file.writelines(pieces)


@contextmanager
def new_place(path: str | Path) -> Iterator[Path]:
    """Where a file, or a folder of files, is to be made, beside its place: at the end it is moved there, after an error
    nothing is left. A link stays and what it points at is replaced; permissions stay those of the file that is there.

    Raises `FileAccessError`: it cannot be written; a folder, a device or a pipe is there, or a file in `KEPT`.
    """
    target = target_of(path)
    if target.exists() and not target.is_file():
        raise FileAccessError(f"{path}: found a device or a pipe, expected a file to write: name another")
    with _cause_named(path), tempfile.TemporaryDirectory(prefix=".contactwrench-", dir=target.parent) as beside:
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
            made.chmod(stat.S_IMODE(target.stat().st_mode))
        made.replace(target)


def _take_name(made: Path, target: Path) -> None:
    """Raises `FileExistsError` where it is taken already."""
    try:
        os.link(made, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        target.touch(exist_ok=False)


KEPT: ContextVar[Collection[Path]] = ContextVar("KEPT", default=())
"""Places at which there was no file when that was decided: one that has appeared since is not replaced."""


def target_of(path: str | Path) -> Path:
    """The place that is written under a name, through links; a pipe behind /dev/stdout has no other name. Raises
    `FileAccessError` for a folder, and for what can be no file's name.
    """
    with _cause_named(path), suppress(FileNotFoundError):
        mode = Path(path).stat().st_mode
        if stat.S_ISDIR(mode):
            raise FileAccessError(f"{path}: found a folder, expected a new name: name another, or a file in it")
        if not stat.S_ISREG(mode):
            return Path(path)
    return Path(os.path.realpath(path))


@contextmanager
def _cause_named(path: str | Path) -> Iterator[None]:
    """Whatever the system says against writing becomes `FileAccessError`."""
    try:
        yield
    except FileAccessError:
        raise
    except FileExistsError:
        raise already_there(path) from None
    except OSError as error:
        folder = Path(os.path.realpath(path)).parent
        if isinstance(error, FileNotFoundError) and not folder.exists():
            raise FileAccessError(f"{path}: there is no folder {folder}: make it first") from None
        is_name = error.errno in (errno.ENAMETOOLONG, errno.ENOTDIR, errno.ELOOP)
        advice = "name another" if is_name else "check the space on the disk and the permissions"
        raise FileAccessError(f"{path}: cannot be written ({_reason(error)}): {advice}") from None


def already_there(path: str | Path) -> FileAccessError:
    """The error for a file that a person may still need."""
    return FileAccessError(
        f"{path}: found a file there already, expected a new name: name another, or replace it with --force"
    )


def name_of(path: str | Path) -> str:
    """A path as text, whatever bytes it has."""
    return os.fsencode(path).decode(errors="replace")


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def identity(path: str | Path) -> tuple[int, int] | str:
    """What all names of a file have in common, links of both kinds too; of one that is not there its place."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return os.path.realpath(path)
    return found.st_dev, found.st_ino
