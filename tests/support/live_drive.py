"""A person who is led by a session: plays the world's moves and pushes into it, and presses its buttons."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from contactwrench.live.session import Session
from contactwrench.live.sink import Turn
from contactwrench.live.snapshot import Command, Event, Snapshot
from contactwrench.live.source import Batch

from .live_world import ROBOT, SENSOR, LiveWorld


class Driver:
    """Feeds a session from a world; `events` is all that it said."""

    def __init__(self, world: LiveWorld, calibration: Any = None, **named: Any) -> None:
        self.world, self.events = world, list[Event]()
        self.session = Session(calibration, sensor="sri://sensor", robot="ur://robot", **named)
        self.session.opened("sensor", SENSOR, world.t)
        self.session.opened("robot", ROBOT, world.t)

    def play(self, batches: Iterable[tuple[Batch | None, Batch | None]]) -> list[Turn]:
        """Feed what comes: what was made of it."""
        turns = []
        for sensor, robot in batches:
            stamps = [sample.arrival for batch in (sensor, robot) if batch is not None for sample in batch.samples]
            turns.append(self.session.feed(sensor, robot, t=max(stamps)))
            self.events += self.session.events()
        return turns

    def do(self, command: Command, number: int | None = None) -> None:
        """Press a button."""
        self.session.do(command, self.world.t, number)
        self.events += self.session.events()

    def shown(self) -> Snapshot:
        """What the person sees."""
        return self.session.snapshot(self.world.t)

    def said(self, kind: str) -> list[str]:
        """Texts of the events of a kind."""
        return [event.text for event in self.events if event.kind == kind]

    def push_test(self, along: tuple[float, float, float] = (1.0, 0.15, 0.1), newtons: float = 9.0) -> None:
        """From connect to poses, with a push down and one roughly towards the flange's +x."""
        self.play(self.world.stand(1.6))
        self.do(Command.NEXT)
        self.play(self.world.stand(1.0))
        self.play(self.world.stand(2.5, tuple(newtons * np.array(self.world.down))))
        self.play(self.world.stand(0.8))
        towards = self.world.R_base_flange.apply(along)
        self.play(self.world.stand(2.5, tuple(newtons * towards / np.linalg.norm(towards))))
        self.play(self.world.stand(0.8))
        self.do(Command.NEXT)

    def turn_to(self, target: tuple[float, ...], seconds: float = 1.8) -> None:
        """Go to an orientation and stand there."""
        self.play(self.world.move(Rotation.from_quat(target)))
        self.play(self.world.stand(seconds))

    def poses(self, count: int) -> None:
        """Take planned poses until there are so many."""
        while (poses := self.shown().poses) is not None and len(poses.taken) < count:
            self.turn_to(poses.targets[0])

    def calibrated(self, count: int = 6) -> None:
        """From the beginning to a fit."""
        self.push_test()
        self.poses(count)
        self.do(Command.NEXT)

    def verified(self) -> None:
        """From a fit to run."""
        self.do(Command.NEXT)
        for _ in range(2):
            poses = self.shown().poses
            if poses is not None:
                self.turn_to(poses.targets[0])
        self.do(Command.NEXT)
