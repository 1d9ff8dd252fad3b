"""Recordings that are not clean, by Monte Carlo: poses in contact, and a bias that steps, drifts or wanders.

24 random poses, a tool of 10 N with the rest of Table V, fitted by `auto` with the noise unknown. What is done to the
readings of world.py is measured in sigma: the length of a wrench, each axis in units of its noise.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from tests.support.poses import POSE_SETS
from tests.support.world import Array, derivatives, noisy_readings, random_rotations

from .accuracy import NOISE, TABLE_V, UNSEEN
from .auto import chunks, force_error, rms
from .table import Row

RIG = replace(TABLE_V, weight=10.0)
POSES = POSE_SETS["24 random"]
TIME: Array = np.linspace(0.0, 60.0 * (len(POSES) - 1), len(POSES))
"""s: a pose a minute."""

BAD = 4
SIZES = (2.0, 3.0, 5.0, 8.0, 15.0, 30.0, 100.0)
CLEARLY_BAD = 8.0
"""Sigma, from which on a pose in contact should hardly be felt."""

TRIALS = 400
CLEAN_TRIALS = 2000

FOUND = {Kind.BIAS_STEPPED: "step", Kind.BIAS_DRIFTED: "drift", Kind.BIAS_WANDERED: "walk"}
"""What this page calls a finding of the bias."""


def _of_length(size: float, rng: np.random.Generator, n: int) -> Array:
    """Wrenches (n, 6) in units of the noise, of that length, in random directions."""
    directions = rng.normal(size=(n, 6))
    scaled: Array = size * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return scaled


@dataclass(frozen=True)
class Contacts:
    """Poses in contact: how far off (sigma), and whether all in one direction."""

    size: float
    one_direction: bool


def with_contacts(contacts: Contacts, seed: tuple[int, ...], n: int) -> Array:
    """Per trial (n, 4): the mean squared force error of the fit to the whole recording, and of that to its good poses;
    how many bad and how many good poses the former left out. NaN where either is refused.
    """
    rng = np.random.default_rng(seed)
    found = np.full((n, 4), np.nan)
    for trial in found:
        wrench = noisy_readings(RIG, POSES, NOISE, rng)
        bad = rng.permutation(len(POSES)) < BAD
        wrench[bad] += NOISE * _of_length(contacts.size, rng, 1 if contacts.one_direction else BAD)
        samples = cw.Samples(wrench, POSES)
        try:
            whole, good = cw.calibrate(samples, "auto"), cw.calibrate(samples.select(~bad), "auto")
        except cw.ContactWrenchError:
            continue
        out = np.array([pose.rejected is not None for pose in whole.poses])
        trial[:2] = [force_error(calibration.predict(UNSEEN)[:, :3], RIG) for calibration in (whole, good)]
        trial[2:] = np.sum(out & bad), np.sum(out & ~bad)
    return found


def contacts_felt(pool: Executor, trials: int) -> Iterator[Row]:
    """RMS of the contact force with 4 bad poses of 24 over that of the fit without them."""
    kinds = [Contacts(size, one) for one in (False, True) for size in SIZES]
    jobs = [
        [pool.submit(with_contacts, kind, (21, k, chunk), n) for chunk, n in enumerate(chunks(trials))]
        for k, kind in enumerate(kinds)
    ]
    for kind, parts in zip(kinds, jobs, strict=True):
        found = np.concatenate([part.result() for part in parts])
        whole, good = (rms(column) for column in found.T[:2])
        bad_out, good_out = np.nanmean(found[:, 2:], axis=0)
        refused = int(np.sum(np.isnan(found[:, 0])))
        remark = f"{whole:.3g} N over {good:.3g}; left out: {bad_out:.2f} bad, {good_out:.2f} good" + (
            f"; {refused} refused" if refused else ""
        )
        any_size = None if kind.one_direction else 1.25
        most = 1.15 if kind.size >= CLEARLY_BAD else any_size
        where = "in one direction" if kind.one_direction else "in random directions"
        yield Row(f"{kind.size:g} sigma {where}", whole / good, "x without them", most=most, remark=remark)


def clean(seed: tuple[int, ...], n: int) -> list[tuple[int, str]]:
    """Of clean recordings in time: how many poses were left out, and which course of the bias was found."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        R = random_rotations(len(POSES), rng)
        calibration = cw.calibrate(cw.Samples(noisy_readings(RIG, R, NOISE, rng), R, TIME), "auto")
        found.append((_left_out(calibration), _course_found(calibration)[0]))
    return found


def _left_out(calibration: cw.Calibration) -> int:
    return sum(pose.rejected is not None for pose in calibration.poses)


def _course_found(calibration: cw.Calibration) -> tuple[str, int | None]:
    """The course of the bias that the findings tell of, and how many poses lie before a step."""
    for finding in calibration.findings:
        if finding.kind in FOUND:
            before = re.search(r"before pose (\d+)", finding.text)
            return FOUND[finding.kind], None if before is None else int(before[1]) - 1
    return "steady", None


def false_alarms(pool: Executor, trials: int) -> Iterator[Row]:
    """What clean recordings lose."""
    jobs = [pool.submit(clean, (22, chunk), n) for chunk, n in enumerate(chunks(trials))]
    found = [one for job in jobs for one in job.result()]
    losing = [count for count, _ in found if count]
    remark = f"{max(losing, default=0)} poses at most, {sum(losing) / len(found):.3f} on average"
    yield Row("recordings that lose a pose", 100.0 * len(losing) / len(found), "%", most=10.0, remark=remark)
    courses = Counter(course for _, course in found if course != "steady")
    remark = ", ".join(f"{course} {count}" for course, count in courses.items())
    moving = 100.0 * courses.total() / len(found)
    yield Row("recordings whose bias is found to move", moving, "%", most=1.0, remark=remark)


