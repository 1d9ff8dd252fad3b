"""The estimator on what real sensors, cables and robots do, on tilts it did not expect, on rows, and against the clock.

Part of inference.py, and judged from outside like it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

import contactwrench as cw
from tests.support.world import Array, random_rotations, readings

from .auto import RUNGS
from .clock import median_seconds
from .errors import NOISE, Realistic, direction, in_order, poses, tilted, times, usual_rig
from .table import Row
from .trials import UNSEEN, Found, force_error, inside, joined, ratio_row, run, share_row, verdict

TOOL = 20.0
SETS = ("6 spread", "12 cone", "24 random")
JUDGED = {
    "gain and cross-talk 1 %": Realistic(gain=0.01),
    "backlash 0.3 N": Realistic(backlash=0.3),
    "cable field 0.3 N": Realistic(cable=0.3),
    "robot 0.3 deg": Realistic(robot=0.3),
    "robot 0.3 deg, correlated": Realistic(robot=0.3, correlation=0.85),
    "all together": Realistic(gain=0.01, backlash=0.3, cable=0.3, robot=0.3, correlation=0.85),
}
KINDS = {**JUDGED, "creep 0.2 %": Realistic(creep=0.002)}
FAR_OFF = 3.0
NORMAL_95 = 1.96


class Erring(NamedTuple):
    """A set of poses by name, and what goes wrong."""

    poses: str
    kind: str


def _said(calibration: cw.Calibration) -> float:
    """N, a norm: the error of the force that the calibration says is to be expected at a new orientation."""
    said = getattr(calibration, "expected_error", None)
    if said is not None:
        return float(said[0])
    largest = np.linalg.norm(calibration.wrench_std(UNSEEN)[:, :3], axis=1).max()
    return float(np.hypot(largest, np.linalg.norm(calibration.noise[:3])))


def erring(cell: Erring, rng: np.random.Generator) -> dict[str, float]:
    """One recording. Covered is by the t of the calibration. Its own error is against what the sensor reads at unseen
    orientations less what differs from pose to pose, gain and cross-talk included; the new readings have all of it,
    drawn anew.
    """
    reality = KINDS[cell.kind].drawn(usual_rig(rng, TOOL), rng)
    R = in_order(poses(cell.poses, rng))
    wrench = reality.read(R, rng)
    calibration = cw.calibrate(cw.Samples(wrench, R, times(len(R))), "auto")
    predicted, std = calibration.predict(UNSEEN)[:, :3], calibration.wrench_std(UNSEEN)[:, :3]
    off = predicted - reality.steady(UNSEEN)[:, :3]
    new = predicted - reality.read(UNSEEN, rng)[:, :3]
    share = float(np.sqrt(np.sum(off**2) / np.sum(std**2)))
    good = verdict(calibration) == "good"
    return {
        "inside": float(np.mean(np.abs(off) <= NORMAL_95 * std)),
        "inside by t": float(np.mean(np.abs(off) <= calibration.t_quantile() * std)),
        "share": share**2,
        "good": float(good),
        "confidently wrong": float(good and share > FAR_OFF),
        "out": float(np.mean([pose.rejected is not None for pose in calibration.poses])),
        "said": _said(calibration) ** 2,
        "true": float(np.sum(new**2, axis=1).mean()),
    }


def errors_of_all(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Coverage, what is wrong and sure, and good poses left out: each error on each set of poses."""
    cells = [Erring(name, kind) for kind, name in product(KINDS, SETS)]
    found = dict(zip(cells, run(pool, erring, cells, n, (seed, 5)), strict=True))
    for cell, some in found.items():
        low, high = (90.0, 99.5) if cell.kind in JUDGED else (None, None)
        share = np.sqrt(some["share"].mean()) if len(some) else np.nan
        remark = (
            f"by 1.96 std {100.0 * some.get('inside').mean():.1f} %; error over stated std {share:.3g}; "
            f"good {100.0 * some.get('good').mean():.0f} %; {some.remark}"
        )
        yield share_row(f"{cell.kind}, {cell.poses}: force covered", some.get("inside by t"), low, high, remark)
    for kind in KINDS:
        of_sets = {cell.poses: some.get("confidently wrong") for cell, some in found.items() if cell.kind == kind}
        most = 2.0 if kind in JUDGED else None
        every = np.concatenate([*of_sets.values()])
        yield share_row(f"{kind}: good, and an error over 3 std", every, most=most, remark=_each(of_sets))
    for kind in KINDS:
        of_sets = {cell.poses: some.get("out") for cell, some in found.items() if cell.kind == kind}
        worst = max(of_sets.values(), key=lambda out: float(out.mean()))
        most = 100.0 / 24.0 if kind in JUDGED else None
        yield share_row(f"{kind}: good poses left out, worst set", worst, most=most, remark=_each(of_sets))
    for kind in JUDGED:
        yield _of_the_verdict(kind, found[Erring("24 random", kind)])


