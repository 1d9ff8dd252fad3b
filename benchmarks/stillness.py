"""Still stretches in runs of the virtual rig: stops found, stretches invented, the coverage of the means, and speed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import contactwrench as cw
from contactwrench.samples.recorded_poses import is_stream
from contactwrench.samples.still_segments import still_segments
from contactwrench.simulate.recording import record_motion
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import exciting
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
    yield "Still stretches: seconds", seconds_taken()
