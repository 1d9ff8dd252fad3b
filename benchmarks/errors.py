"""What goes wrong with a recording of poses: the bias moves, a pose touches something, sensor, cable and robot err.

The judge's own physics: readings come from world.py, and everything here is drawn from a generator and added. Lengths
are in N of force, and each N brings 0.05 N m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.support.poses import SIX_SPREAD, paper_six
from tests.support.world import DOWN, Array, Rig, random_rotations, readings

NOISE = 0.0005 * np.array([70.0, 70.0, 70.0, 3.0, 1.0, 1.0])
"""N and N m: of the mean reading of a pose, 0.05 % of a sensor's ranges."""

RANGES = np.array([70.0, 70.0, 70.0, 3.0, 3.0, 3.0])
"""N and N m: cross-talk is a share of the range of the axis that it shows in."""

LEVER = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
"""N and N m a N."""

CONE, TURN = np.deg2rad(30.0), np.deg2rad(20.0)
PRIOR_MOUNT, PRIOR_BASE = np.deg2rad(1.41), np.deg2rad(0.71)
"""rad, an axis: the stated priors of the mounting's and of the base's tilt (method.md)."""

POSE_TIME = 30.0
"""s."""


def times(n: int) -> Array:
    """s: when n poses are recorded."""
    return np.asarray(POSE_TIME * np.arange(n), dtype=np.float64)


def in_a_cone(n: int, rng: np.random.Generator) -> Array:
    """Orientations (n, 3, 3) within 30 deg of tool-down, uniform over that cap, and turned little about the vertical,
    as the paper's six.
    """
    tilt, side = np.arccos(rng.uniform(np.cos(CONE), 1.0, n)), rng.uniform(0.0, 2.0 * np.pi, n)
    lean = Rotation.from_rotvec(tilt[:, None] * np.column_stack([np.cos(side), np.sin(side), np.zeros(n)]))
    turn = Rotation.from_euler("z", rng.uniform(0.0, 2.0 * np.pi) + TURN * rng.normal(size=(n, 1)))
    matrices: Array = (turn * lean * Rotation.from_euler("x", 180.0, degrees=True)).as_matrix()
    return matrices


def poses(name: str, rng: np.random.Generator) -> Array:
    """Orientations of that name: `paper's 6`, `6 spread`, `12 random`, `24 cone`."""
    fixed = {"paper's 6": paper_six, "6 spread": SIX_SPREAD.copy}
    if name in fixed:
        return fixed[name]()
    n, where = name.split()
    return in_a_cone(int(n), rng) if where == "cone" else random_rotations(int(n), rng)


def in_order(R_base_flange: Array) -> Array:
    """As a person would drive there: by tilt in bands of 15 deg, round the vertical in each."""
    down = R_base_flange.transpose(0, 2, 1) @ DOWN
    band = np.floor(np.rad2deg(np.arccos(np.clip(down[:, 2], -1.0, 1.0))) / 15.0)
    return R_base_flange[np.lexsort((np.arctan2(down[:, 1], down[:, 0]), band))]


def tilted(mount: Array, base: Array, weight: float, rng: np.random.Generator) -> Rig:
    """Any tool of that weight (N), the mounting and the base tilted about x and y by so many rad."""
    turns = [Rotation.from_rotvec([*tilt, 0.0]).as_matrix() for tilt in (mount, base)]
    yaw = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    com = np.array([0.02, 0.02, 0.03]) * rng.normal(size=3) + np.array([0.0, 0.0, 0.04])
    bias = rng.normal(size=6) * np.array([5.0, 5.0, 20.0, 0.5, 0.5, 0.2])
    return Rig(weight, com, bias, turns[0] @ yaw, turns[1] @ DOWN)


def usual_rig(rng: np.random.Generator, weight: float | None = None) -> Rig:
    """A tool of 5 to 30 N; mounting and base are each exactly nominal in half of the rigs, else drawn from the
    priors.
    """
    mount, base = (
        (rng.uniform() < 0.5) * sd * rng.normal(size=2) for sd in (PRIOR_MOUNT, PRIOR_BASE)
    )  # True is 1: off nominal
    return tilted(mount, base, float(np.exp(rng.uniform(np.log(5.0), np.log(30.0)))) if weight is None else weight, rng)


def direction(rng: np.random.Generator, n: int = 3) -> Array:
    """A unit vector (n,), uniform."""
    vector = rng.normal(size=n)
    unit: Array = vector / np.linalg.norm(vector)
    return unit


