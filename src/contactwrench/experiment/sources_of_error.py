"""Section 7: sources of error one at a time, and what each estimator makes of them.

Everything else stays as the paper's model has it. In every trial a source has a random direction; the same trial has
the same direction and the same noise for every source and size, so that a curve shows the source and not the dice.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TypeAlias

import numpy as np

from ..orientation import Array
from ..report.charts import Panel, lines_in_panels
from ..simulate.recording import record_poses
from ..simulate.settings import Drift, Recording, Settings, changed
from .part import Measured, Part, Picture, Table, mean
from .planned import planned_joints
from .trials import (
    Squared,
    free_readings,
    in_batches,
    joints_of_paper,
    learned,
    left_by,
    number_of_trials,
    rms_force,
    unseen_joints,
)
from .ways import WAYS, Learn, calibrated

TRIALS = 4
CLEARLY = 3.0
"""Standard errors by which a difference counts: with so few trials chance alone often gives two."""
ESTIMATORS: dict[str, Learn] = {
    "ours": WAYS["ours"],
    "paper": WAYS["paper"],
    "yaw": calibrated("yaw", "yaw"),
    "mount": calibrated("mount", "mount"),
    "affine": calibrated("affine", "affine"),
    "tare": WAYS["tare"],
}
RIG = Settings(recording=Recording(settle=5.0))
WARM_UP_TIME = 60.0
"""s. Half a minute from the first pose to the last, and a sensor that warms up in one: what counts is by how much the
bias moves meanwhile.
"""


@dataclass(frozen=True)
class Source:
    """One source of error: its `sizes` in `unit`, and the rig with one of them, in a direction drawn at random."""

    name: str
    unit: str
    sizes: tuple[float, ...]
    rig: Callable[[float, np.random.Generator], Settings]


def _tilt(size: float, rng: np.random.Generator) -> tuple[float, float]:
    way = rng.uniform(0.0, 2.0 * np.pi)
    return float(size * np.cos(way)), float(size * np.sin(way))


def _tilted_base(size: float, rng: np.random.Generator) -> Settings:
    return replace(RIG, base=replace(RIG.base, tilt_deg=_tilt(size, rng)))


def _tilted_mounting(size: float, rng: np.random.Generator) -> Settings:
    return replace(RIG, mounting=replace(RIG.mounting, tilt_deg=_tilt(size, rng)))


def _crosstalk(size: float, rng: np.random.Generator) -> Settings:
    """Each axis at its full range shows on every other one as a share of that one's range: `size` %, std."""
    ranges = np.array(RIG.sensor.ranges)
    mixed = 0.01 * size * rng.normal(size=(6, 6)) * ranges[:, None] / ranges
    np.fill_diagonal(mixed, 0.0)
    return changed(RIG, [f"sensor.crosstalk={mixed.tolist()}"])


def _pose_error(size: float, _: np.random.Generator) -> Settings:
    return replace(RIG, recording=replace(RIG.recording, orientation_error_deg=size))


def _drift(size: float, rng: np.random.Generator) -> Settings:
    """While six poses are recorded the bias moves by `size` N on each force axis, by as much of its range on others."""
    share = size * np.array(RIG.sensor.ranges) / RIG.sensor.ranges[0]
    recorded = 6.0 * RIG.recording.settle
    start = rng.choice([-1.0, 1.0], size=6) * share / (1.0 - np.exp(-recorded / WARM_UP_TIME))
    fx, fy, fz, tx, ty, tz = (float(value) for value in start)
    drift = Drift(warm_up=(fx, fy, fz, tx, ty, tz), warm_up_time=WARM_UP_TIME)
    return replace(RIG, sensor=replace(RIG.sensor, drift=drift))


def _motion(size: float, _: np.random.Generator) -> Settings:
    return replace(RIG, recording=replace(RIG.recording, creep=size))


SOURCES = {
    source.name: source
    for source in (
        Source("base tilt", "deg", (0.5, 1.0, 2.0), _tilted_base),
        Source("mounting tilt", "deg", (0.5, 2.0, 5.0), _tilted_mounting),
        Source("cross-talk", "% of range", (0.2, 1.0, 3.0), _crosstalk),
        Source("pose error of the robot", "deg", (0.05, 0.2, 1.0), _pose_error),
        Source("drift while recording", "N", (0.05, 0.2, 1.0), _drift),
        Source("motion while reading", "rad/s", (0.1, 0.3, 1.0), _motion),
    )
}
NONE = "none"
CELLS = ((NONE, 0.0), *((source.name, size) for source in SOURCES.values() for size in source.sizes))

Trials: TypeAlias = list[dict[str, Squared]]
Found: TypeAlias = dict[tuple[str, float], Trials]


def part(pool: Executor, scale: float, seed: int) -> Part:
    """Every source at every size, from the paper's poses and from planned ones."""
    n = number_of_trials(TRIALS, scale)
    unseen = unseen_joints()
    sets = {"the paper's six poses": joints_of_paper(), "six planned poses": planned_joints(6)}
    found: dict[str, Found] = {name: {} for name in sets}
    for (name, poses), (source, size) in product(sets.items(), CELLS):
        found[name][source, size] = in_batches(pool, partial(_run, source, size, poses, unseen, seed), n)
    return Part(
        key="sources_of_error",
        title="Sources of error, one at a time",
        paragraphs=tuple(_said(name, cells) for name, cells in found.items()),
        tables=tuple(_table(name, cells, n) for name, cells in found.items()),
        pictures=tuple(_picture(name, cells, n) for name, cells in found.items()),
    )


