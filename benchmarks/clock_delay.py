"""The delay between two streams: errors against the bound of each motion, coverage of its std, and what it costs.

The bound is of the true tool, motion and white noise. Targets: errors of at most 2 ms at 1 kHz and 100 Hz where it is
below 0.5 ms, of at most half a sample at 10 Hz. Recordings without the flange's positions have none where the whole arm
moves: accelerations of the flange are then unknown, and the std has to say so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from contactwrench.samples.delay import Delay, estimate_delay
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.synchronize import synchronize
from tests.support.moving import bound_of, gravity_alone, rig_recording, two_streams

from .clock import median_seconds
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
    """Ten minutes at 1 kHz and 100 Hz."""
    slow = gravity_alone(0, duration=600.0)
    t = np.arange(0.0, 600.0, 1e-3)
    rows = np.minimum((t * 100.0).astype(int), len(slow.wrench) - 1)
    streams = Streams(
        WrenchStream(t, slow.wrench.wrench[rows]),
        OrientationStream(slow.orientation.t, slow.orientation.R_base_flange),
    )
    times = 1 if quick else 5
    yield Row("estimate, 10 min at 1 kHz", median_seconds(lambda: estimate_delay(streams), times), "s", most=2.0)
    yield Row("synchronize, 10 min at 1 kHz", median_seconds(lambda: synchronize(streams), times), "s", most=1.0)


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Four tables; `quick` takes a tenth of the trials, and two at least."""
    trials = 2 if quick else 12
    yield "Delay, wrist sweeping for 30 s", errors("sweeping", 30.0, trials)
    yield "Delay, whole arm exciting for 30 s", errors("exciting", 30.0, trials)
    yield "Coverage of the delay's two standard deviations", coverage(20 if quick else 200)
    yield "Two clocks, speed", cost(quick)
