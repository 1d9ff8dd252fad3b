"""Section 3: known masses hung on the tool (Table IX), and what a gain error of the sensor does to them.

The paper says neither in which orientation it weighed nor by which component of the contact force; here its table is
compared with the tool down, by the norm. A norm is never negative, and errors across the load make it larger; the
component along gravity, whose direction a calibration knows, stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.kinematics import joints_through
from contactwrench.simulate.rig import build

from .part import Measured, Part, Table, mean, root_mean_square, share
from .trials import (
    DEFAULT,
    in_batches,
    in_words,
    joints_of_paper,
    number_of_trials,
    ratio_of_rms,
    scatter,
    student,
    unseen_joints,
)
from .weighing_trials import ESTIMATORS, LOADS, ORIENTATIONS, SCALES, Weighed, in_range, run

TRIALS = 16
PRINTED = (94.3, 191.5, 480.8, 971.1)
"""g: what the paper's sensor made of them."""
BENCHMARK = {"paper": (39.0, 21.0, 8.4, 4.2), "yaw": (8.1, 4.1, 1.6, 0.8)}
"""%, by the norm, without the noise of the reading: the method, section 5, by a simulation that has nothing in common
with this rig.
"""

GAIN = 0.974
"""The slope of the paper's Table IX (docs/reproduction.md)."""

TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
OUTSIDE = 0.05
"""The share of data sets that an interval leaves out."""

FROM_TO = (
    "From, to: a prediction interval, which holds the reading of one more data set with 95 % (Student's t with one "
    "degree of freedom less than there are data sets, readings taken for normal)."
)
COLUMNS = ("100 g", "200 g", "500 g", "1000 g")


def part(pool: Executor, scale: float, seed: int) -> Part:
    """The paper's verification, with a true sensor and with one whose gain is off."""
    n = number_of_trials(TRIALS, scale)
    poses = joints_of_paper()
    usable = in_range(unseen_joints())
    weighing = np.concatenate([joints_through(build(DEFAULT), TOOL_DOWN[None]), unseen_joints()[usable]])
    off = replace(DEFAULT, sensor=replace(DEFAULT.sensor, gain=(GAIN,) * 6))
    true, low = (in_batches(pool, partial(run, rig, poses, weighing, seed), n) for rig in (DEFAULT, off))
    return Part(
        key="weighing",
        title="Verification with known masses",
        paragraphs=(_said_of_weighing(true), _said_of_range(), _said_of_gain(true, low)),
        tables=(_table_ix(true), _anywhere(true), _intervals(true), _gain(true, low)),
    )


def _table_ix(trials: Sequence[Weighed]) -> Table:
    rows: list[tuple[str, tuple[Measured | str | None, ...]]] = [
        (
            f"the paper's Table IX: {label}",
            (Measured(printed, None, 1), None, None, Measured(100.0 * (printed / (1e3 * load) - 1.0), None, 1), None),
        )
        for label, load, printed in zip(COLUMNS, LOADS, PRINTED, strict=True)
    ]
    for name in ESTIMATORS:
        for k, (label, load) in enumerate(zip(COLUMNS, LOADS, strict=True)):
            rows.append((f"{name}: {label}", _one_load(_down(trials, name)[:, k], 1e3 * load)))
    return Table(
        key="weights",
        title="Known masses, tool down, by the norm of the contact force (Table IX)",
        columns=("read, g", "from, g", "to, g", "error, %", "RMS error, %"),
        rows=tuple(rows),
        note=f"{len(trials)} data sets of the paper's six poses, and one reading of each mass with each. {FROM_TO} "
        "The paper says neither in which orientation nor by which component it weighed; its masses are from one data "
        "set.",
    )


def _down(trials: Sequence[Weighed], name: str) -> Array:
    """The masses (n, 4), g, that an estimator reads with the tool down, by the norm."""
    return np.array([trial.down[name, "norm"] for trial in trials if (name, "norm") in trial.down]).reshape(-1, 4)


def _one_load(read: Array, true: float) -> tuple[Measured | str | None, ...]:
    if len(read) < 2:
        return ("refused",) * 5
    percent = 100.0 * (read / true - 1.0)
    return mean(read), *prediction_interval(read[:, None]), mean(percent), root_mean_square(percent**2)