def _run(source: str, size: float, poses: Array, unseen: Array, seed: int, numbers: range) -> Trials:
    """The trials of those numbers, on joints (6, 7) and judged at joints (m, 7), rad."""
    trials = []
    for number in numbers:
        direction, noise = np.random.default_rng((seed, 7, number)), np.random.default_rng((seed, 7, number, 1))
        settings = RIG if source == NONE else SOURCES[source].rig(size, direction)
        recorded = record_poses(settings, poses, rng=noise)
        free = free_readings(settings, unseen, float(recorded.t[-1]))
        ways = {name: learned(learn, recorded.samples) for name, learn in ESTIMATORS.items()}
        trials.append({name: left_by(way, free) for name, way in ways.items() if way is not None})
    return trials


def _force(trials: Trials, name: str) -> Measured | str:
    of = [trial[name] for trial in trials if name in trial]
    return rms_force(of) if of else "refused"


def _cell_name(source: str, size: float) -> str:
    return "no error but the noise" if source == NONE else f"{source} {size:g} {SOURCES[source].unit}"


def _table(poses: str, found: Found, n: int) -> Table:
    refused = [
        f"{name} with {_cell_name(*cell)} in {missing} of {n}"
        for cell, trials in found.items()
        for name in ESTIMATORS
        if (missing := sum(name not in trial for trial in trials))
    ]
    return Table(
        key=poses.replace("'", "").replace(" ", "_"),
        title=f"Force left at orientations that were not recorded, N: calibrated on {poses}",
        columns=tuple(ESTIMATORS),
        rows=tuple(
            (_cell_name(*cell), tuple(_force(trials, name) for name in ESTIMATORS)) for cell, trials in found.items()
        ),
        note=f"Root mean square over {n} data sets a cell and {len(unseen_joints())} random orientations; the truth "
        "has the source of error in it where it stays (tilts, cross-talk), and the bias is that of the end of the "
        f"recording. Refused, and not in the figures: {'; '.join(refused) if refused else 'none'}.",
    )


def _picture(poses: str, found: Found, n: int) -> Picture:
    panels = [
        Panel(
            source.name,
            source.unit,
            ("0", *(f"{size:g}" for size in source.sizes)),
            {
                name: [
                    _drawn(found[cell], name) for cell in ((NONE, 0.0), *((source.name, size) for size in source.sizes))
                ]
                for name in ESTIMATORS
            },
        )
        for source in SOURCES.values()
    ]
    return Picture(
        name="experiment_sources_of_error_" + ("planned" if "planned" in poses else "paper"),
        html=lines_in_panels(panels, "force error, N"),
        caption=f"Error of the contact force at orientations that were not recorded, calibrated on {poses}, against "
        f"the size of one source of error; RMS over {n} data sets, bars of one standard error.",
    )


def _drawn(trials: Trials, name: str) -> Measured | None:
    cell = _force(trials, name)
    return None if isinstance(cell, str) else cell


def _said(poses: str, found: Found) -> str:
    values = {
        cell: {name: force.value for name in ESTIMATORS if (force := _drawn(trials, name)) is not None}
        for cell, trials in found.items()
    }
    near_best = sum(of.get("ours", np.inf) <= 1.3 * min(of.values()) for of in values.values())
    worst_cell, worst = max(values.items(), key=lambda item: item[1].get("ours", np.inf) / min(item[1].values()))
    best = min(worst, key=lambda name: worst[name])
    told = {cell: _told_apart(trials) for cell, trials in found.items()}
    paper_better, ours_better = (
        [_cell_name(*cell) for cell, by in told.items() if by == name] for name in ("paper", "ours")
    )
    ratios = [of["paper"] / of["ours"] for of in values.values() if "paper" in of and "ours" in of]
    return (
        f"On {poses}, of {len(found)} cases, ours is within 30 % of the best estimator of each in {near_best}; "
        f"furthest from it with {_cell_name(*worst_cell)}, where {best} has {min(worst.values()):.3g} N and ours "
        f"{worst.get('ours', np.nan):.3g} N. The paper's error is {min(ratios):.2g} to {max(ratios):.2g} times ours. "
        f"By more than {CLEARLY:g} standard errors of the ratio of both errors, trial by trial, ours is smaller in "
        f"{len(ours_better)} of the cases and the paper's in {len(paper_better)}"
        f"{': ' + ', '.join(paper_better) if paper_better else ''}; not told apart: "
        f"{len(found) - len(ours_better) - len(paper_better)}."
    )


def _told_apart(trials: Trials) -> str | None:
    """Which of the paper's and ours has clearly the smaller error, where one has."""
    ratios = [np.log(trial["paper"].force / trial["ours"].force) for trial in trials if {"paper", "ours"} <= set(trial)]
    ratio = mean(ratios) if ratios else None
    if ratio is None or ratio.standard_error is None or abs(ratio.value) <= CLEARLY * ratio.standard_error:
        return None
    return "ours" if ratio.value > 0.0 else "paper"
