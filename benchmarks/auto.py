"""`auto` by Monte Carlo: against every rung of the ladder, where their assumptions hold and where they do not.

Truth is Table V with a tool of 2, 10 or 50 N, on parallel faces and a level base, or not; nobody tells `auto` which.
It should be nearly as good as the best rung, which nobody could know beforehand; its intervals should hold the truth
where that is drawn from its priors; and it should find any mounting and any base up to a wall.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.support.poses import POSE_SETS
from tests.support.world import (
    Array,
    Rig,
    bound_on_prediction,
    noisy_readings,
    random_rig,
    random_rotations,
    readings,
    tilted_down,
    with_down,
)

from .accuracy import MOUNTING_NOISE, NAMES, NOISE, TABLE_V, UNSEEN
from .table import Row

WEIGHTS = (2.0, 10.0, 50.0)
SIX = ("paper's 6", "6 spread")
RUNGS = ("yaw", "mount", "mount+base")
PRIOR_MOUNT, PRIOR_BASE = np.deg2rad(1.41), np.deg2rad(0.71)
"""rad, an axis: the stated priors of the mounting's and of the base's tilt."""

TRIALS = 1000
CHUNK = 50
DIRECTIONS = 20
"""Of the tilts, over which the bound is averaged."""


@dataclass(frozen=True)
class Truth:
    """Tilts in deg, towards a random side, and the smallest model that holds them."""

    name: str
    mount: float
    base: float
    model: str


TRUTHS = (
    Truth("as assumed", 0.0, 0.0, "yaw"),
    Truth("sensor z off 2 deg", 2.0, 0.0, "mount"),
    Truth("base tilted 1 deg", 0.0, 1.0, "mount+base"),
    Truth("both", 2.0, 1.0, "mount+base"),
)


@dataclass(frozen=True)
class Cell:
    """What a Monte Carlo run meets: a tool, a set of poses by name, a truth (None: drawn from the priors), and whether
    the noise is given (up to a scale).
    """

    weight: float
    poses: str
    truth: Truth | None
    noise_given: bool

    def rig(self, rng: np.random.Generator) -> Rig:
        """Table V with this weight, tilted as the truth says."""
        if self.truth is None:
            mount, base = PRIOR_MOUNT * rng.normal(size=2), PRIOR_BASE * rng.normal(size=2)
        else:
            mount, base = (np.deg2rad(tilt) * _any_side(rng) for tilt in (self.truth.mount, self.truth.base))
        return replace(
            TABLE_V,
            weight=self.weight,
            R_flange_sensor=_tilt(mount) @ TABLE_V.R_flange_sensor,
            down=_tilt(base) @ TABLE_V.down,
        )

    def calibration(self, rig: Rig, rng: np.random.Generator) -> cw.Calibration:
        """What `auto` makes of one recording. Raises `ContactWrenchError`."""
        R = POSE_SETS[self.poses]
        samples = cw.Samples(noisy_readings(rig, R, NOISE, rng), R)
        return cw.calibrate(samples, "auto", noise=NOISE if self.noise_given else None)


def _any_side(rng: np.random.Generator) -> Array:
    side = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(side), np.sin(side)])


def _tilt(about_x_y: Array) -> Array:
    turn: Array = Rotation.from_rotvec([*about_x_y, 0.0]).as_matrix()
    return turn


def force_error(force: Array, rig: Rig) -> float:
    """Mean squared error (N^2), a norm, of the free force (m, 3) predicted at the unseen orientations."""
    return float(np.sum((force - readings(rig, UNSEEN)[:, :3]) ** 2, axis=1).mean())


def rms(squared: Array) -> float:
    """Root of the mean over what was not refused (NaN); NaN where all was."""
    there = squared[np.isfinite(squared)]
    return float(np.sqrt(there.mean())) if len(there) else np.nan


def chunks(n: int) -> list[int]:
    """Numbers of trials that make n."""
    return [min(CHUNK, n - start) for start in range(0, n, CHUNK)]


def errors(cell: Cell, seed: tuple[int, ...], n: int) -> Array:
    """Mean squared force error (n, 4) of `auto` and of the rungs fitted to the same readings; NaN where refused."""
    rng = np.random.default_rng(seed)
    squared = np.full((n, 1 + len(RUNGS)), np.nan)
    for trial in squared:
        rig = cell.rig(rng)
        try:
            calibration = cell.calibration(rig, rng)
        except cw.ContactWrenchError:
            continue
        trial[0] = force_error(calibration.predict(UNSEEN)[:, :3], rig)
        for rung in calibration.alternatives:
            if rung.model in RUNGS:
                r = np.einsum("nji,j->ni", UNSEEN, rung.gravity_direction)
                trial[1 + RUNGS.index(rung.model)] = force_error(r @ rung.B[:3, :3].T + rung.B[:3, 3], rig)
    return squared


def bound(cell: Cell, model: str) -> float:
    """N: the least RMS force error of a model that is told everything but its parameters."""
    rng = np.random.default_rng(0)
    R = POSE_SETS[cell.poses]
    each = [bound_on_prediction(cell.rig(rng), model, R, NOISE, UNSEEN)[0] for _ in range(DIRECTIONS)]
    return float(np.sqrt(np.mean(np.square(each))))


def against_the_rungs(pool: Executor, trials: int, noise_given: bool) -> Iterator[Row]:
    """RMS of the contact force by `auto` over that of the best rung, each cell; their geometric mean."""
    cells = [
        (Cell(weight, poses, truth, noise_given), truth) for weight in WEIGHTS for poses in SIX for truth in TRUTHS
    ]
    jobs = [
        [pool.submit(errors, cell, (11, int(noise_given), k, chunk), n) for chunk, n in enumerate(chunks(trials))]
        for k, (cell, _) in enumerate(cells)
    ]
    ratios = []
    for (cell, truth), parts in zip(cells, jobs, strict=True):
        squared = np.concatenate([part.result() for part in parts])
        auto, *rungs = (rms(column) for column in squared.T)
        ratios.append(auto / np.nanmin(rungs))
        of_rungs = ", ".join(f"{name} {value:.3g}" for name, value in zip(RUNGS, rungs, strict=True))
        remark = f"auto {auto:.3g} N; {of_rungs}; bound of {truth.model} {bound(cell, truth.model):.3g}"
        missing = np.sum(np.isnan(squared), axis=0)
        missing[1:] -= missing[0]
        refused = [f"{name} {k}" for name, k in zip(("auto", *RUNGS), missing, strict=True) if k]
        remark += f"; refused: {', '.join(refused)}" if refused else ""
        yield Row(f"{cell.weight:g} N, {cell.poses}, {truth.name}", ratios[-1], "x best rung", most=1.30, remark=remark)
    mean = float(np.exp(np.mean(np.log(ratios))))
    yield Row(f"geometric mean of {len(ratios)} cells", mean, "x best rung", most=1.10)


def covered(cell: Cell, seed: tuple[int, ...], n: int) -> Array:
    """Whether the 95 % intervals of weight, com and bias hold the truth (n, 10); NaN where refused."""
    rng = np.random.default_rng(seed)
    inside = np.full((n, 10), np.nan)
    for trial in inside:
        rig = cell.rig(rng)
        truth = np.r_[rig.weight, rig.com, rig.bias]
        try:
            calibration = cell.calibration(rig, rng)
        except cw.ContactWrenchError:
            continue
        low, high = zip(*(calibration.interval(name) for name in ("weight", "com", "bias")), strict=True)
        trial[:] = (np.r_[low] <= truth) & (truth <= np.r_[high])
    return inside


def coverage(pool: Executor, trials: int, poses: tuple[str, ...], noise_given: bool) -> Iterator[Row]:
    """How often the intervals hold a truth drawn from the priors: the worst and the best parameter, and the mean."""
    cells = [Cell(weight, name, None, noise_given) for weight in WEIGHTS for name in poses]
    jobs = [
        [
            pool.submit(covered, cell, (12, int(noise_given), len(poses), k, chunk), n)
            for chunk, n in enumerate(chunks(trials))
        ]
        for k, cell in enumerate(cells)
    ]
    for cell, parts in zip(cells, jobs, strict=True):
        inside = np.concatenate([part.result() for part in parts])
        refused = int(np.sum(np.isnan(inside[:, 0])))
        each = 100.0 * np.nanmean(inside, axis=0)
        most = 97.0 if noise_given or cell.poses == "24 random" else None
        what = f"{cell.weight:g} N, {cell.poses}"
        for word, k in (("lowest", int(np.argmin(each))), ("highest", int(np.argmax(each)))):
            yield Row(f"{what}: {word} coverage", each[k], "%", 93.0, most, NAMES[k])
        remark = f"{refused} refused" if refused else ""
        yield Row(f"{what}: mean coverage", each.mean(), "%", 93.0, most, remark)


@dataclass(frozen=True)
class Outcome:
    """Of one recording: how far the base leans (deg), and what came of it."""

    lean: float
    what: str


RECOVERED = "recovered"
WORDS = 5
"""Of a refusal's message, by which refusals are counted."""


