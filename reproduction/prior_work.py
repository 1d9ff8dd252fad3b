"""Section 6: prior work, each by its published idea in a few lines, beside the paper's estimator and ours.

- Bias from opposite poses (Lin, South China University of Technology, 2013; Cai, Jilin University, 2015; as the paper's
  introduction describes them): in two orientations with gravity reversed the readings add up to twice the bias, and
  half their difference is gravity alone. It needs such pairs, and the sensor's axes are taken for aligned as stated.
- Bias, mass and centre of mass by linear least squares with the sensor's orientation known (Vougioukas, WSEAS
  symposium, Athens 2001, as the paper's introduction has it). The usual ROS tool, force_torque_sensor_calib of
  kth-ros-pkg/force_torque_tools, stacks the same ten unknowns, solves them by SVD with forces and torques weighed
  alike, and takes the sensor's mounting from the robot's description; its gravity comes from an accelerometer, here it
  is that of a level base.
- A base assumed upright, with any mounting: our own model `mount`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from itertools import product
from typing import TypeAlias

import numpy as np

from contactwrench.errors import ContactWrenchError, UnobservableError
from contactwrench.geometry.arrays import Array, read_only
from contactwrench.geometry.rotations import rotations_about_z
from contactwrench.geometry.wrench import cross_matrix
from contactwrench.samples.samples import Samples
from contactwrench.simulate.kinematics import joints_through
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Base, Settings

from .charts import dots_by_group
from .methods import DOWN, METHODS, Learn, Method, calibrated
from .part import Measured, Part, Picture, Table
from .planned import planned_joints
from .trials import (
    DEFAULT,
    Free,
    Squared,
    free_readings,
    in_batches,
    joints_of_paper,
    left_by,
    number_of_trials,
    recordings,
    rms_force,
    unseen_joints,
)

TRIALS = 8
TRUE_YAW = DEFAULT.mounting.yaw_deg
BASE_TILT = 2.0
"""deg, about the base's x."""

STATED = {"yaw exact": 0.0, "yaw 2 deg off": 2.0, "yaw 34 deg off": -TRUE_YAW}
"""What the robot's description says of the sensor's yaw, deg off the truth; the last takes the axes for aligned."""

POSES_OF_PAPER = "paper's six"

OPPOSITE = np.deg2rad(179.0)
"""Between the directions of gravity of two poses that count as opposite."""


def opposite_poses(yaw_deg: float) -> Learn:
    """Lin and Cai: the bias from pairs of readings with gravity reversed, the tool from their differences; the sensor
    is taken to sit at `yaw_deg` on the flange. Raises `UnobservableError` without pairs along three axes.
    """
    R_sensor_flange = rotations_about_z(np.deg2rad([yaw_deg]))[0].T

    def learn(samples: Samples) -> Method:
        r = samples.R_base_flange.transpose(0, 2, 1) @ DOWN
        pairs = np.argwhere(np.triu(r @ r.T < np.cos(OPPOSITE)))
        if not len(pairs) or np.linalg.matrix_rank(r[pairs[:, 0]], tol=0.1) < 3:
            raise UnobservableError(
                f"found {len(pairs)} pairs of opposite poses, expected three along different axes: record each pose "
                "again with gravity reversed"
            )
        first, second = (samples.wrench[pairs[:, side]] for side in (0, 1))
        bias = 0.5 * (first + second).mean(axis=0)
        gravity, u = 0.5 * (first - second), r[pairs[:, 0]] @ R_sensor_flange.T
        weight = float(np.sum(gravity[:, :3] * u) / np.sum(u**2))
        moment: Array = np.linalg.lstsq(np.concatenate([-cross_matrix(one) for one in u]), gravity[:, 3:].ravel())[0]
        return _rigid("opposite poses", weight, moment, bias, R_sensor_flange)

    return learn


