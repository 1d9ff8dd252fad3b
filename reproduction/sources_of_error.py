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

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.recording import SENSOR_RATE, record_poses
from contactwrench.simulate.settings import Drift, Recording, Settings, changed

from .charts import Panel, lines_in_panels
from .methods import METHODS, Learn, calibrated
from .part import Measured, Part, Picture, Table, mean
from .planned import planned_joints
from .trials import (
    Squared,
    force_ratio,
    free_readings,
    in_batches,
    in_words,
    joints_of_paper,
    learned,
    left_by,
    number_of_trials,
    rms_force,
    student,
    unseen_joints,
)

TRIALS = 6
BY_CHANCE = 0.001
"""How often chance alone may make a difference that counts, where there is none: there are many cells."""
NEAR = 1.3
ESTIMATORS: dict[str, Learn] = {
    "ours": METHODS["ours"],
    "paper": METHODS["paper"],
    "yaw": calibrated("yaw", "yaw"),
    "mount": calibrated("mount", "mount"),
    "affine": calibrated("affine", "affine"),
    "tare": METHODS["tare"],
}
RIG = Settings(recording=Recording(settle=5.0))
WARM_UP_TIME = 60.0
"""s. Less than half a minute from the first reading to the last, and a sensor that warms up in one: what counts is by
how much the bias moves meanwhile.
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
    """From the first reading of six poses to the last the bias moves by `size` N on each force axis, by as much of its
    range on others.
    """
    share = size * np.array(RIG.sensor.ranges) / RIG.sensor.ranges[0]
    first, between = RIG.recording.settle, RIG.recording.settle + RIG.recording.rows / SENSOR_RATE
    moved = np.exp(-first / WARM_UP_TIME) - np.exp(-(first + 5.0 * between) / WARM_UP_TIME)
    start = rng.choice([-1.0, 1.0], size=6) * share / moved
    fx, fy, fz, tx, ty, tz = (float(value) for value in start)
    drift = Drift(warm_up=(fx, fy, fz, tx, ty, tz), warm_up_time=WARM_UP_TIME)
    return replace(RIG, sensor=replace(RIG.sensor, drift=drift))


def _motion(size: float, _: np.random.Generator) -> Settings:
    return replace(RIG, recording=replace(RIG.recording, creep=size))


SOURCES = {
    source.name: source
    for source in (
        Source("base tilt", "deg", (1.0, 2.0), _tilted_base),
        Source("mounting tilt", "deg", (2.0, 5.0), _tilted_mounting),
        Source("cross-talk", "% of range", (1.0, 3.0), _crosstalk),
        Source("pose error of the robot", "deg", (0.2, 1.0), _pose_error),
        Source("drift while recording", "N", (0.2, 1.0), _drift),
        Source("motion while reading", "rad/s", (0.3, 1.0), _motion),
    )
}
NONE = "none"
CELLS = ((NONE, 0.0), *((source.name, size) for source in SOURCES.values() for size in source.sizes))

Trials: TypeAlias = list[dict[str, Squared]]
Cell: TypeAlias = tuple[str, float]
Found: TypeAlias = dict[Cell, Trials]


def part(pool: Executor, scale: float, seed: int) -> Part:
    """Every source at every size, from the paper's poses and from planned ones."""
    n = number_of_trials(TRIALS, scale)
    unseen = unseen_joints()
    sets = {"the paper's six poses": joints_of_paper(), "six planned poses": planned_joints(6)}
    found: dict[str, Found] = {name: {} for name in sets}
    for (name, poses), (source, size) in product(sets.items(), CELLS):
        found[name][source, size] = in_batches(pool, partial(trials_at, source, size, poses, unseen, seed), n)
    return Part(
        key="sources_of_error",
        title="Sources of error, one at a time",
        paragraphs=tuple(_said(name, cells) for name, cells in found.items()),
        tables=tuple(_table(name, cells, n) for name, cells in found.items()),
        pictures=tuple(_picture(name, cells, n) for name, cells in found.items()),
    )


def trials_at(source: str, size: float, poses: Array, unseen: Array, seed: int, numbers: range) -> Trials:
    """The trials of those numbers, on joints (6, 7) and judged at joints (m, 7), rad."""
    trials = []
    for number in numbers:
        direction, noise = np.random.default_rng((seed, 7, number)), np.random.default_rng((seed, 7, number, 1))
        settings = RIG if source == NONE else SOURCES[source].rig(size, direction)
        recorded = record_poses(settings, poses, rng=noise)
        free = free_readings(settings, unseen, float(recorded.t[-1]))
        methods = {name: learned(learn, recorded.samples) for name, learn in ESTIMATORS.items()}
        trials.append({name: left_by(method, free) for name, method in methods.items() if method is not None})
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
        "recording. Drift: the movement of the bias from the first reading to the last. "
        f"{_said_of_dice(found)} Refused, and not in the figures: {'; '.join(refused) if refused else 'none'}.",
    )


