"""A tool at a sensor on an arm, as a live session would see it: samples of a script of moves, stops and pushes.

Written from the design's words (section 1), not from the package's model.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from contactwrench.live.source import About, Batch, Sample

Array = NDArray[np.float64]
SENSOR = About("a sensor", wrench=True, orientation=False, rate=1000.0)
ROBOT = About("a robot", wrench=False, orientation=True, rate=500.0)


@dataclass
class LiveWorld:
    """`sign` -1: the sensor reports the reaction; `down` (3,) in base axes; a push is a force (3,) N in base axes, at
    `hook` (3,) m in sensor axes. `delay` s: the wrench comes so much later.
    """

    seed: int = 0
    weight: float = 9.0
    com: tuple[float, float, float] = (0.01, -0.02, 0.06)
    bias: tuple[float, ...] = (3.0, -5.0, 20.0, 0.3, -0.2, 0.1)
    mounting: Rotation = field(default_factory=lambda: Rotation.from_euler("zx", [37.0, 1.5], degrees=True))
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    sign: float = 1.0
    noise: float = 0.02
    hook: tuple[float, float, float] = (0.0, 0.0, 0.12)
    delay: float = 0.0
    rate: int = 1000
    pose_rate: int = 500

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self.R_base_flange = Rotation.from_euler("xyz", [175.0, 8.0, 20.0], degrees=True)
        self.t = 1.79e9

    def wrench(self, R_base_flange: Rotation, push: Array) -> Array:
        """True readings (n, 6) without noise, of orientations (n) and pushes (n, 3) in base axes."""
        to_sensor = (R_base_flange * self.mounting).inv()
        weight, pushed = to_sensor.apply(self.weight * np.array(self.down)), to_sensor.apply(push)
        torque = np.cross(self.com, weight) + np.cross(self.hook, pushed)
        true: Array = np.hstack([weight + pushed, torque]) + np.array(self.bias)
        return self.sign * true

    def stand(
        self, seconds: float, push: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Iterator[tuple[Batch, Batch]]:
        """Stand for some s, with a push (3,) N, base axes, in the middle of it."""
        return self._play(self.R_base_flange, self.R_base_flange, seconds, np.array(push))

    def hold(self, seconds: float, push: Array) -> Iterator[tuple[Batch, Batch]]:
        """Stand for some s with the same push (3,) N, base axes, all the time."""
        return self._play(self.R_base_flange, self.R_base_flange, seconds, push, always=True)

    def move(self, R_base_flange: Rotation, seconds: float = 1.5) -> Iterator[tuple[Batch, Batch]]:
        """Turn to another orientation."""
        return self._play(self.R_base_flange, R_base_flange, seconds, np.zeros(3))

    def _play(
        self, begin: Rotation, end: Rotation, seconds: float, push: Array, always: bool = False
    ) -> Iterator[tuple[Batch, Batch]]:
        s = np.arange(round(seconds * self.rate)) / (seconds * self.rate)
        smooth = Slerp([0.0, 1.0], Rotation.concatenate([begin, end]))

        def at(part: Array) -> Rotation:
            part = np.clip(part, 0.0, 1.0)
            return smooth(part**3 * (10.0 - 15.0 * part + 6.0 * part**2))

        rise = np.clip(np.minimum(s - 0.3, 0.7 - s) * seconds / 0.05, 0.0, 1.0)[:, None]
        if always:
            rise = np.ones_like(rise)
        readings = self.wrench(at(s - self.delay / seconds), rise * push)
        scale = self.noise * np.r_[1.0, 1.0, 1.0, 0.05, 0.05, 0.05]
        readings += scale * self._rng.standard_normal(readings.shape)
        every = self.rate // self.pose_rate
        turns = at(s).as_quat()
        for first in range(0, len(s), 20):
            sensor, robot = Batch(), Batch()
            for k in range(first, min(first + 20, len(s))):
                t = self.t + s[k] * seconds
                sensor.samples.append(Sample(t, t - 1e6, tuple(readings[k].tolist())))
                if k % every == 0:
                    robot.samples.append(Sample(t, t - 2e6, None, tuple(turns[k].tolist()), (0.5, 0.0, 0.4)))
            yield sensor, robot
        self.t += seconds
        self.R_base_flange = end
