"""A recording to contact wrenches, batch by batch: a row for each reading, in order, which says what is wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..calibration.text import NOISE_IS_LEARNED
from ..compensate.bias_tracking import free_mean
from ..compensate.compensator import Compensator
from ..compensate.contact_wrenches import ContactWrenches, contact_wrenches, in_axes, motion_of, require_frame
from ..compensate.delay import delay_of, std_of_delay
from ..compensate.faults import Reason
from ..compensate.filters import LowPass, smoothed
from ..compensate.runner import compiled
from ..compensate.state import INTERVALS
from ..errors import InputError
from ..estimation.calibrate import calibrate
from ..geometry.arrays import Array
from ..geometry.ranges import DELAY, DURATION
from ..samples.accelerometer import with_accelerometer
from ..samples.bursts import bursts_in, even_rows, spread
from ..samples.recorded_poses import is_stream
from ..samples.samples import Samples, Streams
from ..samples.synchronize import NOT_A_NUMBER, Synchronized, synchronized
from ..samples.timestamps import rate_of, spread_evenly
from .accelerations import accelerometer_of
from .in_doubt import InDoubt, OffThroughout, StuckReadings
from .options import Options
from .read import Block, are_pairs, as_streams, batches, blocks, samples_of, telling
from .tables.columns import ROWS, Advance, Tell, unheard
from .tables.table import Table, without_reading

ALL_ROWS = 10**9
"""At once, where accelerations are taken from what comes before and after."""


NOTHING = ContactWrenches(np.empty((0, 6)), np.empty((0, 6)), np.empty(0), True)


@dataclass(frozen=True, eq=False)
class Treatment:
    """What is to be done with a recording beside subtracting weight and bias.

    `output_frame` and `point` as in `contact_wrenches`; `gravity` (3,) in base axes where it differs from the
    calibration's; `delay` s of the wrench, None: the calibration's, where it is significant; `low_pass` of the contact
    wrench, both ways, so that nothing is late; `judged`: contact and faults of each sample, for which `sensor_filter`,
    `drift` (6,) and `noise` are as for a `Compensator`; `zero` s at the beginning, of which the bias is taken anew.
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
    zero: float | None = None

    def __post_init__(self) -> None:
        if self.delay is not None:
            DELAY.require(self.delay, "the delay")
        if self.zero is not None:
            DURATION.require(self.zero, "zero")

    def applied_delay(self, calibration: Calibration) -> float:
        """The delay (s) by which the orientation is looked up earlier."""
        return delay_of(calibration, self.sensor_filter) if self.delay is None else self.delay


def compensated(
    path: str | Path,
    options: Options,
    calibration: Calibration,
    treatment: Treatment,
    advance: Advance = unheard,
    note: Tell = unheard,
) -> Iterator[ContactWrenches]:
    """The contact wrenches of a recording, in batches.

    A table whose rows each have both comes row by row as it is, with the std that the calibration alone causes, where
    nothing is judged, no `delay` is stated, and its first rows are no motion that the calibration's would concern;
    anything else says of each row whether it is valid. A `low_pass` or an inertia takes the whole recording at once.
    `note` is told, at the end, what was left out and why. Raises as reading, pairing and compensating.
    """
    require_frame(calibration, treatment.output_frame)
    if options.imu is not None and (calibration.dynamics is None or calibration.dynamics.accelerometer is None):
        options = replace(options, imu=None)
        note("--imu is not used: the calibration has no inertia that counts from an accelerometer")
    if treatment.zero is not None:
        calibration = _with_zero_of(path, options, calibration.with_gravity(treatment.gravity), treatment.zero)
    rows = ROWS if calibration.dynamics is None else ALL_ROWS
    read = blocks(path, options, rows, advance)
    first = next(read)
    recording, every = chain(iter([first]), read), are_pairs(first)  # an iterator lets go of what it gave
    if _goes_row_by_row(first, calibration, treatment):
        done = _row_by_row(recording, path, options, calibration, treatment, note)
    else:
        streams = map(partial(as_streams, every=every), recording)
        done = _paired(streams, path, options, calibration, treatment, note)
    return _smoothed(done, treatment)


def _goes_row_by_row(first: Block, calibration: Calibration, treatment: Treatment) -> bool:
    """Whether a recording that begins with a block of pairs can be taken as it is, row by row."""
    if treatment.judged or not are_pairs(first):
        return False
    samples = samples_of(first)
    late = treatment.applied_delay(calibration) != 0.0 and (treatment.delay is not None or is_stream(samples))
    return not (late or (calibration.dynamics is not None and even_rows(samples)[1]))