def known_mounting(yaw_deg: float) -> Learn:
    """Vougioukas, and the usual ROS tool: ten unknowns by linear least squares, the sensor at `yaw_deg` on the flange.

    Raises `UnobservableError` where the poses leave one of them open.
    """
    R_sensor_flange = rotations_about_z(np.deg2rad([yaw_deg]))[0].T

    def learn(samples: Samples) -> Method:
        u = samples.R_base_flange.transpose(0, 2, 1) @ DOWN @ R_sensor_flange.T
        A = np.zeros((len(u), 6, 10))
        A[:, :3, 0], A[:, 3:, 1:4], A[:, :, 4:] = u, -cross_matrix(u), np.eye(6)
        found, _, rank, _ = np.linalg.lstsq(A.reshape(-1, 10), samples.wrench.ravel())
        solution: Array = np.asarray(found, dtype=np.float64)
        if rank < 10:
            raise UnobservableError(
                f"found poses that separate {rank} of 10 unknowns, expected all: tilt the tool about two axes"
            )
        return _rigid("known mounting", float(solution[0]), solution[1:4], solution[4:], R_sensor_flange)

    return learn


def _rigid(name: str, weight: float, moment: Array, bias: Array, R_sensor_flange: Array) -> Method:
    """The method of a tool of `weight` N and first `moment` (3,), N m (weight times centre of mass), sensor axes."""
    linear = np.concatenate([weight * np.eye(3), cross_matrix(moment)]) @ R_sensor_flange
    return Method(name, np.column_stack([linear, bias]), DOWN)


ESTIMATORS: dict[str, Learn] = {
    **{f"opposite poses, {stated}": opposite_poses(TRUE_YAW + off) for stated, off in STATED.items()},
    **{f"known mounting, {stated}": known_mounting(TRUE_YAW + off) for stated, off in STATED.items()},
    "upright base (mount)": calibrated("mount", "upright base"),
    "paper": METHODS["paper"],
    "ours": METHODS["ours"],
}
RIGS = {
    "level base": DEFAULT,
    f"base tilted {BASE_TILT:g} deg": replace(DEFAULT, base=Base(tilt_deg=(BASE_TILT, 0.0))),
}

Trials: TypeAlias = list[dict[str, Squared | str]]
"""By estimator what it leaves, or in its own words why it refused."""


