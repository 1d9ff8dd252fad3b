"""Read and write files so that a failure is one clear message and never half a file."""

from __future__ import annotations

import codecs
import os
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
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
    """Write UTF-8 text: beside the file, then renamed over it, so that the file is whole or untouched.

    `-` is standard output; devices and pipes are written directly. Raises `FileAccessError`.
    """
    pieces = [pieces] if isinstance(pieces, str) else pieces
    if str(path) == STDOUT:
        for piece in pieces:
            sys.stdout.write(piece)
        sys.stdout.flush()
    else:
        write_bytes(path, (piece.encode() for piece in pieces))


def write_bytes(path: str | Path, content: bytes | Iterable[bytes]) -> None:
    """Write a binary file, whole or piece by piece: beside the file, then renamed over it, so that the file is whole or
    untouched. Devices and pipes are written directly. Raises `FileAccessError`.
    """
    pieces = [content] if isinstance(content, bytes) else content
    target = Path(os.path.realpath(path))
    try:
        if target.is_dir():
            raise FileAccessError(f"{path}: found a directory, expected a file to write: name a file in it")
        if target.exists() and not stat.S_ISREG(target.stat().st_mode):
            with target.open("wb") as device:
                device.writelines(pieces)
        else:
            _write_beside_then_rename(target, pieces)
    except FileNotFoundError:
        raise FileAccessError(f"{path}: there is no folder {target.parent}: make it first") from None
    except OSError as error:
        if isinstance(error, FileAccessError):
            raise
        raise FileAccessError(
            f"{path}: cannot be written ({_reason(error)}): check the space on the disk and the permissions"
        ) from None


def _write_beside_then_rename(target: Path, pieces: Iterable[bytes]) -> None:
    handle, beside = tempfile.mkstemp(prefix=".contactwrench-", dir=target.parent)
    try:
        with open(handle, "wb") as file:
            file.writelines(pieces)
            file.flush()
            os.fsync(file.fileno())
        Path(beside).chmod(stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~_umask())
        Path(beside).replace(target)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def name_of(path: str | Path) -> str:
    """A path as text, whatever bytes it has."""
    return os.fsencode(path).decode(errors="replace")


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def require_distinct(output: str | Path | None, others: Mapping[str, str | Path | None]) -> None:
    """Raise `FileAccessError` if `output` is one of the other files, each under what it is: it would be lost."""
    if output is None or str(output) == STDOUT:
        return
    for what, other in others.items():
        if other is not None and os.path.realpath(output) == os.path.realpath(other):
            raise FileAccessError(f"{output}: found the {what}, expected another file to write: name one")