AFTER = len(POSES) // 2
"""Poses before a step."""

_BEFORE_STEP = (np.arange(len(POSES)) < AFTER)[:, None].astype(np.float64)
_TO_GO = (1.0 - TIME / TIME[-1])[:, None]


def _walk(rng: np.random.Generator) -> Array:
    steps = np.cumsum(rng.normal(size=(len(POSES), 6)), axis=0)
    to_last: Array = steps - steps[-1]
    return to_last


COURSES: dict[str, tuple[str, Callable[[np.random.Generator], Array]]] = {
    "step of 5 sigma": ("step", lambda rng: _BEFORE_STEP * _of_length(5.0, rng, 1)),
    "step of 10 sigma": ("step", lambda rng: _BEFORE_STEP * _of_length(10.0, rng, 1)),
    "drift by 10 sigma": ("drift", lambda rng: _TO_GO * _of_length(10.0, rng, 1)),
    "drift by 20 sigma": ("drift", lambda rng: _TO_GO * _of_length(20.0, rng, 1)),
    "walk of 1 sigma an axis a pose": ("walk", _walk),
}
"""How the bias (24, 6), in units of the noise, was off the last one; steps are half-way."""


@dataclass(frozen=True, eq=False)
class Moved:
    """A recording whose bias moved: the course that was found, and how many poses lie before a step; the mean squared
    force error, and that of a fit that is told the course; errors of the last bias (6,) in stated std.
    """

    found: str
    before_step: int | None
    squared: float
    told: float
    in_stds: Array


def with_course(name: str, seed: tuple[int, ...], n: int) -> list[Moved | None]:
    """Recordings with a course of the bias; None where one is refused."""
    rng = np.random.default_rng(seed)
    moved: list[Moved | None] = []
    for _ in range(n):
        steady, course = noisy_readings(RIG, POSES, NOISE, rng), COURSES[name][1](rng)
        try:
            found, told = (
                cw.calibrate(cw.Samples(wrench, POSES, TIME), "auto") for wrench in (steady + NOISE * course, steady)
            )
        except cw.ContactWrenchError:
            moved.append(None)
            continue
        squared, of_told = (force_error(calibration.predict(UNSEEN)[:, :3], RIG) for calibration in (found, told))
        moved.append(Moved(*_course_found(found), squared, of_told, (found.bias - RIG.bias) / found.std["bias"]))
    return moved


def cost_of_not_knowing(shape: Array) -> float:
    """How many times the Cramer-Rao bound on the force grows where the size of a course of shape (n, 1) is unknown."""
    J = derivatives(RIG, "yaw", POSES) / NOISE[:, None]
    unseen = derivatives(RIG, "yaw", UNSEEN)[:, :3]
    columns = shape[:, :, None] * np.eye(6)
    variances = []
    for design in (J, np.concatenate([J, columns], axis=2)):
        p = design.shape[2]
        inverse = np.linalg.pinv(design.reshape(-1, p), rcond=1e-12)[: J.shape[2]]
        variances.append(np.mean(np.sum((unseen @ inverse) ** 2, axis=(1, 2))))
    return float(np.sqrt(variances[1] / variances[0]))


def courses_followed(pool: Executor, trials: int) -> Iterator[Row]:
    """What is found of each course, and how good the last bias is."""
    jobs = [
        [pool.submit(with_course, name, (23, k, chunk), n) for chunk, n in enumerate(chunks(trials))]
        for k, name in enumerate(COURSES)
    ]
    for (name, (kind, _)), parts in zip(COURSES.items(), jobs, strict=True):
        all_of_them = [one for part in parts for one in part.result()]
        moved = [one for one in all_of_them if one is not None]
        n = len(moved)
        kinds = Counter(one.found for one in moved)
        remark = ", ".join(f"{found} {count}" for found, count in kinds.most_common())
        remark += f"; {len(all_of_them) - n} refused" if len(all_of_them) > n else ""
        yield Row(f"{name}: found to move", 100.0 * (n - kinds["steady"]) / n, "%", remark=remark)
        if kind == "step":
            exactly = sum(one.before_step == AFTER for one in moved)
            yield Row(f"{name}: found where it is", 100.0 * exactly / n, "%")
        followed, told = (rms(np.array([getattr(one, part) for one in moved])) for part in ("squared", "told"))
        shape = {"step": _BEFORE_STEP, "drift": _TO_GO}.get(kind)
        remark = f"{followed:.3g} N over {told:.3g}"
        remark += "" if shape is None else f"; of the bound, its size unknown: {cost_of_not_knowing(shape):.3g}"
        yield Row(f"{name}: RMS of the force", followed / told, "x told", remark=remark)
        in_stds = np.array([one.in_stds for one in moved])
        remark = f"{100.0 * np.mean(np.abs(in_stds) < 1.96):.1f} % within 1.96, {np.abs(in_stds).max():.3g} at most"
        yield Row(f"{name}: RMS error of the last bias", rms(in_stds**2), "stated std", remark=remark)


def tables(pool: Executor, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of recordings that are not clean, and of those that are."""
    less = 10 if quick else 1
    trials, clean_ones = TRIALS // less, CLEAN_TRIALS // less
    yield f"Clean recordings of 24 poses, {clean_ones} of them", false_alarms(pool, clean_ones)
    yield f"{BAD} of 24 poses in contact, {trials} recordings: RMS of the contact force", contacts_felt(pool, trials)
    yield f"A bias that moves over 24 poses, {trials} recordings", courses_followed(pool, trials)
