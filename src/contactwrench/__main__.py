"""The program's start: from here on a signal ends it with one line, its own exit status, and nothing left behind.

Little is imported before that. A library's user keeps signals, warnings and limits as they were: only `main` sets them.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import suppress

ENDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "its terminal is gone"}
"""What a signal says; the exit status is 128 and its number."""
STACKS = 1 << 24
"""Bytes that the threads of a core may reserve and do not use."""
_temporary: list[str] = []
"""Files and folders that Python's `tempfile` has made, those that are gone again too."""


def main() -> None:
    """Run the program and leave with its exit status."""
    sys.addaudithook(_remember)
    for name in ENDS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # as under nohup, or of a job with &
            signal.signal(number, _leave)
            atexit.register(signal.signal, number, signal.SIG_IGN)  # all is done: the interpreter only tidies up
    for descriptor in range(3):
        _be_open(descriptor)
    _bound_memory()
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    from .cli.main import main as run

    run()


def _remember(event: str, arguments: tuple[object, ...]) -> None:
    """Hear of temporary files before they are there: none is between its making and its being known."""
    if event in {"tempfile.mkstemp", "tempfile.mkdtemp"}:
        _temporary.append(str(arguments[0]))


def _leave(number: int, _: object) -> None:
    """Leave without unwinding: an exception could be caught, or shown, by whatever library is at work."""
    for name in ENDS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    try:
        _remove_temporary()
        bar = b"\r\x1b[2K\x1b[?25h" if "rich.live" in sys.modules and os.isatty(2) else b""  # away, and the cursor back
        os.write(2, bar + f"contactwrench: {ENDS[signal.Signals(number).name]}\n".encode())
    finally:
        os._exit(128 + number)


def _remove_temporary() -> None:
    if _temporary:
        import shutil

        for path in _temporary:
            shutil.rmtree(path, ignore_errors=True)
            if os.path.lexists(path):
                os.unlink(path)


def _be_open(descriptor: int) -> None:
    """Open a standard stream that whoever started the program has closed: else the next file would take its number, and
    with it what libraries print.
    """
    try:
        os.fstat(descriptor)
    except OSError:
        os.open(os.devnull, os.O_RDWR)


def _bound_memory() -> None:
    """Let what does not fit into memory be an error that can be said, before the machine swaps or ends the program."""
    try:
        import resource

        left = min(_memory_left()) + (os.cpu_count() or 1) * STACKS
        soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if soft == resource.RLIM_INFINITY:
            resource.setrlimit(resource.RLIMIT_DATA, (left, hard))
    except (ImportError, OSError, ValueError):  # another system than Linux: as it is
        return


def _memory_left() -> Iterator[int]:
    """What the machine has left, and what a container is held to, bytes."""
    with open("/proc/meminfo", "rb") as file:
        yield from (int(line.split()[1]) << 10 for line in file if line.startswith(b"MemAvailable:"))
    with suppress(OSError, ValueError), open("/sys/fs/cgroup/memory.max", "rb") as file:
        yield int(file.read())


if __name__ == "__main__":
    main()
