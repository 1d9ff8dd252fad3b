"""A session that is played, for the page: snapshots of every phase, plain and ugly, and one that takes commands."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from queue import Empty
from threading import Event as Flag
from threading import Thread
from typing import Any

import msgspec
from scipy.spatial.transform import Rotation

from contactwrench.live.page import Ask, Hub
from contactwrench.live.snapshot import (
    Check,
    Command,
    Contact,
    Device,
    Event,
    Fit,
    Output,
    Parameter,
    Phase,
    Poses,
    PushStep,
    Running,
    Snapshot,
    TakenPose,
)
from contactwrench.live.source import Four, Six

T0 = 1_780_000_000.0
READING: Six = (1.234, -2.345, 21.98, 0.0456, -0.123, 0.0078)
NOISE: Six = (0.031, 0.029, 0.048, 0.0011, 0.0012, 0.0008)
NAMES = ("weight", "com x", "com y", "com z", "bias fx", "bias fy", "bias fz", "bias tx", "bias ty", "bias tz", "yaw")
UNITS = ("N", "mm", "mm", "mm", "N", "N", "N", "N m", "N m", "N m", "deg")
POSES_NEEDED = 8


def quaternions(n: int, seed: int = 1) -> list[Four]:
    """Orientations that spread well."""
    return [(q[0], q[1], q[2], q[3]) for q in Rotation.random(n, random_state=seed).as_quat().tolist()]


def sensor(**changes: Any) -> Device:
    device = Device(
        "netft://192.168.1.1", "sensor", "ATI Axia80-M20, firmware 2.1", "streaming", "", 999.8, 1000.0, 48_211,
        3, 0, 0, 0.001, 0.0004,
    )  # fmt: skip
    return msgspec.structs.replace(device, **changes)


def robot(**changes: Any) -> Device:
    device = Device(
        "ur://10.0.0.5", "robot", "UR10e, PolyScope 5.15", "streaming", "", 499.9, 500.0, 24_105, 0, 0, 0, 0.002, 0.0002
    )
    return msgspec.structs.replace(device, **changes)


EVENTS = (
    Event(T0 - 42.0, "connected", "note", "connected: ATI Axia80-M20", "netft://192.168.1.1"),
    Event(T0 - 41.5, "connected", "note", "connected: UR10e", "ur://10.0.0.5"),
    Event(T0 - 12.0, "lost", "warning", "3 samples were lost", "netft://192.168.1.1"),
)


def trace(t: float, seconds: float, wrench: Six = READING, push: float = 0.0) -> tuple[tuple[float | None, ...], ...]:
    """Rows at 100 Hz until `t`, wavy, with a push along z in the last third of every 6 s; flagged as contact."""
    rows = []
    for i in range(int(100 * seconds)):
        at = t - seconds + (i + 1) / 100
        pushed = push * max(0.0, math.sin((at % 6.0 - 4.0) * math.pi / 2)) if at % 6.0 > 4.0 else 0.0
        waves = [value + 0.02 * abs(value) * math.sin(7 * at + k) for k, value in enumerate(wrench)]
        waves[2] -= pushed
        waves[3] += 0.05 * pushed
        rows.append((at, *waves, 1.0, 1.0 if pushed > 0.3 else 0.0))
    return tuple(rows)


def snapshot(phase: Phase, t: float = T0, seconds: float = 10.0, **changes: Any) -> Snapshot:
    """One moment of a good session."""
    commands = {
        Phase.CONNECT: (Command.NEXT,),
        Phase.PUSH: (Command.BACK, Command.SKIP),
        Phase.POSES: (Command.BACK, Command.CAPTURE, Command.RETAKE),
        Phase.FIT: (Command.BACK, Command.SAVE, Command.NEXT),
        Phase.VERIFY: (Command.BACK, Command.SKIP),
        Phase.RUN: (Command.ZERO, Command.RECORD, Command.BACK),
    }[phase]
    running = phase is Phase.RUN
    moment = Snapshot(
        t, phase, (sensor(), robot()), READING, NOISE, quaternions(1, 9)[0], (0.4, 0.1, 0.6), True, "",
        trace(t, seconds, (0.05, -0.03, 0.04, 0.002, -0.001, 0.001) if running else READING, 18.0 if running else 0.0),
        commands, EVENTS,
    )  # fmt: skip
    extra: dict[str, Any] = {}
    if phase is Phase.PUSH:
        extra["push"] = (
            PushStep("Press the tool down with a hand", 10.0, 12.0, "Felt 12 N along the sensor's +z.", "down"),
            PushStep("Press the tool towards the flange's +x", 10.0, 6.4, "", "+x"),
        )
    if phase in {Phase.POSES, Phase.VERIFY}:
        extra["poses"] = poses_step(5)
    if phase in {Phase.FIT, Phase.VERIFY}:
        extra["fit"] = good_fit()
    if phase is Phase.VERIFY:
        extra["checks"] = (Check(0.12, 0.004, True),)
    if running:
        extra["contact"] = Contact((0.05, -0.03, 0.04, 0.002, -0.001, 0.001), (0.06, 0.06, 0.07, 0.002, 0.002, 0.001),
                                   True, False, "")  # fmt: skip
        contacts = ((T0 - 60, 0.82, 12.4), (T0 - 31, 2.05, 18.0))
        extra["running"] = Running(contacts, (0.11, -0.04, 0.2, 0.001, 0.0, -0.002), 12, "gripper.json")
        extra["outputs"] = (Output("udp://127.0.0.1:9000", 102_334, 0, ""), Output("run.mcap", 102_000, 334, ""))
    return msgspec.structs.replace(moment, **{**extra, **changes})


def poses_step(taken: int, planned: int = 4, progress: float = 0.0, doubt: int | None = 2) -> Poses:
    history = tuple(None if n < 3 else 2.4 / n**1.6 for n in range(taken))
    doubts = [
        "The reading moved by 0.8 N while it was taken: was it touched?" if i == doubt else "" for i in range(taken)
    ]
    return Poses(
        tuple(TakenPose(q, why) for q, why in zip(quaternions(taken), doubts, strict=True)),
        tuple(quaternions(planned, 5)), 0.6, progress, "Waiting until the arm stands still.",
        history[-1] if history else None, 0.004, 0.1, bool(history and history[-1] and history[-1] < 0.1), history,
    )  # fmt: skip


def good_fit() -> Fit:
    values = ("12.034", "1.2", "-0.8", "61.4", "3.012", "-5.104", "20.031", "0.2004", "-0.1003", "0.0498", "30.12")
    stds = ("0.012", "0.1", "0.1", "0.2", "0.010", "0.011", "0.013", "0.0004", "0.0004", "0.0002", "0.05")
    parameters = tuple(Parameter(*row) for row in zip(NAMES, values, stds, UNITS, strict=True))
    findings = (("note", "The mounting turns the sensor by 30.1 degrees about z."),
                ("warning", "Pose 3 was touched by accident: it weighs little in the result."))  # fmt: skip
    return Fit("good", "", parameters, 0.08, 0.003, "Signs: the sensor reads pulls (push test).", "", findings)


LONG = (
    "netft://a-very-long-host-name-that-somebody-gave-his-sensor.cell-14.hall-3.plant.example:49152/?rate=7000&x=<b>&"
)
UGLY: dict[str, Snapshot] = {
    "no devices": snapshot(Phase.CONNECT, devices=(), reading=None, noise=None, trace=(), events=(), orientation=None),
    "no robot": snapshot(Phase.RUN, devices=(sensor(), robot(state="down", text="refused", age=None, rate=None))),
    "sensor silent": snapshot(
        Phase.RUN, devices=(sensor(state="silent", age=3.2, rate=0.0), robot()),
        trace=trace(T0 - 3.2, 6.8, (0.05, -0.03, 0.04, 0.002, -0.001, 0.001), 18.0),
    ),
    "long names": snapshot(
        Phase.RUN,
        devices=(sensor(uri=LONG, name="Maker of sensors " * 12, text="wrong sum " * 30), robot(name="<img src=x>")),
        events=tuple(Event(T0 + i, "cut", "error", "The connection was cut " * 8, LONG) for i in range(50)),
        outputs=(Output("udp://" + "x" * 200, 10**12, 10**9, "No space is left on the device. " * 4),),
        recording="/a/path/" + "of/folders/" * 30 + "run.mcap",
    ),
    "all faults": snapshot(
        Phase.RUN,
        devices=(sensor(state="silent", text="nothing for 4 s", age=4.0, lost=9000, wrong=77, rate=12.0),
                 robot(state="down", text="protective stop", age=9.0)),
        contact=Contact((None,) * 6, (None,) * 6, False, None, "saturated: fx; the orientation is 4 s old"),
        trace=tuple((T0 - 5 + i / 100, *(None,) * 6, 0.0, None) for i in range(500)),
    ),
    "fit refused": snapshot(
        Phase.FIT, commands=(Command.BACK,),
        fit=Fit("", "The poses turn about one axis only: the weight cannot be told from the bias. Take two that tip "
                "the flange sideways.", (), None, None, "", "", (("refused", "weight and bias cannot be told apart"),)),
    ),
    "forty poses": snapshot(Phase.POSES, poses=poses_step(40, 12, 0.4)),
    "first pose": snapshot(Phase.POSES, poses=poses_step(0), orientation=None),
    "check failed": snapshot(
        Phase.VERIFY, checks=(Check(0.12, 0.004, True), Check(2.3, 0.1, False)), verified="failed: 2.3 N are left",
        commands=(Command.BACK, Command.NEXT),
    ),
    "contact": snapshot(
        Phase.RUN, t=T0 + 5.2,
        contact=Contact((0.5, -1.2, -18.0, 0.9, 0.0, 0.01), (0.06,) * 3 + (0.002,) * 3, True, True, ""),
    ),
}  # fmt: skip


@dataclass
class Played:
    """A session that goes on by commands, and by itself where a person would act: pushes grow, poses are taken."""

    phase: Phase = Phase.CONNECT
    taken: int = 0
    progress: float = 0.0
    force: float = 0.0
    pushes: int = 0
    checks: int = 0
    saved: bool = False
    recording: bool = False
    zeroed: int = 0
    asked: list[Ask] = field(default_factory=list)
    began: float = field(default_factory=time.time)
    speed: float = 1.0

    def take(self, ask: Ask) -> None:
        """Do what was asked."""
        self.asked.append(ask)
        phases = list(Phase)
        if ask.do in {Command.NEXT, Command.SKIP}:
            self.phase = phases[min(phases.index(self.phase) + 1, 5)]
        elif ask.do is Command.BACK:
            self.phase = Phase.CONNECT if self.phase is Phase.RUN else phases[max(phases.index(self.phase) - 1, 0)]
        elif ask.do is Command.CAPTURE or ask.do is Command.RETAKE:
            self.progress = 0.01
        elif ask.do is Command.SAVE:
            self.saved = True
        elif ask.do is Command.RECORD:
            self.recording = not self.recording
        elif ask.do is Command.ZERO:
            self.zeroed += 1

    def moment(self, dt: float) -> Snapshot:
        """What is seen `dt` s later."""
        self._act(dt * self.speed)
        now = snapshot(self.phase, time.time(), dt)
        changes: dict[str, Any] = {"recording": "run.mcap" if self.recording else "", "commands": self._commands(now)}
        if self.phase is Phase.PUSH:
            changes["push"] = tuple(
                PushStep(ask, 10.0, 12.0 if i < self.pushes else self.force if i == self.pushes else 0.0,
                         "Felt 12 N." if i < self.pushes else "", toward)
                for i, (ask, toward) in enumerate((("Press the tool down", "down"), ("Press towards +x", "+x")))
            )  # fmt: skip
        if now.poses:
            changes["poses"] = poses_step(self.taken, 4, self.progress)
        if self.phase is Phase.VERIFY:
            changes["checks"] = (Check(0.1, 0.003, True),) * self.checks
            changes["verified"] = "passed: the residual is what the calibration explains" if self.checks == 2 else ""
        if self.phase is Phase.FIT and self.saved:
            changes["saved"] = "Saved as gripper.json."
        return msgspec.structs.replace(now, **changes)

    def _act(self, dt: float) -> None:
        if self.phase is Phase.PUSH and self.pushes < 2:
            self.force += 8.0 * dt
            if self.force >= 10.0:
                self.pushes, self.force = self.pushes + 1, 0.0
        if (self.phase is Phase.POSES and self.taken < POSES_NEEDED) or self.phase is Phase.VERIFY:
            self.progress += dt
            if self.progress >= 1.0:
                self.progress = 0.0
                self.taken += self.phase is Phase.POSES
                self.checks = min(self.checks + (self.phase is Phase.VERIFY), 2)

    def _commands(self, now: Snapshot) -> tuple[Command, ...]:
        done = {Phase.PUSH: self.pushes == 2, Phase.POSES: self.taken >= POSES_NEEDED, Phase.VERIFY: self.checks == 2}
        return (*now.commands, Command.NEXT) if done.get(self.phase) else now.commands


@contextmanager
def played(hub: Hub, session: Played, rate: float = 30.0) -> Iterator[Played]:
    """The session, published at `rate` Hz in a thread, until the block ends."""
    ended = Flag()

    def work() -> None:
        before = time.time()
        while not ended.wait(1.0 / rate):
            while True:
                try:
                    session.take(hub.commands.get_nowait())
                except Empty:
                    break
            now = time.time()
            hub.publish(msgspec.json.encode(session.moment(now - before)))
            before = now

    thread = Thread(target=work)
    thread.start()
    try:
        yield session
    finally:
        ended.set()
        thread.join()
