"""An accelerometer on the tool: what it reads, and how it sits, from how gravity turns in it.

    y = M f + b + c t,   f = a - g R_base_flange^T d        specific force, flange axes

At rest f is gravity alone, so M (3, 3), scale and axes in whatever unit, b, and how it drifts follow from the poses;
then the acceleration of its own place, wherever that is: the sensor's origin counts from there. By how much it is
stamped later than the wrench shows in what both feel, the shaking of drives above all.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array, Frozen, Matrix, Rows, Vector, column, shaped
from ..geometry.rotations import procrustes, rotation_vectors
from .samples import Samples
from .timestamps import default_gap, spread_evenly

BLOCK = 0.1
"""s, over which readings are averaged."""
REST, LEVER = 0.02, 0.5
"""m/s^2: what a mean at rest is off by; and m, from the axes about which the arm turns: an acceleration that is not
known, as large as the squared angular velocity makes it there.
"""
PASSES, BEYOND = 10, 3.0
"""In which means that are so many standard deviations off come to count less."""
OWN_SHAPE = 0.02
"""Of the scale: how far from a rotation an instrument's axes and scales are."""
DRIFT = 0.1
"""m/s^2, from begin to end: what a zero drifts by as an instrument warms."""
PRIOR = np.array([OWN_SHAPE**-2, OWN_SHAPE**-2, OWN_SHAPE**-2, 0.0, DRIFT**-2])
"""Information on a row of the matrix, relative, the bias, and its drift."""
LEAST_TURN = 0.02
"""Of gravity squared, about the second of the axes over which it is spread: 8 deg to each side."""
EVERY_WAY = 0.05
"""The same about the third: from there on an instrument that mirrors shows."""
MEDIAN_OF_THREE = 1.538
"""Of the length of three normal numbers, in their std."""
MOST_UNEXPLAINED = 0.15
"""Of gravity, RMS."""
SLOWEST, FASTEST = 5.0, 100.0
"""Hz, between which the two are compared: drives shake there, and the arm's own motion is over."""
LONGEST = 0.05
"""s, either way, in which the delay is looked for."""
LEAST_ALIKE = 0.2
"""Of the force's power there, explained by the acceleration at the best delay: less tells none."""
ALIKE = 40
"""Of these means in a row: 4 s, a stop and the move to the next."""
UNITS = {"m/s^2": 1.0, "g": 1.0 / 9.80665, "mg": 1e3 / 9.80665, "mm/s^2": 1e3}
AS_A_UNIT = 0.05


@dataclass(frozen=True, eq=False)
class AccelerometerStream(Rows):
    """What an accelerometer read: `reading` (m, 3), own axes and unit, at `t` (m,) s. `source`: in words."""

    t: Array = field(metadata=column())
    reading: Array = field(metadata=column(3))
    source: str = "arrays"


@dataclass(frozen=True, eq=False)
class Accelerometer(Frozen):
    """How an accelerometer sits and reads.

    Attributes:
        matrix: M (3, 3), its unit for each m/s^2 in flange axes.
        bias: b (3,), its unit.
        noise: m/s^2, by which a reading at rest is off, an axis, RMS.
        delay: s, by which its stamps are later than the wrench's.
        drift: (3,), m/s^2, by which the bias rose from begin to end of the recording, about the mean.
    """

    matrix: Matrix = field(metadata=shaped(3, 3))
    bias: Vector = field(metadata=shaped(3))
    noise: float
    delay: float = 0.0
    drift: Vector = field(default_factory=lambda: np.zeros(3), metadata=shaped(3))

    @property
    def scale(self) -> float:
        """Its unit for each m/s^2."""
        return float(abs(np.linalg.det(self.matrix)) ** (1.0 / 3.0))

    @property
    def unit(self) -> str | None:
        """The name of its unit, None where that is none."""
        return next((name for name, per in UNITS.items() if abs(self.scale / per - 1.0) < AS_A_UNIT), None)

    @property
    def mirrors(self) -> bool:
        """Whether two axes are exchanged, or one or all of them reversed: its axes are not right-handed."""
        return bool(np.linalg.det(self.matrix) < 0.0)

    def acceleration(self, reading: Array, t: Array, R_base_flange: Array, gravity: Array) -> Array:
        """Of its place (n, 3), m/s^2, flange axes, without gravity (3,) m/s^2, base axes, at times t (n,); NaN where it
        did not read.
        """
        if self.delay:
            reading = np.stack([np.interp(t + self.delay, t, values) for values in reading.T], axis=1)
        specific_force = np.linalg.solve(self.matrix, (reading - self.bias).T).T
        return specific_force + gravity @ R_base_flange


