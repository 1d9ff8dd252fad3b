"""One thread for linear algebra, as a test has a core to itself; property tests draw the same examples at every run.

`make explore` draws new examples. What is collected stays to the end: the garbage collector need not go through the
quarter of a million objects of libraries and tests again and again. Nor need each worker, each run and each program
that a test starts compile the same files anew where PYTHONDONTWRITEBYTECODE is set: what Python makes of them is kept.
Nor need all workers at once compile with numba, or rewrite the assertions of a file, where that is not on disk yet, or
no longer: one does, and the others load it.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import partial, wraps
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

gc.disable()

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

settings.register_profile("same_every_time", derandomize=True, database=None, deadline=None)
settings.register_profile("explore", database=None, deadline=None, print_blob=True)
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "same_every_time")
settings.load_profile(PROFILE)
if PROFILE == "same_every_time":
    # No example is drawn from the constants of local modules: which are loaded by then depends on the tests before it.
    drawing = vars(import_module("hypothesis.internal.conjecture.providers"))
    drawing["_get_local_constants"] = partial(drawing.__getitem__, "_local_constants")


@contextmanager
def _alone_with(file: str | Path) -> Iterator[None]:
    """Meanwhile other processes wait that would be alone with it too."""
    fcntl = import_module("fcntl")
    with open(file, "rb") as lock:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX)  # until it is closed
        yield


def _one_at_a_time(compiled: Callable[..., Any]) -> Callable[..., Any]:
    """A compiler that waits for what another process compiles, which takes 20 s of a core where no file has it yet."""

    @wraps(compiled)
    def waits(*arguments: Any, **options: Any) -> Any:
        with _alone_with(__file__):
            return compiled(*arguments, **options)

    return waits


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, Any]:
    """Of all workers the first goes ahead, and writes what the others read: a third of what all of them would do."""
    is_file = find_spec("fcntl") and isinstance(collector, pytest.Module)
    with _alone_with(collector.path) if is_file else nullcontext():
        return (yield)


if find_spec("fcntl"):
    compiling = vars(import_module("contactwrench.subtract"))
    compiling["compiled_by_numba"] = _one_at_a_time(compiling["compiled_by_numba"])


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 10, 10)
    gc.enable()


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report's figures of poses are made and not drawn: where only words, or the other figures, are looked at."""
    monkeypatch.setattr(import_module("contactwrench.report.figures"), "svg_text", lambda _: "<svg></svg>")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: a sixth of the time, tests wait for sockets, pages and programs."""
    return (os.cpu_count() or 1) + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Each worker begins with a part of its own, so that what a file's tests share is made once, and ends with what is
    left of another's.
    """
    from xdist.scheduler import WorkStealingScheduling  # type: ignore[import-untyped]

    return WorkStealingScheduling(config, log)