def _picture(poses: str, found: Found, n: int) -> Picture:
    panels = [
        Panel(
            source.name,
            source.unit,
            ("0", *(f"{size:g}" for size in source.sizes)),
            {name: [_drawn(found[cell], name) for cell in _cells(source)] for name in ESTIMATORS},
        )
        for source in SOURCES.values()
    ]
    return Picture(
        name="experiment_sources_of_error_" + ("planned" if "planned" in poses else "paper"),
        html=lines_in_panels(panels, "force error, N"),
        caption=f"Error of the contact force at orientations that were not recorded, calibrated on {poses}, against "
        f"the size of one source of error; RMS over {n} data sets, bars of one standard "
        "error, which is that of the level: all points share the same noise draws, so that a curve is surer than they.",
    )


def _cells(source: Source) -> list[Cell]:
    return [(NONE, 0.0), *((source.name, size) for size in source.sizes)]


def _drawn(trials: Trials, name: str) -> Measured | None:
    cell = _force(trials, name)
    return None if isinstance(cell, str) else cell


def _said_of_dice(found: Found) -> str:
    """What all cells share, and how sure their level is."""
    level = {name: _drawn(found[NONE, 0.0], name) for name in ESTIMATORS}
    relative = ", ".join(
        f"{name} {100.0 * one.standard_error / one.value:.0f} %"
        for name, one in level.items()
        if one is not None and one.standard_error is not None
    )
    return (
        "All cells share the same noise draws: compare along a row or a column. The level itself is uncertain by about "
        f"(one standard error of the case without error): {relative}."
    )


def _said(poses: str, found: Found) -> str:
    against = {cell: against_best(trials) for cell, trials in found.items()}
    refused = [cell for cell, trials in found.items() if not _solved_all(trials, "ours")]
    near_best = sum(cell not in refused and ratio.value <= NEAR for cell, (_, ratio) in against.items())
    worst = max(against, key=lambda cell: against[cell][1].value)
    best, ratio = against[worst]
    furthest = (
        f"furthest from it with {_cell_name(*worst)}, where its error is {in_words(ratio)} times that of {best}"
        if best != "ours"
        else "in none is another better"
    )
    ratios = [one for trials in found.values() if (one := force_ratio(trials, "paper", "ours")) is not None]
    told = {cell: told_apart(trials) for cell, trials in found.items()}
    paper_better, ours_better = (
        [_cell_name(*cell) for cell, by in told.items() if by == name] for name in ("paper", "ours")
    )
    n = len(found[NONE, 0.0])
    return (
        f"On {poses}, of {len(found)} cases, ours is within {100.0 * (NEAR - 1.0):.0f} % of the best estimator of each "
        f"in {near_best}; {furthest} (an estimator that refuses a data set is not called best, and ours refuses some "
        f"in {len(refused)} cases). {_said_of_paper(ratios, n)} Two errors count as told apart where the mean "
        "logarithm of their ratio, trial by trial, is further from zero than chance alone makes it in one of "
        f"{1.0 / BY_CHANCE:.0f} cases (Student's t with one degree of freedom less than trials: with {n} trials "
        f"{student(n - 1, BY_CHANCE):.1f} standard errors). So ours is smaller in {len(ours_better)} of the cases and "
        f"the paper's in {len(paper_better)}{': ' + ', '.join(paper_better) if paper_better else ''}; not told apart: "
        f"{len(found) - len(ours_better) - len(paper_better)}."
    )


def _said_of_paper(ratios: list[Measured], n: int) -> str:
    if not ratios:
        return "No data set was solved by both the paper's and ours."
    low, high = (pick(ratios, key=lambda one: one.value) for pick in (min, max))
    both = min(one.trials for one in ratios)
    return (
        f"The paper's error is {in_words(low)} to {in_words(high)} times ours, over the data sets that both solved "
        f"({f'at least {both}' if both < n else 'all'} of {n} in each case)."
    )


def _solved_all(trials: Trials, name: str) -> bool:
    return all(name in trial for trial in trials)


def against_best(trials: Trials) -> tuple[str, Measured]:
    """The best of the estimators that refused no trial, and how many times its error ours is, over the trials that ours
    solved; infinitely many where it solved none.
    """
    candidates = {
        name: ratio
        for name in ESTIMATORS
        if _solved_all(trials, name) and (ratio := force_ratio(trials, "ours", name)) is not None
    }
    if not candidates:
        return "any other", Measured(np.inf, None, 0)
    best = max(candidates, key=lambda name: candidates[name].value)
    return best, candidates[best]


def told_apart(trials: Trials) -> str | None:
    """Which of the paper's and ours has clearly the smaller error, where one has."""
    ratios = [np.log(trial["paper"].force / trial["ours"].force) for trial in trials if {"paper", "ours"} <= set(trial)]
    ratio = mean(ratios) if ratios else None
    if ratio is None or ratio.standard_error is None:
        return None
    if abs(ratio.value) <= student(ratio.trials - 1, BY_CHANCE) * ratio.standard_error:
        return None
    return "ours" if ratio.value > 0.0 else "paper"
