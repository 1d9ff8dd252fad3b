"""Noise that is not white, and what strong pushes leave, behind the Compensator with nothing stated of the noise. Both
are drawn here: 1/f noise by its spectrum, a remnant that stays, adds up or decays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.compensator import Compensator
from contactwrench.samples.still_noise import StillNoise
from tests.support.world import Array, Rig, random_rig, random_rotations, readings

from .table import Row

RATE = 1000.0
WHITE = np.array([0.1, 0.1, 0.1, 0.004, 0.004, 0.004])
"""N and N m: std of the white noise of a sample."""
OCTAVES_OF_A_MINUTE = np.log(30_000.0)
FALSE_ALARMS = 1e-4
STOPS, STOP_ROWS = 24, 3000
DURATIONS = np.array([0.01, 0.03, 0.1, 1.0])
PUSH, APART = 30.0, (1.5, 2.5)
"""N; s between pushes."""


@dataclass(frozen=True)
class Case:
    """1/f noise with a std of so many N within a minute, and how the Compensator is set."""

    one_over_f: float
    drift: float | None = None
    learned: bool = False

    @property
    def name(self) -> str:
        """In words."""
        how = ", learned live" if self.learned else ""
        return f"1/f of {self.one_over_f:g} N{how}{'' if self.drift is None else f', drift {self.drift:g}'}"


CASES = (
    *(Case(size, drift) for drift in (None, 0.05) for size in (0.0, 0.02, 0.05, 0.1)),
    *(Case(size, learned=True) for size in (0.0, 0.02, 0.05, 0.1)),
)


def one_over_f(rng: np.random.Generator, n: int) -> Array:
    """1/f noise (n, 6) by its spectrum, with a std of 1 within a minute; it does not come back to where it began."""
    f = np.fft.rfftfreq(2 * n, 1.0 / RATE)
    f[0] = np.inf
    drawn = rng.normal(size=(len(f), 6)) + 1j * rng.normal(size=(len(f), 6))
    spectrum = np.sqrt(2.0 * n * RATE / 4.0 / OCTAVES_OF_A_MINUTE / f)
    noise: Array = np.fft.irfft(drawn * spectrum[:, None], 2 * n, axis=0)[:n]
    return noise


def calibrated(rng: np.random.Generator, case: Case, live: int) -> tuple[cw.Calibration, Rig, Array]:
    """From stops of 3 s, as rows or, where the noise is to be `learned`, as a table of their means; what is true; and
    the noise (live, 6) that follows the last stop.
    """
    rig, R = random_rig(rng), random_rotations(STOPS, rng)
    rows = STOPS * STOP_ROWS
    noise = WHITE * (rng.normal(size=(rows + live, 6)) + case.one_over_f / WHITE[0] * one_over_f(rng, rows + live))
    stops = readings(rig, R)[:, None] + noise[:rows].reshape(STOPS, STOP_ROWS, 6)
    if case.learned:
        return cw.calibrate(cw.Samples(stops.mean(axis=1), R), "mount"), rig, noise[rows:]
    calibration = cw.calibrate(cw.Samples(stops.reshape(-1, 6), R.repeat(STOP_ROWS, axis=0)), "mount")
    return replace(calibration, still_noise=allan(stops)), rig, noise[rows:]


def allan(stops: Array) -> StillNoise:
    """The noise of means within stops (k, n, 6)."""
    deviations = []
    for rows in np.round(DURATIONS * RATE).astype(int):
        means = stops[:, : stops.shape[1] // rows * rows].reshape(len(stops), -1, rows, 6).mean(axis=2)
        deviations.append(np.sqrt(0.5 * np.mean(np.diff(means, axis=1) ** 2, axis=(0, 1))))
    return StillNoise(DURATIONS, np.array(deviations))


def swings(rng: np.random.Generator, n: int) -> Array:
    """Orientations (n, 3, 3) of an arm that swings about an axis and rests, in turn, for 2 s each."""
    axis = rng.normal(size=3)
    phase = np.arange(n) / RATE % 4.0
    angle = 0.4 * np.where(phase < 2.0, 1.0 - np.cos(np.pi * phase), 0.0)
    turn = Rotation.from_rotvec(angle[:, None] * axis / np.linalg.norm(axis))
    matrices: Array = (Rotation.random(random_state=rng) * turn).as_matrix()
    return matrices


def false_alarms(case: Case, calibrations: int, minutes: float) -> Iterator[Row]:
    """Samples beyond their threshold, and contacts, of a free tool behind a low-pass of 20 Hz."""
    n, shares, events = int(60.0 * minutes * RATE), np.empty(calibrations), np.empty(calibrations)
    for number in range(calibrations):
        rng = np.random.default_rng((16, number))
        calibration, rig, noise = calibrated(rng, case, n)
        R = swings(rng, n)
        compensator = Compensator(calibration, rate=RATE, lowpass=20.0, drift=case.drift, false_alarm_rate=FALSE_ALARMS)
        batch = compensator.run(readings(rig, R) + noise, R, np.arange(n) / RATE)
        last = compensator.last_contact
        shares[number] = np.mean(batch.statistic > batch.threshold) / FALSE_ALARMS
        events[number] = (len(batch.contacts) + (last is not None and last.release is None)) * 10.0 / minutes
    error, of_events = shares.std() / np.sqrt(calibrations), events.std() / np.sqrt(calibrations)
    remark = f"+- {error:.2g}, {calibrations} calibrations of {minutes:g} min"
    yield Row(f"{case.name}: false alarms", float(shares.mean()), "x stated", most=3.0, remark=remark)
    yield Row(f"{case.name}: false contacts", float(events.mean()), "in 10 min", most=1.0, remark=f"+- {of_events:.2g}")


def remnants(memory: float, adds_up: bool, count: int, drift: float | None) -> Iterator[Row]:
    """Pushes of 30 N, each of which leaves 0.1 to 0.3 % that decays with `memory` s: where it `adds_up` on what those
    before left, else in place of that; white noise and 1/f of 0.02 N, a low-pass of 20 Hz.
    """
    rng = np.random.default_rng((17, int(10 * min(memory, 1e6))))
    n = int((count * 4.0 + 60.0) * RATE)
    calibration, rig, noise = calibrated(rng, Case(0.02), n)
    force, begin = np.zeros((n, 6)), 2000
    spans: list[tuple[int, int, int]] = []
    for _ in range(count):
        end = begin + int(rng.uniform(0.3, 2.0) * RATE)
        push = rng.normal(size=3)
        push *= PUSH / np.linalg.norm(push)
        wrench = np.r_[push, np.cross(rng.uniform(-0.1, 0.1, 3), push)]
        following = end + int(rng.uniform(*APART) * RATE)
        force[begin:end] += wrench
        until = n if adds_up or len(spans) == count - 1 else following
        left = np.exp(-np.arange(until - end) / RATE / memory)
        force[end:until] += rng.uniform(0.001, 0.003) * wrench * left[:, None]
        spans.append((begin, end, following))
        begin = following
    R = swings(rng, n)
    compensator = Compensator(calibration, rate=RATE, lowpass=20.0, drift=drift)
    batch = compensator.run(readings(rig, R) + noise + force, R, np.arange(n) / RATE)
    held = batch.contact == 1
    ended = [not held[end + int(RATE) : following].any() for _, end, following in spans]
    kept = [bool(held[begin + 50 : end].all()) for begin, end, _ in spans]
    stays = "adds up" if adds_up else "stays until the next" if np.isinf(memory) else f"decays in {memory:g} s"
    name = f"a remnant that {stays}{'' if drift is None else f', drift {drift:g}'}"
    left_over = float(np.linalg.norm((compensator.drift - force[-1])[:3]))
    said = f"{len(batch.contacts)} contacts; at the end the bias is {1e3 * left_over:.2g} mN off"
    yield Row(f"{name}: ended within 1 s", 100.0 * float(np.mean(ended)), "%", least=100.0, remark=said)
    yield Row(f"{name}: held throughout", 100.0 * float(np.mean(kept)), "%", least=100.0)


def tables(quick: bool) -> Iterator[tuple[str, Iterator[Row]]]:
    """Both tables."""
    calibrations, minutes, count = (4, 2.0, 20) if quick else (40, 10.0, 100)
    yield (
        f"Live: free samples with 1/f noise beside {WHITE[0]:g} N of white noise, low-pass 20 Hz, noise not stated",
        (row for case in CASES for row in false_alarms(case, calibrations, minutes)),
    )
    ways = ((0.1, False), (1.0, False), (10.0, False), (np.inf, False), (np.inf, True))
    yield (
        f"Live: {count} pushes of {PUSH:g} N that leave 0.1 to 0.3 %",
        (row for drift in (None, 0.05) for memory, adds_up in ways for row in remnants(memory, adds_up, count, drift)),
    )
