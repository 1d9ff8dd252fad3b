"""Turns of a session as its pump would make them, for sinks and replays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.compensate.faults import Reason
from contactwrench.live.sink import Turn
from tests.support.world import Array

START = 1.7e9
RATE, ROBOT_RATE = 1000.0, 125.0
LATENCY = 1.5e-3
"""s from a reading to its arrival."""
FLAW = "saturated: fx, fy"


def orientations(t: Array) -> Array:
    """Quaternions x, y, z, w (n, 4) of an arm that turns at 0.5 rad/s."""
    axis = np.array([0.6, 0.0, 0.8])
    turned: Array = Rotation.from_rotvec(0.5 * (t - START)[:, None] * axis).as_quat()
    return turned


def turn(first: int, count: int, seed: int = 0, flawed: float = 0.0, judged: bool = True) -> Turn:
    """`count` readings from the `first` on, and the poses of that time; some with a flaw."""
    rng = np.random.default_rng((seed, first))
    t = START + np.arange(first, first + count) / RATE
    ratio = round(RATE / ROBOT_RATE)
    pose_t = START + np.arange(-(-first // ratio), -(-(first + count) // ratio)) / ROBOT_RATE
    is_flawed = rng.random(count) < flawed
    return Turn(
        t=t,
        arrival=t + LATENCY,
        wrench=rng.normal(size=(count, 6)),
        orientation=orientations(t),
        flaw=[FLAW if each else "" for each in is_flawed.tolist()],
        pose_t=pose_t,
        pose=orientations(pose_t),
        position=np.column_stack([pose_t - START, np.ones((len(pose_t), 2))]),
        contact=contact_wrenches(t, rng) if judged else None,
    )


def contact_wrenches(t: Array, rng: np.random.Generator) -> ContactWrenches:
    """Judged ones of which some are not valid, or not known."""
    valid = rng.random(len(t)) < 0.7
    wrench = np.where(rng.random((len(t), 1)) < 0.8, rng.normal(size=(len(t), 6)), np.nan)
    reasons = tuple(None if good else Reason('stale: no "pose", 0.2 s', "stale") for good in valid.tolist())
    contact = rng.integers(-1, 2, len(t)).astype(np.int8)
    return ContactWrenches(wrench, np.abs(wrench) / 10.0, t, True, valid, reasons, contact)


def turns(sizes: list[int], seed: int = 0, flawed: float = 0.0, judged: bool = True) -> list[Turn]:
    """Turns of so many readings, one behind the other."""
    firsts = np.cumsum([0, *sizes]).tolist()
    return [turn(first, size, seed, flawed, judged) for first, size in zip(firsts, sizes, strict=False)]


def without_orientation(one: Turn) -> Turn:
    """The same without a robot."""
    nothing = np.empty((0, 4))
    return replace(
        one,
        orientation=np.full((len(one.t), 4), np.nan),
        pose_t=np.empty(0),
        pose=nothing,
        position=nothing[:, :3],
    )