def any_mounting_and_base(seed: tuple[int, ...], n: int) -> list[Outcome]:
    """Random tools at 12 random poses, mounted anyhow, on bases up to a wall."""
    rng = np.random.default_rng(seed)
    outcomes = []
    for _ in range(n):
        lean = rng.uniform(0.0, 90.0)
        rig = with_down(random_rig(rng), tilted_down(np.deg2rad(lean), rng))
        R = random_rotations(12, rng)
        samples = cw.Samples(noisy_readings(rig, R, MOUNTING_NOISE, rng), R)
        try:
            what = judged(cw.calibrate(samples, "auto"), rig)
        except cw.ContactWrenchError as refusal:
            what = f"refused: {' '.join(str(refusal).split()[:WORDS])}"
        outcomes.append(Outcome(lean, what))
    return outcomes


def judged(calibration: cw.Calibration, rig: Rig) -> str:
    """Whether weight, mounting and gravity are the rig's, to 6 stated std; for directions 1 deg will do as well."""
    std, R = calibration.std, calibration.R_flange_sensor
    if calibration.weight is None or R is None:
        raise TypeError("auto gives a rigid tool")
    turn = Rotation.from_matrix(R.T @ rig.R_flange_sensor).as_rotvec()
    lean = float(np.arccos(np.clip(calibration.gravity_direction @ rig.down, -1.0, 1.0)))
    degree = np.deg2rad(1.0)
    wrong = {
        "weight": abs(calibration.weight - rig.weight) > 6.0 * std["weight"],
        "mounting": np.linalg.norm(turn) > degree and bool((np.abs(turn) > 6.0 * std["mount"]).any()),
        "gravity": lean > max(degree, 6.0 * float(std["gravity"].max())),
    }
    named = " and ".join(name for name, is_wrong in wrong.items() if is_wrong)
    return f"wrong {named}" if named else RECOVERED


