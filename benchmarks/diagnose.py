"""Wrong readings of files: is the right one found, and is a right one left alone?

Measured and simulated sets are written as files that say one thing and hold another: one or two mistakes a person
makes. A reading is judged by what it makes of the file, not by its name. It is the right one where its directions of
gravity and its wrenches are the true ones, up to one fixed rotation each (another mounting); of the right class where
reflections are allowed too, and a torque up to its sign or unit: that much free air cannot tell (method, section 4b).
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from contactwrench.assess.diagnose import Diagnosis, diagnose
from contactwrench.assess.interpretations import Interpretations, as_read
from contactwrench.recording.interpretations import interpretations
from contactwrench.recording.options import Options
from tests.support.world import Array

from .mistakes import File, as_it_should_be, correct_file, correct_file_of_few_poses, measured, with_mistakes
from .table import Row

CASES = 500
OF_FEW_POSES = 2000
FIRST_JUDGED = 100_000
"""The first seed of the right files of few poses; those below are for looking at."""

CHUNK = 25
SAME = 1e-4
"""Relative: files have six decimals."""


def diagnosed(file: File, folder: Path) -> tuple[Interpretations, Diagnosis]:
    """Write the file, and diagnose it."""
    path = folder / "file.csv"
    path.write_text(file.text())
    all_of_it = interpretations(path, Options(file.stated_as))
    return all_of_it, diagnose(all_of_it)


def _fixed_turn(a: Array, b: Array) -> tuple[Array, float]:
    """The orthogonal matrix that turns rows a into rows b best, and what is left, relative."""
    U, _, Vt = np.linalg.svd(a.T @ b)
    Q = U @ Vt
    return Q, float(np.linalg.norm(a @ Q - b) / max(float(np.linalg.norm(b)), 1e-12))


def likeness(file: File, R: Array, wrench: Array) -> str:
    """Whether a reading is the `right` one, of its `class`, or `wrong`."""
    rows = file.true_rows(len(R))
    R_true, wrench_true = file.R[rows], file.wrench[rows]
    if len(R_true) != len(R):
        return "wrong"
    A, left_r = _fixed_turn(-R_true[:, 2], -R[:, 2])
    B, left_f = _fixed_turn(wrench_true[:, :3], wrench[:, :3])
    torque, torque_true = wrench[:, 3:], wrench_true[:, 3:] @ B
    factor = float(np.sum(torque * torque_true) / np.sum(torque_true**2))
    left_t = float(np.linalg.norm(torque - factor * torque_true) / np.linalg.norm(torque))
    if max(left_r, left_f, left_t) > SAME:
        return "wrong"
    proper = np.linalg.det(A) > 0.0 and np.linalg.det(B) > 0.0
    return "right" if proper and abs(factor - 1.0) < SAME else "class"


def judged(file: File, found: Interpretations, diagnosis: Diagnosis) -> str:
    """`first`; `tied` inside a class; `near`, behind a reading that the noise does not tell from it; or `missed`."""
    best = likeness(file, *as_read(found, diagnosis.best.interpretation))
    if best == "right":
        return "first"
    others = (likeness(file, *as_read(found, reading)) for reading in diagnosis.alike)
    return "missed" if "right" not in others else "tied" if best == "class" else "near"


def _corrupted(seed: int, trials: int) -> list[tuple[str, tuple[str, ...]]]:
    rng = np.random.default_rng(seed)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(trials):
            file, kinds = with_mistakes(rng)
            results.append((judged(file, *diagnosed(file, Path(folder))), kinds))
    return results


def _left_alone(seed: int, trials: int) -> list[bool]:
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        return [_untouched(correct_file(rng), Path(folder)) for _ in range(trials)]


def _few_left_alone(first: int, trials: int) -> list[bool]:
    with tempfile.TemporaryDirectory() as folder:
        return [few_left_alone(seed, Path(folder)) for seed in range(first, first + trials)]


def few_left_alone(seed: int, folder: Path) -> bool:
    """Whether the stated reading of a right file of few poses is kept."""
    return _untouched(correct_file_of_few_poses(np.random.default_rng(seed)), folder)


def _untouched(file: File, folder: Path) -> bool:
    """Whether the stated reading of a right file is kept; a base that does lean may be found to."""
    found, diagnosis = diagnosed(file, folder)
    best = diagnosis.best.interpretation
    as_given = found.stated is not None and (best.orientation, best.wrench, best.negated) == (0, 0, False)
    return diagnosis.read_rightly or as_given


def tables(pool: Executor | None, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Both tables, one after the other; without a pool in this process."""
    chunks = CASES // CHUNK // (10 if quick else 1)
    run = map if pool is None else pool.map
    seeds, sizes = range(chunks), [CHUNK] * chunks
    results = [result for chunk in run(_corrupted, seeds, sizes) for result in chunk]
    n = len(results)
    share = {how: 100.0 * sum(result == how for result, _ in results) / n for how in ("first", "tied", "near")}
    yield (
        f"Diagnosis: {n} files with one or two mistakes, measured and simulated",
        [
            Row("the right reading is first", share["first"], "%"),
            Row("or tied with the first, in its class", share["tied"], "%"),
            Row("first or tied in its class", share["first"] + share["tied"], "%", least=100.0),
            Row("listed as one that the noise does not tell from the first", share["near"], "%"),
        ],
    )
    alone = [kept for chunk in run(_left_alone, seeds, sizes) for kept in chunk]
    few = OF_FEW_POSES // CHUNK // (10 if quick else 1)
    firsts = range(FIRST_JUDGED, FIRST_JUDGED + few * CHUNK, CHUNK)
    of_few = [kept for chunk in run(_few_left_alone, firsts, [CHUNK] * few) for kept in chunk]
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        others = [_untouched(as_it_should_be(rng, *one), Path(folder)) for one in measured() for _ in range(4)]
    yield (
        "Diagnosis: files without a mistake",
        [
            Row(f"mended, of {len(alone)} simulated", float(len(alone) - sum(alone)), "files", most=0.0),
            Row(f"mended, of {len(of_few)} of few poses", float(len(of_few) - sum(of_few)), "files", most=0.0),
            Row(f"mended, of {len(others)} measured", float(len(others) - sum(others)), "files", most=0.0),
        ],
    )
