"""Model `dynamic` on the virtual rig: what is left of a free tool's readings in fast motion, how well inertia and the
sensor's place are known and whether their intervals hold, with poses as robots give them and an arm that shakes; speed.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.dynamics import elements, inertial_jacobian
from contactwrench.compensate.contact_wrenches import ContactWrenches, contact_wrenches
from contactwrench.compensate.delay import delay_of
from contactwrench.estimation.priors import tool_of
from contactwrench.samples.accelerometer import Accelerometer
from contactwrench.samples.flange_motion import FlangeMotion, flange_motion
from contactwrench.simulate.trajectory import Push
from tests.support.in_motion import RAMP, Moving, moving
from tests.support.moving_tool import known
from tests.support.world import Array, random_rotations

from .clock import median_seconds
from .speed import MIB, extra_memory, memcpy
from .table import Row
from .trials import BLIND, DEVELOPMENT, Found, ratio, run, share_row

TRIALS = 20
STOPS, SECONDS, RATE = 12, 30.0, 1000.0
LOW_PASS = 20.0
"""Hz, of second order, behind which the contact force is judged."""
FORCE_NOISE, TORQUE_NOISE = 0.05, 0.002
"""N and N m, of a reading of `tests.support.in_motion.TOOL`."""
INTERVAL = 1.96
"""Standard deviations, of a 95 % interval."""
FREE_SECONDS, PUSHES, PUSH = 600.0, 48, 5.0
"""s; and N."""
THINNED = 10
"""Of readings, one in so many: the information of all."""
SAMPLES = 10_000_000
BYTES_OF_SAMPLE = 64


@dataclass(frozen=True)
class Cell:
    """How poses come (their rate, Hz, None: with each reading; noise in deg and m, or of the joint angles that they
    follow from, deg), and `arm.vibration`.
    """

    name: str
    pose_rate: float | None = None
    noise_deg: float = 0.0
    noise_m: float = 0.0
    joint_deg: float = 0.0
    vibration: tuple[float, float] = (0.0, 0.0)

    def samples(self, of: Moving, delay: float = 0.0) -> cw.Samples:
        """What is recorded, paired with the poses of `delay` s before."""
        return of.samples(self.pose_rate, self.noise_deg, self.noise_m, delay, self.joint_deg)


CELLS = (
    Cell("exact poses at 1 kHz"),
    Cell("poses at 100 Hz, 0.01 deg, 0.02 mm", 100.0, 0.01, 2e-5),
    Cell("exact poses at 1 kHz, 12 and 30 Hz vibration", vibration=(0.1, 0.2)),
    Cell("poses at 100 Hz, 0.01 deg, 0.02 mm, vibration", 100.0, 0.01, 2e-5, vibration=(0.1, 0.2)),
    Cell("joint states at 500 Hz, 0.001 deg", 500.0, joint_deg=0.001),
)
JUDGED = CELLS[0]
"""The targets are set for this one; the others stand beside it."""


def _any_tool(rng: np.random.Generator) -> list[str]:
    """Settings of a tool of 1 kg, mounted anyhow: four masses that lie 50 mm apart."""
    places = 0.05 * rng.normal(size=(4, 3))
    places -= places.mean(axis=0)
    second = 0.25 * places.T @ places
    inertia = elements(np.trace(second) * np.eye(3) - second)
    com = [*rng.uniform(-0.03, 0.03, 2), rng.uniform(0.02, 0.1)]
    return [
        f"tool.inertia={inertia.tolist()}",
        f"tool.com={[float(value) for value in com]}",
        f"mounting.yaw_deg={rng.uniform(-180.0, 180.0)}",
        f"mounting.tilt_deg={rng.uniform(-2.0, 2.0, 2).tolist()}",
        f"mounting.height={rng.uniform(0.02, 0.1)}",
    ]


def trial(cell: Cell, rng: np.random.Generator) -> dict[str, float]:
    """A tool is calibrated, and its readings in another free motion, which the calibration never saw, compensated
    offline.
    """
    settings = [*_any_tool(rng), f"arm.vibration={list(cell.vibration)}"]
    true, other = (
        moving(int(rng.integers(2**31)), *settings, stops=stops, seconds=SECONDS, rate=RATE) for stops in (STOPS, 0)
    )
    found = cw.calibrate(cell.samples(true), "dynamic")
    if found.dynamics is None or found.com is None:
        raise cw.InputError("found no dynamics")
    off = np.r_[elements(found.dynamics.inertia - true.settings.inertia), found.dynamics.sensor_offset - true.offset]
    samples = cell.samples(other, delay_of(found))
    contact = contact_wrenches(found, samples)
    t = np.asarray(samples.t)
    free = (t > other.begin + RAMP) & (t < t[-1] - RAMP)
    noise = np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)
    over_std = (contact.wrench[free] ** 2).mean(axis=0) / (contact.std[free] ** 2 + noise**2).mean(axis=0)
    still = found.compensate(samples.wrench, samples.R_base_flange)
    dynamic, static = (_low_passed(wrench[:, :3])[free] for wrench in (contact.wrench, still))
    largest = float(np.linalg.eigvalsh(true.settings.inertia)[2])
    return {
        "left": float(np.mean(dynamic**2)),
        "static": float(np.mean(static**2)),
        "force over std": float(over_std[:3].mean()),
        "torque over std": float(over_std[3:].mean()),
        "inertia": 100.0 * float(np.abs(off[:6]).max()) / largest,
        "com": 1e3 * float(np.linalg.norm(found.com - np.array(true.settings.tool.com))),
        "offset": 1e3 * float(np.linalg.norm(off[6:])),
        "bandwidth": found.dynamics.bandwidth,
        **{f"off {k}": float(value) for k, value in enumerate(off / found.dynamics.std)},
        **{f"over bound {k}": float(value) for k, value in enumerate(found.dynamics.std / _bound(found, true))},
    }


def _bound(found: cw.Calibration, true: Moving) -> Array:
    """The least std (9,) that inertia and offset can have (Cramer and Rao): of all that every reading tells of them and
    of the tool, with the noise as it is.
    """
    samples, tool = true.recorded.samples.select(slice(None, None, THINNED)), tool_of(found)
    terms = flange_motion(true.recorded.samples).terms[::THINNED]
    inertia, names = true.settings.inertia, found.parameter_names
    of_terms = inertial_jacobian(tool, float(found.mass or 0.0), inertia, true.offset, names)
    J = np.einsum("nt,tap->nap", terms, of_terms)
    J[:, :, : len(names)] += found.free_wrench_jacobian(samples.R_base_flange)
    J /= np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)[:, None]
    information = THINNED * np.einsum("nap,naq->pq", J, J)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information)))[len(names) :])


def _low_passed(signal: Array) -> Array:
    from scipy.signal import butter, lfilter

    numerator, denominator = butter(2, LOW_PASS, fs=RATE)
    return np.asarray(lfilter(numerator, denominator, signal, axis=0))


def _filtered_noise() -> float:
    """Standard deviation, N, of an axis of the sensor's white noise behind the filter."""
    impulse = np.zeros((4000, 1))
    impulse[0] = FORCE_NOISE
    return float(np.linalg.norm(_low_passed(impulse)))


