"""The estimator on recordings that are not clean, judged from outside: by the public names of the package alone.

A bias that moves or does not, against a fit that is told its course; poses in contact, against the fit without them; a
step before any pose. What sensors, cables and robots do besides is in realistic.py. A full run draws from the blind
seed, a quick one from that of development; `--only drift` is one table.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

import contactwrench as cw
from tests.support.world import Array, Rig, readings

from . import realistic
from .errors import NOISE, Contacts, Course, in_order, poses, times, usual_rig
from .table import Row
from .told import told
from .trials import (
    BLIND,
    DEVELOPMENT,
    UNSEEN,
    Found,
    force_error,
    inside,
    joined,
    ratio,
    ratio_row,
    run,
    share_row,
    verdict,
)

SETS = ("paper's 6", "12 random", "12 cone", "24 random", "24 cone")
KINDS = ("drift", "walk", "warm-up", "step")
STRENGTHS = (0.1, 0.3, 1.0)
FURTHEST_TILT = 6.0
"""deg: with a truth within 1.41 an axis, a mounting or a base found further off has left its priors."""

NAMED_FROM = 50
"""Trials a cell, from which on the worst cell is named."""


class Setting(NamedTuple):
    """A set of poses by name, in order or shuffled, and how the bias moves; whether the noise is given."""

    poses: str
    ordered: bool
    course: Course
    noise_given: bool = False

    @property
    def where(self) -> str:
        return f"{self.poses}, {'in order' if self.ordered else 'shuffled'}"

    def drawn(self, rng: np.random.Generator) -> tuple[Rig, Array, Array, Array]:
        """A rig, orientations in the order of time, their times, and readings less the course."""
        R = poses(self.poses, rng)
        R = in_order(R) if self.ordered else R[rng.permutation(len(R))]
        rig = usual_rig(rng)
        wrench = readings(rig, R) + NOISE * rng.normal(size=(len(R), 6))
        return rig, R, times(len(R)), wrench


def _moved(calibration: cw.Calibration) -> float:
    """Whether a finding says that the bias moved."""
    return float(any(str(finding.kind).startswith("bias") for finding in calibration.findings))


def _left_priors(calibration: cw.Calibration, rig: Rig) -> float:
    R = calibration.R_flange_sensor
    cosines = calibration.gravity_direction @ np.array([0.0, 0.0, -1.0]), 1.0 if R is None else R[2, 2]
    return float(np.rad2deg(np.arccos(np.clip(np.min(cosines), -1.0, 1.0))) > FURTHEST_TILT)


def with_course(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
    """One recording: `auto` and the fit that is told; of a steady one also `auto` without the times."""
    rig, R, t, wrench = setting.drawn(rng)
    change, covariance = setting.course.drawn(t, rng)
    noise = NOISE if setting.noise_given else None
    calibration = cw.calibrate(cw.Samples(wrench + change, R, t), "auto", noise=noise)
    reference = told(rig, R, wrench + change, covariance, UNSEEN)
    truth = readings(rig, UNSEEN)
    outcome = {
        "squared": force_error(calibration, truth) / reference.expected,
        "told": reference.squared / reference.expected,
        "weight": inside(calibration, "weight", rig.weight),
        "bias": inside(calibration, "bias", rig.bias),
        "left": _left_priors(calibration, rig),
        "moved": _moved(calibration),
        "good": float(verdict(calibration) == "good"),
    }
    if setting.course.kind == "steady":
        timeless = cw.calibrate(cw.Samples(wrench, R), "auto", noise=noise)
        outcome["timeless"] = force_error(timeless, truth) / reference.expected
    return outcome


def _over_told(what: str, found: Found, most: float | None, worst: str = "") -> Row:
    if not len(found):
        return Row(what, np.nan, "x told", most=most, remark=found.remark)
    remark = f"{found.remark}; good {100.0 * found['good'].mean():.0f} %, moved {100.0 * found['moved'].mean():.0f} %"
    return ratio_row(what, found["squared"], found["told"], "x told", most, remark + worst)


def _worst(settings: list[tuple[Setting, Found]]) -> str:
    """The setting with the largest ratio, where there are trials enough to tell."""
    if min(len(found) for _, found in settings) < NAMED_FROM:
        return ""
    each = [(*ratio(found["squared"], found["told"]), setting.where) for setting, found in settings]
    value, error, where = max(each)
    return f"; worst {value:.3g} +- {error:.2g}: {where}"


def drift(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Each course and strength over all poses and orders, then each set of poses over all courses. Squares are in units
    of what the told fit was to expect, so that no set of poses outweighs the others.
    """
    courses = [Course(kind, strength) for kind in KINDS for strength in STRENGTHS]
    settings = [Setting(name, ordered, course) for course, name, ordered in product(courses, SETS, (True, False))]
    pairs = list(zip(settings, run(pool, with_course, settings, n, (seed, 1)), strict=True))
    of_course = {course: [pair for pair in pairs if pair[0].course == course] for course in courses}
    for course, some in of_course.items():
        what = f"{course.kind} of {course.strength:g} N: force RMS"
        yield _over_told(what, joined(found for _, found in some), 1.25, _worst(some))
    for where in dict.fromkeys(setting.where for setting in settings):
        yield _over_told(f"{where}: force RMS", joined(f for s, f in pairs if s.where == where), None)
    for course, some in of_course.items():
        found = joined(found for _, found in some)
        for name in ("weight", "bias"):
            what = f"{course.kind} of {course.strength:g} N: {name} covered"
            yield share_row(what, found.get(name), 92.0, 98.0)
    for course, some in of_course.items():
        what = f"{course.kind} of {course.strength:g} N: leaves its priors"
        yield share_row(what, joined(found for _, found in some).get("left"), most=1.0)