def _each(shares: dict[str, Array]) -> str:
    return ", ".join(f"{name} {100.0 * share.mean():.1f} %" for name, share in shares.items())


def _of_the_verdict(kind: str, found: Found) -> Row:
    said, true = found.get("said"), found.get("true")
    words = f"{np.sqrt(said.mean()):.3g} N said, {np.sqrt(true.mean()):.3g} N true" if len(found) else found.remark
    row = ratio_row(f"{kind}, 24 random: error to expect", said, true, "x true", remark=words)
    return Row(row.what, row.value, row.unit, 0.75, 1.25, row.remark, row.standard_error)


@dataclass(frozen=True)
class Tilted:
    """A set of poses by name, the tool's weight (N), and how far off the mounting is (deg)."""

    poses: str
    weight: float
    tilt: float


def with_tilt(cell: Tilted, rng: np.random.Generator) -> dict[str, float]:
    """One recording: `auto`, the rungs of its alternatives, and its intervals."""
    rig = tilted(np.deg2rad(cell.tilt) * direction(rng, 2), np.zeros(2), cell.weight, rng)
    R, truth = poses(cell.poses, rng), readings(rig, UNSEEN)
    calibration = cw.calibrate(cw.Samples(readings(rig, R) + NOISE * rng.normal(size=(6, 6)), R), "auto")
    outcome = {"squared": force_error(calibration, truth), **dict.fromkeys(RUNGS, np.inf)}
    for rung in calibration.alternatives:
        if rung.model in RUNGS:
            predicted = np.einsum("nji,j->ni", UNSEEN, rung.gravity_direction) @ rung.B[:3, :3].T + rung.B[:3, 3]
            outcome[rung.model] = float(np.sum((predicted - truth[:, :3]) ** 2, axis=1).mean())
    covered = {name: inside(calibration, name, getattr(rig, name)) for name in ("weight", "com", "bias")}
    outcome["inside"] = float(np.average([*covered.values()], weights=(1.0, 3.0, 6.0)))
    return {**outcome, **covered, "good": float(verdict(calibration) == "good")}