def accuracy(cell: Cell, found: Found) -> Iterator[Row]:
    """The figures of a cell, with targets where it is the one that is judged."""
    judged, noise = cell == JUDGED, np.full(len(found), _filtered_noise() ** 2)

    def most(target: float) -> float | None:
        return target if judged else None

    left, error = ratio(found.get("left"), noise)
    remark = f"{1e3 * left * _filtered_noise():.3g} mN; {found.remark}"
    yield Row("contact force in free motion behind 20 Hz", left, "x noise", None, most(1.5), remark, error)
    gained, error = ratio(found.get("static"), found.get("left"))
    yield Row("static over dynamic compensation", gained, "x", 5.0 if judged else None, None, "", error)
    for name, unit, target in (("inertia", "% of largest", 3.0), ("com", "mm", 1.0), ("offset", "mm", None)):
        value, error = ratio(found.get(name) ** 2, np.ones(len(found)))
        worst = f"worst {found.get(name).max(initial=0.0):.3g}"
        yield Row(f"{name}, RMS error", value, unit, None, None if target is None else most(target), worst, error)
    limits = (92.0, 98.0) if judged else (None, None)
    for name, places in (("inertia", range(6)), ("offset", range(6, 9))):
        off = np.array([found.get(f"off {k}") for k in places])
        inside = (np.abs(off) < INTERVAL).mean(axis=0)
        yield share_row(f"{name}, 95 % intervals that hold the truth", inside, *limits)
        value, error = ratio((off**2).mean(axis=0), np.ones(len(found)))
        yield Row(f"{name}, RMS error over std", value, "", standard_error=error)
    if judged:  # the others' poses are noisy too
        each = np.array([found.get(f"over bound {k}") for k in range(9)])
        remark = f"each {each.mean(axis=1).min():.3g} to {each.mean(axis=1).max():.3g}"
        error = float(each.mean(axis=0).std() / np.sqrt(each.shape[1]))
        yield Row("inertia and offset, std over the bound", float(each.mean()), "", 0.9, 1.1, remark, error)
    for name in ("force", "torque"):
        value, error = ratio(found.get(f"{name} over std"), np.ones(len(found)))
        yield Row(f"contact {name} in free motion, RMS over std", value, "", standard_error=error)
    yield Row("bandwidth of the motion, median", float(np.median(found.get("bandwidth"))), "Hz")


