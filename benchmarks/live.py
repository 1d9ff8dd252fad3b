"""The Compensator against signals of the judge (world.py) with a sensor's filter from scipy.signal: what is left of
gravity while the arm turns, false alarms, contacts found, a shift of eight hours, and what a call costs.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.bias_tracking import TYPICAL_DRIFT
from contactwrench.compensate.compensator import Compensator
from contactwrench.compensate.contact_wrenches import Contact
from contactwrench.compensate.filters import LowPass
from tests.support.world import Array, Rig, noisy_readings, random_rig, random_rotations, readings

from . import live_noise
from .table import Row

RATE = 1000.0
NOISE = np.array([0.05, 0.05, 0.05, 0.002, 0.002, 0.002])
"""N and N m: std of one sample."""
FALSE_ALARMS = 1e-4
HOUR = 3600.0
YARDSTICK = 0.5e-6
"""s of one `stepper()` call on the machine that the limits are for."""
LIMITS, LIMITS_WITHOUT_NUMBA = (3e-6, 50e-6, 1.5e-6), (30e-6, 100e-6, 30e-6)
"""s: the mean of a call, its p99.9, a sample of a batch."""


def calibrated(rng: np.random.Generator, poses: int = 24, given: bool = True) -> tuple[cw.Calibration, Rig]:
    """A calibration from random poses, one reading each, of any tool and mounting; and what is true."""
    rig, R = random_rig(rng), random_rotations(poses, rng)
    samples = cw.Samples(noisy_readings(rig, R, NOISE, rng), R)
    return cw.calibrate(samples, "mount", noise=NOISE if given else None), rig


def motion(
    rng: np.random.Generator, n: int, rate: float = RATE, begin: Rotation | None = None, rests: float = 2.0
) -> tuple[Array, Rotation]:
    """Orientations (n, 3, 3) of an arm that turns smoothly from pose to pose for a second and then `rests` s, and the
    last pose.
    """
    turn, rest = int(rate), int(rests * rate)
    legs = -(-n // (turn + rest))
    at, parts = begin or Rotation.random(random_state=rng), []
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, turn + 1) / turn)
    for _ in range(legs):
        vector = rng.normal(size=3)
        vector *= rng.uniform(0.2, 1.0) / np.linalg.norm(vector)
        parts.append((at * Rotation.from_rotvec(share[:, None] * vector)).as_matrix())
        at = at * Rotation.from_rotvec(vector)
        parts.append(np.broadcast_to(at.as_matrix(), (rest, 3, 3)))
    return np.concatenate(parts)[:n], at


def turning(cutoff: float = 10.0, speed: float = 60.0) -> Iterator[Row]:
    """Gravity that is left of a turn behind a first-order filter of the sensor, with next to no noise."""
    rng = np.random.default_rng(11)
    without: list[float] = []
    left: list[float] = []
    fine = 20
    for _ in range(20):
        rig = random_rig(rng)
        R = random_rotations(24, rng)
        calibration = cw.calibrate(cw.Samples(readings(rig, R), R), "mount", noise=NOISE)
        n = int(2.0 * RATE) * fine
        t = np.arange(n) / (fine * RATE)
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        angle = np.deg2rad(speed) * np.maximum(t - 0.5, 0.0)
        start = Rotation.random(random_state=rng)
        course = (start * Rotation.from_rotvec(angle[:, None] * axis)).as_matrix()
        wrench = readings(rig, course)
        kept = np.exp(-2.0 * np.pi * cutoff / (fine * RATE))
        wrench = wrench[0] + lfilter([1.0 - kept], [1.0, -kept], wrench - wrench[0], axis=0)
        rows = slice(0, None, fine)
        wrench += 1e-3 * NOISE * rng.normal(size=wrench.shape)
        for sensor, found in ((None, without), (cutoff, left)):
            compensator = Compensator(calibration, rate=RATE, noise=NOISE, sensor_filter=sensor, fast=False)
            contact = compensator.run(wrench[rows], course[rows], t[rows]).wrench
            found.append(np.linalg.norm(contact[:, :3], axis=1).max() / rig.weight)
    ratio = float(np.median(np.array(without) / np.array(left)))
    worst = float(np.min(np.array(without) / np.array(left)))
    remark = f"median {ratio:.3g}; {100 * np.max(without):.2g} % of the weight without, {100 * np.max(left):.2g} % with"
    yield Row("largest force left, without over with the filter, worst of 20 tools", worst, "x", 20.0, remark=remark)


@dataclass(frozen=True)
class Case:
    """How the Compensator is set for free samples."""

    name: str
    lowpass: float | None
    drift: bool
    given: bool = True


CASES = (
    Case("no filter, no drift", None, drift=False),
    Case("low-pass 50 Hz", 50.0, drift=False),
    Case("drift", None, drift=True),
    Case("low-pass 50 Hz and drift", 50.0, drift=True),
    Case("no filter, no drift, calibration's noise unknown", None, drift=False, given=False),
)


def false_alarms(case: Case, calibrations: int, samples: int) -> Row:
    """Per-sample false alarms on free white noise, before hysteresis, over the stated rate.

    A calibration's error is the same in all its samples, so false alarms come in clusters: the standard error is that
    of the mean over calibrations.
    """
    counts, events = np.zeros(calibrations), 0
    for number in range(calibrations):
        rng = np.random.default_rng((12, number))
        calibration, rig = calibrated(rng, given=case.given)
        R, _ = motion(rng, samples, rests=0.2)
        compensator = Compensator(
            calibration,
            rate=RATE,
            noise=NOISE,
            lowpass=case.lowpass,
            drift=TYPICAL_DRIFT if case.drift else None,
            false_alarm_rate=FALSE_ALARMS,
        )
        batch = compensator.run(noisy_readings(rig, R, NOISE, rng), R, np.arange(samples) / RATE)
        counts[number] = np.sum(batch.statistic > batch.threshold)
        last = compensator.last_contact
        events += len(batch.contacts) + (last is not None and last.release is None)
    hours = calibrations * samples / RATE / HOUR
    rate, error = counts.mean() / samples, counts.std() / np.sqrt(calibrations) / samples
    remark = f"+- {error / FALSE_ALARMS:.2g}; after hysteresis {events} events in {hours:.2g} h"
    least, most = (0.5, 2.0) if case.given else (None, None)
    return Row(f"{case.name}: false alarms", float(rate / FALSE_ALARMS), "x stated", least, most, remark)


def pushes(lowpass: float | None, contacts: int) -> Iterator[Row]:
    """Steps of 1 N in random directions at the sensor's origin: how many are found, and how soon."""
    rng = np.random.default_rng(13)
    found, late = [], []
    per_tool = 50
    for _ in range(contacts // per_tool):
        calibration, rig = calibrated(rng)
        n = per_tool * 500
        R, _ = motion(rng, n)
        wrench = noisy_readings(rig, R, NOISE, rng)
        starts = 400 + 500 * np.arange(per_tool)
        for start in starts:
            force = rng.normal(size=3)
            wrench[start : start + 100, :3] += force / np.linalg.norm(force)
        compensator = Compensator(calibration, rate=RATE, noise=NOISE, lowpass=lowpass, drift=TYPICAL_DRIFT)
        batch = compensator.run(wrench, R, np.arange(n) / RATE)
        for start in starts:
            flagged = np.flatnonzero(batch.contact[start : start + 100] == 1)
            found.append(len(flagged) > 0 and flagged[0] <= 10)
            late.append(flagged[0] if len(flagged) else 100)
    name = "no low-pass" if lowpass is None else f"low-pass {lowpass:g} Hz"
    least = 90.0 if lowpass is None else None
    yield Row(
        f"1 N found within 10 ms, {name}",
        100.0 * float(np.mean(found)),
        "%",
        least,
        remark=f"median {np.median(late):.3g} ms",
    )


@dataclass(frozen=True, eq=False)
class Touch:
    """A contact of the shift: from sample to sample, and its wrench."""

    start: int
    stop: int
    wrench: Array


def touches(rng: np.random.Generator, n: int, rate: float, count: int) -> list[Touch]:
    """Contacts of 1 N and more lasting 0.1 to 60 s, at points within 0.1 m, spread over the samples."""
    lasting = np.exp(rng.uniform(np.log(0.1), np.log(60.0), count)) * rate
    free = rng.dirichlet(np.ones(count + 1)) * (n - lasting.sum() - count * rate) + rate
    found, at = [], 0.0
    for gap, length in zip(free[:-1], lasting, strict=True):
        at += gap
        force = rng.normal(size=3)
        force *= (1.0 + rng.exponential(3.0)) / np.linalg.norm(force)
        torque = np.cross(rng.uniform(-0.1, 0.1, 3), force)
        found.append(Touch(int(at), int(at + length), np.r_[force, torque]))
        at += length
    return found


def shift(hours: float, rate: float) -> Iterator[Row]:
    """A shift of a sensor that warms up and walks, with contacts."""
    rng = np.random.default_rng(14)
    calibration, rig = calibrated(rng)
    n, batch = int(hours * HOUR * rate), int(30.0 * rate)
    contacts = touches(rng, n, rate, int(125 * hours))
    pressed: Any = np.zeros(n, dtype=np.int32)
    for number, touch in enumerate(contacts, 1):
        pressed[touch.start : touch.stop] = number
    direction = rng.normal(size=3)
    warm = np.r_[direction / np.linalg.norm(direction), 0.05 * rng.normal(size=3)]
    step = np.array([0.02] * 3 + [0.001] * 3) / np.sqrt(HOUR * rate)
    compensator = Compensator(calibration, rate=rate, noise=NOISE, drift=TYPICAL_DRIFT)
    walked, at, flags, off, learned = np.zeros(6), None, [], [], []
    reported: list[Contact] = []
    seconds = 0.0
    ramp = max(int(0.02 * rate), 1)
    loads = np.vstack([np.zeros(6), *(touch.wrench for touch in contacts)])
    for start in range(0, n, batch):
        rows = np.arange(start, min(start + batch, n))
        R, at = motion(rng, len(rows), rate, at)
        walk = walked + np.cumsum(rng.normal(size=(len(rows), 6)) * step, axis=0)
        walked = walk[-1]
        t = rows / rate
        bias = warm * (1.0 - np.exp(-t / 1200.0))[:, None] + walk
        share = np.minimum(1.0, (rows - _starts(contacts)[pressed[rows]]) / ramp)
        wrench = noisy_readings(rig, R, NOISE, rng) + bias + loads[pressed[rows]] * share[:, None]
        clock = time.perf_counter()
        for part in np.array_split(np.arange(len(rows)), 30):
            result = compensator.run(wrench[part], R[part], t[part])
            flags.append(result.contact == 1)
            reported += result.contacts
            off.append(np.linalg.norm((compensator.drift - bias[part[-1]])[:3]))
            learned.append(pressed[rows[part[-1]]])
        seconds += time.perf_counter() - clock
    flag, error, inside = np.concatenate(flags), np.array(off), np.array(learned)
    yield from judged(contacts, flag, pressed, error, inside, reported, rate)
    yield Row("time of a sample", 1e6 * seconds / n, "us", remark=f"{hours:g} h at {rate:g} Hz, batches of a second")


def _starts(contacts: list[Touch]) -> Array:
    return np.array([0.0, *(touch.start for touch in contacts)])


def judged(
    contacts: list[Touch],
    flag: Array,
    pressed: Array,
    error: Array,
    inside: Array,
    reported: list[Contact],
    rate: float,
) -> Iterator[Row]:
    late = int(0.02 * rate) + int(0.01 * rate)
    share = np.array([flag[min(c.start + late, c.stop - 1) : c.stop].mean() for c in contacts])
    settled = np.arange(len(error)) > 5
    rms = float(np.sqrt(np.mean(error[settled] ** 2) / 3.0))
    yield Row("RMS bias error of a force axis", rms / NOISE[0], "x noise", most=3.0, remark=f"{1e3 * rms:.3g} mN")
    yield Row("largest bias error, in contact or not", float(error[settled].max()), "N")
    yield Row("contacts held for 99 % of their time", 100.0 * float(np.mean(share > 0.99)), "%", least=100.0)
    lost = int(np.sum((inside > 0) & (error > 0.5)))
    yield Row("seconds in contact with 0.5 N of it learned away", lost, "", most=0.0)
    near = pressed.astype(bool)
    false = 0
    for contact in reported:
        first, last = int(contact.onset * rate), int(np.ceil((contact.release or contact.onset) * rate))
        false += not near[max(first - 1, 0) : last + 1].any()
    yield Row("contacts that were none", false, "", remark=f"{len(reported)} reported, {len(contacts)} true")


def share_of_limit(what: str, seconds: float, limit: float, yardstick: float, remark: str = "") -> Row:
    """A thread's own time over its limit (s), which is for a machine on which `stepper()` takes `YARDSTICK`.

    Its own, as on a machine that is shared the clock on the wall measures the others.
    """
    unit, scale = ("s", 1.0) if limit >= 1.0 else ("us", 1e6)
    said = f"{scale * seconds:.3g} {unit}, {scale * limit:.3g} allowed where stepper() takes {1e6 * YARDSTICK:.2g} us"
    here = f"{said}; {1e6 * yardstick:.3g} us meanwhile{remark}"
    return Row(what, seconds / limit * YARDSTICK / yardstick, "of its limit", most=1.0, remark=here)


def cost(calls: int, fast: bool) -> Iterator[Row]:
    """One call: compensate, low-pass of order 4, sensor filter, delay, drift, detect; the arm turns all the time."""
    rng = np.random.default_rng(15)
    calibration, rig = calibrated(rng)
    n = 10_000
    t = np.arange(n) / RATE
    turn = Rotation.from_rotvec(np.outer(np.sin(0.628 * t), [0.3, 1.0, 0.2]))
    wrench, quat_xyzw = noisy_readings(rig, turn.as_matrix(), NOISE, rng), turn.as_quat()
    compensator = Compensator(
        calibration,
        rate=RATE,
        noise=NOISE,
        lowpass=LowPass(100.0, 4),
        sensor_filter=50.0,
        delay=0.005,
        drift=TYPICAL_DRIFT,
        fast=fast,
    )
    step, rows = calibration.stepper(), np.hstack([wrench, quat_xyzw]).tolist()
    seconds, own, memory = np.empty(calls), np.empty(calls), 0
    plain, mean, batch, now = [], [], [], 0.0
    for start in range(0, calls, n):
        clock = time.thread_time()
        for row in rows:
            step(*row)
        plain.append((time.thread_time() - clock) / n)
        clock = time.thread_time()
        for i in range(n):
            compensator(wrench[i], quat_xyzw[i], now + i / RATE)
        mean.append((time.thread_time() - clock) / n)
        now += n / RATE
        for i in range(n):
            wall, clock = time.perf_counter(), time.thread_time()
            compensator(wrench[i], quat_xyzw[i], now + i / RATE)
            own[start + i] = time.thread_time() - clock
            seconds[start + i] = time.perf_counter() - wall
        now += n / RATE
        clock = time.thread_time()
        compensator.run(wrench, quat_xyzw, now + t)
        batch.append((time.thread_time() - clock) / n)
        now += n / RATE
        if start == 0:
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
    name, (most, most_rare, most_batch) = ("with numba", LIMITS) if fast else ("without numba", LIMITS_WITHOUT_NUMBA)
    usual, rare = float(np.median(plain)), float(np.quantile(own, 0.999))
    yield share_of_limit(f"a call, {name}: mean", float(np.median(mean)), most, usual)
    on_the_wall = f"; {1e6 * float(np.quantile(seconds, 0.999)):.3g} us on the wall's clock"
    yield share_of_limit(f"a call, {name}: p99.9", rare, most_rare, usual, on_the_wall)
    yield share_of_limit(f"a sample of a batch, {name}", float(np.median(batch)), most_batch, usual)
    unit = 2**20 if sys.platform == "darwin" else 2**10
    yield Row(f"memory grown over {calls} calls, {name}", grown / unit, "MiB", most=1.0)


def compilation() -> Iterator[Row]:
    """The first Compensator of a machine, and the first of a process once the step is in numba's cache."""
    script = (
        "import time; from contactwrench.compensate.runner import compiled; import numba, scipy.special; "
        "start = time.process_time(); compiled({}); print(time.process_time() - start)"
    )
    step, plain, seconds = calibrated(np.random.default_rng(15))[0].stepper(), [], []
    with TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        for inertia in (False, False, True):
            command = [sys.executable, "-c", script.format(inertia)]
            done = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
            while done.poll() is None:
                clock = time.thread_time()
                for _ in range(1000):
                    step(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 1.0)
                plain.append((time.thread_time() - clock) / 1000)
                time.sleep(0.05)
            seconds.append(float(done.communicate()[0]))
    usual = float(np.median(plain))
    first, cached, of_inertia = seconds
    yield share_of_limit("the step compiled for the first time", first, 10.0, usual)
    yield share_of_limit(
        "the step of a tool whose inertia is known compiled for the first time", of_inertia, 10.0, usual
    )
    yield share_of_limit("the step from the cache", cached, 1.0, usual)


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table, one after the other."""
    less = 10 if quick else 1
    yield "Live: gravity left of a turn at 60 deg/s, first-order 10 Hz filter in the sensor", turning()
    yield (
        f"Live: false alarms of free samples, {FALSE_ALARMS:g} stated",
        (false_alarms(case, 1000 // less, 2000) for case in CASES),
    )
    yield (
        "Live: contacts of 1 N at 0.05 N noise and 1 kHz",
        (row for lowpass in (None, 100.0) for row in pushes(lowpass, 2000 // less)),
    )
    yield from live_noise.tables(quick)
    numba = find_spec("numba") is not None
    yield "Live: a shift with warm-up, walk and contacts", shift(8.0 / less, RATE if numba else RATE / 10.0)
    yield (
        "Live: what a sample costs",
        (
            row
            for fast in ([True, False] if numba else [False])
            for row in cost((1_000_000 if fast else 100_000) // less, fast)
        ),
    )
    if numba:
        yield "Live: the step is compiled", compilation()