@dataclass(frozen=True)
class Course:
    """How the bias moves: `steady`, `drift`, `walk`, `warm-up` or `step`, by `strength` N over the run."""

    kind: str
    strength: float = 0.0

    def drawn(self, t: Array, rng: np.random.Generator, first_after: int | None = None) -> tuple[Array, Array]:
        """What each bias was off the last one (n, 6), and the covariance across poses (6, n, n) of that, which is all
        that a fit can be told of it: kind, times and strength, not the direction.

        `first_after`: the pose that a step lies before; None: two at least lie on either side.
        """
        n, before = len(t), (t[-1] - t) / (t[-1] - t[0])
        variance = (self.strength * LEVER) ** 2 / 3.0
        if self.kind == "walk":
            steps = rng.normal(size=(n - 1, 6)) * np.sqrt(variance * -np.diff(before)[:, None])
            walk = np.vstack([np.zeros(6), np.cumsum(steps, axis=0)])
            return walk - walk[-1], variance[:, None, None] * np.minimum.outer(before, before)
        k = int(rng.integers(2, n - 1)) if first_after is None else first_after
        shape = self._shape(before, k, 3.0 * rng.uniform(0.8, 1.25))
        change = self.strength * LEVER * np.r_[direction(rng), direction(rng)]
        return np.outer(shape, change), variance[:, None, None] * np.outer(shape, shape)

    def _shape(self, before: Array, first_after: int, lasts: float) -> Array:
        """How much of the change is still to come (n,); a warm-up `lasts` so many time constants."""
        if self.kind == "drift":
            return before
        if self.kind == "warm-up":
            decayed: Array = (np.exp(lasts * before) - 1.0) / (np.exp(lasts) - 1.0)
            return decayed
        return (np.arange(len(before)) < first_after).astype(np.float64) * (self.kind == "step")


@dataclass(frozen=True)
class Contacts:
    """Poses in contact: how far off (noise sd, the length of the wrench), and whether all in one direction."""

    size: float
    one_direction: bool

    def drawn(self, n: int, count: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """What the contacts add (n, 6), and which poses they are."""
        bad = rng.permutation(n) < count
        added = np.zeros((n, 6))
        pushes = [direction(rng, 6) for _ in range(1 if self.one_direction else count)]
        added[bad] = self.size * NOISE * np.array(pushes)
        return added, bad


FEATURES = 300
"""Cosines that make a smooth field."""

FIELD_LENGTH = 0.5
"""rad over which a cable's pull changes."""


@dataclass(frozen=True)
class Realistic:
    """How large the errors of sensor, cable and robot are: gain and cross-talk a share, backlash N in all, cable N an
    axis, robot deg an axis with that correlation from pose to pose, creep the share of the last change of load that is
    still to come.
    """

    gain: float = 0.0
    backlash: float = 0.0
    cable: float = 0.0
    robot: float = 0.0
    correlation: float = 0.0
    creep: float = 0.0

    def drawn(self, rig: Rig, rng: np.random.Generator) -> Reality:
        """A sensor, a cable and a robot of that kind."""
        gain = np.eye(6) + self.gain * rng.normal(size=(6, 6)) * np.divide.outer(RANGES, RANGES)
        frequencies = rng.normal(size=(FEATURES, 9)) / (np.sqrt(2.0) * FIELD_LENGTH)
        amplitudes = rng.normal(size=(FEATURES, 6)) * np.sqrt(2.0 / FEATURES) * self.cable * LEVER
        backlash = self.backlash * LEVER * np.r_[direction(rng), direction(rng)]
        phases = rng.uniform(0.0, 2.0 * np.pi, FEATURES)
        return Reality(self, rig, gain, backlash, direction(rng), frequencies, amplitudes, phases)


@dataclass(frozen=True, eq=False)
class Reality:
    """A drawn sensor, cable and robot with the tool of `rig`."""

    kind: Realistic
    rig: Rig
    gain: Array
    backlash: Array
    about: Array
    frequencies: Array
    amplitudes: Array
    phases: Array

    def cable(self, R_base_flange: Array) -> Array:
        """What the cable pulls with (n, 6)."""
        pull: Array = np.cos(R_base_flange.reshape(-1, 9) @ self.frequencies.T + self.phases) @ self.amplitudes
        return pull

    def steady(self, R_base_flange: Array) -> Array:
        """The free wrench (n, 6) as this sensor reads it, less what differs from pose to pose."""
        return (readings(self.rig, R_base_flange) - self.rig.bias) @ self.gain.T + self.rig.bias

    def read(self, R_base_flange: Array, rng: np.random.Generator) -> Array:
        """Readings (n, 6) of orientations that the robot states, visited in that order, with all errors."""
        n = len(R_base_flange)
        turns = np.deg2rad(self.kind.robot) * rng.normal(size=(n, 3))
        for k in range(1, n):
            turns[k] = self.kind.correlation * turns[k - 1] + np.sqrt(1.0 - self.kind.correlation**2) * turns[k]
        load = self.steady(R_base_flange @ Rotation.from_rotvec(turns).as_matrix())
        load[1:] -= self.kind.creep * np.diff(load, axis=0)
        way = Rotation.from_matrix(R_base_flange[1:] @ R_base_flange[:-1].transpose(0, 2, 1)).as_rotvec()
        approach = np.sign(np.r_[rng.normal(), way @ self.about])
        noise = NOISE * rng.normal(size=(n, 6))
        return load + np.outer(approach, self.backlash) + self.cable(R_base_flange) + noise
