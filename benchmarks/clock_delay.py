"""The delay between two streams: errors against the bound of each motion, coverage of its std, and what it costs.

The bound is of the true tool, motion and white noise. Targets: errors of at most 2 ms at 1 kHz and 100 Hz where it is
below 0.5 ms, of at most half a sample at 10 Hz. Recordings without the flange's positions have none where the whole arm
moves: accelerations of the flange are then unknown, and the std has to say so.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from tempfile import TemporaryDirectory

import numpy as np

from contactwrench.samples.delay import Delay, estimate_delay
from contactwrench.samples.samples import Streams, WrenchStream
from contactwrench.samples.synchronize import synchronize
from tests.support.moving import bound_of, gravity_alone, rig_recording, two_streams, whole_arm, with_joints

from .table import Row

TRUE = 0.004
RATES = {"1 kHz / 100 Hz": (1, 10, 0.002), "100 / 100 Hz": (10, 10, 0.005), "10 / 10 Hz": (100, 100, 0.05)}
"""Every how many rows of each stream are kept, and the largest error, s."""


def errors(kind: str, duration: float, trials: int) -> Iterator[Row]:
    """The largest error at each rate, with positions and without."""
    recordings = [rig_recording(kind, duration, seed) for seed in range(trials)]
    for name, (wrench, pose, most) in RATES.items():
        bounds = [bound_of(rec, wrench) for rec in recordings]
        for position in (True, False):
            found = [estimate_delay(two_streams(rec, wrench, pose, position)) for rec in recordings]
            off = np.array([one.value - TRUE for one in found])
            judged = position or kind == "sweeping"
            largest = float(np.abs(off).max())
            what = f"{name}, {'with' if position else 'without'} positions"
            std = np.median([one.std for one in found])
            remark = f"bound {1e3 * np.median(bounds):.3g}, std {1e3 * std:.3g} ms; {_applied(found)}"
            yield Row(f"{what}: largest error", 1e3 * largest, "ms", most=1e3 * most if judged else None, remark=remark)
            inside = np.mean(np.abs(off) < 2.0 * np.array([one.std for one in found]))
            yield Row(f"{what}: within two std", 100.0 * float(inside), "%")


def _applied(found: list[Delay]) -> str:
    return f"applied in {sum(one.significant for one in found)} of {len(found)}"


def whole_arms(trials: int) -> Iterator[Row]:
    """How far off it is where the arm's joints are recorded, -20 to 60 ms late: 60 s each."""
    for kind, seed in {"vertical": 7000, "tilted": 8000, "hand": 9000}.items():
        found, true = [], []
        for trial in range(trials):
            rng = np.random.default_rng(seed + trial)
            true.append(rng.uniform(-0.02, 0.06))
            found.append(estimate_delay(with_joints(whole_arm(kind, 60.0, seed + trial), true[-1], rng)))
        off = np.array([one.value for one in found]) - true
        size, std = np.sort(np.abs(off)), np.array([one.std for one in found])
        reach = 0.5 / np.sqrt(trials)
        error = 0.5e3 * float(np.diff(np.quantile(size, [0.5 - reach, 0.5 + reach]))[0])
        remark = (
            f"+- {error:.2g}; largest {1e3 * size[-1]:.2g}, median std {1e3 * np.median(std):.2g}; {_applied(found)}"
        )
        name = "a hand guides the arm" if kind == "hand" else f"{kind} pick and place"
        yield Row(f"{name}: median error", 1e3 * float(np.median(size)), "ms", most=0.3, remark=remark)
        share = np.mean(size < 2.0 * std[np.argsort(np.abs(off))])
        remark = f"+- {100.0 * np.sqrt(share * (1.0 - share) / trials):.2g}"
        yield Row(f"{name}: within two std", 100.0 * float(share), "%", remark=remark)


def coverage(trials: int) -> Iterator[Row]:
    """How often the truth is within two std, with noise that is white or correlated in time."""
    for duration in (10.0, 40.0):
        for over in (0.0, 0.05, 0.2, 1.0):
            found = [
                estimate_delay(gravity_alone(seed, duration=duration, noise=5.0, correlated_over=over), within=0.2)
                for seed in range(trials)
            ]
            off = np.array([one.value - 0.0137 for one in found])
            std = np.array([one.std for one in found])
            kind = f"correlated over {over:g} s" if over else "white"
            remark = f"RMS error {1e3 * np.sqrt(np.mean(off**2)):.3g}, median std {1e3 * np.median(std):.3g} ms"
            covered = 100.0 * float(np.mean(np.abs(off) < 2.0 * std))
            yield Row(f"{duration:g} s, noise {kind}", covered, "%", remark=remark)


def cost(quick: bool) -> Iterator[Row]:
    """CPU time of all threads: ten minutes at 1 kHz and 100 Hz, and the whole command on a bag of 69 s."""
    slow = gravity_alone(0, duration=600.0)
    t = np.arange(0.0, 600.0, 1e-3)
    rows = np.minimum((t * 100.0).astype(int), len(slow.wrench) - 1)
    streams = Streams(WrenchStream(t, slow.wrench.wrench[rows]), slow.orientation)
    times = 2 if quick else 10
    yield _cpu("estimate, 10 min at 1 kHz", lambda: estimate_delay(streams), times, 1.0)
    yield _cpu("synchronize, 10 min at 1 kHz", lambda: synchronize(streams), times, 1.0)
    with TemporaryDirectory() as folder:
        _run(folder, "simulate", "--trajectory", "stops:7", "-o", "run.mcap", "--set", "sensor.bias=0")
        command = ("calibrate", "run.mcap", "-o", "tool.json", "--force")
        yield _cpu("the command calibrate, bag of 69 s", lambda: _run(folder, *command), times, 2.5)


def _run(folder: str, *words: str) -> None:
    subprocess.run([sys.executable, "-m", "contactwrench", *words], cwd=folder, check=True, capture_output=True)


def _cpu(what: str, action: Callable[[], object], times: int, most: float) -> Row:
    """The mean with its standard error, of this process and those that it ran."""
    seconds = np.empty(times)
    action()
    for k in range(times):
        start = sum(os.times()[:4])
        action()
        seconds[k] = sum(os.times()[:4]) - start
    error = seconds.std(ddof=1) / np.sqrt(times)
    return Row(what, float(seconds.mean()), "s", most=most, remark=f"+- {error:.2g} s of CPU")


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Five tables; `quick` takes a tenth of the trials, and two at least."""
    trials = 2 if quick else 12
    yield "Delay, wrist sweeping for 30 s", errors("sweeping", 30.0, trials)
    yield "Delay, whole arm exciting for 30 s", errors("exciting", 30.0, trials)
    yield "Delay, joints of the whole arm", whole_arms(4 if quick else 40)
    yield "Coverage of the delay's two standard deviations", coverage(20 if quick else 200)
    yield "Two clocks, speed", cost(quick)
