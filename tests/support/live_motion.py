"""A recording of the moving rig as two devices send it: each by its own clock, over a network that delays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import nan
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.live.running import Options
from contactwrench.live.session import Session
from contactwrench.live.sink import Turn
from contactwrench.live.source import About, Batch, Sample
from contactwrench.simulate.trajectory import Push
from tests.support.in_motion import Moving, moving
from tests.support.world import Array

T0 = 1.79e9
TURN = 0.004
"""s between turns of the worker."""
SENSOR = About("a sensor", wrench=True, orientation=False, rate=1000.0)


@lru_cache
def swung(push: float = 0.0, seed: int = 31) -> Moving:
    """1.5 s at rest and 3 s of fast motion at 1 kHz, in which so many N push for 0.4 s from 1.2 s on."""
    pushes = (Push(1.2, 1.6, push * np.array([0.6, 0.0, 0.8])),) if push else ()
    return moving(seed, stops=0, seconds=3.0, rate=1000.0, pushes=pushes)


@lru_cache
def dynamic() -> cw.Calibration:
    """Of the same tool, from stops and motion, each reading with its pose."""
    return cw.calibrate(moving(7, stops=8, seconds=10.0, rate=250.0).samples(), "dynamic")


@dataclass(frozen=True)
class Devices:
    """How the two send: `pose_rate` poses in a second; `jitter` s by which the network delays a packet at most; `noise`
    of the poses, m, and 2 rad/m of it; whether the robot says its `position`, and its `clock`; `cut`, s of the
    recording in which the robot, or its position, is `lost`.
    """

    pose_rate: int = 500
    jitter: float = 0.0
    noise: float = 0.0
    position: bool = True
    clock: bool = True
    cut: tuple[float, float] = (np.inf, np.inf)
    lost: Literal["robot", "position"] = "robot"

    def turns(self, arm: Moving) -> Iterator[tuple[float, Batch, Batch]]:
        """Turn by turn: now, and what came from the sensor and from the robot."""
        rng, rec = np.random.default_rng(0), arm.recorded
        every = round(rec.settings.recording.rate / self.pose_rate)
        rows = np.arange(0, len(rec.t), every)
        off = self.noise * rng.normal(size=(len(rows), 2, 3))
        quaternions = (Rotation.from_matrix(rec.R_base_flange[rows]) * Rotation.from_rotvec(2.0 * off[:, 0])).as_quat()
        places = rec.position[rows] + off[:, 1]
        t, robot, sensor = rec.t[rows], [], []
        gone = (t >= self.cut[0]) & (t < self.cut[1])
        placed = self.position & ~(gone & (self.lost == "position"))
        for k, arrival in enumerate(self._arrivals(t, rng).tolist()):
            if not gone[k] or self.lost == "position":
                place = tuple(places[k].tolist()) if placed[k] else None
                device = float(t[k]) if self.clock else nan
                robot.append(Sample(arrival, device, None, tuple(quaternions[k].tolist()), place))
        for arrival, device, wrench in zip(
            self._arrivals(rec.t, rng).tolist(), rec.t.tolist(), rec.wrench.tolist(), strict=True
        ):
            sensor.append(Sample(arrival, 7.0 + device, tuple(wrench)))
        begin = {"sensor": 0, "robot": 0}
        for now in (T0 + np.arange(TURN, rec.t[-1] + 0.1, TURN)).tolist():
            parts = []
            for name, samples in (("sensor", sensor), ("robot", robot)):
                first = begin[name]
                while begin[name] < len(samples) and samples[begin[name]].arrival <= now:
                    begin[name] += 1
                parts.append(Batch(samples[first : begin[name]]))
            yield now, parts[0], parts[1]

    def _arrivals(self, t: Array, rng: np.random.Generator) -> Array:
        late: Array = np.maximum.accumulate(T0 + t + 2e-4 + self.jitter * rng.random(len(t)) ** 3)
        return late


@dataclass(frozen=True, eq=False)
class Felt:
    """What a session made of it: `rows` from half a second on; `said`: events as their kind, severity and text."""

    rows: ContactWrenches
    session: Session
    said: tuple[tuple[str, str, str], ...]

    def between(self, begin: float, end: float) -> ContactWrenches:
        """The rows of so many s of the recording."""
        assert self.rows.t is not None
        return self.rows.select((self.rows.t >= T0 + begin) & (self.rows.t < T0 + end))

    def rms(self, begin: float = -np.inf) -> float:
        """Of the force of the valid rows from so many s of the recording on, N."""
        rows = self.between(begin, np.inf)
        return float(np.sqrt(np.mean(np.sum(rows.wrench[rows.valid, :3] ** 2, axis=1))))


def felt(arm: Moving, devices: Devices) -> Felt:
    """What a session makes of the recording."""
    return fed(devices.turns(arm))


def fed(turns: Iterable[tuple[float, Batch, Batch]], robot: str | None = "robot") -> Felt:
    """What a session behind 20 Hz makes of turns; without a robot all comes from the sensor."""
    session = Session(dynamic(), robot=robot, options=Options(lowpass=20.0))
    session.opened("sensor", SENSOR, T0)
    if robot is not None:
        session.opened("robot", About("a robot", wrench=False, orientation=True), T0)
    made = Turn.joined([session.feed(sensor, poses if robot else None, t=now) for now, sensor, poses in turns])
    rows = made.contact
    assert rows is not None
    assert rows.t is not None
    said = tuple((event.kind, event.severity, event.text) for event in session.events())
    return Felt(rows.select(rows.t > rows.t[0] + 0.5), session, said)