def with_accelerometer(samples: Samples, stream: AccelerometerStream | None) -> Samples:
    """The samples with what the accelerometer read at their times, between its rows; NaN in its gaps; as they are where
    there is none, or no sample. Raises `InputError` where the two have no common span.
    """
    if stream is None or not len(samples):
        return samples
    known = np.isfinite(stream.reading).all(axis=1) & np.isfinite(stream.t)
    t, reading = stream.t[known], stream.reading[known]
    order = np.argsort(t, kind="stable")
    t, reading = t[order], reading[order]
    if samples.t is None or len(t) < 2 or t[-1] <= samples.t.min() or t[0] >= samples.t.max():
        raise InputError(
            f"{stream.source}: found no accelerations at the times of the wrench, expected both on one clock: record "
            "them together"
        )
    t = spread_evenly(t)
    at = np.stack([np.interp(samples.t, t, values, np.nan, np.nan) for values in reading.T], axis=1)
    after = np.clip(np.searchsorted(t, samples.t), 1, len(t) - 1)
    at[t[after] - t[after - 1] > default_gap(t)] = np.nan
    return replace(samples, accelerometer=at, accelerometer_period=float(np.median(np.diff(t))))


def mounted_accelerometer(samples: Samples, gravity: Array) -> tuple[Accelerometer, Array]:
    """How the accelerometer of samples with times sits, from means over 0.1 s; those in motion count little. And the
    covariance (4, 4) of each row `[E, e]`, by which a specific force f is found as f + E f + e. `gravity` (3,) m/s^2,
    base axes. Raises `InputError` where it did not read, does not turn with gravity, or gravity turns too little in it.
    """
    specific_force, reading, off, scatter, time = _means(samples, gravity)
    columns = np.column_stack([specific_force, np.ones(len(time)), time])
    g = float(np.linalg.norm(gravity))
    if len(reading) < 4:
        raise InputError(f"{samples.source}: found no accelerometer's readings, expected some: name another source")
    weight = 1.0 / off**2
    for _ in range(PASSES):
        found, spread, told = _fitted(columns, reading, weight)
        if spread[1] < LEAST_TURN * g**2:
            raise InputError(
                f"{samples.source}: found gravity turning too little in the accelerometer, expected stops that tilt it "
                "by 10 deg and more, both ways: add some"
            )
        left = np.linalg.norm(reading - columns @ found, axis=1) / told
        weight = 1.0 / (off**2 + np.maximum(left / BEYOND, 0.0) ** 2)
    unexplained = float(np.sqrt(np.average(left**2, weights=weight)))
    if (share := min(unexplained / g, 1.0)) > MOST_UNEXPLAINED:
        raise InputError(
            f"{samples.source}: found accelerations that do not turn with gravity ({share:.0%} of it "
            "is left), expected an accelerometer fixed to the tool: name another source"
        )
    at_rest = off < 2.0 * REST
    noise = np.median(left[at_rest]) / MEDIAN_OF_THREE if at_rest.any() else unexplained
    noise = np.hypot(noise, np.median(scatter[at_rest if at_rest.any() else slice(None)]) / told)
    residual = np.asarray(np.linalg.solve(found[:3].T, (reading - columns @ found).T).T, dtype=np.float64)
    sits = Accelerometer(found[:3].T, found[3], max(float(noise), REST / 10.0), drift=found[4] / told)
    return sits, _covariance(columns, residual, off**-2)


def _covariance(columns: Array, residual: Array, weight: Array) -> Array:
    """Of a row `[E, e]`, as `mounted_accelerometer` has it, from the columns (k, 5) of `_fitted`, what is left of each
    mean (k, 3), m/s^2, and its weight (k,). Means of the same seconds are off alike, as by a pose.
    """
    first = np.arange(0, len(weight), ALIKE)
    weighted = weight[:, None] * np.column_stack([np.ones(len(weight)), residual, columns])
    total, off, pull = np.split(np.add.reduceat(weighted, first, axis=0), [1, 4], axis=1)
    count = float(total.sum() ** 2 / np.sum(total**2))
    variance = float(np.sum(off**2) / (3.0 * np.sum(total**2))) * count / max(count - len(PRIOR), 1.0)
    inverse = np.linalg.inv((weight * columns.T) @ columns + np.diag(PRIOR))
    covariance: Array = inverse @ (variance * pull.T @ pull + np.diag(PRIOR)) @ inverse
    return covariance[:4, :4]


def without_drift(samples: Samples, accelerometer: Accelerometer) -> Samples:
    """The samples with an accelerometer's readings as if its bias had been that of the middle."""
    t = np.asarray(samples.t)
    drifted = np.outer((t - t[0]) / (t[-1] - t[0]) - 0.5, accelerometer.scale * accelerometer.drift)
    return replace(samples, accelerometer=np.asarray(samples.accelerometer) - drifted)


