"""The work that needs a sense of touch, done by the virtual arm with each method of compensation: what one job of the
experiment's pool does. Jobs and what they give back are small, so that they go between processes.

A job is a block of trials with one method. Every trial has its own random offsets, distances and noise, the same for
every method, and a calibration of its own, learned from a recording of its own: trials are independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from contactwrench.errors import MissingExtraError
from contactwrench.estimation.calibrate import calibrate
from contactwrench.geometry.arrays import Array
from contactwrench.simulate.kinematics import HOME, paper_joints
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.rig import Rig, build
from contactwrench.simulate.settings import Settings

from . import film, guarded_move, peg, pushing
from .closed_loop import ToContact, Trace, servo_rig
from .methods import Method, paper, tare, without_bias
from .scenes import PLATE, PROBE, TOOL, hole, peg_tool

SETTINGS = Settings(tool=TOOL)

LEVEL = (np.eye(3), np.array([0.6, 0.0, 0.25]))
UPRIGHT = (np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.array([0.55, -0.1, 0.45]))
"""Two faces to work on, in base axes: the level one below where the sensor is zeroed, and the upright side of
a machine."""
FACES = {"level": LEVEL, "upright": UPRIGHT}

Strip: TypeAlias = tuple[str, str]
"""An `img`, and no word; or nothing, and the word why there is no picture."""


def joints_of_calibration() -> Array:
    """Joints (6, 7), rad, in the paper's six postures."""
    return paper_joints(build(SETTINGS))


def learned(seed: int, number: int, joints: Array) -> dict[str, Method]:
    """Every method as it came out of the recording of that number.

    The recording is of the paper's six postures, `joints` (6, 7), rad, with the tool that does the work. The tare is
    what people do: the sensor is zeroed once, with the arm at `HOME`, where the tool points straight down.
    """
    rng = np.random.default_rng([seed, 0, number])
    samples = record_poses(SETTINGS, joints, rng=rng).samples
    zeroed = tare(record_poses(SETTINGS, HOME[None], rng=rng).samples)
    calibration = calibrate(samples, "auto")
    return {
        "tare": zeroed,
        "gravity only": without_bias("gravity only", calibration),
        "paper": paper(samples),
        "ours": Method("ours", calibration.B, calibration.gravity_direction),
    }


def touch(method: Method) -> ToContact:
    """A method as a controller calls it 125 times a second, without the checks of arrays that nobody typed in."""
    gravity, bias, down = np.array(method.B[:, :3]), np.array(method.B[:, 3]), np.array(method.gravity_direction)

    def to_contact(reading: Array, R_base_flange: Array) -> Array:
        contact: Array = reading - gravity @ (R_base_flange.T @ down) - bias
        return contact

    return to_contact


@dataclass(frozen=True, eq=False)
class Job:
    """Trials `first` to `last` (that one not) with one method, as each of them learned it, on the `face` of that name.

    `joints`, rad: where each guarded move begins (n, 7), or where the arm is at that face (7,).
    """

    methods: tuple[Method, ...]
    first: int
    last: int
    seed: int
    face: str
    joints: Array

    def trials(self, task: int) -> list[tuple[int, ToContact, np.random.Generator]]:
        """Number, sense and random generator of each; `task` keeps the tasks' generators apart."""
        return [
            (number, touch(self.methods[number]), np.random.default_rng([self.seed, task, number]))
            for number in range(self.first, self.last)
        ]


def joints_of_moves(n: int, seed: int) -> Array:
    """Joints (n, 7), rad, where the guarded moves begin: the same for every method."""
    rng, found = np.random.default_rng([seed, 1]), np.empty((0, 7))
    rig = _probe_rig()
    while len(found) < n:
        found = np.concatenate([found, guarded_move.approaches(rig, 2 * n, rng)])
    return found[:n]


def joints_of_pushing(face: str) -> Array:
    """Joints (7,), rad, with the probe at a plate."""
    return pushing.joints_at(_probe_rig(), *FACES[face])


def joints_of_peg(face: str) -> Array:
    """Joints (7,), rad, with the peg over a hole."""
    return peg.joints_over(_peg_rig(), *FACES[face])