def prediction_interval(read: Array) -> tuple[Measured, Measured]:
    """From where to where 95 % of single readings lie, by those of n data sets (n, k): a prediction interval, with the
    uncertainty of mean and scatter in it. The k readings of a data set share its errors: no more freedom than n - 1.
    """
    n = len(read)
    of_sets = read.mean(axis=1)
    variance = (1.0 + 1.0 / n) * of_sets.var(ddof=1) + np.mean((read - of_sets[:, None]) ** 2)
    half = student(n - 1, OUTSIDE) * float(np.sqrt(variance))
    return Measured(float(read.mean()) - half, None, n), Measured(float(read.mean()) + half, None, n)


def _anywhere(trials: Sequence[Weighed]) -> Table:
    rows: list[tuple[str, tuple[Measured | str | None, ...]]] = []
    for name in ESTIMATORS:
        for scale in SCALES:
            cells = tuple(_error_anywhere(trials, name, scale, k) for k in range(len(LOADS)))
            rows.append((f"{name}, {scale}", cells))
        if name in BENCHMARK:
            printed = tuple(Measured(value, None, 20_000) for value in BENCHMARK[name])
            rows.append((f"{name}, norm: expected", printed))
    return Table(
        key="weights_anywhere",
        title="RMS error of the mass in any orientation within range, %",
        columns=COLUMNS,
        rows=tuple(rows),
        note=f"{len(trials)} data sets of the paper's six poses, and with each one reading of each mass in "
        f"{ORIENTATIONS} orientations, drawn anew from the random ones in which the sensor stays in range. A tare "
        "does not know where gravity is in the sensor's axes. "
        "Expected: 20 000 trials of a simulation that has nothing in common with this rig, without the noise of the "
        "reading.",
    )


def _error_anywhere(trials: Sequence[Weighed], name: str, scale: str, k: int) -> Measured | str:
    read = [trial.anywhere[name, scale][k] for trial in trials if (name, scale) in trial.anywhere]
    if not read:
        return "none"
    true = 1e3 * LOADS[k]
    return root_mean_square(((100.0 * (np.array(read) / true - 1.0)) ** 2).mean(axis=1))


def _intervals(trials: Sequence[Weighed]) -> Table:
    rows: list[tuple[str, tuple[Measured | str | None, ...]]] = []
    for name in ESTIMATORS:
        for scale in SCALES:
            read = np.array([trial.anywhere[name, scale] for trial in trials if (name, scale) in trial.anywhere])
            cells = [end for k in range(len(LOADS)) for end in prediction_interval(read[:, k])] if len(read) > 1 else []
            rows.append((f"{name}, {scale}", tuple(cells) or ("none",) * (2 * len(LOADS))))
    return Table(
        key="weights_anywhere_intervals",
        title="From where to where 95 % of single readings lie, in any orientation within range, g",
        columns=tuple(f"{label}: {end}" for label in COLUMNS for end in ("from", "to")),
        rows=tuple(rows),
        note=f"The readings of the table above, {ORIENTATIONS} of each mass with each of {len(trials)} data sets. "
        f"{FROM_TO} A norm is not normal where the error is as large as the mass: it cannot be below zero.",
    )


def line(read: Array) -> tuple[float, float]:
    """Slope and offset, g, of masses read (4,), g, against those that hung, by least squares."""
    slope, offset = np.polyfit(1e3 * np.array(LOADS), read, 1)
    return float(slope), float(offset)


def _lines(trials: Sequence[Weighed], name: str) -> Array:
    """Slope and offset (n, 2) of every trial, tool down, by the norm."""
    return np.array([line(read) for read in _down(trials, name)]).reshape(-1, 2)


def _gain(true: Sequence[Weighed], low: Sequence[Weighed]) -> Table:
    slope, offset = line(np.array(PRINTED))
    rows: list[tuple[str, tuple[Measured | str | None, ...]]] = [
        ("the paper's Table IX", (Measured(slope, None, 1), Measured(offset, None, 1), None, None, None))
    ]
    for label, trials in (("gain 1", true), (f"gain {GAIN}", low)):
        for name in ("paper", "yaw", "ours"):
            of = _lines(trials, name)
            if not len(of):
                rows.append((f"{label}: {name}", ("refused",) * 5))
                continue
            free = [mean([by[name] for by in found if name in by]) for found in _found(trials)]
            rows.append((f"{label}: {name}", (mean(of[:, 0]), mean(of[:, 1]), scatter(of[:, 1]), *free)))
    return Table(
        key="gain",
        title="Masses read against masses hung, tool down: the line through them",
        columns=("slope", "offset, g", "scatter of the offset, g", "tool's weight, N", "left in the six poses, N"),
        rows=tuple(rows),
        note=f"{len(true)} data sets with each gain, of all six channels. The last two columns are what the "
        "calibration in free air has found.",
    )


