"""Accuracy by Monte Carlo on readings from world.py.

Errors against the Cramer-Rao bound, intervals against their level, random mountings against the stated standard
deviations. But for the mountings the truth is the paper's Table V, the noise 0.05 % of the M8125's ranges.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import ndtri, stdtr

import contactwrench as cw
from tests.support.poses import POSE_SETS
from tests.support.world import (
    DOWN,
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

from .table import Row

TABLE_V = Rig(
    weight=1.980,
    com=np.array([-0.006, 0.006, 0.032]),
    bias=np.array([3.769, -6.903, 57.657, 2.228, 0.963, 0.017]),
    R_flange_sensor=Rotation.from_euler("z", 33.918, degrees=True).as_matrix(),
    down=DOWN,
)
NOISE = 0.0005 * np.array([70.0, 70.0, 70.0, 3.0, 1.0, 1.0])
UNSEEN = random_rotations(100, np.random.default_rng(7))

MODELS = ("yaw", "mount", "mount+base")
TRIALS = 4000
TRIALS_OF_TABLE = 2000
MOUNTINGS = 1000
CHUNK = 250

NAMES = ("weight", "com_x", "com_y", "com_z", "bias_fx", "bias_fy", "bias_fz", "bias_tx", "bias_ty", "bias_tz")


@dataclass(frozen=True)
class Case:
    """What a Monte Carlo run fits: a model, a set of poses by name, and whether the noise is given (up to a scale)."""

    model: str
    poses: str
    noise_given: bool


@dataclass(frozen=True, eq=False)
class Trials:
    """Per trial: the mean squared error of the predicted force and torque (n, 2), N and N m, at the unseen
    orientations; whether the 95 % intervals of weight, com and bias hold the truth (n, 10); how many were refused.
    """

    squared: Array
    inside: Array
    refused: int

    @property
    def rms(self) -> Array:
        """RMS over the trials, force and torque (2,)."""
        rms: Array = np.sqrt(self.squared.mean(axis=0))
        return rms


def run(case: Case, seed: tuple[int, ...], n: int) -> Trials:
    """`n` trials of a case."""
    rng = np.random.default_rng(seed)
    R = POSE_SETS[case.poses]
    truth, free = np.r_[TABLE_V.weight, TABLE_V.com, TABLE_V.bias], readings(TABLE_V, UNSEEN)
    squared, inside, refused = [], [], 0
    for _ in range(n):
        wrench = noisy_readings(TABLE_V, R, NOISE, rng)
        try:
            predicted, low, high = _estimate(case, wrench, R)
        except cw.ContactWrenchError:
            refused += 1
            continue
        errors = predicted - free
        squared.append([np.sum(part**2, axis=1).mean() for part in (errors[:, :3], errors[:, 3:])])
        inside.append((low <= truth) & (truth <= high))
    return Trials(np.array(squared).reshape(-1, 2), np.array(inside, dtype=float).reshape(-1, 10), refused)


def _estimate(case: Case, wrench: Array, R: Array) -> tuple[Array, Array, Array]:
    """The predicted free wrench at the unseen orientations, and the ends (10,) of the 95 % intervals."""
    nothing = np.full(10, np.nan)
    if case.model == "tare in one pose":
        return np.broadcast_to(wrench[0], (len(UNSEEN), 6)), nothing, nothing
    model = "yaw" if case.model == "gravity only" else case.model
    calibration = cw.calibrate(cw.Samples(wrench, R), model, noise=NOISE if case.noise_given else None)
    predicted = calibration.predict(UNSEEN)
    if case.model == "gravity only":
        return predicted - calibration.bias, nothing, nothing
    if case.model == "affine":
        return predicted, nothing, nothing
    low, high = zip(*(calibration.interval(name) for name in ("weight", "com", "bias")), strict=True)
    return predicted, np.r_[low], np.r_[high]


def monte_carlo(pool: Executor, cases: list[Case], trials: int, seed: int) -> dict[Case, Trials]:
    """Every case, `trials` times, its chunks spread over the pool; seeds of (seed, case, chunk)."""
    chunks = [min(CHUNK, trials - start) for start in range(0, trials, CHUNK)]
    jobs = {
        case: [pool.submit(run, case, (seed, number, chunk), n) for chunk, n in enumerate(chunks)]
        for number, case in enumerate(cases)
    }
    done = {case: [job.result() for job in parts] for case, parts in jobs.items()}
    return {
        case: Trials(
            np.concatenate([part.squared for part in parts]),
            np.concatenate([part.inside for part in parts]),
            sum(part.refused for part in parts),
        )
        for case, parts in done.items()
    }


def against_the_bound(results: dict[Case, Trials]) -> Iterator[Row]:
    """RMS of the contact wrench over the Cramer-Rao bound."""
    for case, trials in results.items():
        bound = bound_on_prediction(TABLE_V, case.model, POSE_SETS[case.poses], NOISE, UNSEEN)
        most = None if case.poses == "6 spread" and not case.noise_given else 1.03
        for what, unit, rms, least in zip(("force", "torque"), ("N", "N m"), trials.rms, bound, strict=True):
            remark = f"{rms:.3g} {unit}, bound {least:.3g}{_refusals(trials)}"
            yield Row(f"{case.model}: RMS of the {what}", rms / least, "x bound", most=most, remark=remark)


def _refusals(trials: Trials) -> str:
    return f", {trials.refused} refused" if trials.refused else ""


def coverage(results: dict[Case, Trials]) -> Iterator[Row]:
    """How often the 95 % intervals hold the truth: the worst and the best parameter, and the mean."""
    for case, trials in results.items():
        each = 100.0 * trials.inside.mean(axis=0)
        if case.noise_given:
            least, most = 93.5, 96.5
        else:
            least, most = 93.0, (97.0 if case.poses == "24 random" else 100.0)
        for what, k in (("lowest", int(np.argmin(each))), ("highest", int(np.argmax(each)))):
            yield Row(f"{case.model}: {what} coverage", each[k], "%", least, most, NAMES[k])
        yield Row(f"{case.model}: mean coverage", each.mean(), "%")


def side_by_side(pool: Executor, trials: int) -> Iterator[Row]:
    """RMS contact-force error of every estimator and of what people do without one."""
    estimators = ("gravity only", "tare in one pose", "paper", *MODELS, "affine")
    sets = ("paper's 6", "6 spread")
    cases = [Case(model, poses, True) for poses in sets for model in estimators]
    for case, result in monte_carlo(pool, cases, trials, 9).items():
        force, torque = result.rms
        remark = f"torque {1e3 * torque:.3g} mN m{_refusals(result)}"
        if case.model in MODELS:
            bound = bound_on_prediction(TABLE_V, case.model, POSE_SETS[case.poses], NOISE, UNSEEN)
            remark += f", force bound {bound[0]:.3g} N"
        yield Row(f"{case.poses}: {case.model}", force, "N", remark=remark)


MOUNTING_NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])


def mountings(model: str, noise_given: bool, seed: tuple[int, ...], n: int) -> tuple[Array, Array, int]:
    """For random tools, mountings (and bases within 80 deg of down) at 12 random poses: errors of every parameter in
    stated standard deviations (n, p), the degrees of freedom behind those (n,), and the number of refusals.
    """
    rng = np.random.default_rng(seed)
    found, dof, refused = [], [], 0
    for _ in range(n):
        rig = random_rig(rng)
        if model == "mount+base":
            rig = with_down(rig, tilted_down(rng.uniform(0.0, np.deg2rad(80.0)), rng))
        R = random_rotations(12, rng)
        samples = cw.Samples(noisy_readings(rig, R, MOUNTING_NOISE, rng), R)
        try:
            calibration = cw.calibrate(samples, model, noise=MOUNTING_NOISE if noise_given else None)
        except cw.ContactWrenchError:
            refused += 1
            continue
        found.append(_in_stds(calibration, rig))
        dof.append(calibration.dof)
    return np.array(found), np.array(dof), refused


def _in_stds(calibration: cw.Calibration, rig: Rig) -> Array:
    std = calibration.std
    errors = [
        (np.atleast_1d(getattr(calibration, name) - getattr(rig, name)) / std[name])
        for name in ("weight", "com", "bias")
    ]
    turn = Rotation.from_matrix(calibration.R_flange_sensor.T @ rig.R_flange_sensor)  # type: ignore[union-attr]
    errors.append(turn.as_rotvec() / std["mount"])
    if std["gravity"] is not None:
        errors.append(np.atleast_1d(np.linalg.norm(calibration.gravity_direction - rig.down) / std["gravity"].max()))
    stds: Array = np.concatenate(errors)
    return stds


def random_mountings(pool: Executor, n: int) -> Iterator[Row]:
    """The largest error over all mountings and parameters, in standard deviations."""
    kinds = [(model, given) for model in ("mount", "mount+base") for given in (True, False)]
    per_job = max(n // 8, 1)
    jobs = [
        [pool.submit(mountings, model, given, (number, job), per_job) for job in range(n // per_job)]
        for number, (model, given) in enumerate(kinds)
    ]
    for (model, given), parts in zip(kinds, jobs, strict=True):
        results = [part.result() for part in parts]
        worst = np.concatenate([np.abs(errors).max(axis=1) for errors, _, _ in results])
        dof = np.concatenate([of_trial for _, of_trial, _ in results])
        refused = sum(of_job for _, _, of_job in results)
        as_normal = float(np.max(-ndtri(stdtr(dof, -worst))))
        remark = (
            f"{int(np.sum(worst > 5.0))} of {len(worst)} beyond 5, {refused} refused; by Student's t as improbable as "
            f"{as_normal:.3g} of a normal"
        )
        yield Row(f"{model}, noise {'given' if given else 'unknown'}", worst.max(), "std", most=5.0, remark=remark)


def tables(pool: Executor, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every accuracy table, one after the other."""
    less = 10 if quick else 1
    yield "Random mountings: largest error over all parameters", random_mountings(pool, MOUNTINGS // less)
    groups = [(poses, given) for poses in ("6 spread", "24 random") for given in (True, False)]
    for seed, (poses, given) in enumerate(groups):
        results = monte_carlo(pool, [Case(model, poses, given) for model in MODELS], TRIALS // less, seed)
        known = "known up to one scale" if given else "unknown per axis"
        title = f"{poses} poses, noise {known}, {TRIALS // less} trials: RMS over the Cramer-Rao bound; 95 % intervals"
        yield title, [*against_the_bound(results), *coverage(results)]
    yield "RMS error of the contact force, every estimator", side_by_side(pool, TRIALS_OF_TABLE // less)
