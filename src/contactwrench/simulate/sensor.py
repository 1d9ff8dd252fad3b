"""What the sensor makes of the true wrench: gain and cross-talk, bias and its drift, filter, delay, noise, limits.

The order is that of the signal's way: strain gauges, amplifier, filter, converter. Rows come at one rate, in blocks of
any length, so that a whole recording is one block and a control loop takes one row, or a few, at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array
from .settings import Sensor

HOUR = 3600.0
FILTER_ROWS = 64
"""Rows that the filter takes at a time, by one matrix product."""


@dataclass(frozen=True, eq=False)
class Readings:
    """`wrench` (n, 6) N and N m as the sensor gives it, and `saturated` (n, 6), where a channel stands at its limit
    and shows less than there is.
    """

    wrench: Array
    saturated: NDArray[np.bool_]


class SensorStream:
    """The sensor as time passes: `read` takes the true wrenches of the next rows and gives the readings."""

    def __init__(self, sensor: Sensor, rate: float, rng: np.random.Generator) -> None:
        if rate <= 0.0:
            raise InputError(f"the rate is {rate:g} Hz, expected more than 0")
        self._sensor = sensor
        self._rng = rng
        self._period = 1.0 / rate
        self._rows = 0
        self._walk = np.zeros(6)
        self._late = round(sensor.delay * rate)
        self._before: Array | None = None
        self._filtered: Array | None = None
        self._bias_at_rest, self._warm_up = np.array(sensor.bias), np.array(sensor.drift.warm_up)
        self._walk_steps = np.array(sensor.drift.walk) * np.sqrt(self._period / HOUR)
        self._mixing = (np.diag(sensor.gain) + np.array(sensor.crosstalk)).T
        self._noise = np.array([*sensor.noise.force, *sensor.noise.torque])
        age = np.arange(FILTER_ROWS) - np.arange(FILTER_ROWS)[:, None]
        keep = np.exp(-2.0 * np.pi * sensor.low_pass * self._period)
        self._response = (1.0 - keep) * np.tril(keep ** np.maximum(-age, 0))
        self._decay = keep ** np.arange(1.0, FILTER_ROWS + 1.0)[:, None]
        self._limit = sensor.overload * np.array(sensor.ranges)
        self._warms, self._walks = bool(self._warm_up.any()), bool(self._walk_steps.any())

    def read(self, wrench: Array) -> Readings:
        """Readings (n, 6) of the true wrenches (n, 6), the next n rows."""
        if len(wrench) == 0:
            return Readings(np.empty((0, 6)), np.empty((0, 6), dtype=bool))
        signal = wrench @ self._mixing + self._bias(len(wrench))
        signal = self._delayed(self._low_passed(signal))
        signal = signal + self._noise * self._rng.standard_normal(signal.shape)
        saturated = np.abs(signal) >= self._limit
        signal = np.minimum(np.maximum(signal, -self._limit), self._limit)
        if self._sensor.quantum > 0.0:
            signal = np.rint(signal / self._sensor.quantum) * self._sensor.quantum + 0.0
        self._rows += len(wrench)
        return Readings(signal, saturated)

    def _bias(self, rows: int) -> Array:
        """The bias in the next rows: what warming up leaves of it, and where its random walk has come.

        (rows, 6), or (6,) of one that stays.
        """
        bias = self._bias_at_rest
        if self._warms:
            t = (self._rows + np.arange(rows)) * self._period
            bias = bias + np.exp(-t / self._sensor.drift.warm_up_time)[:, None] * self._warm_up
        if self._walks:
            walk = self._walk + np.cumsum(self._walk_steps * self._rng.normal(size=(rows, 6)), axis=0)
            self._walk = walk[-1]
            bias = bias + walk
        return bias

    def _low_passed(self, signal: Array) -> Array:
        """First-order filter, exact for a signal that is constant between rows; it begins settled."""
        if self._sensor.low_pass == 0.0 or len(signal) == 0:
            return signal
        last = signal[0] if self._filtered is None else self._filtered
        filtered = np.empty_like(signal)
        for start in range(0, len(signal), FILTER_ROWS):
            rows = signal[start : start + FILTER_ROWS]
            n = len(rows)
            filtered[start : start + n] = self._response[:n, :n] @ rows + self._decay[:n] * last
            last = filtered[start + n - 1]
        self._filtered = last.copy()
        return filtered

    def _delayed(self, signal: Array) -> Array:
        """The signal of `delay` ago, in whole rows; before that, the first one."""
        if self._late == 0:
            return signal
        if self._before is None:
            self._before = np.repeat(signal[:1], self._late, axis=0)
        line = np.concatenate([self._before, signal])
        self._before, delayed = line[len(signal) :], line[: len(signal)]
        return delayed