def online(cell: Cell, seed: int) -> Iterator[Row]:
    """A `Compensator` behind the low-pass, reading by reading: ten minutes of free motion, and a minute with pushes."""
    shaken = f"arm.vibration={list(cell.vibration)}"
    begun = moving(seed, shaken, stops=STOPS, seconds=SECONDS, rate=RATE)
    calibration = cw.calibrate(cell.samples(begun), "dynamic")
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(PUSHES, 3))
    forces = PUSH * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    pushes = tuple(Push(2.0 + 1.2 * k, 2.25 + 1.2 * k, force) for k, force in enumerate(forces))
    free = moving(seed + 1, shaken, stops=0, seconds=FREE_SECONDS, rate=RATE)
    pushed = moving(seed + 2, shaken, stops=0, seconds=4.0 + 1.2 * PUSHES, rate=RATE, pushes=pushes)
    judged = cell == JUDGED
    rows = _by_compensator(calibration, free, cell)
    still = np.asarray(free.recorded.t > RAMP)
    left = float(np.sqrt(np.mean(rows.wrench[still, :3] ** 2)))
    yield Row("contact force in free motion", left / _filtered_noise(), "x noise", most=2.5 if judged else None)
    std = np.sqrt(np.mean(rows.std[still, :3] ** 2) + _filtered_noise() ** 2)
    yield Row("the same over what its std says", left / float(std), "")
    yield Row("contacts in ten minutes of free motion", float(len(rows.contacts)), "", most=1.0)
    rows, t = _by_compensator(calibration, pushed, cell), pushed.recorded.t - pushed.begin
    felt = [np.flatnonzero((t >= push.t_start) & (t < push.t_end) & (rows.contact == 1)) for push in pushes]
    after = np.array([t[k[0]] - p.t_start if len(k) else np.inf for k, p in zip(felt, pushes, strict=True)])
    what = f"pushes of {PUSH:g} N felt within 20 ms"
    remark = f"median {1e3 * float(np.median(after)):.0f} ms, latest {1e3 * after.max():.0f}"
    yield Row(what, 100.0 * float(np.mean(after <= 0.02)), "%", 95.0 if judged else None, remark=remark)


