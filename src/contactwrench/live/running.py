"""Contact wrenches while the arm runs: a Compensator, and no valid one from an orientation that is old."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from ..calibration.calibration import Calibration
from ..compensate.compensator import Compensator
from ..compensate.contact_wrenches import NOT_JUDGED, TOUCHING, ContactWrenches
from ..compensate.faults import Reason
from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.orientation import from_quat_xyzw
from ..samples.delay import is_significant
from ..samples.samples import Samples
from .history import History
from .snapshot import Contact, Running
from .source import Six

CONTACTS_SHOWN = 20
ZERO_OVER = 0.5
"""s of readings that a new zero is taken from."""
OF_SENSOR, OF_ROBOT = ("stuck", "overload"), ("stale", "frozen")
"""Why contact wrenches are not valid, by the device whose fault it is, where that does not say so itself."""
SAID_AGAIN = 1.0
"""s without the fault before it is said again."""


@dataclass(frozen=True)
class Options:
    """Of the `Compensator`: low-pass cut-off, Hz; drift of the bias, N after an hour; the sensor's ranges (6,), N and
    N m, where it does not state them itself; None: none.
    """

    lowpass: float | None = None
    drift: float | None = None
    ranges: Six | None = None


class Runner:
    """A calibration at work, on readings as the device gives them times `sign`."""

    def __init__(self, calibration: Calibration, sign: float, options: Options, ranges: Six | None) -> None:
        self.calibration, self.sign = calibration, sign
        given: dict[str, Any] = {"lowpass": options.lowpass, "drift": options.drift, "ranges": ranges or options.ranges}
        self._compensator = Compensator(calibration, delay=0.0, **given)
        self._contacts: deque[tuple[float, float, float]] = deque(maxlen=CONTACTS_SHOWN)
        self._invalid, self._touching = 0, False
        self._seen: dict[str, float] = {}

    @property
    def delay(self) -> float:
        """Seconds by which the wrench is stamped later than the orientation that goes with it."""
        c = self.calibration
        applied = c.delay is not None and c.delay_std is not None and is_significant(c.delay, c.delay_std)
        return c.delay if applied and c.delay is not None else 0.0

    def step(
        self, t: Array, wrench: Array, orientation: Array, why: list[str]
    ) -> tuple[ContactWrenches, list[tuple[str, str]]]:
        """Contact wrenches of readings (n, 6); `why` not, of each: its flaw, or that the orientation is old. And what
        happened, as kinds of events and in words: faults, and contacts that began and ended.
        """
        result = self._compensator.run(self.sign * wrench, orientation, t)
        if any(why):
            reasons = tuple(
                Reason(text, text.partition(":")[0]) if text else before
                for text, before in zip(why, result.reason, strict=True)
            )
            result = replace(result, reason=reasons, valid=result.valid & np.array([not text for text in why]))
        invalid = [] if result.valid.all() else np.flatnonzero(~result.valid).tolist()
        self._invalid += len(invalid)
        faults = self._faults([(float(t[k]), result.reason[k]) for k in invalid])
        return result, [*faults, *(("contact", text) for text in self._events(result))]

    def _faults(self, reasons: list[tuple[float, Reason | None]]) -> list[tuple[str, str]]:
        """Those that were not there a moment ago."""
        said = []
        for t, reason in reasons:
            if reason is not None and reason.kind in (*OF_SENSOR, *OF_ROBOT):
                if t - self._seen.get(reason.kind, -inf) > SAID_AGAIN:
                    said.append((reason.kind, str(reason)))
                self._seen[reason.kind] = t
        return said

    def _events(self, result: ContactWrenches) -> list[str]:
        events = []
        for contact in result.contacts:
            release = contact.onset if contact.release is None else contact.release
            largest = float(np.linalg.norm(contact.peak[:3]))
            self._contacts.append((contact.onset, release - contact.onset, largest))
            events.append(f"contact of {release - contact.onset:.2f} s ended, {largest:.1f} N at most")
        judged = result.contact[result.contact != NOT_JUDGED]
        touching = bool(judged[-1] == TOUCHING) if len(judged) else self._touching
        if touching and not self._touching:
            events.append(f"contact: {np.linalg.norm(result.wrench[-1, :3]):.1f} N")
        self._touching = touching
        return events

    def zero(self, history: History) -> str:
        """Take the bias anew from what a free tool reads now; what it did, in words. Raises `InputError`."""
        t, wrench, orientation = history.last(ZERO_OVER)
        if self._touching:
            raise InputError("no new zero: the tool is in contact, expected a free one: let go of it")
        if not len(t) or not np.isfinite(orientation).all():
            raise InputError("no new zero: the robot's orientation is missing, expected both streams: wait for them")
        zero = self._compensator.zero(Samples(self.sign * wrench, from_quat_xyzw(orientation), t.copy()))
        force, torque = float(np.linalg.norm(zero.shift[:3])), 1e3 * float(np.linalg.norm(zero.shift[3:]))
        return f"the zero moved by {force:.2g} N and {torque:.2g} mN m since the calibration"

    def shown(self, saved: str) -> Running:
        """For a person; `saved`: the calibration's file, where it was written."""
        drift: Any = tuple(self._compensator.drift.tolist())
        source = saved or str(self.calibration.provenance.get("source", ""))
        return Running(tuple(self._contacts), drift, self._invalid, source)


def last_contact_wrench(result: ContactWrenches) -> Contact:
    """The newest row, for a person: what is no number is None."""
    flag = int(result.contact[-1])
    return Contact(
        tuple(value if np.isfinite(value) else None for value in result.wrench[-1].tolist()),
        tuple(value if np.isfinite(value) else None for value in result.std[-1].tolist()),
        bool(result.valid[-1]),
        None if flag < 0 else bool(flag),
        str(result.reason[-1] or ""),
    )
