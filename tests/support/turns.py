"""Turns of a session as its pump would make them, for sinks and replays."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactwrench.compensate.contact_wrenches import ContactWrench
from contactwrench.compensate.faults import Reason
from contactwrench.live.sink import Pose, Reading, Turn
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
    rows = zip(t, t + LATENCY, rng.normal(size=(count, 6)), orientations(t), is_flawed.tolist(), strict=True)
    places = zip(pose_t, orientations(pose_t), strict=True)
    return Turn(
        [Reading._make([*plain(*row), FLAW if bad else ""]) for *row, bad in rows],
        [Pose._make(plain(when, quaternion, [when - START, 1.0, 1.0])) for when, quaternion in places],
        judged_at(t, rng) if judged else [],
    )


def plain(*values: Any) -> list[Any]:
    """Plain numbers and tuples of them."""
    return [tuple(map(float, each)) if np.ndim(each) else float(each) for each in values]


def judged_at(t: Array, rng: np.random.Generator) -> list[ContactWrench]:
    """Contact wrenches of which some are not valid, or not known."""
    valid = rng.random(len(t)) < 0.7
    wrench = np.where(rng.random((len(t), 1)) < 0.8, rng.normal(size=(len(t), 6)), np.nan)
    stale, contact = Reason('stale: no "pose", 0.2 s', "stale"), rng.choice(np.array([None, False, True]), len(t))
    return [
        ContactWrench(row, np.abs(row) / 10.0, float(when), good, None if good else stale, touching)
        for row, when, good, touching in zip(wrench, t, valid.tolist(), contact.tolist(), strict=True)
    ]


def turns(sizes: list[int], seed: int = 0, flawed: float = 0.0, judged: bool = True) -> list[Turn]:
    """Turns of so many readings, one behind the other."""
    firsts = np.cumsum([0, *sizes]).tolist()
    return [turn(first, size, seed, flawed, judged) for first, size in zip(firsts, sizes, strict=False)]


def without_orientation(one: Turn) -> Turn:
    """The same without a robot."""
    return replace(one, readings=[each._replace(orientation=(math.nan,) * 4) for each in one.readings], poses=[])
