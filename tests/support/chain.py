"""A session on fake devices, end to end: fake, source, reader, pump; with what it said and made, and when."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from math import cos, inf, sin
from time import monotonic, sleep
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.lab.truth import FlangePose
from contactwrench.live.pump import Pump, Reader
from contactwrench.live.session import Session
from contactwrench.live.sink import Turn, open_sink
from contactwrench.live.snapshot import Event
from contactwrench.live.source import Batch, now
from contactwrench.live.uri import source_of

from .live_world import Array, LiveWorld

NOISE = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
AXIS = np.array([0.6, -0.64, 0.48])
SWING, SPEED = 0.5, 2.0
"""rad, and rad/s of the phase: at most 1 rad/s, so that an orientation 50 ms old is 0.45 N of the tool's 9."""
TOLERANCE = 0.65
"""N of contact force, where there is none: the 70 ms of the swing by which a reading may be late, and a pose old."""
TOO_LATE = 6.0


@cache
def calibration() -> cw.Calibration:
    """Of the world, from exact readings of 20 orientations."""
    turns = Rotation.random(20, random_state=1)
    readings = LiveWorld().wrench(turns, np.zeros((20, 3)))
    return cw.calibrate(cw.Samples(readings, turns.as_matrix()), "mount", noise=NOISE)


FAST = 0.6
"""Of the fastest turn of a swing."""


class Swinging:
    """A tool on an arm that swings to and fro: a `Truth`. `spoil` is added to every reading; one that `freezes` shows,
    from where it turns too fast to stop before the next pose, its last pose, and goes on swinging: then it is `frozen`.
    """

    def __init__(self) -> None:
        world = LiveWorld()
        self.begin, self.spoil, self.spoil_pose = world.R_base_flange, 0.0, 0.0
        self.freezes = self.frozen = False
        down = (self.begin * world.mounting).inv().apply([0.0, 0.0, -world.weight])
        axis = world.mounting.inv().apply(AXIS)
        force = np.array([axis * (axis @ down), down - axis * (axis @ down), np.cross(axis, down)])
        self._waves = np.hstack([force, np.cross(world.com, force)])
        self._waves[0] += world.bias
        self._quaternions = np.array([self.begin.as_quat(), (self.begin * Rotation.from_quat([*AXIS, 0.0])).as_quat()])
        self._rng, self._last = np.random.default_rng(0), self._pose(0.0)

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """As `Truth`: the weight turns against the swing."""
        angle = -SWING * np.sin(SPEED * (t0 + np.arange(n) / rate))
        rows: Array = np.stack([np.ones(n), np.cos(angle), np.sin(angle)], axis=1) @ self._waves
        return rows + NOISE * self._rng.standard_normal(rows.shape) + self.spoil

    def pose_at(self, t: float) -> FlangePose:
        """As `Truth`."""
        if not (self.frozen and self.freezes):
            self._last = self._pose(t)
            self.frozen = self.freezes and abs(cos(SPEED * t)) > FAST
        return self._last

    def _pose(self, t: float) -> FlangePose:
        half = 0.5 * SWING * sin(SPEED * t)
        quaternion = np.array([cos(half), sin(half)]) @ self._quaternions
        matrix = Rotation.from_quat(quaternion).as_matrix()
        return FlangePose(matrix, quaternion + self.spoil_pose, np.array([0.5, 0.0, 0.4]), np.zeros(6))

    def true_contact(self, t: float) -> Array:
        """None."""
        return np.zeros(6)


class _Kept:
    """A sink that keeps what it gets."""

    uri, waits, written, dropped = "kept:", False, 0, 0

    def __init__(self) -> None:
        self.turns: list[Turn] = []

    def open(self) -> None:
        """Nothing to open."""

    def write(self, turn: Turn) -> None:
        """Keep it."""
        if len(turn.t):
            self.turns.append(turn)

    def close(self) -> None:
        """Nothing to close."""


class Chain:
    """A session that runs: `events` and `turns` with their times so far, `snapshot` as it was last published; in the
    end how long (s) it took to close, and the threads that were left.
    """

    def __init__(self, uris: dict[str, str], calibrated: bool = True) -> None:
        self.uris, self.events, self.snapshot = uris, list[Event](), b""
        self.closed_in, self.left = inf, set[threading.Thread]()
        self._kept, self._busy = _Kept(), 0.0
        readers = {}
        for role, uri in uris.items():
            source = source_of(uri)
            readers[role] = Reader(source, source.open(), Batch())
        session = Session(
            calibration() if calibrated else None,
            sensor=uris["sensor"],
            robot=uris.get("robot"),
        )
        self.session = session
        outlets = (open_sink(self._kept),)
        self.pump = Pump(session, readers, publish=self._publish, say=self.events.append, outlets=outlets)
        self.pump.start()

    def _publish(self, snapshot: bytes) -> None:
        self.snapshot = snapshot
        seconds, self._busy = self._busy, 0.0
        sleep(seconds)

    def compute(self, seconds: float) -> None:
        """Keep the worker busy for so long, once."""
        self._busy = seconds

    @property
    def turns(self) -> list[Turn]:
        """Those with readings."""
        return self._kept.turns

    def wait(self, found: Callable[[], bool], most: float = TOO_LATE) -> float:
        """Until it is so; s that it took, infinity where it never was."""
        begun = monotonic()
        while not found():
            if self.pump.failure is not None:
                raise self.pump.failure
            if monotonic() - begun > most:
                return inf
            sleep(0.005)
        return monotonic() - begun

    def said(self, begin: int, kinds: tuple[str, ...], device: str) -> bool:
        """Whether one of the kinds was said of the device, since so many events."""
        return any(event.kind in kinds and event.device == device for event in self.events[begin:])

    def valid_since(self, t: float) -> bool:
        """Whether a valid contact wrench of a reading that came after `t` has come."""
        last = self.turns[-1] if self.turns else None
        if last is None or last.contact is None:
            return False
        return bool((last.contact.valid & (last.arrival > t)).any())

    def wrong(self, begin: int) -> list[tuple[float, float]]:
        """Times, and N, of valid contact wrenches since so many turns that nothing made."""
        found: list[tuple[float, float]] = []
        for turn in self.turns[begin:]:
            if turn.contact is not None:
                force = np.linalg.norm(turn.contact.wrench[:, :3], axis=1)
                bad = turn.contact.valid & ~(force < TOLERANCE)
                found += zip(turn.t[bad].tolist(), force[bad].tolist(), strict=True)
        return found


@contextmanager
def running(fakes: dict[str, Any], options: dict[str, str], **named: Any) -> Iterator[Chain]:
    """A chain on fakes by role; afterwards no thread is left but those of before."""
    before = set(threading.enumerate())
    with ExitStack() as stack:
        for fake in fakes.values():
            stack.enter_context(fake)
        chain = Chain({role: fake.uri + options.get(role, "") for role, fake in fakes.items()}, **named)
        try:
            yield chain
        finally:
            begun = now()
            chain.pump.close()
            chain.closed_in = now() - begun
    chain.left = set(threading.enumerate()) - before