def steady(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """What it costs to think of courses where there is none. The told fit knows the noise too: the ratio is judged
    where `auto` is given it.
    """
    cells = [
        Setting(name, ordered, Course("steady"), given)
        for given, name, ordered in product((True, False), SETS, (True, False))
    ]
    pairs = list(zip(cells, run(pool, with_course, cells, n, (seed, 2)), strict=True))
    for given, word in ((True, "known"), (False, "unknown")):
        some = [(setting, found) for setting, found in pairs if setting.noise_given == given]
        found = joined(found for _, found in some)
        yield _over_told(f"noise {word}: force RMS", found, 1.05 if given else None, _worst(some))
        yield ratio_row(
            f"noise {word}: force RMS", found.get("squared"), found.get("timeless"), "x without times", 1.05
        )
        for name in ("weight", "bias"):
            yield share_row(f"noise {word}: {name} covered", found.get(name))
        yield share_row(f"noise {word}: said that the bias moved", found.get("moved"), most=1.0)
        yield share_row(f"noise {word}: leaves its priors", found.get("left"), most=1.0)


@dataclass(frozen=True)
class Touched:
    """How many poses, and the contacts of up to 30 % of them; of six, of one."""

    poses: int
    contacts: Contacts


SIZES = (3.0, 5.0, 8.0, 15.0, 30.0, 100.0)
FELT_NO_MORE = 8.0
FAR_OFF = 5.0


def touched(cell: Touched, rng: np.random.Generator) -> dict[str, float]:
    """One recording, with times or without: `auto` on all poses, and on those that are not in contact."""
    rig, R = usual_rig(rng), poses(f"{cell.poses} random", rng)
    t = times(len(R)) if rng.integers(2) else None
    count = int(rng.integers(1, int(0.3 * cell.poses) + 1))
    added, bad = cell.contacts.drawn(cell.poses, count, rng)
    clean, truth = readings(rig, R) + NOISE * rng.normal(size=(len(R), 6)), readings(rig, UNSEEN)
    expected = told(rig, R[~bad], clean[~bad], None, UNSEEN).expected
    whole = cw.calibrate(cw.Samples(clean + added, R, t), "auto")
    free = cw.Samples(clean[~bad], R[~bad], None if t is None else t[~bad])
    without = force_error(cw.calibrate(free, "auto"), truth)
    squared, out = force_error(whole, truth), np.array([pose.rejected is not None for pose in whole.poses])
    good = verdict(whole) == "good"
    return {
        "squared": squared / expected,
        "without": without / expected,
        "good": float(good),
        "confidently wrong": float(good and squared > FAR_OFF**2 * max(without, expected)),
        "times": float(np.sqrt(squared / max(without, expected))),
        "good out": float(np.mean(out[~bad])),
        "bad in": float(np.mean(~out[bad])),
    }


def _over_without(what: str, found: Found, most: float | None) -> Row:
    means = {name: 100.0 * float(found.get(name).mean()) if len(found) else np.nan for name in ("good out", "bad in")}
    kept = ", ".join(f"{name} {share:.1f} %" for name, share in means.items())
    return ratio_row(
        what, found.get("squared"), found.get("without"), "x without them", most, f"{found.remark}; {kept}"
    )


def contacts(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Each size and direction over all numbers of poses, each number over all from 8 sd on, and what is wrong and
    sure.
    """
    kinds = [Contacts(size, one) for one in (False, True) for size in SIZES]
    cells = [Touched(count, kind) for kind, count in product(kinds, (6, 12, 24, 60))]
    pairs = list(zip(cells, run(pool, touched, cells, n, (seed, 3)), strict=True))
    for kind in kinds:
        where = "one direction" if kind.one_direction else "many directions"
        found = joined(f for cell, f in pairs if cell.contacts == kind)
        most = 1.25 if kind.size >= FELT_NO_MORE else None
        yield _over_without(f"{kind.size:g} sd in {where}: force RMS", found, most)
    for count in (6, 12, 24, 60):
        some = [f for cell, f in pairs if cell.poses == count and cell.contacts.size >= FELT_NO_MORE]
        yield _over_without(f"{count} poses, 8 sd and more: force RMS", joined(some), None)
    found = joined(f for _, f in pairs)
    remark = f"{found.get('confidently wrong').sum():.0f} of {found.remark}; largest {found.get('times').max():.3g} x"
    yield share_row("good, and an error over 5 x", found.get("confidently wrong"), most=0.0, remark=remark)


@dataclass(frozen=True)
class Stepped:
    """A set of poses by name, a step's size (N), and how many poses come after it; None: any number."""

    poses: str
    size: float
    after: int | None


def stepped(cell: Stepped, rng: np.random.Generator) -> dict[str, float]:
    """One recording: how far off the last bias is, the worst of its six axes."""
    rig, R, t, wrench = Setting(cell.poses, bool(rng.integers(2)), Course("step")).drawn(rng)
    place = int(rng.integers(1, len(R))) if cell.after is None else len(R) - cell.after
    change, _ = Course("step", cell.size).drawn(t, rng, place)
    calibration = cw.calibrate(cw.Samples(wrench + change, R, t), "auto")
    off = np.abs(calibration.bias - rig.bias) / calibration.std["bias"]
    good = verdict(calibration) == "good"
    return {
        "within 3 or doubtful": float(off.max() <= 3.0 or not good),
        "axes within 3": float(np.mean(off <= 3.0)),
        "good": float(good),
        "confidently wrong": float(good and off.max() > 5.0),
        "off": float(off.max()),
    }


def steps(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Each size and place over all sets of poses, and what is wrong and sure."""
    places = {"the last pose": 1, "the last but one": 2, "any pose": None}
    rows = list(product((0.3, 1.0, 3.0), places.values()))
    cells = [Stepped(name, size, after) for (size, after), name in product(rows, SETS)]
    pairs = list(zip(cells, run(pool, stepped, cells, n, (seed, 4)), strict=True))
    words = {after: word for word, after in places.items()}
    for size, after in rows:
        found = joined(f for cell, f in pairs if (cell.size, cell.after) == (size, after))
        remark = found.remark + "".join(
            f"; {name} {100.0 * found.get(name).mean():.0f} %" for name in ("good", "axes within 3")
        )
        what = f"{size:g} N before {words[after]}: bias within 3 sd, or doubtful"
        yield share_row(what, found.get("within 3 or doubtful"), least=97.0, remark=remark)
    found = joined(f for _, f in pairs)
    furthest = np.max(found.get("off")[found.get("good") > 0.0], initial=0.0)
    remark = f"{found.get('confidently wrong').sum():.0f} of {found.remark}; largest while good {furthest:.3g} sd"
    yield share_row("good, and over 5 sd", found.get("confidently wrong"), most=0.0, remark=remark)


def tables(pool: Executor, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of the estimator on recordings of poses."""
    seed, seeds = (DEVELOPMENT, "development") if quick else (BLIND, "blind")
    numbers = (2, 6, 3, 3) if quick else (200, 400, 210, 225)
    families = (
        ("drift: 6, 12 and 24 poses whose bias moves", drift),
        ("steady: the same poses, and a bias that does not", steady),
        ("contact: 6, 12, 24 and 60 poses, up to 30 % of them in contact", contacts),
        ("steps: the last bias after a step before any pose", steps),
    )
    for (title, family), n in zip(families, numbers, strict=True):
        yield f"{title}, {n} trials a cell, {seeds} seed", family(pool, n, seed)
    yield from realistic.tables(pool, quick, seed, seeds)
