"""The program's start: from here on a signal ends it with one line, its own exit status, and nothing left behind.

Little is imported before that. A library's user keeps signals, warnings and limits as they were: only `main` sets them.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import warnings
from contextlib import suppress
from itertools import pairwise

SAID = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "its terminal is gone"}
ENDS = {getattr(signal, name): said for name, said in SAID.items() if hasattr(signal, name)}
"""What a signal says; the exit status is 128 and its number."""
RESERVED = 1 << 24
"""Bytes that the threads of a core may reserve and do not use."""
READERS = ("info", "calibrate", "diagnose", "compensate", "verify", "weigh")
OUTPUTS = ("-o", "--output", "--report")
ROOM, BYTES_PER_BYTE = 5 << 28, 1 << 7
"""Bytes of memory for a verb that reads recordings, whatever they are, and for each of their bytes: ten minutes at
1 kHz take a tenth of it, packed as tightly as noise allows.
"""
_temporary: list[str] = []
"""Files and folders that Python's `tempfile` has made, those that are gone again too."""


def main() -> None:
    """Run the program and leave with its exit status."""
    sys.addaudithook(_remember)
    for number in ENDS:
        if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup, or of a script's job in the background
            signal.signal(number, _leave)
            atexit.register(signal.signal, number, signal.SIG_IGN)  # all is done: the interpreter only tidies up
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:  # a closed stream's number would be the next file's
        pass
    os.close(descriptor)
    # No window is drawn in: what looks for a library of windows outlives this program, and not every value is one.
    os.environ.update(MUJOCO_GL="off", MPLBACKEND="agg")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of small matrices a second thread only waits: twice the CPU
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
    for each in ENDS:
        signal.signal(each, signal.SIG_IGN)
    try:
        if _temporary:
            import shutil  # as tempfile did
        for path in _temporary:
            shutil.rmtree(path, ignore_errors=True)
            with suppress(OSError):
                os.unlink(path)
        bar = b"\r\x1b[2K\x1b[?25h" if "rich.live" in sys.modules and os.isatty(2) else b""  # away, and the cursor back
        os.write(2, bar + f"contactwrench: {ENDS[signal.Signals(number)]}\n".encode())
    finally:
        os._exit(128 + number)


def _bound_memory() -> None:
    """Let what does not fit into memory be an error that can be said, before the machine swaps or ends the program; of
    what reads recordings also what takes more than files of their size hold.
    """
    with suppress(ImportError, OSError, ValueError):  # another system than Linux: as it is
        import resource

        with open("/proc/meminfo", "rb") as file:
            most = [int(line.split()[1]) << 10 for line in file if line.startswith(b"MemAvailable:")]
        with suppress(OSError, ValueError), open("/sys/fs/cgroup/memory.max", "rb") as file:
            most.append(int(file.read()))  # of a container
        if sys.argv[1:2] and sys.argv[1] in READERS and "-" not in sys.argv:
            most.append(
                ROOM + BYTES_PER_BYTE * sum(_size(each) for flag, each in pairwise(sys.argv[1:]) if flag not in OUTPUTS)
            )
        soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if soft == resource.RLIM_INFINITY:
            resource.setrlimit(resource.RLIMIT_DATA, (min(most) + (os.cpu_count() or 1) * RESERVED, hard))
            os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # pyarrow's own reserves a GiB beforehand


def _size(argument: str) -> int:
    """Bytes of the file that an argument names, or of all in a folder; 0 for none."""
    flag, _, value = argument.partition("=")
    path = argument if os.path.lexists(argument) else value * (flag not in OUTPUTS)
    if not os.path.isdir(path):
        return os.path.getsize(path) if os.path.isfile(path) else 0
    from .files import parts_of

    return sum(os.path.getsize(file) for file in parts_of(path) if os.path.isfile(file))


if __name__ == "__main__":
    main()