def delay_behind(force: Array, reading: Array, angular: Array, t: Array) -> float:
    """s, by which an accelerometer's readings (n, 3) are later than forces (n, 3) at times t (n,); 0 where none shows.
    A rigid tool has both alike, gravity included: less what goes with the `angular` terms (n, k), one is a fixed
    matrix times the other.
    """
    run = _longest_run(np.asarray(np.isfinite(reading).all(axis=1)))
    force, reading, angular, t = (each[run] for each in (force, reading, angular, t))
    period, n = float(np.median(np.diff(t))) if len(t) > 1 else np.inf, len(t)
    reach = int(LONGEST / period)
    if reach < 2 or n < 4 * reach:
        return 0.0
    frequency = np.fft.rfftfreq(2 * n, period)
    compared = (frequency > SLOWEST) & (frequency < FASTEST)
    columns = np.hstack([angular, force, reading])
    columns = (columns - columns.mean(axis=0)) * np.hanning(n)[:, None]
    seen = np.fft.rfft(columns, 2 * n, axis=0)[compared]
    both = np.concatenate([seen.real, seen.imag])
    explaining, left = both[:, : angular.shape[1]], both[:, angular.shape[1] :]
    left = left - explaining @ np.linalg.lstsq(explaining, left, rcond=1e-9)[0]
    spectra = np.zeros((len(frequency), 6), dtype=np.complex128)
    spectra[compared] = left[: len(seen)] + 1j * left[len(seen) :]
    of_force, of_reading = spectra[:, :3], spectra[:, 3:]
    alike = np.fft.irfft(of_reading.conj()[:, :, None] * of_force[:, None, :], axis=0)
    own = np.fft.irfft(of_reading.conj()[:, :, None] * of_reading[:, None, :], axis=0)[0]
    power = float(np.fft.irfft(np.sum(np.abs(of_force) ** 2, axis=1))[0])
    lags = np.arange(-reach, reach + 1)
    explained = np.einsum("kab,ac,kcb->k", alike[-lags], np.linalg.pinv(own), alike[-lags]) / max(power, 1e-300)
    best = int(np.argmax(explained[1:-1])) + 1
    before, here, after = explained[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    if here < LEAST_ALIKE or not bend < 0.0:
        return 0.0
    return float(period * (lags[best] + 0.5 * (before - after) / bend))


def _longest_run(known: NDArray[np.bool_]) -> slice:
    """Of rows (n,) the longest that are known one after the other."""
    edges = np.flatnonzero(np.diff(np.r_[False, known, False].astype(int)))
    runs = edges.reshape(-1, 2)
    return slice(*runs[np.argmax(runs[:, 1] - runs[:, 0])].tolist()) if len(runs) else slice(0)


def _means(samples: Samples, gravity: Array) -> tuple[Array, ...]:
    """Of blocks in which it read: specific force at rest (k, 3), the reading (k, 3), by how much (k,) the former is off
    because the arm moves, m/s^2, by how much (k,) readings scatter about theirs, an axis, and when it was (k,), from
    -0.5 to 0.5 over the recording.
    """
    t, R = spread_evenly(np.asarray(samples.t)), samples.R_base_flange
    reading = np.full((len(t), 3), np.nan) if samples.accelerometer is None else samples.accelerometer
    known = np.flatnonzero(np.isfinite(reading).all(axis=1))
    block = np.floor((t[known] - t[0]) / BLOCK).astype(int)
    first = np.flatnonzero(np.r_[True, np.diff(block) != 0]) if len(known) else np.empty(0, dtype=int)
    last = np.r_[first[1:] - 1, len(known) - 1] if len(first) else first
    count: Array = (last - first + 1).astype(np.float64)
    whole = np.flatnonzero(count > 0.5 * (np.median(count) if len(count) else 0.0))
    down = gravity @ R[known]
    read = reading[known]
    means = [np.add.reduceat(values, first, axis=0) / count[:, None] for values in (down, read)]
    about = read - np.repeat(means[1], count.astype(int), axis=0)
    scatter = np.sqrt(np.add.reduceat(np.mean(about**2, axis=1), first) / count)
    begin, end = known[first], known[last]
    time = (0.5 * (t[begin] + t[end]) - t[0]) / (t[-1] - t[0]) - 0.5
    turned = np.linalg.norm(rotation_vectors(R[begin].transpose(0, 2, 1) @ R[end]), axis=1)
    speed = turned / np.maximum(t[end] - t[begin], 1e-9)
    off = np.hypot(REST, LEVER * (speed**2 + np.abs(np.gradient(speed)) / BLOCK)) if len(speed) > 1 else speed
    return -means[0][whole], means[1][whole], off[whole], scatter[whole], time[whole]


def _fitted(columns: Array, reading: Array, weight: Array) -> tuple[Array, Array, float]:
    """What each of the columns (k, 5), specific force, 1 and time, adds to a reading (5, 3); how far gravity is spread
    over its axes, largest first; and the scale: the similarity that fits best (Umeyama 1991), which mirrors only where
    that shows, then whatever matrix is near it.
    """
    total = weight.sum()
    f, y = (each - weight @ each / total for each in (columns[:, :3], reading))
    spread = np.linalg.eigvalsh(np.cov(f.T, bias=True))[::-1]
    M = (weight * y.T) @ f
    mirrored, turn = -procrustes(-M), procrustes(M)
    if spread[2] > EVERY_WAY * spread.sum() / 3.0 and np.sum(mirrored * M) > np.sum(turn * M):
        turn = mirrored
    scale = float(np.sum(turn * M)) / float(weight @ np.sum(f**2, axis=1))
    nominal = np.zeros((5, 3))
    nominal[:3] = scale * turn.T
    information = (weight * columns.T) @ columns + np.diag(PRIOR)
    right = (weight * columns.T) @ (reading - columns @ nominal)
    return nominal + np.linalg.solve(information, right), np.asarray(spread), scale