def _with_zero_of(path: str | Path, options: Options, calibration: Calibration, seconds: float) -> Calibration:
    """The calibration with the bias of a recording's first `seconds`, in which nothing may touch the tool, at rest.
    Raises `InputError` where these move, scatter or are too few, and as reading and pairing.
    """
    first, begin = list[Samples](), np.nan
    for part in synchronized(batches(path, options)):
        samples = part.samples
        if samples.t is None or not len(samples):
            continue
        begin = samples.t[0] if np.isnan(begin) else begin
        first.append(samples.select(samples.t < begin + seconds))
        if len(first[-1]) < len(samples):
            break
    wrench = np.concatenate([np.empty((0, 6)), *(samples.wrench for samples in first)])
    orientation = np.concatenate([np.empty((0, 3, 3)), *(samples.R_base_flange for samples in first)])
    try:
        _, _, R = free_mean(calibration, Samples(wrench, orientation), None)
    except InputError as error:
        raise InputError(f"{path}, its first {seconds:g} s: {error}") from None
    zeroed = calibrate(Samples(wrench, np.broadcast_to(R, orientation.shape), source=str(path)), prior=calibration)
    return replace(zeroed, still_noise=calibration.still_noise)


def _row_by_row(
    pairs: Iterable[Block], path: str | Path, options: Options, tool: Calibration, treatment: Treatment, note: Tell
) -> Iterator[ContactWrenches]:
    """Of a table of pairs, each row by itself; those without a reading have no contact wrench."""
    lacking, off, imu, read = 0, OffThroughout(tool), accelerometer_of(path, options), list[Table]()

    def readings() -> Iterator[Samples]:
        for block in pairs:
            if isinstance(block, Table):
                read[:] = [block]  # and not by tee, which holds on to dozens of blocks
                yield samples_of(block)

    for samples in telling(readings(), path, options, note):
        table, rows = read[0], _plain(tool, with_accelerometer(samples, imu), treatment)
        off.add(rows)
        if len(rows) < len(table) and table.t is not None:
            lacks, lacking = ~table.has_reading, lacking + len(table) - len(rows)
            rows = ContactWrenches.concatenate([rows, without_wrench(NOT_A_NUMBER, table.t[lacks])])
            rows = rows.select(np.argsort(np.argsort(lacks, kind="stable")))
        yield rows
    for doubt in filter(None, (without_reading(lacking) if lacking else "", str(off))):
        note(doubt)


def _plain(calibration: Calibration, samples: Samples, treatment: Treatment) -> ContactWrenches:
    return contact_wrenches(calibration, samples, treatment.output_frame, treatment.point, treatment.gravity)


def _paired(
    recording: Iterable[Streams],
    path: str | Path,
    options: Options,
    calibration: Calibration,
    treatment: Treatment,
    note: Tell,
) -> Iterator[ContactWrenches]:
    """Brought onto one clock, with a word on each row that has no contact wrench."""
    order, delay, imu = InOrder(), treatment.applied_delay(calibration), accelerometer_of(path, options)
    if delay != 0.0:
        whose = "the calibration's" if treatment.delay is None else "as stated"
        by = f"{1e3 * abs(delay):.4g} ms {'later' if delay > 0.0 else 'earlier'}"
        note(f"the wrench is taken to be stamped {by} than the orientation, {whose}")
    listened = order.listening(telling(recording, path, options, note))
    parts = synchronized(listened, delay, at_their_pace=calibration.dynamics is not None)
    begun = list(islice(parts, 2))
    compensator, stuck, off = None, StuckReadings(), OffThroughout(calibration)
    in_doubt = InDoubt(calibration.with_gravity(treatment.gravity))
    if treatment.judged:
        if treatment.noise is None and calibration.still_noise is None:
            note(f"{NOISE_IS_LEARNED}; --noise states it")
        times = (part.samples.t for part in begun if part.samples.t is not None)
        many = len(begun) > 1 or sum(len(part.samples) for part in begun) > ROWS
        compensator = Compensator(
            calibration,
            rate=next((rate_of(t) for t in times if len(t) > INTERVALS), None),  # a few would be believed to the end
            delay=0.0,
            delay_std=std_of_delay(calibration) if treatment.delay is None else 0.0,
            drift=treatment.drift,
            sensor_filter=treatment.sensor_filter,
            noise=treatment.noise,
            gravity=treatment.gravity,
            fast=None if many or compiled.cache_info().currsize else False,  # few are done before it is compiled
        )
    for part in chain(begun, parts):
        samples = with_accelerometer(part.samples, imu)
        wrenches = stuck.marked(_of_samples(calibration, compensator, samples, treatment), samples)
        if compensator is None:
            off.add(wrenches)
        elif samples.t is not None and len(samples):
            in_doubt.add(samples, wrenches)
        yield order.whole(wrenches, part)
        for sentence in part.notes:
            note(sentence)
    for doubt in filter(None, (str(stuck), str(in_doubt), str(off))):
        note(doubt)
    if compensator is not None and (last := compensator.last_contact) is not None and last.release is None:
        yield replace(NOTHING, contacts=(last,))