def _by_compensator(calibration: cw.Calibration, motion: Moving, cell: Cell) -> ContactWrenches:
    """Poses are held from one to the next."""
    rec, rng = motion.recorded, np.random.default_rng(9)
    held = (np.arange(len(rec.t)) // round(RATE / (cell.pose_rate or RATE))) * round(RATE / (cell.pose_rate or RATE))
    R, position = motion.poses(slice(None), cell.noise_deg, cell.noise_m, cell.joint_deg, rng)
    noise = np.repeat([FORCE_NOISE, TORQUE_NOISE], 3)
    compensator = cw.Compensator(calibration, rate=RATE, lowpass=LOW_PASS, noise=noise)
    return compensator.run(rec.wrench, R[held], rec.t, position=position[held])


def identification() -> Iterator[Row]:
    """From samples to a calibration."""
    whole = moving(1, stops=8, seconds=30.0, rate=RATE)
    for cell in CELLS[:2]:
        samples = cell.samples(whole)
        seconds = median_seconds(lambda samples=samples: cw.calibrate(samples, "dynamic"), 3)  # type: ignore[misc]
        yield Row(f"identification, {samples.t[-1] - samples.t[0]:.0f} s, {cell.name}", seconds, "s", most=2.0)  # type: ignore[index]


def batch(n: int) -> Iterator[Row]:
    """Batch compensation of `n` samples with a motion, into an `out=` that was touched, against memcpy."""
    rng = np.random.default_rng(2)
    copying = memcpy(n * BYTES_OF_SAMPLE, rng)
    calibration, wrench, R = known(0)[1], rng.random((n, 6)), np.tile(random_rotations(1000, rng), (n // 1000, 1, 1))
    quaternions = rng.normal(size=(n, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    omega, alpha, change = (rng.random((n, 3)) for _ in range(3))
    motion, out = FlangeMotion(omega, alpha, change, R, np.ones(n, np.bool_)), wrench + 1.0

    def subtract() -> Array:
        return calibration.compensate(wrench, quaternions, out=out, motion=motion)

    seconds = median_seconds(subtract, 5)
    remark = f"{1e9 * seconds / n:.3g} ns a sample"
    yield Row(f"batch of {n:.0e} samples with a motion", seconds / copying, "x memcpy", most=4.0, remark=remark)
    still = median_seconds(lambda: calibration.compensate(wrench, quaternions, out=out), 5)
    yield Row("the same at rest", still / copying, "x memcpy")
    yield Row("extra memory", extra_memory(subtract) / MIB, "MiB", most=64.0)


def calls() -> Iterator[Row]:
    """A call of a `Compensator` with inertia, over one without: by positions, and by an accelerometer's readings."""
    whole = moving(1, stops=8, seconds=8.0, rate=RATE)
    calibration, arm = cw.calibrate(whole.samples(), "dynamic"), whole.recorded.samples.select(slice(-8000, None))
    R, still = Rotation.from_matrix(arm.R_base_flange).as_quat(), replace(calibration, dynamics=None)
    sits = Accelerometer(np.eye(3), np.zeros(3), 0.01, 0.004)
    by_one = replace(calibration, dynamics=replace(calibration.dynamics, accelerometer=sits))  # type: ignore[type-var]

    def seconds(of: cw.Calibration, fast: bool, *names: str) -> float:
        compensator = cw.Compensator(of, rate=RATE, lowpass=LOW_PASS, noise=FORCE_NOISE, fast=fast)
        told = [dict.fromkeys(names, place) for place in np.asarray(arm.position)]
        spent = []
        for turn in range(5):
            t, clock = (turn * len(R) / RATE + np.arange(len(R)) / RATE).tolist(), time.thread_time()
            for k, now in enumerate(t):
                compensator(arm.wrench[k], R[k], now, **told[k])
            spent.append(time.thread_time() - clock)
        return float(np.median(spent))

    for name, fast in (("with numba", True), ("without numba", False)):
        static = seconds(still, fast)
        remark = f"{1e6 * static / len(R):.3g} us without"
        for what, of in (("position", calibration), ("acceleration", by_one)):
            most = 2.0 if fast else None
            yield Row(f"a call, {what}, {name}", seconds(of, fast, what) / static, "x static", most=most, remark=remark)


def tables(pool: Executor, quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Every table of model `dynamic`."""
    n, seed = (max(TRIALS // 10, 2), DEVELOPMENT) if quick else (TRIALS, BLIND)
    for k, cell in enumerate(CELLS):
        yield f"Dynamic: {cell.name}", _judged(pool, cell, n, (seed, k))
    for cell in CELLS:
        yield f"Dynamic: online, {cell.name}", online(cell, seed)
    yield "Dynamic: identification", identification()
    yield "Dynamic: batch compensation with a motion, quaternions", batch(SAMPLES // 10 if quick else SAMPLES)
    yield "Dynamic: one call", calls()


def _judged(pool: Executor, cell: Cell, n: int, seed: Sequence[int]) -> Iterator[Row]:
    """Nothing is computed before the table is asked for."""
    yield from accuracy(cell, run(pool, trial, [cell], n, tuple(seed))[0])
