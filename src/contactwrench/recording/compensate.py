"""A recording to contact wrenches, batch by batch: on one clock where it is two streams, judged where that is asked.

One row comes out for each reading of the recording, in its order. Where a reading has no orientation, or something is
wrong with it, the row says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..compensate.compensator import LONGEST_DELAY, Compensator
from ..compensate.contact_wrenches import Contact
from ..compensate.filters import LowPass, least_rows, zero_phase
from ..compensate.output_frame import ContactWrenches, contact_wrenches, in_axes, require_frame
from ..compensate.settings import delay_of
from ..errors import InputError
from ..geometry.arrays import Array
from ..samples.recorded_poses import is_stream
from ..samples.samples import Samples, Streams
from ..samples.synchronize import LeftOut, Synchronized, default_gap, synchronized
from ..samples.timestamps import SORTED_WITHIN
from .options import Layout
from .read import Advance, batches, pairs_in_batches

SATURATED = "saturated: a channel stands at its limit"
NOT_JUDGED, FREE, TOUCHING = -1, 0, 1


@dataclass(frozen=True, eq=False)
class Treatment:
    """What is to be done with a recording beside subtracting weight and bias.

    `output_frame` and `point` as in `contact_wrenches`; `gravity` (3,) in base axes where it differs from the
    calibration's; `delay` s of the wrench, None: the calibration's, where it is significant; `low_pass` of the contact
    wrench, both ways, so that nothing is late; `judged`: contact and faults of each sample, for which `sensor_filter`,
    `drift` (6,) and `noise` are as for a `Compensator`.
    """

    output_frame: str = "sensor"
    point: Array | None = None
    gravity: Array | None = None
    delay: float | None = None
    low_pass: LowPass | None = None
    judged: bool = False
    sensor_filter: LowPass | None = None
    drift: Array | None = None
    noise: Array | None = None

    def __post_init__(self) -> None:
        if self.delay is not None and not abs(self.delay) <= LONGEST_DELAY:
            raise InputError(
                f"the delay is {self.delay:g} s, expected at most {LONGEST_DELAY:g} s either way: is it in ms?"
            )

    def applied_delay(self, calibration: Calibration) -> float:
        """The delay (s) by which the orientation is looked up earlier."""
        return delay_of(calibration, self.sensor_filter) if self.delay is None else self.delay


@dataclass(frozen=True, eq=False)
class JudgedWrenches:
    """Contact wrenches `wrench` (n, 6) with `std` (n, 6) at `t` (n,) s, NaN where there is none; `valid` (n,), and the
    `reason` where it is False; `contact` (n,) 1 in contact, 0 free, -1 where that was not judged. `contacts`: those
    that ended here, in sensor axes.
    """

    wrench: Array
    std: Array
    t: Array
    valid: NDArray[np.bool_]
    reason: tuple[str | None, ...]
    contact: NDArray[np.int8]
    contacts: tuple[Contact, ...] = ()

    def __len__(self) -> int:
        return len(self.t)


Rows: TypeAlias = ContactWrenches | JudgedWrenches
Note: TypeAlias = Callable[[str], None]


def compensated(
    path: str | Path,
    layout: Layout,
    calibration: Calibration,
    treatment: Treatment,
    advance: Advance | None = None,
    note: Note | None = None,
) -> Iterator[Rows]:
    """The contact wrenches of a recording, in batches; `note` is told, at the end, what was left out and why.

    A table whose rows each have both comes row by row as it is, with the std that the calibration alone causes, where
    nothing is judged, no `delay` is stated, and its first rows are no motion that the calibration's would concern;
    anything else as `JudgedWrenches`. With a `low_pass` the whole recording is held in memory. Raises what reading,
    pairing and compensating raise.
    """
    require_frame(calibration, treatment.output_frame)
    pairs = None if treatment.judged else pairs_in_batches(path, layout, advance=advance)
    first = None if pairs is None else next(pairs)
    late = treatment.applied_delay(calibration) != 0.0
    if pairs is None or first is None or (late and (treatment.delay is not None or is_stream(first))):
        return _smoothed(_paired(path, layout, calibration, treatment, advance, note), treatment)
    plain = (
        contact_wrenches(calibration, samples, treatment.output_frame, treatment.point, treatment.gravity)
        for samples in chain([first], pairs)
    )
    return _smoothed(plain, treatment)


def _paired(
    path: str | Path,
    layout: Layout,
    calibration: Calibration,
    treatment: Treatment,
    advance: Advance | None,
    note: Note | None,
) -> Iterator[Rows]:
    """Brought onto one clock, with a word on each row that has no contact wrench."""
    order = _InOrder()
    delay = treatment.applied_delay(calibration)
    if note is not None and delay != 0.0:
        whose = "the calibration's" if treatment.delay is None else "as stated"
        late = f"stamped {1e3 * delay:.4g} ms later than the orientation"
        note(f"the wrench is taken to be {late}, {whose}")
    parts = synchronized(order.listening(batches(path, layout, advance=advance)), delay)
    begun = list(islice(parts, 2))
    compensator = None
    if treatment.judged:
        compensator = Compensator(
            calibration,
            delay=0.0,
            drift=treatment.drift,
            sensor_filter=treatment.sensor_filter,
            noise=treatment.noise,
            gravity=treatment.gravity,
            fast=None if len(begun) > 1 else False,  # one batch is done before the step is compiled
        )
    for part in chain(begun, parts):
        rows = _of_samples(calibration, compensator, part.samples, treatment)
        yield order.whole(rows, part)
        if note is not None:
            for sentence in part.notes:
                note(sentence)
    if compensator is not None and (last := compensator.last_contact) is not None and last.release is None:
        yield replace(_nothing(), contacts=(last,))


def _of_samples(
    calibration: Calibration, compensator: Compensator | None, samples: Samples, treatment: Treatment
) -> JudgedWrenches:
    n = len(samples)
    t = np.empty(0) if samples.t is None else samples.t
    if compensator is None:
        plain = contact_wrenches(calibration, samples, treatment.output_frame, treatment.point, treatment.gravity)
        return JudgedWrenches(
            plain.wrench, plain.std, t, np.ones(n, dtype=bool), (None,) * n, np.full(n, NOT_JUDGED, np.int8)
        )
    found = compensator.run(samples.wrench, samples.R_base_flange, _spread(t))
    wrench, std = found.wrench, found.std
    if treatment.output_frame != "sensor" or treatment.point is not None:
        covariance = found.covariance[found.covariance_of]
        turned = calibration.with_gravity(treatment.gravity)
        wrench, std = in_axes(
            turned, samples.R_base_flange, wrench, covariance, treatment.output_frame, treatment.point
        )
        std = np.where(np.isfinite(found.std), std, np.nan)
    return JudgedWrenches(wrench, std, t, found.valid, found.reason, found.contact, found.contacts)


def _spread(t: Array) -> Array:
    """Stamps (n,) of which several in a row are the same, as a clock of ms gives them at 4 kHz, spread evenly up
    to the next one.
    """
    new = np.flatnonzero(np.r_[True, np.diff(t) > 0.0][: len(t)])
    if len(new) in (len(t), 0, 1):
        return t
    count = np.diff(np.r_[new, len(t)])
    width = np.diff(t[new])
    width = np.minimum(np.r_[width, width[-1]], 2.0 * float(np.median(width)))
    within = np.arange(len(t)) - np.repeat(new, count)
    spread: Array = t + within * np.repeat(width / count, count)
    return spread


def _nothing() -> JudgedWrenches:
    return JudgedWrenches(
        np.empty((0, 6)),
        np.empty((0, 6)),
        np.empty(0),
        np.empty(0, dtype=bool),
        (),
        np.empty(0, dtype=np.int8),
    )


class _InOrder:
    """Puts what is known of readings, as they are paired, back into the order of the recording.

    Between two calls it holds the stamps of the readings that are not yet paired, and rows that are ahead of them.
    """

    def __init__(self) -> None:
        self._begin = 0
        self._t: list[Array] = [np.empty(0)]
        self._saturated: list[NDArray[np.bool_]] = [np.empty(0, dtype=bool)]
        self._ahead: tuple[NDArray[np.intp], JudgedWrenches] = (np.empty(0, dtype=np.intp), _nothing())

    def listening(self, recording: Iterable[Streams]) -> Iterator[Streams]:
        """The same batches; the stamps of their readings are kept."""
        for streams in recording:
            wrench = streams.wrench
            self._t.append(wrench.t)
            self._saturated.append(np.zeros(len(wrench), dtype=bool) if wrench.saturated is None else wrench.saturated)
            yield streams

    def whole(self, paired: JudgedWrenches, part: Synchronized) -> JudgedWrenches:
        """All rows from where the last call ended up to the first that is not yet known."""
        t, saturated = np.concatenate(self._t), np.concatenate(self._saturated)
        rows = np.concatenate([self._ahead[0], part.rows, *(left.rows for left in part.left_out)])
        known = _joined(
            [self._ahead[1], paired, *(_missing(left, t[left.rows - self._begin]) for left in part.left_out)]
        )
        order = np.argsort(rows, kind="stable")
        rows, known = rows[order], _picked(known, order)
        count = int(np.argmin(np.r_[rows == self._begin + np.arange(len(rows)), False]))
        self._ahead = rows[count:], replace(_picked(known, slice(count, None)), contacts=())
        done = _flagged(_picked(known, slice(count)), saturated[:count])
        self._begin, self._t, self._saturated = self._begin + count, [t[count:]], [saturated[count:]]
        return done


def _missing(left: LeftOut, t: Array) -> JudgedWrenches:
    n = len(t)
    nan = np.full((n, 6), np.nan)
    return JudgedWrenches(
        nan, nan, t, np.zeros(n, dtype=bool), (f"left out: {left.reason}",) * n, np.full(n, NOT_JUDGED, np.int8)
    )


def _joined(parts: list[JudgedWrenches]) -> JudgedWrenches:
    return JudgedWrenches(
        np.concatenate([part.wrench for part in parts]),
        np.concatenate([part.std for part in parts]),
        np.concatenate([part.t for part in parts]),
        np.concatenate([part.valid for part in parts]),
        tuple(reason for part in parts for reason in part.reason),
        np.concatenate([part.contact for part in parts]),
        tuple(contact for part in parts for contact in part.contacts),
    )


def _picked(rows: JudgedWrenches, pick: NDArray[np.intp] | slice) -> JudgedWrenches:
    reasons = rows.reason[pick] if isinstance(pick, slice) else tuple(rows.reason[place] for place in pick.tolist())
    return JudgedWrenches(
        rows.wrench[pick], rows.std[pick], rows.t[pick], rows.valid[pick], reasons, rows.contact[pick], rows.contacts
    )


def _flagged(rows: JudgedWrenches, saturated: NDArray[np.bool_]) -> JudgedWrenches:
    """Rows whose recording says that a channel stood at its limit are not valid."""
    new = saturated & rows.valid
    if not new.any():
        return rows
    reasons = list(rows.reason)
    for place in np.flatnonzero(new):
        reasons[place] = SATURATED
    return replace(rows, valid=rows.valid & ~new, reason=tuple(reasons))


def _smoothed(recording: Iterator[Rows], treatment: Treatment) -> Iterator[Rows]:
    """Through the low-pass both ways, each stretch between gaps by itself, in the order of its stamps."""
    if treatment.low_pass is None:
        yield from recording
        return
    parts = list(recording)
    t = np.concatenate([np.empty(0) if part.t is None else part.t for part in parts])
    wrench = np.concatenate([part.wrench for part in parts])
    if len(t) != len(wrench) or len(t) < 2:
        raise InputError("found no times to filter by, expected a column t: add it, or leave the low-pass out")
    there = np.isfinite(wrench).all(axis=1)
    known = t[there]
    steps = np.diff(known)
    cut = (steps > default_gap(known)) | (steps <= -SORTED_WITHIN)
    spacing = float(steps[~cut].mean()) if not cut.all() else 0.0
    if not spacing > 0.0:
        raise InputError("found times that stand still, expected a recording with a rate: leave the low-pass out")
    filtered = wrench[there]
    ends = np.r_[0, np.flatnonzero(cut) + 1, len(known)]
    for a, b in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        rows = a + np.argsort(known[a:b], kind="stable")
        filtered[rows] = _smooth(filtered[rows], treatment.low_pass, 1.0 / spacing)
    wrench[there] = filtered
    start = 0
    for part in parts:
        yield replace(part, wrench=wrench[start : start + len(part.wrench)])
        start += len(part.wrench)


def _smooth(values: Array, low_pass: LowPass, rate: float) -> Array:
    """A stretch through the low-pass; one that is too short to start a filter on becomes its mean."""
    if len(values) >= least_rows(low_pass.sections(rate)):
        return zero_phase(values, low_pass, rate)
    return np.broadcast_to(values.mean(axis=0), values.shape) if len(values) else values
