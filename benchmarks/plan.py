"""Planned poses, judged by readings from world.py: against random sets, after the paper's six poses, and the clock."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.resources import files

import numpy as np

import contactwrench as cw
from contactwrench.assess.plan import Expected, Plan, expected_tool, plan, recorded_orientations
from contactwrench.assess.robot_arms import ARMS, reach
from tests.support.world import DOWN, Array, Rig, derivatives, random_rotations

from .accuracy import NOISE, TABLE_V
from .table import Row

MODELS = ("yaw", "mount", "mount+base", "auto")
LEVER = 0.05
"""m: the lever at which the planner weighs a torque against a force."""

PRIOR_OF_AUTO = {10: 1.41, 11: 1.41, 13: 0.71, 14: 0.71}
"""Parameters of `mount+base` by their place: std in deg of the mounting's tilt about x and y, and of gravity's."""

A_KILOGRAM = Rig(10.0, np.array([0.01, -0.02, 0.06]), np.array([3.0, -5.0, 12.0, 0.2, -0.1, 0.05]), np.eye(3), DOWN)
DECENT = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
SETS = 10_000
UNSEEN = random_rotations(3000, np.random.default_rng(17))
PAPER = str(files("contactwrench") / "data" / "paper_six_poses.csv")


def mean_variances(rig: Rig, model: str, sets: Array, noise: Array) -> Array:
    """The least mean variance (k, 2) of contact force and torque over unseen orientations, N^2 and (N m)^2, after each
    of k sets of poses (k, n, 3, 3).
    """
    full = "mount+base" if model == "auto" else model
    J = derivatives(rig, full, sets.reshape(-1, 3, 3)) / noise[:, None]
    J = J.reshape(len(sets), -1, J.shape[2])
    information = J.transpose(0, 2, 1) @ J
    if model == "auto":
        for k, degrees in PRIOR_OF_AUTO.items():
            information[:, k, k] += np.deg2rad(degrees) ** -2
    covariance = np.linalg.inv(information)
    unseen = derivatives(rig, full, UNSEEN)
    force, torque = (
        np.einsum("nip,niq->pq", part, part, optimize=True) / len(UNSEEN) for part in (unseen[:, :3], unseen[:, 3:])
    )
    return np.stack([np.sum(covariance * M, axis=(1, 2)) for M in (force, torque)], axis=1)


def weighed(variances: Array) -> Array:
    """What the planner makes least: the variance of the force, and of the torque at its lever."""
    total: Array = variances[:, 0] + variances[:, 1] / LEVER**2
    return total


def against_random_sets(sets: int) -> Iterator[Row]:
    """The planner's criterion, a variance, over that of the best of many random sets of six poses."""
    random = random_rotations(6 * sets, np.random.default_rng(18)).reshape(sets, 6, 3, 3)
    for name, rig, noise in (("Table V", TABLE_V, NOISE), ("10 N", A_KILOGRAM, DECENT)):
        for model in MODELS:
            best = weighed(mean_variances(rig, model, random, noise)).min()
            planned = weighed(mean_variances(rig, model, plan(6, model=model).R_base_flange[None], noise))[0]
            yield Row(f"{name}, {model}", planned / best, "x best", most=1.05)


def within_reach(sets: int) -> Iterator[Row]:
    """The same for what the wrists of arms reach from where they stand, against random sets that no joint limits."""
    random = random_rotations(6 * sets, np.random.default_rng(19)).reshape(sets, 6, 3, 3)
    best = weighed(mean_variances(A_KILOGRAM, "auto", random, DECENT)).min()
    for name in ("iiwa7", "ur5e", "panda", "fr3"):
        planned = plan(6, reach=reach(ARMS[name])).R_base_flange
        value = weighed(mean_variances(A_KILOGRAM, "auto", planned[None], DECENT))[0] / best
        yield Row(f"{name}, auto", value, "x best", most=1.05)


def after_the_paper() -> Iterator[Row]:
    """How many times two added poses cut the bound of the contact force's RMS; the truth is Table V, which the planner
    does not know.
    """
    samples = cw.read(PAPER)
    paper = recorded_orientations(samples)
    for model, least in (("yaw", 2.5), ("auto", 2.5), ("mount", 4.0), ("mount+base", None)):
        added = _after(samples, expected_tool(samples, model), model).R_base_flange
        before, after = (
            np.sqrt(mean_variances(TABLE_V, model, poses[None], NOISE)[0, 0])
            for poses in (paper, np.concatenate([paper, added]))
        )
        yield Row(model, before / after, "times", least=least, remark=f"{before:.3g} N to {after:.3g} N")


def _after(samples: cw.Samples, expected: Expected, model: str) -> Plan:
    return plan(2, expected, model=model, recorded=recorded_orientations(samples))


def durations() -> Iterator[Row]:
    """From the call to the poses, in this process once warm; and the whole command."""
    samples = cw.read(PAPER)
    actions: dict[str, Callable[[], Plan]] = {
        "six poses": lambda: plan(6),
        "two poses after the paper's six": lambda: _after(samples, expected_tool(samples), "auto"),
        "six poses of an iiwa7": lambda: plan(6, reach=reach(ARMS["iiwa7"])),
        "24 poses": lambda: plan(24),
    }
    for what, action in actions.items():
        action()
        start = time.perf_counter()
        action()
        yield Row(what, time.perf_counter() - start, "s", most=2.0)
    start = time.perf_counter()
    command = [sys.executable, "-m", "contactwrench", "plan", "-n", "6", "--robot", "iiwa7"]
    subprocess.run(command, capture_output=True, check=True)
    yield Row("contactwrench plan -n 6 --robot iiwa7", time.perf_counter() - start, "s", most=2.0)


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of the planner."""
    sets = SETS // 10 if quick else SETS
    yield f"Six planned poses against the best of {sets:,} random sets of six: mean variance", against_random_sets(sets)
    yield "The same within reach of a wrist, the random sets anywhere", within_reach(sets)
    yield "Two planned poses after the paper's six: RMS of the contact force, bound", after_the_paper()
    yield "Planning", durations()
