"""Speed and memory, each against a yardstick measured in the same run: memcpy, numpy's import, or the clock."""

from __future__ import annotations

import importlib
import os
import resource
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

import contactwrench as cw
from tests.support.world import Array, noisy_readings, random_rotations

from .accuracy import NOISE, TABLE_V
from .clock import median_seconds
from .table import Row

SAMPLES = 10_000_000
BYTES_OF_SAMPLE = 64
MIB = 2**20

kernel = importlib.import_module("contactwrench.subtract")


def _calibration(n: int = 24) -> cw.Calibration:
    rng = np.random.default_rng(1)
    R = random_rotations(n, rng)
    return cw.calibrate(cw.Samples(noisy_readings(TABLE_V, R, NOISE, rng), R), "mount")


def _quaternions(n: int, rng: np.random.Generator) -> Array:
    quaternions = rng.normal(size=(n, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return quaternions


@contextmanager
def _numpy_only() -> Iterator[None]:
    before = kernel.FUSED_FROM
    vars(kernel)["FUSED_FROM"] = 2**62
    try:
        yield
    finally:
        vars(kernel)["FUSED_FROM"] = before


def memcpy(size: int, rng: np.random.Generator) -> float:
    """Seconds for `size` bytes on one thread, both sides written to before."""
    source = rng.random(size // 8)
    target = source[::-1].copy()
    return median_seconds(lambda: np.copyto(target, source), 7)


def batch(n: int) -> Iterator[Row]:
    """Batch compensation of `n` samples with quaternions, into an `out=` that was touched, against memcpy."""
    rng = np.random.default_rng(2)
    copying = memcpy(n * BYTES_OF_SAMPLE, rng)
    calibration, wrench, quaternions = _calibration(), rng.random((n, 6)), _quaternions(n, rng)
    out = wrench + 1.0

    def run() -> Array:
        return calibration.compensate(wrench, quaternions, out=out)

    speed = n * BYTES_OF_SAMPLE / copying / 1e9
    yield Row(
        f"memcpy of {n * BYTES_OF_SAMPLE / 1e6:.0f} MB, one thread", 1e3 * copying, "ms", remark=f"{speed:.3g} GB/s"
    )
    if find_spec("numba") is not None:
        fused = median_seconds(run, 7)
        yield Row(
            "batch with numba", fused / copying, "x memcpy", most=1.3, remark=f"{1e9 * fused / n:.3g} ns a sample"
        )
        yield Row("batch with numba: extra memory", extra_memory(run) / MIB, "MiB", most=64.0)
    with _numpy_only():
        plain = median_seconds(run, 5)
        yield Row(
            "batch with numpy", plain / copying, "x memcpy", most=5.0, remark=f"{1e9 * plain / n:.3g} ns a sample"
        )
        yield Row("batch with numpy: extra memory", extra_memory(run) / MIB, "MiB", most=64.0)


def extra_memory(action: Callable[[], object]) -> float:
    """Bytes: what Python and numpy allocate on top, or what the process' peak grows by, if that is more."""
    peak_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    action()
    traced = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    unit = 1 if sys.platform == "darwin" else 1024
    return float(max(traced, unit * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_before)))


def per_sample() -> Iterator[Row]:
    """One sample at a time, in a loop of Python: the loop itself included."""
    step = _calibration().stepper()
    rng = np.random.default_rng(3)
    rows = np.hstack([rng.random((100_000, 6)), _quaternions(100_000, rng)]).tolist()

    def run() -> None:
        for row in rows:
            step(*row)

    yield Row("stepper()", 1e6 * median_seconds(run, 7) / len(rows), "us", most=1.0)


def calibrations() -> Iterator[Row]:
    """From samples to a calibration."""
    rng = np.random.default_rng(4)
    R = random_rotations(24, rng)
    few = cw.Samples(noisy_readings(TABLE_V, R, NOISE, rng), R)
    yield Row(
        "calibrate 24 poses, mount", 1e3 * median_seconds(lambda: cw.calibrate(few, "mount"), 50), "ms", most=10.0
    )
    for model in ("yaw", "mount+base", "affine", "paper"):
        seconds = median_seconds(partial(cw.calibrate, few, model), 20)
        yield Row(f"calibrate 24 poses, {model}", 1e3 * seconds, "ms")
    repeated = np.repeat(random_rotations(50, rng), 20_000, axis=0)
    many = cw.Samples(noisy_readings(TABLE_V, repeated, NOISE, rng), repeated)
    shuffled = many.select(rng.permutation(len(many)))
    for name, samples in (("in order", many), ("shuffled", shuffled)):
        seconds = median_seconds(partial(cw.calibrate, samples, "mount"), 5)
        yield Row(f"calibrate 1 million rows at 50 orientations, {name}", seconds, "s", most=0.5)


def starts() -> Iterator[Row]:
    """Starting up, in processes of their own, one after the other in turn."""
    python = sys.executable
    commands: dict[str, list[str]] = {
        "python": [python, "-c", "pass"],
        "numpy": [python, "-c", "import numpy"],
        "contactwrench": [python, "-c", "import contactwrench"],
        "help": [python, "-m", "contactwrench", "--help"],
    }
    durations: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(15):
        for name, command in commands.items():
            durations[name].append(_wall(command))
    python_alone, numpy, package, help_ = (float(np.median(durations[name])) for name in commands)
    yield Row("import numpy", 1e3 * numpy, "ms", remark=f"of which {1e3 * python_alone:.0f} ms for Python itself")
    yield Row("import contactwrench", package / numpy, "x numpy", most=2.0)
    yield Row("contactwrench --help", help_ / numpy, "x numpy", most=4.0)
    bare = numpy - python_alone
    yield Row("import contactwrench, Python's start taken off", (package - python_alone) / bare, "x numpy", most=2.0)
    yield Row("contactwrench --help, Python's start taken off", (help_ - python_alone) / bare, "x numpy", most=4.0)
    with tempfile.TemporaryDirectory() as folder:
        demo = _wall([python, "-m", "contactwrench", "demo", "--out", os.path.join(folder, "demo")])
    yield Row("contactwrench demo", demo, "s", most=10.0)


def _wall(command: list[str]) -> float:
    start = time.perf_counter()
    done: Any = subprocess.run(command, capture_output=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr.decode()}")
    return time.perf_counter() - start


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every speed table, one after the other."""
    yield "Starting up", starts()
    yield "Batch compensation, quaternions", batch(SAMPLES // 10 if quick else SAMPLES)
    yield "Per sample", per_sample()
    yield "Calibration", calibrations()