def recovery(pool: Executor, trials: int) -> Iterator[Row]:
    """How many of the mountings and bases are recovered, and what became of the others."""
    jobs = [pool.submit(any_mounting_and_base, (13, chunk), n) for chunk, n in enumerate(chunks(trials))]
    outcomes = [outcome for job in jobs for outcome in job.result()]
    recovered = sum(outcome.what == RECOVERED for outcome in outcomes)
    yield Row("recovered", float(recovered), f"of {trials}", least=float(trials))
    others = Counter(outcome.what for outcome in outcomes if outcome.what != RECOVERED)
    for what, count in others.most_common():
        leans = ", ".join(f"{outcome.lean:.1f}" for outcome in outcomes if outcome.what == what)
        yield Row(what, float(count), f"of {trials}", remark=f"bases lean {leans} deg")


def tables(pool: Executor, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of `auto`, one after the other."""
    trials = TRIALS // 10 if quick else TRIALS
    ratio = "RMS of the contact force, auto over the best rung"
    yield f"{ratio}, noise unknown, {trials} trials a cell", against_the_rungs(pool, trials, False)
    half = trials // 2
    yield f"{ratio}, noise known up to one scale, {half} trials a cell", against_the_rungs(pool, half, True)
    intervals = f"95 % intervals of auto, truth drawn from its priors, {trials} trials"
    yield f"{intervals}, noise known up to one scale", coverage(pool, trials, SIX, True)
    yield f"{intervals}, noise unknown", coverage(pool, trials, (*SIX, "24 random"), False)
    yield "auto, any mounting, any base up to a wall, any tool, 12 random poses", recovery(pool, trials)
