"""Still stretches in runs of the virtual rig: stops found, stretches invented, the coverage of the means, sensors that
creep or wander, slow motions without stops, and speed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import contactwrench as cw
from contactwrench.samples.recorded_poses import is_stream
from contactwrench.samples.still_segments import still_segments
from contactwrench.simulate.recording import record_motion
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import exciting, sweeping
from tests.support.runs import TOOL, Run, run

from .clock import median_seconds
from .table import Row

RUNS = 25
STOPS = 12

WAYS: dict[str, dict[str, Any]] = {
    "1 kHz, no sensor filter": {"settings": ("sensor.low_pass=0",)},
    "1 kHz, filter of 10 Hz": {"settings": ("sensor.low_pass=10",)},
    "1 kHz, filter of 2 Hz": {"settings": ("sensor.low_pass=2",)},
    "1 kHz, 50 ms late": {"settings": ("sensor.delay=0.05",)},
    "1 kHz, orientation +- 0.05 deg": {"orientation_noise_deg": 0.05},
    "1 kHz, stops of 0.6 s": {"stop": 0.6},
    "1 kHz, warming up by 1 N in 20 min": {"settings": ("sensor.drift.warm_up=[1,1,1,0.02,0.02,0.02]",)},
    "100 Hz, orientation +- 0.01 deg": {"rate": 100.0, "orientation_noise_deg": 0.01},
    "10 Hz": {"rate": 10.0},
    "10 Hz, orientation +- 0.03 deg": {"rate": 10.0, "orientation_noise_deg": 0.03},
}
DRIFTING = "1 kHz, warming up by 1 N in 20 min"
"""The true wrench there is that of no time; its means are not judged."""


@dataclass
class Count:
    """Of some runs: `stops`, how many of them were `found`, stretches `invented` between them, `rejected` ones, and how
    far off the means are, in std.
    """

    stops: int
    found: int
    invented: int
    rejected: int
    off: list[np.ndarray[Any, Any]]


def counted(runs: Iterable[Run]) -> Count:
    """What `still_segments` makes of runs."""
    count = Count(0, 0, 0, 0, [])
    for one in runs:
        found = still_segments(one.samples)
        seen = set()
        for stretch in found.accepted:
            middle = 0.5 * (stretch.t_start + stretch.t_end)
            inside = np.flatnonzero((one.stops[:, 0] <= middle) & (middle <= one.stops[:, 1]))
            if not len(inside):
                count.invented += 1
                continue
            seen.add(int(inside[0]))
            count.off.append((stretch.wrench - one.wrench[inside[0]]) / np.sqrt(np.diag(stretch.wrench_cov)))
        count.stops += len(one.stops)
        count.found += len(seen)
        count.rejected += len(found.rejected)
    return count


def found_and_covered(runs: int) -> Iterator[Row]:
    """Stops of 2 s, moves of 1.5 s; the share of means whose error is below 1.96 std."""
    for name, way in WAYS.items():
        count = counted(run(stops=STOPS, seed=seed, **way) for seed in range(runs))
        share = 100.0 * count.found / count.stops
        remark = f"{count.stops} stops, {count.invented} stretches invented, {count.rejected} left out"
        yield Row(f"{name}: found", share, "%", least=98.0, remark=remark)
        if name != DRIFTING:
            covered = 100.0 * float(np.mean(np.abs(count.off) < 1.96))
            yield Row(f"{name}: means covered", covered, "%", least=90.0, most=98.0)


def invented_in_motion(runs: int) -> Iterator[Row]:
    """Motions that never stop: what is taken for still in them, per minute."""
    settings = changed(Settings(), [*TOOL])
    for seconds in (20.0, 60.0):
        found, minutes, streams = 0, 0.0, 0
        for seed in range(runs):
            rng = np.random.default_rng(seed)
            samples = record_motion(settings, exciting(seconds, 1000.0, rng), rng=rng).samples
            moving = samples.select(
                slice(round(100.0 * seconds), -round(100.0 * seconds))
            )  # it begins and ends at rest
            streams += is_stream(moving)
            found += len(still_segments(moving).accepted)
            minutes += 0.8 * seconds / 60.0
        yield Row(f"an exciting motion of {seconds:g} s: stretches a minute", found / minutes, most=0.1)
        yield Row(f"an exciting motion of {seconds:g} s: taken for a stream", 100.0 * streams / runs, "%", least=100.0)


QUIET = np.array([1e-3, 1e-3, 1e-3, 2e-5, 2e-5, 2e-5])
"""Noise of a sample of a sensor that creeps or wanders, N and N m."""
MOVE = 1.5
SEEDS_OF_CREEP, SEEDS_OF_SWEEPS = 91_000, 92_000
WEIGHT = 9.80665
SHAPES: dict[str, Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]] = {
    "even": lambda way: way,
    "slowing": lambda way: np.log1p(20.0 * way) / np.log(21.0),
    "decaying": lambda way: np.exp(-4.0 * way),
}


def creeping(seed: int, stop: float, shape: str, flicker: float) -> Callable[..., np.ndarray[Any, Any]]:
    """What a sensor adds: in each stop and on each axis 5 to 60 times a sample's noise, and 1/f noise whose means
    scatter by `flicker` of a sample's whatever their length.
    """
    rng = np.random.default_rng(seed)

    def disturb(t: np.ndarray[Any, Any], wrench: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        number = (t // (stop + MOVE)).astype(int)
        by = QUIET * np.exp(rng.uniform(np.log(5.0), np.log(60.0), (number.max() + 1, 6)))
        by *= rng.choice([-1.0, 1.0], size=by.shape)
        frequency = np.maximum(np.fft.rfftfreq(len(t)), 1.0 / len(t))
        white = np.fft.rfft(rng.normal(size=wrench.shape), axis=0)
        wander = np.fft.irfft(white / np.sqrt(frequency)[:, None], len(t), axis=0)
        means = wander[: len(t) // 200 * 200].reshape(-1, 200, 6).mean(axis=1)
        wander *= flicker * QUIET / np.sqrt(0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0))
        way = SHAPES[shape](np.minimum((t % (stop + MOVE)) / stop, 1.0))
        disturbed: np.ndarray[Any, Any] = wrench + wander + by[number] * way[:, None]
        return disturbed

    return disturb


def sensors_that_creep(runs: int) -> Iterator[Row]:
    """Stops used of 2 s and more, and the weight in std, over rates, lengths of stops and delays."""
    used, stops, off = 0, 0, []
    settings = [f"sensor.noise.force={QUIET[0]}", f"sensor.noise.torque={QUIET[3]}", "sensor.quantum=0.00001"]
    seed = SEEDS_OF_CREEP
    for rate in (10.0, 100.0, 1000.0):
        for stop in (2.0, 5.0, 20.0):
            for delay in (0.0, 0.3, 0.6):
                for shape in SHAPES:
                    for _ in range(max(1, runs // 5)):
                        seed += 1
                        late = (*settings, f"sensor.delay={delay}")
                        disturb = creeping(seed, stop, shape, float(seed % 3))
                        made = run(stops=8, stop=stop, move=MOVE, rate=rate, seed=seed, settings=late, disturb=disturb)
                        found = cw.calibrate(made.samples, "mount")
                        count = counted([made])
                        used, stops = used + count.found, stops + count.stops
                        off.append(((found.weight or 0.0) - WEIGHT) / found.std["weight"])
    remark = f"{len(off)} runs of 8 stops"
    yield Row("creep of 5 to 60 samples' noise, 1/f: stops used", 100.0 * used / stops, "%", least=99.5, remark=remark)
    share = 100.0 * float(np.mean(np.abs(off) < 3.0))
    yield Row("creep of 5 to 60 samples' noise, 1/f: weight within 3 std", share, "%", least=99.0, remark=remark)


def slow_sweeps(runs: int) -> Iterator[Row]:
    """Sweeps at 5 deg/s in the mean, all the rig's dynamics, 0.05 N of noise, 0.1 s late."""
    settings = changed(Settings(), [*TOOL, "recording.rate=100", "sensor.delay=0.1"])
    motion = sweeping(160.0, 100.0)
    off, std = [], []
    for seed in range(SEEDS_OF_SWEEPS, SEEDS_OF_SWEEPS + 2 * runs):
        samples = record_motion(settings, motion, rng=np.random.default_rng(seed)).samples
        begin = 2000 * (seed % 5)
        found = cw.calibrate(samples.select(slice(begin, begin + 6000)), "mount")
        off.append((found.weight or 0.0) - WEIGHT)
        std.append(found.std["weight"])
    remark = f"{len(off)} minutes"
    worst = 100.0 * float(np.abs(off).max()) / WEIGHT
    yield Row("a minute of a slow sweep: largest error of the weight", worst, "%", most=1.0, remark=remark)
    covered = 100.0 * float(np.mean(np.abs(off) < 1.96 * np.array(std)))
    yield Row("a minute of a slow sweep: weight covered", covered, "%", least=90.0, remark=remark)


def seconds_taken() -> Iterator[Row]:
    """The clock: 10 minutes at 1 kHz, and 20,000 rows."""
    one = run(stops=120, stop=3.0, move=2.0, seed=1).samples
    few = one.select(slice(None, None, 30))
    minutes = f"{len(one):,} rows at 1 kHz"
    yield Row(f"{minutes}: still stretches", median_seconds(lambda: still_segments(one), 3), "s", most=1.0)
    yield Row(f"{minutes}: stream or table", median_seconds(lambda: is_stream(one), 3), "s", most=1.0)
    yield Row(f"{minutes}: calibrate", median_seconds(lambda: cw.calibrate(one), 1), "s")
    yield Row(f"{len(few):,} rows: still stretches", median_seconds(lambda: still_segments(few), 3), "s", most=0.1)


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of still stretches."""
    runs = RUNS // 5 if quick else RUNS
    yield "Still stretches: stops found, means covered", found_and_covered(runs)
    yield "Still stretches: invented in motion", invented_in_motion(runs)
    yield "Still stretches: sensors that creep", sensors_that_creep(runs)
    yield "Still stretches: slow motion", slow_sweeps(runs)
    yield "Still stretches: seconds", seconds_taken()
