"""Contact wrenches while the arm runs: a Compensator, and no valid one from an orientation that is old."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from ..calibration.calibration import Calibration
from ..compensate.compensator import Compensator
from ..compensate.contact_wrenches import Contact as ContactEnded
from ..compensate.contact_wrenches import ContactWrench
from ..compensate.delay import delay_of, std_of_delay
from ..compensate.faults import Reason
from ..errors import InputError
from ..geometry.orientation import from_quat_xyzw
from ..samples.samples import Samples
from ..statistics import force_and_torque
from .history import History
from .intake import STREAMING, Intake
from .pose_track import NEEDED, PoseFeed
from .sink import Reading, Turn
from .snapshot import Contact, Running
from .source import NO_WRENCH, UNKNOWN, About, Four, Sample, Six

CONTACTS_SHOWN = 20
ZERO_OVER = 0.5
"""s of readings that a new zero is taken from."""
OF_SENSOR, OF_ROBOT = ("stuck", "overload"), ("stale", "frozen", "no_motion")
"""Why contact wrenches are not valid, or what is not subtracted, by the device whose fault it is, where that does not
say so itself.
"""
NOTHING_KNOWN = About("a sensor", wrench=True, orientation=False)
SAID_AGAIN = 1.0
"""s without the fault before it is said again."""
SUBTRACTED = "the tool's inertia is subtracted: the robot's poses tell how the arm moves"
NOT_SUBTRACTED = (
    "the robot's poses have no {}: the tool's inertia is not subtracted, and reads as contact while the arm "
    "accelerates; let it send {}"
)
OF_ACCELEROMETER = (
    "the calibration's inertia counts from an accelerometer, which a session does not read: it is not subtracted, and "
    "reads as contact while the arm accelerates; calibrate by positions"
)
NOT_KNOWN = (
    "the calibration knows no inertia of the tool, which reads as contact while the arm accelerates: calibrate with "
    "--model dynamic, or in a session whose robot sends positions"
)


@dataclass(frozen=True)
class Options:
    """Of the `Compensator`: low-pass cut-off, Hz; drift of the bias, N after an hour; the sensor's ranges (6,), N and
    N m; None: those that it states itself, or none.
    """

    lowpass: float | None = None
    drift: float | None = None
    ranges: Six | None = None


class Runner:
    """A calibration at work, on readings as the device gives them times `sign`; `sensor`: what it says of itself."""

    def __init__(self, calibration: Calibration, sign: float, options: Options, sensor: About | None) -> None:
        self.calibration, self.sign = calibration, sign
        known = sensor if sensor is not None and not sensor.replay else NOTHING_KNOWN
        self._compensator = Compensator(
            calibration,
            delay=0.0,
            delay_std=std_of_delay(calibration),
            rate=known.rate,  # by the first stamps it would be that of what waited, where a network is busy
            lowpass=options.lowpass,
            drift=options.drift,
            ranges=options.ranges or known.ranges,
        )
        self.delay = delay_of(calibration)
        """s by which the wrench is stamped later than the orientation that goes with it."""
        dynamics = calibration.dynamics
        of_positions = dynamics is not None and dynamics.accelerometer is None
        self._feed = PoseFeed(self._compensator, self.delay) if of_positions else None
        self._contacts: deque[tuple[float, float, float]] = deque(maxlen=CONTACTS_SHOWN)
        self._invalid, self._touching = 0, False
        self._seen: dict[str, float] = {}
        self._begun = inf
        not_subtracted = ("inertia", NOT_KNOWN) if dynamics is None else ("no_motion", OF_ACCELEROMETER)
        self._said = [] if of_positions else [not_subtracted]
        self._ended: list[ContactEnded] = []

    def came(self, poses: Sequence[tuple[float, Sample]]) -> None:
        """Poses with their times, s, those that the next readings lie among."""
        if self._feed is None:
            return
        before = self._feed.lacks
        self._feed.add(poses)
        if (lacks := self._feed.lacks) is not None and lacks != before:
            missing = NOT_SUBTRACTED.format(lacks, NEEDED.get(lacks))
            self._said.append(("no_motion", missing) if lacks else ("inertia", SUBTRACTED))

    def step(self, reading: Reading, orientation: Four, why: str, longest: float) -> ContactWrench:
        """The contact wrench; `why` there is no valid one; from `longest` s on a pose is old."""
        self._begun = min(self._begun, reading.t)
        if self._feed is not None and (doubt := self._feed.doubt(reading.t - self.delay, reading.t, longest)):
            orientation, why = UNKNOWN, why or doubt
        wrench = np.array(NO_WRENCH if reading.flaw else reading.wrench)
        made = self._compensator(wrench if self.sign > 0.0 else -wrench, np.array(orientation), reading.t)
        if why:
            made = replace(made, valid=False, reason=Reason(why))
        if not made.valid:
            self._invalid += 1
            self._fault(made)
        if made.contact or self._touching:
            self._follow(made)
        return made

    def _fault(self, made: ContactWrench) -> None:
        """Say a fault that was not there a moment ago. A robot's first pose may come a moment late."""
        kind = "" if made.reason is None else made.reason.kind
        if kind in (*OF_SENSOR, *OF_ROBOT):
            is_new = made.t - self._seen.get(kind, self._begun if kind == "stale" else -inf) > SAID_AGAIN
            if is_new:
                self._said.append((kind, str(made.reason)))
            if is_new or kind in self._seen:
                self._seen[kind] = made.t

    def _follow(self, made: ContactWrench) -> None:
        """Say that a contact began, or ended."""
        if made.contact:
            if not self._touching:
                self._said.append(("contact", f"contact: {np.linalg.norm(made.wrench[:3]):.1f} N"))
            self._touching = True
        elif made.contact is not None and (last := self._compensator.last_contact) and last.release is not None:
            self._touching = False
            self._ended.append(last)
            lasted, largest = last.release - last.onset, float(np.linalg.norm(last.peak[:3]))
            self._contacts.append((last.onset, lasted, largest))
            self._said.append(("contact", f"contact of {lasted:.2f} s ended, {largest:.1f} N at most"))

    def happened(self) -> tuple[list[tuple[str, str]], tuple[ContactEnded, ...]]:
        """Since it was last asked: events, as kinds and in words; and the contacts that ended."""
        said, ended = self._said, tuple(self._ended)
        self._said, self._ended = [], []
        return said, ended

    def zero(self, history: History, now: float) -> str:
        """Take the bias anew from what a free tool reads `now`, s; what it did, in words. Raises `InputError`."""
        t, wrench, orientation = history.last(ZERO_OVER, now)
        if not len(t):
            raise InputError("no new zero: no reading comes that can be used, expected both streams: wait for them")
        if not np.isfinite(orientation).all():
            raise InputError("no new zero: the robot's orientation is missing, expected both streams: wait for them")
        zero = self._compensator.zero(Samples(self.sign * wrench, from_quat_xyzw(orientation), t.copy()))
        self._touching = False
        return f"the zero moved by {force_and_torque(zero.shift)} since the calibration"

    def shown(self, saved: str) -> Running:
        """For a person; `saved`: the calibration's file, where it was written."""
        drift: Any = tuple(self._compensator.drift.tolist())
        source = saved or str(self.calibration.provenance.get("source", ""))
        lacks = None if self._feed is None else self._feed.lacks
        return Running(tuple(self._contacts), drift, self._invalid, source, None if lacks is None else not lacks)


def traced(reading: Reading, made: ContactWrench | None) -> tuple[float | None, ...]:
    """A row of the trace: `t`, the contact wrench, or without one the reading, `valid`, and `contact`, -1 not known."""
    wrench, valid = (reading.wrench, not reading.flaw) if made is None else (made.wrench.tolist(), made.valid)
    touching = -1.0 if made is None or made.contact is None else float(made.contact)
    return (reading.t, *_finite(wrench), float(valid), touching)


def shown_contact_wrench(turn: Turn, sensor: Intake) -> Contact | None:
    """The last contact wrench, for a person: what is no number is None; none is valid while the sensor says nothing."""
    if not turn.judged:
        return None
    if sensor.state != STREAMING:
        return Contact((None,) * 6, (None,) * 6, valid=False, contact=None, reason=f"{sensor.state}: {sensor.text}")
    made = turn.judged[-1]
    wrench, std = _finite(made.wrench.tolist()), _finite(made.std.tolist())
    return Contact(wrench, std, made.valid, made.contact, str(made.reason or ""))


def _finite(values: Sequence[float]) -> tuple[float | None, ...]:
    return tuple(value if isfinite(value) else None for value in values)