def _of_samples(
    calibration: Calibration, compensator: Compensator | None, samples: Samples, treatment: Treatment
) -> ContactWrenches:
    """The contact wrenches of samples with times, judged where there is a compensator."""
    if compensator is None or samples.t is None:
        return replace(_plain(calibration, samples, treatment), judged=True)
    there = calibration.with_gravity(treatment.gravity)
    motion = motion_of(there, samples, 0.0 if treatment.sensor_filter is None else treatment.sensor_filter.lag)
    rows = compensator.run(samples.wrench, samples.R_base_flange, spread_evenly(samples.t), motion=motion)
    wrench, std, frame, point = rows.wrench, rows.std, treatment.output_frame, treatment.point
    if frame != "sensor" or point is not None:
        covariance = np.asarray(rows.covariance)[rows.covariance_of]
        if motion is not None:
            covariance += there.covariance_in_motion(samples.R_base_flange, motion)
        covariance[:, range(6), range(6)] = np.fmax(np.einsum("nii->ni", covariance), rows.std**2)  # what a delay adds
        wrench, std = in_axes(calibration, samples.R_base_flange, wrench, covariance, frame, point)
        std = np.where(np.isfinite(rows.std), std, np.nan)
    return replace(rows, wrench=wrench, std=std, t=samples.t)


def _smoothed(recording: Iterator[ContactWrenches], treatment: Treatment) -> Iterator[ContactWrenches]:
    """Through the low-pass, all of it at once."""
    if treatment.low_pass is None:
        yield from recording
        return
    whole = ContactWrenches.concatenate(list(recording))
    if whole.t is None or len(whole) < 2:
        raise InputError("found no times to filter by, expected a column t: add it, or leave the low-pass out")
    evenly = spread(whole.t, bursts_in(whole.t))
    yield replace(whole, wrench=smoothed(evenly, whole.wrench, treatment.low_pass))


class InOrder:
    """Puts rows, as they are paired, back into the order of the recording; between two calls it holds what waits."""

    def __init__(self) -> None:
        self._begin = 0
        self._t: list[Array] = [np.empty(0)]
        self._ahead: tuple[NDArray[np.intp], ContactWrenches] = (np.empty(0, dtype=np.intp), NOTHING)

    def listening(self, recording: Iterable[Streams]) -> Iterator[Streams]:
        """The same batches; the stamps of their readings are kept."""
        for streams in recording:
            self._t.append(streams.wrench.t)
            yield streams

    def whole(self, paired: ContactWrenches, part: Synchronized) -> ContactWrenches:
        """All rows from where the last call ended up to the first that is not yet known."""
        t = np.concatenate(self._t)
        missing = [without_wrench(left.reason, t[left.rows - self._begin]) for left in part.left_out]
        rows = np.concatenate([self._ahead[0], part.rows, *(left.rows for left in part.left_out)])
        known = ContactWrenches.concatenate([self._ahead[1], paired, *missing])
        order = np.argsort(rows, kind="stable")
        rows, known = rows[order], known.select(order)
        count = int(np.argmin(np.r_[rows == self._begin + np.arange(len(rows)), False]))
        self._ahead = rows[count:], replace(known.select(slice(count, None)), contacts=())
        done = replace(known.select(slice(count)), t=t[:count])
        self._begin, self._t = self._begin + count, [t[count:]]
        return done


def without_wrench(reason: str, t: Array) -> ContactWrenches:
    """Rows at `t` (n,) that have no contact wrench, and why."""
    n, nan = len(t), np.full((len(t), 6), np.nan)
    return ContactWrenches(nan, nan, t, True, np.zeros(n, dtype=bool), (Reason(f"left out: {reason}", reason),) * n)