def _found(trials: Sequence[Weighed]) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    return [trial.weight for trial in trials], [trial.left for trial in trials]


def _said_of_weighing(trials: Sequence[Weighed]) -> str:
    def of(name: str, scale: str, k: int) -> float:
        cell = _error_anywhere(trials, name, scale, k)
        return float("nan") if isinstance(cell, str) else cell.value

    down = {name: (_down(trials, name)[:, 0] - 100.0) ** 2 for name in ESTIMATORS}
    percent = {name: f"{np.sqrt(squares.mean()):.2g} %" for name, squares in down.items() if len(squares)}
    here, anywhere = (
        in_words(ratio_of_rms(*zip(*both, strict=True))) if both else "(refused)"
        for both in (_both(trials, lambda trial: trial.down), _both(trials, lambda trial: trial.anywhere))
    )
    return (
        f"Weighed in any orientation within range by the norm of the contact force, 100 g comes out with an RMS error "
        f"of {of('paper', 'norm', 0):.2g} % by the paper's estimator and {of('ours', 'norm', 0):.2g} % by ours, 1000 g "
        f"with {of('paper', 'norm', 3):.2g} % and {of('ours', 'norm', 3):.2g} %. Along gravity, which a calibration "
        f"knows, it is {of('paper', 'along gravity', 0):.2g} % and {of('ours', 'along gravity', 0):.2g} % at 100 g. "
        f"With the tool down, among the poses of the calibration, 100 g has {percent.get('paper', 'refused')} and "
        f"{percent.get('ours', 'refused')}, and {percent['tare']} with a mere tare in the first pose. The paper says "
        f"neither in which orientation nor by which component it weighed; here: tool down, the norm. Weighing there "
        f"tells the tare from ours by a factor of {here}, weighing anywhere by {anywhere}."
    )


def _both(trials: Sequence[Weighed], read: Callable[[Weighed], dict[tuple[str, str], Array]]) -> list[Array]:
    """Squared errors, g^2, of 100 g by tare and ours, trial by trial where neither refused."""
    keys = ("tare", "norm"), ("ours", "norm")
    return [
        np.array([np.mean((read(trial)[key][0] - 100.0) ** 2) for key in keys])
        for trial in trials
        if all(key in read(trial) for key in keys)
    ]


def _said_of_range() -> str:
    joints = unseen_joints()
    within = share(np.isin(np.arange(len(joints)), in_range(joints)))
    sensor, hook = DEFAULT.sensor, DEFAULT.tool.hook[2]
    return (
        f"The masses hang {1e3 * hook:.0f} mm from the sensor. With its zero of {sensor.bias[4]:g} N m on Ty, of which "
        f"it reads {sensor.overload * sensor.ranges[4]:g} N m at most, all four masses stay in range in "
        f"{100.0 * within.value:.0f} +- {100.0 * (within.standard_error or 0.0):.0f} % of orientations: of "
        f"{len(joints)} random ones {round(within.value * len(joints))}. From these each data set draws "
        f"{ORIENTATIONS} anew."
    )


def _said_of_gain(true: Sequence[Weighed], low: Sequence[Weighed]) -> str:
    slope, offset = line(np.array(PRINTED))
    with_gain, without = _lines(low, "paper"), _lines(true, "paper")
    if not len(with_gain) or not len(without):
        return "The paper's estimator refused every data set."
    beyond = int(np.sum(np.abs(with_gain[:, 1] - with_gain[:, 1].mean()) >= abs(offset)))
    weight, left = (
        [float(np.mean([by["ours"] for by in _found(trials)[which] if "ours" in by])) for trials in (true, low)]
        for which in (0, 1)
    )
    return (
        f"The line through the paper's four masses has a slope of {slope:.3f} and an offset of {offset:.1f} g. A "
        f"sensor whose gain is {GAIN:g} gives a slope of {in_words(mean(with_gain[:, 0]))} (a true one "
        f"{in_words(mean(without[:, 0]))}), and an offset that scatters by {in_words(scatter(with_gain[:, 1]))} g from "
        f"one data set to the next: {beyond} of {len(with_gain)} are further from the mean than the paper's is from "
        f"zero. The line of Table IX is what a gain of {GAIN:g} gives{'' if beyond else ' but for its offset'}. "
        f"Calibrating in free air cannot see the gain: the tool's weight comes out {weight[1] / weight[0]:.3f} times "
        f"as large (ours), and the fit leaves {left[1]:.4f} N instead of {left[0]:.4f} N. It takes a known mass."
    )
