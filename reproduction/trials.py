"""Trials on the rig: each is one recording, every method learned from it, and what they leave where none was made.

The truth is the rig's own physics. A user moves the tool to any orientation, so the figure of merit is the contact
wrench that a method reports of a free tool at orientations spread at random over all rotations, without the noise of
the reading itself: that noise is the sensor's, whatever the method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from contactwrench.errors import ContactWrenchError
from contactwrench.geometry.arrays import Array, read_only
from contactwrench.samples.samples import Samples
from contactwrench.simulate.kinematics import joints_through, paper_joints
from contactwrench.simulate.recording import read_poses, true_poses
from contactwrench.simulate.rig import build, inverse_dynamics
from contactwrench.simulate.settings import Recording, Settings

from .methods import Learn, Method
from .part import Measured, mean, root_mean_square

Result = TypeVar("Result")

BRISK = Recording(settle=0.05)
"""Where nothing drifts, the time from pose to pose is not seen; the sensor's filter settles within this one."""

DEFAULT = Settings(recording=BRISK)
"""The paper's rig: Tables I, II and V."""

UNSEEN = 200
UNSEEN_SEED = 7
FEWEST = 2
A_BATCH = 4
"""Trials that a worker does at a time: few enough to keep all of them busy to the end."""


@dataclass(frozen=True, eq=False)
class Free:
    """What the sensor shows of a free tool, without noise: `wrench` (m, 6) at `R_base_flange` (m, 3, 3)."""

    R_base_flange: Array
    wrench: Array

    def __post_init__(self) -> None:
        for name in ("R_base_flange", "wrench"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True)
class Squared:
    """Mean over the unseen orientations of the squared norm of force (N^2) and torque ((N m)^2) left by a method."""

    force: float
    torque: float


@cache
def joints_of_paper() -> Array:
    """Joints (6, 7), rad, in the paper's six poses."""
    return read_only(paper_joints(build(DEFAULT)))


@cache
def unseen_joints() -> Array:
    """Joints (m, 7), rad, that bring the flange to orientations spread at random over all rotations."""
    from scipy.spatial.transform import Rotation

    anywhere = Rotation.random(UNSEEN, random_state=UNSEEN_SEED).as_matrix()
    return read_only(joints_through(build(DEFAULT), anywhere))


def free_readings(settings: Settings, joints: Array, t: float = 0.0) -> Free:
    """What the sensor shows of a free tool at joints (m, 7), rad, `t` seconds after it was switched on, but for noise
    and random drift.
    """
    physics, sensor = inverse_dynamics(build(settings), joints), settings.sensor
    mixing = np.diag(sensor.gain) + np.array(sensor.crosstalk)
    warm = np.exp(-t / sensor.drift.warm_up_time) * np.array(sensor.drift.warm_up)
    return Free(physics.R_base_flange, physics.wrench @ mixing.T + np.array(sensor.bias) + warm)


def recordings(settings: Settings, joints: Array, rngs: Iterable[np.random.Generator]) -> Iterator[Samples]:
    """Contact-free recordings of an arm at rest in joints (n, 7), rad, one for each generator."""
    truth = true_poses(settings, joints, 0.0, np.zeros_like(joints))
    for rng in rngs:
        yield read_poses(settings, [truth], (0.0,), rng).samples


def learned(learn: Learn, samples: Samples) -> Method | None:
    """The method, or None where it refuses the recording."""
    try:
        return learn(samples)
    except ContactWrenchError:
        return None


def left_by(method: Method, free: Free) -> Squared:
    """What a method leaves of a free tool."""
    contact = method.contact(free.wrench, free.R_base_flange)
    force, torque = (float(np.sum(part**2, axis=1).mean()) for part in (contact[:, :3], contact[:, 3:]))
    return Squared(force, torque)


def number_of_trials(full: int, scale: float) -> int:
    """How many trials a part makes at a scale, of `full` at 1."""
    return max(FEWEST, round(full * scale))


def in_batches(pool: Executor, run: Callable[[range], Sequence[Result]], trials: int) -> list[Result]:
    """The results of all trials, in order; `run` does a batch of them, by their numbers, in the pool."""
    batches = [range(start, min(start + A_BATCH, trials)) for start in range(0, trials, A_BATCH)]
    return [result for results in pool.map(run, batches) for result in results]


def rms_force(results: Iterable[Squared | None]) -> Measured | str:
    """Root mean square of the force, N, over the trials that were not refused."""
    return _rms([result.force for result in results if result is not None])


def rms_torque(results: Iterable[Squared | None]) -> Measured | str:
    """Root mean square of the torque, N m, over the trials that were not refused."""
    return _rms([result.torque for result in results if result is not None])


def _rms(squares: list[float]) -> Measured | str:
    return root_mean_square(squares) if squares else "refused"


def times(measured: Measured | str, factor: float) -> Measured | str:
    """The figure in another unit."""
    if isinstance(measured, str):
        return measured
    error = measured.standard_error
    return replace(
        measured, value=factor * measured.value, standard_error=None if error is None else abs(factor) * error
    )


def ratio_of_rms(above: ArrayLike, below: ArrayLike) -> Measured:
    """The ratio of two root mean squares, each of one square a trial (n,), trial by trial the same dice; its standard
    error by propagation, in which what both have in common cancels.
    """
    a, b = (np.asarray(squares, dtype=np.float64) for squares in (above, below))
    ratio = float(np.sqrt(a.mean() / b.mean()))
    relative = mean(a / a.mean() - b / b.mean()).standard_error
    return Measured(ratio, None if relative is None else 0.5 * ratio * relative, len(a))


def force_ratio(trials: Iterable[Mapping[str, Squared]], above: str, below: str) -> Measured | None:
    """How many times the RMS force of one method that of another is, over the trials that neither refused; None without
    any.
    """
    both = [(trial[above].force, trial[below].force) for trial in trials if above in trial and below in trial]
    return ratio_of_rms(*zip(*both, strict=True)) if both else None


def scatter(values: ArrayLike) -> Measured:
    """The standard deviation of estimates (n,) from trial to trial, and its standard error if they are normal."""
    array = np.asarray(values, dtype=np.float64)
    n = len(array)
    if n < 2:
        return Measured(0.0, None, n)
    std = float(array.std(ddof=1))
    return Measured(std, std / np.sqrt(2.0 * (n - 1)), n)


def student(dof: int, outside: float) -> float:
    """Standard deviations to both sides of the mean outside of which a share of Student's t distribution lies."""
    from scipy.special import stdtrit

    return float(stdtrit(dof, 1.0 - 0.5 * outside))


def in_words(measured: Measured | None) -> str:
    """The figure +- its standard error, as prose has it."""
    if measured is None:
        return "(refused)"
    if measured.standard_error is None:
        return f"{measured.value:.2g}"
    return " +- ".join(_digits(measured.value, measured.standard_error))


def _digits(value: float, error: float) -> tuple[str, str]:
    """With one digit of the error, or two where the first is a 1."""
    if not error > 0.0:
        return f"{value:.3g}", "0"
    place = int(np.floor(np.log10(error)))
    digits = max(0, -place + (error < 2.0 * 10.0**place))
    return f"{value:.{digits}f}", f"{error:.{digits}f}"
