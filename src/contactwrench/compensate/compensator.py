"""Contact wrenches one sample at a time: compensation, filters, drift, contact, faults. The only class with state.

The work on each sample is kernel.py's, on flat sequences of floats; here is what needs matrices, ten times
a second and whenever the arm has turned by 5 degrees: the offset that drift.py estimates, and the covariance of the
contact wrench that detection.py tests it against. A batch is the same kernel in a loop, and gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from math import ceil, inf, nan

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array, read_only
from ..geometry.wrench import wrench_rows
from ..samples.samples import Samples
from . import state as slot
from .bias_tracking import HOUR, CalibrationError, Offset, calibrated, predicted, updated, zeroed
from .contact_detection import satterthwaite, thresholds, whitening
from .contact_wrenches import NOT_KNOWN, Contact, ContactWrench, ContactWrenchBatch, Zero, reason_of
from .faults import LOG_SAME_UNSEEN
from .filters import LowPass
from .noise import noise_of_sample
from .settings import arrays, delay_of, lists, positive, six
from .step import BLOCK_SECONDS, advance, compiled
from .zeroing import free_mean

ROWS_AT_ONCE = 4096
TRIANGLE = np.tril_indices(6)
GAP_SECONDS, GAP_SAMPLES = 0.1, 5.0
"""After a longer gap than both the filters start anew."""
UNKNOWN_RATE_GAP = 1.0
LONGEST_DELAY = 10.0
"""s, either way."""
LEAST_LOOK_BACK = 0.02
"""s: over which the arm's turn is taken that a pose which comes late is carried on with."""
DENSEST = 10_000.0
"""Hz: the ring of past orientations has room for this many a second."""


