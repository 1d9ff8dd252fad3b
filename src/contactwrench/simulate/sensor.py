"""What the sensors make of what is true: the six-axis sensor at the flange, and the torque sensors in the joints.

The six-axis sensor has gain and cross-talk, bias and its drift, filter, delay, noise and limits, in the order of the
signal's way: strain gauges, amplifier, filter, converter. Rows come at one rate, in blocks of any length, so that a
whole recording is one block and a control loop takes one row, or a few, at a time.

A joint's sensor sits between gear and link: the friction of motor and gear, by far the largest, never reaches it. What
does is the friction on the link's side, of bearings, seals and cables, and the sensor's own hysteresis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array
from .settings import JointTorque, Sensor

HOUR, DAY = 3600.0, 86_400.0
MINUTE_AT_1_KHZ = 30_000.0
"""Largest over least frequency: of half the rate, and of once a minute."""


@dataclass(frozen=True, eq=False)
class Readings:
    """`wrench` (n, 6) N and N m as the sensor gives it, and `saturated` (n, 6), where a channel stands at its limit
    and shows less than there is.
    """

    wrench: Array
    saturated: NDArray[np.bool_]


class OneOverF:
    """1/f noise (n, 6) as it goes on, of a std (6,) within a minute at 1 kHz: a sum of processes that each forget what
    they were, four times as slowly as the one before, from a row to a day.
    """

    def __init__(self, std: Array, period: float, rng: np.random.Generator) -> None:
        self._rng, memory = rng, period * 4.0 ** np.arange(np.log(DAY / period) / np.log(4.0)) / 2.0
        self._kept = np.exp(-period / memory) if std.any() else np.empty(0)
        self._std = std * np.sqrt(np.log(4.0) / np.log(MINUTE_AT_1_KHZ))
        self._state = self._std * rng.normal(size=(len(self._kept), 6))

    def next(self, rows: int) -> Array:
        """The next rows (rows, 6)."""
        from scipy.signal import lfilter

        total = np.zeros((rows, 6))
        for k, kept in enumerate(self._kept):
            drawn = np.sqrt(1.0 - kept**2) * self._std * self._rng.normal(size=(rows, 6))
            part = lfilter([1.0], [1.0, -kept], drawn, axis=0, zi=kept * self._state[k : k + 1])[0]
            self._state[k] = part[-1]
            total += part
        return total


class SensorStream:
    """The sensor as time passes: `read` takes the true wrenches of the next rows and gives the readings."""

    def __init__(self, sensor: Sensor, rate: float, rng: np.random.Generator) -> None:
        if rate <= 0.0:
            raise InputError(f"the rate is {rate:g} Hz, expected more than 0")
        self._sensor, self._rng, self._period = sensor, rng, 1.0 / rate
        self._rows, self._walk = 0, np.zeros(6)
        self._late = round(sensor.delay * rate)
        self._before: Array | None = None
        self._filtered: Array | None = None
        self._bias_at_rest, self._warm_up = np.array(sensor.bias), np.array(sensor.drift.warm_up)
        self._walk_steps = np.array(sensor.drift.walk) * np.sqrt(self._period / HOUR)
        self._mixing = (np.diag(sensor.gain) + np.array(sensor.crosstalk)).T
        self._noise = np.array([*sensor.noise.force, *sensor.noise.torque])
        self._one_over_f = OneOverF(np.array(sensor.noise.one_over_f), self._period, rng)
        self._limit = sensor.overload * np.array(sensor.ranges)
        self._warms, self._walks = bool(self._warm_up.any()), bool(self._walk_steps.any())

    def read(self, wrench: Array) -> Readings:
        """Readings (n, 6) of the true wrenches (n, 6), the next n rows."""
        if len(wrench) == 0:
            return Readings(np.empty((0, 6)), np.empty((0, 6), dtype=bool))
        shown = self._delayed(self._low_passed(wrench @ self._mixing + self._bias(len(wrench))))
        shown = shown + self._noise * self._rng.standard_normal(shown.shape) + self._one_over_f.next(len(shown))
        saturated = np.abs(shown) >= self._limit
        shown = np.minimum(np.maximum(shown, -self._limit), self._limit)
        if self._sensor.quantum > 0.0:
            shown = np.rint(shown / self._sensor.quantum) * self._sensor.quantum + 0.0
        self._rows += len(wrench)
        return Readings(shown, saturated)

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

    def _low_passed(self, wrench: Array) -> Array:
        """First-order filter, exact for a wrench that is constant between rows; it begins settled."""
        from scipy.signal import lfilter

        if self._sensor.low_pass == 0.0:
            return wrench
        keep = np.exp(-2.0 * np.pi * self._sensor.low_pass * self._period)
        last = wrench[:1] if self._filtered is None else self._filtered
        if len(wrench) == 1:  # of a control loop: the same to the last bit, in a tenth of the time
            self._filtered = keep * last + (1.0 - keep) * wrench
            return self._filtered
        filtered: Array = lfilter([1.0 - keep], [1.0, -keep], wrench, axis=0, zi=keep * last)[0]
        self._filtered = filtered[-1:]
        return filtered

    def _delayed(self, wrench: Array) -> Array:
        """The wrench of `delay` ago, in whole rows; before that, the first one."""
        if self._late == 0:
            return wrench
        before = np.repeat(wrench[:1], self._late, axis=0) if self._before is None else self._before
        line = np.concatenate([before, wrench])
        self._before = line[len(wrench) :]
        return line[: len(wrench)]


def joint_torque_readings(sensors: JointTorque, torque: Array, friction: Array, rng: np.random.Generator) -> Array:
    """Readings (n, 7), N m, where the drives exert `torque` (n, 7) without friction, and `friction` (n, 7) besides."""
    noise = sensors.noise * rng.normal(size=torque.shape)
    return np.asarray((torque + friction) * np.array(sensors.gain) + np.array(sensors.offset) + noise)


def friction_torque(sensors: JointTorque, velocity: Array, rng: np.random.Generator) -> Array:
    """What Coulomb friction adds to the drives' torque (n, 7), N m, at joint velocities (n, 7), rad/s: all of it along
    the velocity. At rest it is anything up to that, either way, as the joint came to rest; it stays as long as the
    joint does, so a row here is a stay.
    """
    most = abs(sensors.friction)  # -0.0 is a range upside down to the generator
    at_rest = rng.uniform(-most, most, size=velocity.shape)
    return np.where(velocity == 0.0, at_rest, most * np.sign(velocity))