def opposite_joints() -> Array:
    """Joints (6, 7), rad, with gravity along x and -x, y and -y, z and -z of the flange, as the idea needs them."""
    R_base_flange = np.array(
        [
            [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]],
            [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
            [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
            [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        ]
    )
    return read_only(joints_through(build(DEFAULT), R_base_flange))


def part(pool: Executor, scale: float, seed: int) -> Part:
    """Each idea on the poses that it needs and on others, with its assumptions kept and broken."""
    n = number_of_trials(TRIALS, scale)
    unseen = unseen_joints()
    poses = {"opposite poses": opposite_joints(), "six planned": planned_joints(6), POSES_OF_PAPER: joints_of_paper()}
    found: dict[tuple[str, str], Trials] = {
        (rig, name): in_batches(pool, partial(_run, RIGS[rig], joints, unseen, seed), n)
        for rig in RIGS
        for name, joints in poses.items()
    }
    return Part(
        key="prior_work",
        title="Prior work",
        paragraphs=_said(found),
        tables=tuple(_table(rig, tuple(poses), found, n) for rig in RIGS),
        pictures=(_picture(tuple(poses), found, n),),
    )


def _run(settings: Settings, poses: Array, unseen: Array, seed: int, numbers: range) -> Trials:
    """The trials of those numbers, on joints (6, 7) and judged at joints (m, 7), rad."""
    free = free_readings(settings, unseen)
    rngs = [np.random.default_rng((seed, 6, number)) for number in numbers]
    trials = []
    for samples in recordings(settings, poses, rngs):
        trials.append({name: _left(learn, samples, free) for name, learn in ESTIMATORS.items()})
    return trials


def _left(learn: Learn, samples: Samples, free: Free) -> Squared | str:
    try:
        return left_by(learn(samples), free)
    except ContactWrenchError as error:
        return str(error)


def _force(trials: Trials, name: str) -> Measured | str:
    return rms_force([one for trial in trials if isinstance(one := trial[name], Squared)])


def _refusals(poses: Sequence[str], found: dict[tuple[str, str], Trials], rig: str) -> str:
    """Who refused what, how often, and the error's own words."""
    who: dict[str, dict[str, list[str]]] = {}
    for name, where in product(ESTIMATORS, poses):
        whys = Counter(one for trial in found[rig, where] if isinstance(one := trial[name], str))
        for why, count in whys.items():
            who.setdefault(why, {}).setdefault(name, []).append(f"{where} {count} of {len(found[rig, where])}")
    said = [
        f"“{why}”: " + "; ".join(f"{name} ({', '.join(places)})" for name, places in of.items())
        for why, of in who.items()
    ]
    return f"Refused, {'. '.join(said)}." if said else "No data set was refused."


def _table(rig: str, poses: Sequence[str], found: dict[tuple[str, str], Trials], n: int) -> Table:
    return Table(
        key=rig.replace(" ", "_"),
        title=f"Force left at orientations that were not recorded, N: {rig}",
        columns=tuple(poses),
        rows=tuple((name, tuple(_force(found[rig, where], name) for where in poses)) for name in ESTIMATORS),
        note=f"Root mean square over {n} data sets a cell and {len(unseen_joints())} random orientations, without the "
        f"refused ones. {_refusals(poses, found, rig)}",
    )


def _picture(poses: Sequence[str], found: dict[tuple[str, str], Trials], n: int) -> Picture:
    level = next(iter(RIGS))
    groups = {
        name: {where: None if isinstance(force := _force(found[level, where], name), str) else force for where in poses}
        for name in ESTIMATORS
    }
    return Picture(
        name="experiment_prior_work",
        html=dots_by_group(groups, "force error at orientations that were not recorded, N"),
        caption=f"Prior work on a level base, by the poses it was calibrated on: RMS over {n} data sets, bars of one "
        "standard error.",
    )


def _said(found: dict[tuple[str, str], Trials]) -> tuple[str, ...]:
    level, tilted = RIGS

    def of(rig: str, poses: str, name: str) -> str:
        cell = _force(found[rig, poses], name)
        return cell if isinstance(cell, str) else f"{cell.value:.3g}"

    return (
        f"Bias from opposite poses leaves {of(level, 'opposite poses', 'opposite poses, yaw exact')} N on the poses "
        "that it needs with the sensor's yaw known exactly, "
        f"{of(level, 'opposite poses', 'opposite poses, yaw 2 deg off')} N with a yaw that is 2 deg off, "
        f"{of(level, 'opposite poses', 'opposite poses, yaw 34 deg off')} N with the axes taken for "
        f"aligned; ours, which is told no yaw, {of(level, 'opposite poses', 'ours')} N on the same readings.",
        f"Least squares with the mounting known leaves {of(level, 'six planned', 'known mounting, yaw exact')} N on "
        f"six planned poses with the yaw exact, {of(level, 'six planned', 'known mounting, yaw 2 deg off')} N with one "
        f"2 deg off, {of(level, 'six planned', 'known mounting, yaw 34 deg off')} N with the axes taken for aligned; "
        f"ours {of(level, 'six planned', 'ours')} N, the paper's {of(level, 'six planned', 'paper')} N. On the paper's "
        f"poses: {of(level, POSES_OF_PAPER, 'known mounting, yaw exact')} N with the yaw exact, "
        f"ours {of(level, POSES_OF_PAPER, 'ours')} N, the paper's {of(level, POSES_OF_PAPER, 'paper')} N.",
        f"With the base tilted by {BASE_TILT:g} deg, on six planned poses: any mounting but an upright base "
        f"{of(tilted, 'six planned', 'upright base (mount)')} N, known mounting "
        f"{of(tilted, 'six planned', 'known mounting, yaw exact')} N, the paper's "
        f"{of(tilted, 'six planned', 'paper')} N, ours {of(tilted, 'six planned', 'ours')} N.",
    )
