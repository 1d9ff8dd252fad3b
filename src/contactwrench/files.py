"""Read and write files so that a failure is one clear message and never half a file."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from .errors import FileAccessError

STDOUT = "-"


def read_bytes(path: str | Path) -> bytes:
    """The content of a file. Raises `FileAccessError` naming the path and why it cannot be read."""
    try:
        return Path(path).read_bytes()
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
        return
    target = Path(os.path.realpath(path))
    try:
        if target.is_dir():
            raise FileAccessError(f"{path}: found a directory, expected a file to write: name a file in it")
        if target.exists() and not stat.S_ISREG(target.stat().st_mode):
            with target.open("w", encoding="utf-8", newline="") as device:
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


def write_bytes(path: Path, content: bytes) -> None:
    """Write a binary file: beside it, then renamed over it. Raises `FileAccessError`."""
    try:
        _write_beside_then_rename(path, [content])
    except OSError as error:
        raise FileAccessError(
            f"{path}: cannot be written ({_reason(error)}): check the space on the disk and the permissions"
        ) from None


def _write_beside_then_rename(target: Path, pieces: Iterable[str] | Iterable[bytes]) -> None:
    handle, beside = tempfile.mkstemp(prefix=".contactwrench-", dir=target.parent)
    try:
        with open(handle, "wb") as file:
            file.writelines(piece.encode() if isinstance(piece, str) else piece for piece in pieces)
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


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def require_distinct(output: str | Path | None, others: dict[str, str | Path | None]) -> None:
    """Raise `FileAccessError` if `output` is one of the other files, each under what it is: it would be lost."""
    if output is None or str(output) == STDOUT:
        return
    for what, other in others.items():
        if other is not None and os.path.realpath(output) == os.path.realpath(other):
            raise FileAccessError(f"{output}: found the {what}, expected another file to write: name one")