@dataclass(frozen=True)
class Stopped:
    """One guarded move, as in `GuardedMove`."""

    ended: str
    at_stop: float
    largest: float


def guarded(job: Job) -> list[Stopped]:
    """The job's guarded moves."""
    rig = _probe_rig()
    moves = [
        guarded_move.guarded_move(rig, job.joints[number], sense, rng) for number, sense, rng in job.trials(task=2)
    ]
    return [Stopped(move.ended, move.at_stop, move.largest) for move in moves]


@dataclass(frozen=True, eq=False)
class Pushed:
    """One pushing, as in `Pushing`: its error, N, and the true normal force every `EVERY` rows; `saturated` as in
    `Trace`.
    """

    error: float
    ended_early: bool
    normal_force: Array
    saturated: float


EVERY = 20


def pushed(job: Job) -> list[Pushed]:
    """The job's pushing."""
    rig = _probe_rig()
    R, spot = FACES[job.face]
    runs = [pushing.push(rig, R, spot, job.joints, sense, rng) for _, sense, rng in job.trials(task=3)]
    return [Pushed(run.error, run.ended_early, run.normal_force[::EVERY].copy(), run.trace.saturated) for run in runs]


@dataclass(frozen=True)
class Inserted:
    """One peg, as in `Insertion`; `saturated` as in `Trace`."""

    ended: Literal["in", "time", "lost", "stop"]
    largest_force: float
    seconds: float
    saturated: float

    @property
    def inserted(self) -> bool:
        """Whether the peg is in."""
        return self.ended == "in"


def inserted(job: Job) -> list[Inserted]:
    """The job's pegs."""
    rig = _peg_rig()
    R, mouth = FACES[job.face]
    tries = [peg.insert(rig, R, mouth, job.joints, sense, rng) for _, sense, rng in job.trials(task=4)]
    return [Inserted(one.ended, one.largest_force, one.seconds, one.trace.saturated) for one in tries]


def guarded_pictures(job: Job) -> Strip:
    """The end of each move of the job."""
    rig = _probe_rig()
    R_world_base = rig.settings.R_world_base
    films = []
    for number, sense, rng in job.trials(task=2):
        trace = guarded_move.guarded_move(rig, job.joints[number], sense, rng).trace
        approach = R_world_base @ guarded_move.tool_axis(rig, job.joints[number])
        films.append((trace, trace.t[-1:], film.whole_arm(trace.work_position, approach)))
    return _strip(rig, films)


def pushing_pictures(job: Job) -> Strip:
    """The job's first run, square to the plate and leaning."""
    rig = _probe_rig()
    R, spot = FACES[job.face]
    _, sense, rng = job.trials(task=3)[0]
    trace = pushing.push(rig, R, spot, job.joints, sense, rng).trace
    moments = pushing.SETTLED + pushing.ROUND * np.array([0.0, 0.11, 0.39, 0.61])
    x, y, z = (float(value) for value in spot)
    return _strip(rig, [(trace, moments, film.View((x - 0.1, y, z + 0.2), 1.0, 125.0, -12.0))])


def peg_pictures(job: Job) -> Strip:
    """The job's first peg: the whole arm, and on its way in."""
    rig = _peg_rig()
    R, mouth = FACES[job.face]
    _, sense, rng = job.trials(task=4)[0]
    trace = peg.insert(rig, R, mouth, job.joints, sense, rng).trace
    end, into = trace.t[-1], -R[:, 2]
    x, y, z = (float(value) for value in mouth)
    near = film.View((x, y + 0.03, z), 0.36, 215.0, -25.0)
    return _strip(
        rig, [(trace, trace.t[-1:], film.whole_arm(mouth, into)), (trace, end * np.array([0.0, 0.5, 1.0]), near)]
    )


def _strip(rig: Rig, films: list[tuple[Trace, Array, film.View]]) -> Strip:
    try:
        return film.filmstrip([picture for one in films for picture in film.frames(rig, *one)]), ""
    except (film.NoPicturesError, MissingExtraError) as error:
        return "", str(error)


def _probe_rig() -> Rig:
    return servo_rig(SETTINGS, PROBE, PLATE)


def _peg_rig() -> Rig:
    return servo_rig(SETTINGS, peg_tool(), hole())