class Compensator:
    """From readings, one at a time or in batches, to contact wrenches with their std, faults and contacts.

    `rate` Hz; None: from the first 25 stamps (`InputError` where a cut-off is too high for it), nothing filtered until
    then. `noise`: the std (6,) of one sample, N and N m, or a recording (n, 6) at rest or, compensated, of free motion;
    None: from the calibration. `lowpass` of the contact wrench: a `LowPass`, or a cut-off in Hz (Butterworth of order
    2). `sensor_filter`: what the sensor itself does to a wrench, a `LowPass` or a cut-off in Hz (first order); the same
    is done to the model. `delay` s: how much later than the orientation the wrench is stamped; None: the calibration's,
    where it is significant. `drift`: std (6,) of the bias' random walk after an hour, as `drift.TYPICAL_DRIFT`; None:
    the bias is not followed, for whatever follows a bias takes a push that is too slow or too weak to be detected for
    one. `temperature_coefficient` (6,) of the bias, N/K and N m/K. `false_alarm_rate` per sample; `minimum_duration` s
    of a contact, and of its end; `ranges` (6,) of the sensor, N and N m; `gravity` (3,): its direction in base axes
    where that differs from the calibration's. `fast`: whether numba compiles the step, here and not at the first
    sample; None: where it is installed.

    Raises `InputError` for values that cannot be meant.
    """

    def __init__(
        self,
        calibration: Calibration,
        *,
        rate: float | None = None,
        noise: ArrayLike | None = None,
        lowpass: LowPass | float | None = None,
        sensor_filter: LowPass | float | None = None,
        delay: float | None = None,
        drift: ArrayLike | None = None,
        temperature_coefficient: ArrayLike | None = None,
        false_alarm_rate: float = 1e-4,
        minimum_duration: float = 0.005,
        ranges: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        fast: bool | None = None,
    ) -> None:
        self._calibration = calibration.with_gravity(None if gravity is None else np.asarray(gravity, dtype=np.float64))
        self._noise = noise_of_sample(calibration, noise)
        self._error = CalibrationError(self._calibration, self._noise.between)
        self._thresholds = thresholds(false_alarm_rate)
        self._follows = drift is not None
        self._walk = six(drift, "drift", 0.0, least=0.0) ** 2 / HOUR
        self._rate = None if rate is None else positive(rate, "rate", "Hz")
        self._lowpass = lowpass if isinstance(lowpass, LowPass | None) else LowPass(lowpass)
        self._sensor = sensor_filter if isinstance(sensor_filter, LowPass | None) else LowPass(sensor_filter, 1)
        self._delay = delay_of(calibration, self._sensor) if delay is None else float(delay)
        if not abs(self._delay) <= LONGEST_DELAY:
            raise InputError(f"delay is {self._delay:g} s, expected at most {LONGEST_DELAY:g} s either way")
        tool = (
            calibration.B[:, :3].ravel(),
            six(ranges, "range", inf, least=np.finfo(float).tiny),
            np.sqrt(self._noise.of_sample),
            six(temperature_coefficient, "temperature coefficient", 0.0),
            self._calibration.gravity_direction,
            [self._delay, self._delay if self._delay > 0.0 else max(-self._delay, LEAST_LOOK_BACK)],
            [positive(minimum_duration, "minimum duration", "s") - 1e-9],
        )
        fast = find_spec("numba") is not None if fast is None else fast
        self._advance: Callable[..., int] = compiled() if fast else advance
        self._flat = arrays if fast else lists
        self._tool = self._flat(np.concatenate(tool))
        empty = (np.zeros((ROWS_AT_ONCE, 6)), np.zeros(ROWS_AT_ONCE), np.full(ROWS_AT_ONCE, nan))
        self._buffers = [self._flat(rows) for rows in empty]
        self._orientations = {width: self._flat(np.zeros((ROWS_AT_ONCE, width))) for width in (4, 9)}
        self._out = self._flat(np.zeros((ROWS_AT_ONCE, slot.OUT)))
        self.reset()
        for width in self._orientations:
            self._step(width, 0, 0)

    def reset(self) -> None:
        """Forget everything but the settings: filters, contact, what was learned of the bias and a new zero."""
        memory = np.zeros(slot.MEMORY_SIZE)
        memory[[slot.TIME, slot.FREE_TIME, slot.FIRST_HEAT]] = nan
        memory[slot.QUANTUM : slot.QUANTUM + 6] = inf
        memory[slot.LOG_SAME : slot.LOG_SAME + 6] = LOG_SAME_UNSEEN
        look_back = float(self._tool[slot.LOOK_BACK]) if self._delay else 0.0
        room = 2 + ceil(look_back * max(DENSEST, 2.0 * (self._rate or 0.0)))
        self._memory, self._ring = self._flat(memory), self._flat(np.zeros((room, 4)))
        self._live, self._filters = self._flat(np.zeros(slot.LIVE_SIZE)), self._flat(np.zeros(slot.FILTERS_SIZE))
        self._offset: Offset | None = None
        self._block: tuple[Array, Array, Array, float] | None = None
        self._clean_before = False
        self._last_contact: Contact | None = None
        self._std, self._threshold = NOT_KNOWN, nan
        self._covariance = np.full((6, 6), nan)
        self._interval, self._filtered, self._slowness = inf, self._noise.of_sample[None], np.ones(6)
        self._live[slot.LONGEST_GAP] = UNKNOWN_RATE_GAP
        if self._rate is not None:
            self._memory[slot.STAMPS] = slot.N_INTERVALS
            self._use_rate(self._rate)
        self._take_over(np.zeros(6))

    def __call__(
        self, wrench: ArrayLike, orientation: ArrayLike, t: float, temperature: float | None = None
    ) -> ContactWrench:
        """The contact wrench of a reading (6,) at `R_base_flange` (3, 3) or quaternion x, y, z, w (4,), time `t` s.

        What is wrong with a sample comes back in `valid` and `reason`. Raises `InputError` for a shape, or a low rate.
        """
        reading, turn = np.asarray(wrench, dtype=np.float64), np.asarray(orientation, dtype=np.float64)
        if reading.shape != (6,) or turn.shape not in {(4,), (3, 3)}:
            raise InputError(
                f"wrench and orientation have shapes {reading.shape} and {turn.shape}, expected (6,) and (3, 3) or (4,)"
            )
        width = turn.size
        readings, times, heats = self._buffers
        if self._advance is advance:
            readings[0] = reading.tolist()
            self._orientations[width][0] = turn.ravel().tolist()
        else:
            readings[0] = reading
            self._orientations[width][0] = turn.ravel()
        times[0], heats[0] = t, nan if temperature is None else temperature
        taken = 0
        while not taken:
            taken, std = self._step(width, 0, 1), self._std
            if self._memory[slot.ASK]:
                self._attend()
        out = self._out[0]
        result = np.array(out[:6])
        result.flags.writeable = False
        contact, fault = out[slot.CONTACT], int(out[slot.FAULT])
        touching = None if contact < 0.0 else bool(contact > 0.0)
        if fault == slot.FINE:
            return ContactWrench(result, std, float(t), True, None, touching)
        reason = reason_of(fault, out[slot.DETAIL], int(out[slot.CHANNEL]))
        return ContactWrench(result, std if fault >= slot.BACK else NOT_KNOWN, float(t), False, reason, touching)

    def run(
        self, wrench: ArrayLike, orientation: ArrayLike, t: ArrayLike, temperature: ArrayLike | None = None
    ) -> ContactWrenchBatch:
        """The contact wrenches of the next readings (n, 6), at matrices (n, 3, 3) or quaternions x, y, z, w (n, 4),
        times (n,) and, where there is one, temperatures (n,). The state goes on from call to call.

        Raises `InputError` where the shapes do not pair.
        """
        readings, _ = wrench_rows(wrench)
        n = len(readings)
        turns, times = np.asarray(orientation, dtype=np.float64), np.asarray(t, dtype=np.float64)
        heats = np.full(n, nan) if temperature is None else np.asarray(temperature, dtype=np.float64)
        if turns.shape not in {(n, 4), (n, 3, 3)} or times.shape != (n,) or heats.shape != (n,):
            raise InputError(
                f"orientation, t and temperature have shapes {turns.shape}, {times.shape} and {heats.shape}, expected "
                f"({n}, 3, 3) or ({n}, 4), ({n},) and ({n},) for {n} readings"
            )
        width = 4 if turns.shape[1:] == (4,) else 9
        out, std, threshold = np.empty((n, slot.OUT)), np.empty((n, 6)), np.empty(n)
        contacts: list[Contact] = []
        covariances, covariance_of = [self._covariance], np.zeros(n, dtype=np.intp)
        for start in range(0, n, ROWS_AT_ONCE):
            rows = slice(start, min(start + ROWS_AT_ONCE, n))
            m = rows.stop - start
            self._fill(width, readings[rows], turns[rows].reshape(m, width), times[rows], heats[rows])
            at = 0
            while at < m:
                after = self._step(width, at, m)
                std[start + at : start + after] = self._std
                threshold[start + at : start + after] = self._threshold
                if self._covariance is not covariances[-1]:
                    covariances.append(self._covariance)
                covariance_of[start + at : start + after] = len(covariances) - 1
                at = after
                if self._memory[slot.ASK]:
                    contacts += self._attend()
            out[rows] = self._out[:m]
        fault = out[:, slot.FAULT].astype(np.int64)
        std[(fault > slot.FINE) & (fault < slot.BACK)] = nan
        reasons: list[str | None] = [None] * n
        for row in np.flatnonzero(fault):
            reasons[row] = reason_of(int(fault[row]), float(out[row, slot.DETAIL]), int(out[row, slot.CHANNEL]))
        return ContactWrenchBatch(
            out[:, :6].copy(),
            std,
            times.copy(),
            fault == slot.FINE,
            tuple(reasons),
            out[:, slot.CONTACT].astype(np.int8),
            out[:, slot.STATISTIC].copy(),
            threshold,
            tuple(contacts),
            np.array(covariances),
            covariance_of,
        )

    def zero(self, samples: Samples) -> Zero:
        """Take what free readings at rest leave, in whatever orientation, for the bias from now on.

        Raises `InputError`, and changes nothing, where the samples move, scatter more than noise does or are fewer than
        10, and while in a contact whose beginning was seen.
        """
        contact = self.last_contact
        if contact is not None and contact.release is None and contact.onset_seen:
            raise InputError(
                f"no new zero: in contact since t = {contact.onset:g} s, expected a free tool; let go of it, or, if "
                "nothing touches it, reset() first"
            )
        mean, R = free_mean(self._calibration, samples, np.sqrt(self._noise.of_sample))
        variance = self._noise.of_sample * self._noise.slowness(len(samples)) / len(samples)
        t = float(self._memory[slot.TIME])
        before = np.zeros(6) if self._offset is None else self._offset.value
        of_calibration = calibrated(self._error, R, t).covariance
        self._offset = zeroed(self._error, mean, variance, R, t)
        self._memory[slot.FIRST_HEAT] = self._memory[slot.HEAT] if self._knows_heat else nan
        self._memory[slot.SPOILED], self._memory[slot.FRESH], self._block = 1.0, slot.WRENCH_ALONE, None
        self._memory[slot.TOUCHING] = self._memory[slot.RUN] = 0.0
        self._take_over(mean)
        return Zero(mean - before, np.sqrt(np.diag(of_calibration) + variance))

    @property
    def last_contact(self) -> Contact | None:
        """The contact that lasts (`release` None), or else the last one that ended."""
        return self._contact(None) if self._memory[slot.TOUCHING] else self._last_contact

    @property
    def drift(self) -> Array:
        """By how much (6,), N and N m, free readings have moved since the calibration, as far as it was learned."""
        return read_only(np.zeros(6) if self._offset is None else self._offset.value)

    @property
    def delay(self) -> float:
        """The delay (s) that is applied."""
        return self._delay

    @property
    def _knows_heat(self) -> bool:
        return bool(self._memory[slot.FIRST_HEAT] == self._memory[slot.FIRST_HEAT])

    def _step(self, width: int, start: int, stop: int) -> int:
        readings, times, heats = self._buffers
        return self._advance(
            self._tool,
            self._live,
            self._filters,
            self._memory,
            self._ring,
            readings,
            self._orientations[width],
            times,
            heats,
            self._out,
            start,
            stop,
        )

    def _fill(self, width: int, *rows: Array) -> None:
        """Samples into the buffers that the kernel reads."""
        m = len(rows[0])
        readings, times, heats = self._buffers
        for buffer, values in zip((readings, self._orientations[width], times, heats), rows, strict=True):
            buffer[:m] = self._flat(values)

    def _attend(self) -> list[Contact]:
        """Do what the kernel stopped for; the contact that ended, if one did."""
        ask = int(self._memory[slot.ASK])
        ended: list[Contact] = []
        if ask & slot.RELEASED:
            self._last_contact = self._contact(float(self._memory[slot.RELEASE]))
            ended.append(self._last_contact)
        if ask & slot.RATE:
            intervals = self._memory[slot.INTERVALS : slot.INTERVALS + slot.N_INTERVALS]
            self._memory[slot.STAMPS] = 0.0  # asked for again where no filter takes this rate
            self._use_rate(slot.N_INTERVALS / float(np.sum(intervals)))
            self._memory[slot.STAMPS] = slot.N_INTERVALS
            self._memory[slot.FRESH] = slot.WHOLLY
        if ask & slot.BLOCK:
            self._end_block()
        if ask & slot.REFRESH:
            self._refresh()
        return ended

    def _use_rate(self, rate: float) -> None:
        filters = np.zeros(slot.FILTERS_SIZE)
        for at, low_pass in ((slot.LOWPASS, self._lowpass), (slot.SENSOR, self._sensor)):
            if low_pass is not None:
                sections = low_pass.sections(rate)[:, [0, 1, 2, 4, 5]]
                filters[at] = len(sections)
                filters[at + 1 : at + 1 + sections.size] = sections.ravel()
        self._filters[:] = self._flat(filters)
        self._filtered = self._noise.behind(self._lowpass, rate)
        self._slowness = self._noise.slowness(max(round(BLOCK_SECONDS * rate), 1))
        self._live[slot.LONGEST_GAP] = max(GAP_SECONDS, GAP_SAMPLES / rate)
        self._interval = 1.0 / rate

    def _end_block(self) -> None:
        """Learn from the block of samples before this one, where it, this one and the one before it were all free: so a
        contact that was too weak at first, or fades, is not taken for drift.
        """
        memory, offset, clean = self._memory, self._offset, self._memory[slot.SPOILED] == 0.0
        if self._follows and offset is not None:
            R = np.array(memory[slot.R_NOW : slot.R_NOW + 9]).reshape(3, 3)
            rows, t = float(memory[slot.BLOCK_ROWS]), float(memory[slot.TIME])
            mean = np.array(memory[slot.BLOCK_SUM : slot.BLOCK_SUM + 6]) / rows + offset.value
            if clean and self._clean_before and self._block is not None:
                there = predicted(offset, self._error, self._walk, self._block[2], self._block[3])
                self._offset = updated(there, self._block[0], self._block[1])
                self._take_over(self._offset.value)
            self._clean_before = self._block is not None
            variance = self._noise.of_sample * np.minimum(self._slowness * self._held() / rows, 1.0)
            self._block = (mean, variance, R, t) if clean else None
        if self._follows or memory[slot.SINCE] < len(self._filtered) + 2.0 * memory[slot.BLOCK_ROWS]:
            memory[slot.STALE] = 1.0
        memory[slot.BLOCK_TIME] = memory[slot.TIME]
        memory[slot.BLOCK_ROWS] = memory[slot.SPOILED] = 0.0
        memory[slot.BLOCK_SUM : slot.BLOCK_SUM + 6] = self._flat(np.zeros(6))

    def _refresh(self) -> None:
        """The covariance of the contact wrench at the orientation and time of the sample that comes."""
        memory, live = self._memory, self._live
        turn = memory[slot.R_NEXT : slot.R_NEXT + 9]
        R, t = np.array(turn).reshape(3, 3), float(memory[slot.NEXT_TIME])
        since = int(memory[slot.SINCE])
        if since == 0:
            self._block = None
        if self._offset is None:
            self._offset = calibrated(self._error, R, t)
        elif np.isnan(self._offset.t):
            self._offset = replace(self._offset, t=t)
        systematic = predicted(self._offset, self._error, self._walk, R, t).covariance
        filtered = self._filtered[min(since, len(self._filtered) - 1)]
        covariance = systematic + np.diag(np.minimum(filtered * self._held(), self._noise.of_sample))
        W = whitening(covariance)
        dof = satterthwaite(W, systematic, self._calibration.dof)
        live[slot.FIRE], live[slot.QUIET_BELOW] = self._thresholds.at(dof)
        live[slot.WHITENING : slot.FIRE] = self._flat(W[TRIANGLE])
        memory[slot.R_REFRESHED : slot.R_REFRESHED + 9] = turn
        memory[slot.STALE], memory[slot.READY] = 0.0, 1.0
        self._systematic, self._threshold = systematic, live[slot.FIRE]
        self._covariance, self._std = covariance, np.sqrt(covariance.diagonal())
        self._std.flags.writeable = False

    def _held(self) -> float:
        """For how many samples one reading of the sensor stands, where a driver repeats each: so much less do a filter
        and a mean reduce the noise.
        """
        held = float(self._memory[slot.NEW_USUAL]) / self._interval
        return held if held > 1.5 else 1.0

    def _take_over(self, offset: Array) -> None:
        """Subtract another offset from now on."""
        self._live[slot.BIAS : slot.BIAS + 6] = self._flat(self._calibration.B[:, 3] + offset)
        self._memory[slot.STALE] = 1.0

    def _contact(self, release: float | None) -> Contact:
        memory = self._memory
        rows, of_sample = float(memory[slot.SUM_ROWS]), self._noise.of_sample
        gain = np.minimum(self._filtered[-1] * self._held() / of_sample, 1.0)
        noise = of_sample * gain / (1.0 + (rows - 1.0) * gain)
        return Contact(
            float(memory[slot.ONSET]),
            release,
            np.array(memory[slot.PEAK : slot.PEAK + 6]),
            np.array(memory[slot.SUM : slot.SUM + 6]) / rows,
            self._systematic + np.diag(noise),
            bool(memory[slot.ONSET_SEEN]),
        )
