"""What is said of a calibration and by it, as often as it should: verify, diff and weigh; a bias along one direction.

The tests look at a few recordings of each; here are as many as tell a share or a std.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.assess.weigh import weigh
from tests.support.rigs import NOISE, noisy
from tests.support.world import Array, Rig, noisy_readings, random_rig, random_rotations, readings

from .errors import direction
from .table import Row
from .trials import BLIND, DEVELOPMENT, inside, run, share_row

HELD = 1.0, np.array([0.02, -0.05, 0.12])
"""kg, and where its centre of mass is, m, sensor axes."""


def judged(noise_given: bool, rng: np.random.Generator) -> dict[str, float]:
    """A tool calibrated twice: whether verify finds it another one in ten new poses, and diff in the second."""
    rig, noise = random_rig(rng), NOISE if noise_given else None
    first, second = (cw.calibrate(noisy(rig, random_rotations(16, rng), rng), "mount", noise=noise) for _ in range(2))
    return {
        "verify": float(not verify(first, noisy(rig, random_rotations(10, rng), rng)).passed),
        "diff": float(any(group.significant for group in first.diff(second).groups)),
    }


def false_alarms(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Each one in a hundred times."""
    for given, found in zip((True, False), run(pool, judged, (True, False), n, (seed, 21)), strict=True):
        for verb in ("verify", "diff"):
            what = f"noise {'known' if given else 'unknown'}: {verb} finds another tool"
            yield share_row(what, found.get(verb), most=2.0, remark=found.remark)


def weighed(poses: int, rng: np.random.Generator) -> dict[str, float]:
    """How many of its std the mass of a held object is off, and its centre of mass across gravity or in all."""
    rig = replace(random_rig(rng), weight=6.0, com=np.array([0.15, 0.2, -0.15]))
    calibration = cw.calibrate(noisy(rig, random_rotations(8, rng), rng), "mount", noise=NOISE)
    mass, com = HELD
    at = random_rotations(poses, rng)
    hung = Rig(9.80665 * mass, com, np.zeros(6), rig.R_flange_sensor, rig.down)
    held = weigh(calibration, cw.Samples(noisy_readings(rig, at, NOISE, rng) + readings(hung, at), at))
    if held.com is None or held.com_covariance is None:
        raise cw.ContactWrenchError("nothing is held")
    across: Array = np.eye(3)
    if held.unknown_along is not None:
        across = np.linalg.svd(held.unknown_along[None])[2][1:]
    off = across @ (held.com - across.T @ across @ com)
    squared = float(off @ np.linalg.solve(across @ held.com_covariance @ across.T, off)) / len(across)
    return {"mass": ((held.mass - mass) / held.mass_std) ** 2, "com": squared}


def weighings(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """Mean squares in std, for one, two and three poses: 1, as the noise is known."""
    numbers = (1, 2, 3)
    for poses, found in zip(numbers, run(pool, weighed, numbers, n, (seed, 22)), strict=True):
        for name in ("mass", "com"):
            squares = found.get(name)
            error = float(squares.std() / np.sqrt(max(len(squares), 1))) if len(squares) else None
            what = f"{poses} poses: error of the {name} in its std, squared"
            yield Row(what, float(squares.mean()), most=1.2, standard_error=error, remark=found.remark)


def along_one_direction(cell: tuple[int, bool], rng: np.random.Generator) -> dict[str, float]:
    """A bias that wanders alike on all axes, by 10 noise std in all: whether its end is in the 95 % intervals."""
    poses, cycle = cell
    rig, R = random_rig(rng), random_rotations(poses, rng)
    phase = 3.0 * np.pi * np.linspace(0.0, 1.0, poses) + rng.uniform(0.0, 2.0 * np.pi)
    course = np.sin(phase) if cycle else np.cumsum(rng.normal(size=poses)) / np.sqrt(poses)
    change = 10.0 * np.sqrt(2.0) * NOISE * np.outer(course - course[-1], direction(rng, 6))
    samples = cw.Samples(noisy_readings(rig, R, NOISE, rng) + change, R, t=10.0 * np.arange(float(poses)))
    return {"bias": inside(cw.calibrate(samples, "mount"), "bias", rig.bias)}


def wandering(pool: Executor, n: int, seed: int) -> Iterator[Row]:
    """There and back one and a half times, or as a walk."""
    cells = [(poses, cycle) for poses in (12, 24) for cycle in (True, False)]
    for (poses, cycle), found in zip(cells, run(pool, along_one_direction, cells, n, (seed, 23)), strict=True):
        what = f"{poses} poses, {'there and back' if cycle else 'a walk'}: bias covered"
        yield share_row(what, found.get("bias"), 90.0, remark=found.remark)


def tables(pool: Executor, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of judgements."""
    seed, n = (DEVELOPMENT, 20) if quick else (BLIND, 400)
    yield f"false alarms of verify and diff, {n} trials a cell", false_alarms(pool, n, seed)
    yield f"weigh: std against scatter, {n} trials a cell", weighings(pool, n, seed)
    yield f"a bias that wanders along one direction, {n} trials a cell", wandering(pool, n, seed)
