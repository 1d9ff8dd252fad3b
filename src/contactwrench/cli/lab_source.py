"""`rig://`: the lab's rig as a source in the program's own process, by an entry point as any package's.

It stands here because the rig judges what listens to devices, so neither knows the other.
"""

from __future__ import annotations

from threading import Event
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..live.source import About, Batch, Sample, now
from ..live.uri import Uri
from .lab import BRISK, REST, wandering

if TYPE_CHECKING:
    from ..lab.rig import Lab

RATE = 1_000.0
"""Hz."""
TOGETHER, MOST = 4, 100
"""Readings of a batch, the last of them with the pose; and at most, where nobody asked for a while."""


class RigSource:
    """The virtual rig, whose arm goes from pose to pose of its own accord."""

    FORM = "rig://[?seed=N]"
    ABOUT = "the virtual rig in this process, the arm goes from pose to pose: wrench, orientation, position, joints"
    RATE = "1000 Hz, with 250 poses"
    TESTED = "the rig's truth; no robot"

    _lab: Lab

    def __init__(self, uri: Uri) -> None:
        uri.only("seed")
        if uri.host or uri.port is not None or uri.path:
            raise InputError(f"{uri.text}: found an address, expected none as the rig is in this program: {self.FORM}")
        self.uri, self._seed = uri.text, uri.whole("seed", 0)
        self._closed = Event()

    def open(self) -> About:
        """As `Source`. Raises `MissingExtraError` without mujoco."""
        from ..lab.rig import Lab

        self._closed.clear()
        self._lab, self._poses = Lab(seed=self._seed, speed=BRISK), wandering(np.random.default_rng(self._seed))
        self._begun, self._row = monotonic(), 0
        self._leaves = self._begun + REST
        return About("virtual rig", wrench=True, orientation=True, rate=RATE)

    def read(self, timeout: float) -> Batch:
        """As `Source`."""
        wait = self._begun + (self._row + TOGETHER) / RATE - monotonic()
        if self._closed.wait(min(max(wait, 0.0), timeout)):
            return Batch()
        n = min(int((monotonic() - self._begun) * RATE) - self._row, MOST)
        if n < TOGETHER:
            return Batch()
        if monotonic() > self._leaves:
            self._leaves = monotonic() + self._lab.move_to(next(self._poses)) + REST
        first, arrival = self._begun + self._row / RATE, now()
        wrench, pose = self._lab.wrench_rows(first, n, RATE), self._lab.pose_at(first + (n - 1) / RATE)
        device = ((self._row + np.arange(n)) / RATE).tolist()
        self._row += n
        samples = [Sample(arrival, t, tuple(row)) for t, row in zip(device, wrench.tolist(), strict=True)]
        samples[-1] = samples[-1]._replace(
            orientation=tuple(pose.quat_xyzw.tolist()),
            position=tuple(pose.position.tolist()),
            joints=tuple(pose.joints.tolist()),
        )
        return Batch(samples)

    def close(self) -> None:
        """As `Source`."""
        self._closed.set()