def tilts(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Each tilt and weight, on the paper's poses and on spread ones: over the best rung, and coverage."""
    cells = [Tilted(*of) for of in product(("paper's 6", "6 spread"), (2.0, 10.0, 50.0), (0.0, 1.0, 5.0, 7.0, 90.0))]
    pairs = list(zip(cells, run(pool, with_tilt, cells, n, (seed, 6)), strict=True))
    for cell, found in pairs:
        what = f"{cell.poses}, {cell.weight:g} N, mounted {cell.tilt:g} deg off: force RMS"
        if not len(found):
            yield Row(what, np.nan, "x best rung", most=1.30, remark=found.remark)
            continue
        best = min(RUNGS, key=lambda name: float(found[name].mean()))
        remark = (
            f"{best} {np.sqrt(found[best].mean()):.3g} N; good {100.0 * found['good'].mean():.0f} %; {found.remark}"
        )
        yield ratio_row(what, found["squared"], found[best], "x best rung", 1.30, remark)
    for poses_, tilt in dict.fromkeys((cell.poses, cell.tilt) for cell in cells):
        found = joined(some for cell, some in pairs if (cell.poses, cell.tilt) == (poses_, tilt))
        what = f"{poses_}, 2 to 50 N, mounted {tilt:g} deg off: covered"
        of = ", ".join(
            f"{name} {100.0 * found.get(name).mean():.0f} %" for name in ("weight", "com", "bias") if len(found)
        )
        yield share_row(what, found.get("inside"), 93.0, 99.0, of)


ROW_NOISE = np.array([1.2, 1.2, 1.2, 0.02, 0.02, 0.02])
STOPS, ROWS = 16, 300
"""Of 3 s at 100 Hz."""


def by_rows(weight: float, rng: np.random.Generator) -> dict[str, float]:
    """One recording: from its rows, without times, and from the means of its stops."""
    rig = tilted(np.deg2rad(0.5) * direction(rng, 2), np.deg2rad(0.7) * direction(rng, 2), weight, rng)
    R, truth = random_rotations(STOPS, rng), readings(rig, UNSEEN)
    rows = readings(rig, R)[:, None] + ROW_NOISE * rng.normal(size=(STOPS, ROWS, 6))
    of_rows = cw.calibrate(cw.Samples(rows.reshape(-1, 6), np.repeat(R, ROWS, axis=0)), "auto")
    of_means = cw.calibrate(cw.Samples(rows.mean(axis=1), R), "auto")
    return {
        "rows": force_error(of_rows, truth),
        "means": force_error(of_means, truth),
        "same": float(of_rows.assumptions == of_means.assumptions),
        "inside": inside(of_rows, "bias", rig.bias),
    }


def rows_and_means(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """The error from rows over that from means, and whether both say the same of mounting and base."""
    weights = (5.0, 10.0, 20.0)
    each = run(pool, by_rows, weights, n, (seed, 7))
    for weight, found in (*zip(weights, each, strict=True), (None, joined(each))):
        what = "all" if weight is None else f"{weight:g} N"
        rows, means = found.get("rows"), found.get("means")
        remark = f"{np.sqrt(rows.mean()):.3g} N over {np.sqrt(means.mean()):.3g}; {found.remark}"
        yield ratio_row(f"{what}: force RMS from rows", rows, means, "x from means", 1.05, remark)
    yield share_row("rows and means say the same of mounting and base", joined(each).get("same"))
    yield share_row("bias covered, from rows", joined(each).get("inside"))


def _timed(poses_: int, rows: int, in_time: bool, model: str, repeats: int) -> float:
    """s a calibration, in a process whose linear algebra has one thread."""
    rng = np.random.default_rng(8)
    rig = usual_rig(rng, 10.0)
    R = np.repeat(random_rotations(poses_, rng), rows, axis=0)
    wrench = readings(rig, R) + NOISE * rng.normal(size=(len(R), 6))
    samples = cw.Samples(wrench, R, times(len(R)) if in_time else None)
    return median_seconds(partial(cw.calibrate, samples, model), repeats)


def durations(pool: Executor, quick: bool) -> Iterator[Row]:
    """One after the other, while nothing else is done."""
    less = 4 if quick else 1
    for what, of, most in (
        ("24 poses with times, auto", (24, 1, True, "auto", 40 // less), 15.0),
        ("24 poses with times, mount", (24, 1, True, "mount", 40 // less), 5.0),
        ("200 poses with times, auto", (200, 1, True, "auto", 8 // less), 60.0),
        ("10^6 rows at 50 orientations, auto", (50, 20_000, False, "auto", 4 // less), 400.0),
    ):
        yield Row(what, 1e3 * pool.submit(_timed, *of).result(), "ms", most=most)


def tables(pool: Executor, quick: bool, seed: int, seeds: str) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of this page."""
    families = (
        ("realistic: errors of sensor, cable and robot, a tool of 20 N", errors_of_all, (10, 400)),
        ("tilts: a truth exactly nominal, or not as assumed", tilts, (6, 400)),
        ("rows: 16 stops of 3 s at 100 Hz, 1.2 N and 20 mN m a row", rows_and_means, (8, 300)),
    )
    for title, family, numbers in families:
        n = numbers[0 if quick else 1]
        yield f"{title}, {n} trials a cell, {seeds} seed", family(pool, n, seed)
    yield "time: calibrations on one thread", durations(pool, quick)
