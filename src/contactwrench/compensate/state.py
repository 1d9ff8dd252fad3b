"""What a running Compensator knows, and a sample: declared once, attributes for plain Python, a record for numba."""
# ruff: noqa: RUF009, `numbers` gives a field

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from math import inf, nan
from typing import Any, TypeAlias, TypeVar

import numpy as np

Row: TypeAlias = list[float]
Matrix: TypeAlias = list[list[float]]
Function = TypeVar("Function", bound=Callable[..., Any])

PARAMETERS = 20
"""Of a calibration, that depend on the orientation, at most: those of `affine`."""
OCTAVES, OCTAVES_HELD = 20, 7
"""Of numbers of samples, over which the noise is learned, and for which a pose is held."""
THRESHOLDS = 400
"""Knots of the thresholds over the degrees of freedom."""
INTERVALS, MOST_INTERVALS = 24, 6144
"""Between stamps, from which the rate is taken: so few may have waited in a queue; then twice as many, to the last."""
ANOTHER = 1.02
"""Times the rate, or less than one over it: another rate."""
TERMS = 12
"""Of a motion, that a moving tool's wrench is linear in."""
OF_DOWN, OF_MOTION, OF_FELT = 7, 1 + TERMS, 4
"""Numbers of down, and of what it is carried on to, a motion, an accelerometer: side by side in a ring, time first."""
SECTIONS = 2
"""Second-order sections of a filter, at most; where the first coefficient is 0 there is none."""
LOG_SAME_UNSEEN = -0.0207  # of a channel that never moved: it may repeat 10,000 times

ENDED, RATE_FOUND, COVARIANCE, NOISE_LEARNED = 1, 2, 4, 8
"""Events of a sample: a contact ended, the rate is known or another, the covariance another, the noise learned."""

KERNEL: list[Callable[..., Any]] = []


def kernel(function: Function) -> Function:
    """Mark a function that runs both plain and compiled, of what numba compiles: numbers, lists, attributes, loops."""
    KERNEL.append(function)
    return function


def numbers(*shape: int, fill: float = 0.0) -> Any:
    """A field of so many floats: a list, or a list of rows."""
    return field(default_factory=lambda: np.full(shape, fill).tolist(), metadata={"shape": shape})


@dataclass(slots=True)
class Sample:
    """A sample: what is given, and what the step makes of it. `told` of the motion is the flange's position, or what an
    accelerometer reads. Where `passed` is no NaN it is a pose without a reading, so many s after the pose before.
    """

    reading: Row = numbers(6)
    orientation: Row = numbers(9)
    time: float = nan
    temperature: float = nan
    told: Row = numbers(3, fill=nan)
    passed: float = nan
    motion: Row = numbers(TERMS, fill=nan)
    motion_variance: Row = numbers(6, fill=nan)
    wrench: Row = numbers(6)
    wrench_std: Row = numbers(6)
    statistic: float = nan
    threshold: float = nan
    contact: int = -1
    fault: int = 0
    detail: float = 0.0
    channel: int = -1
    events: int = 0
    said: int = 0


@dataclass(slots=True)
class State:
    """Settings, and what is known from sample to sample. Orientations are row-major lists of 9 numbers."""

    # The tool and the sensor.
    B: Matrix = numbers(6, 4)
    gravity_direction: Row = numbers(3)
    ranges: Row = numbers(6)
    noise_variance: Row = numbers(6)
    per_kelvin: Row = numbers(6)
    delay: float = 0.0
    delay_std: float = 0.0
    look_back: float = 0.0
    past: float = 0.0
    minimum_duration: float = 0.0

    # What follows from the rate.
    interval: float = inf
    longest_gap: float = 1.0
    block_noise: Row = numbers(6, fill=inf)
    noise_filtered: Row = numbers(6, fill=inf)
    settled: int = 0
    lowpass: Matrix = numbers(SECTIONS, 5)
    sensor: Matrix = numbers(SECTIONS, 5)

    # Time, and what starts anew.
    time: float = nan
    stamps: int = 0
    stamps_awaited: int = INTERVALS
    counted: float = 0.0
    rate_found: float = nan
    fresh: int = 0
    since_fresh: int = 0
    temperature: float = 0.0
    first_temperature: float = nan

    # The noise, where it is learned: means over 1, 2, 4, ... samples, and their differences in pairs.
    knows_noise: bool = True
    learn_next: float = inf
    learned_from: float = 0.0
    learn_anew: bool = False
    means: Row = numbers(OCTAVES)
    first_mean: Matrix = numbers(OCTAVES, 6)
    squares: Matrix = numbers(OCTAVES, 6)

    # Filters and the delay.
    lowpass_memory: Matrix = numbers(2 * SECTIONS, 6)
    sensor_memory: Matrix = numbers(2 * SECTIONS, TERMS)
    down: Row = numbers(TERMS)  # of which three count, or all where it is carried on: as long as `seen`
    ring_next: int = 0
    ring_at: int = 0
    missed_at: int = 0
    missed: Matrix = numbers(2, 3)
    poses_from: float = 0.0

    # The tool's inertia, and how the flange moves, as in inertia.py.
    knows_inertia: bool = False
    D: Matrix = numbers(6, TERMS)
    uncertain: Matrix = numbers(6, 3)
    pose_gain: Row = numbers(OCTAVES_HELD, fill=1.0)
    poses_alone: bool = False
    placed: bool = False
    poses: int = 0
    pose_time: float = nan
    pose_period: float = 0.0
    pose_repeats: float = 0.0
    pose_usual: float = 0.0
    resting: bool = True
    unknown: int = 0
    pose_R: Row = numbers(9)
    last_position: Row = numbers(3)
    rate: Row = numbers(6)
    terms: Row = numbers(TERMS)
    seen: Row = numbers(TERMS)
    inertial: Row = numbers(6)
    trend: Row = numbers(6)
    off: Row = numbers(6)
    alike: Row = numbers(6)
    stopping: Row = numbers(6)
    stopping_until: float = -inf
    lag: Row = numbers(6)
    lag_memory: Matrix = numbers(2 * SECTIONS, 6)
    pose_noise: Row = numbers(6)
    noise_before: Row = numbers(6)
    motion_memory: Matrix = numbers(2 * SECTIONS, TERMS)
    motion_next: int = 0
    motion_at: int = 0

    # What an accelerometer says of that, as in acceleration.py.
    feels: bool = False
    felt_by: Matrix = numbers(3, 4)
    felt_late: float = 0.0
    felt_variance: float = 0.0
    g: float = 0.0
    felt_time: float = -inf
    felt_next: int = 0
    felt_at: int = 0
    felt_anew: bool = True
    felt_news: float = -inf
    felt_told: Row = numbers(3, fill=nan)
    specific_force: Row = numbers(3)
    felt_passed: float = inf
    felt: Row = numbers(3)
    felt_rate: Row = numbers(3)
    felt_off: float = 0.0

    # How fast down turns as the sensor sees it, 1/s, what a delay that is off makes of that, and of a turn carried on.
    followed: float = 0.0
    since_turn: float = 0.0
    last_down: Row = numbers(3)
    down_rate: Row = numbers(3)
    turned_by: Row = numbers(TERMS)
    turn_memory: Matrix = numbers(2 * SECTIONS, TERMS)

    # What shakes it, and the test in motion, as in shaking.py.
    shaking: Matrix = numbers(2, 2)
    shaken_by: Row = numbers(6)
    stirred: Row = numbers(2)
    shaken: float = 0.0
    of_motion: Row = numbers(6)
    stray: Matrix = numbers(3, 3)
    by_stray: Matrix = numbers(3, 6)
    stray_gram: Matrix = numbers(3, 3)

    # Faults of the reading and of the orientation.
    last_reading: Row = numbers(6)
    repeats: Row = numbers(6)
    measured: Row = numbers(6, fill=1.0)
    quantum: Row = numbers(6, fill=inf)
    log_same: Row = numbers(6, fill=LOG_SAME_UNSEEN)
    new_time: float = 0.0
    new_usual: float = 0.0
    R: Row = numbers(9)
    last_R: Row = numbers(9)
    last_turn: Row = numbers(9)
    turn_time: float = 0.0
    turn_usual: float = 0.0
    speed: float = 0.0
    sharpest: float = 0.0
    sharpest_time: float = 0.0
    steady: bool = False
    jitter: float = 0.0
    longest_rest: float = 0.0

    # What free readings are off the calibration, as in bias_tracking.py.
    follows_bias: bool = False
    follow_until: float = -inf
    walk: Row = numbers(6)
    flicker: Row = numbers(6)
    remnant: Row = numbers(6)
    between: Row = numbers(6)
    parameters: int = 0
    H_slope: list[Matrix] = numbers(6, PARAMETERS, 9)
    offset: Row = numbers(6)
    offset_time: float = nan
    age: float = 0.0
    offset_R: Row = numbers(9)
    offset_covariance: Matrix = numbers(6, 6)
    with_calibration: Matrix = numbers(6, PARAMETERS)
    with_pose: Row = numbers(6)
    lost: Row = numbers(6)
    moved: Matrix = numbers(6, PARAMETERS)
    of_eta: Row = numbers(PARAMETERS)
    column: Row = numbers(6)

    # The block of samples of the last 0.1 s, and the one before; since when they stay the same, how long they should.
    block_time: float = 0.0
    block_rows: float = 0.0
    block_sum: Row = numbers(6)
    spoiled: bool = False
    clean_blocks: int = 0
    block_mean: Row = numbers(6)
    block_variance: Row = numbers(6)
    block_R: Row = numbers(9)
    to_settle: float = 0.0
    same_since: float = nan
    same_mean: Row = numbers(6)
    same_R: Row = numbers(9)

    # The covariance of the contact wrench, `systematic` and of the noise, and the test against it, or the onset's.
    dof: float = 0.0
    fires: Row = numbers(THRESHOLDS)
    ends: Row = numbers(THRESHOLDS)
    begins: Row = numbers(THRESHOLDS)
    stale: bool = True
    covariance_time: float = nan
    covariance_R: Row = numbers(9)
    systematic: Matrix = numbers(6, 6, fill=nan)
    noise_left: Row = numbers(6, fill=nan)
    wrench_std: Row = numbers(6, fill=nan)
    whitening: Matrix = numbers(6, 6)
    whitening_then: Matrix = numbers(6, 6)
    fire: float = nan
    end: float = nan
    begin: float = nan

    # The contact, and what is kept of it when it has ended.
    touching: bool = False
    run: int = 0
    quiet: int = 0
    free_time: float = nan
    known_free: bool = False
    onset: float = nan
    onset_seen: bool = False
    release: float = nan
    contact_rows: float = 0.0
    contact_sum: Row = numbers(6)
    peak_statistic: float = 0.0
    peak: Row = numbers(6)
    contact_covariance: Matrix = numbers(6, 6)


def layout_of(declared: type[State] | type[Sample]) -> np.dtype[np.void]:
    """Of the record that stands for it."""
    kinds = {"int": np.int64, "bool": np.bool_}
    each = [(f.name, kinds.get(str(f.type), np.float64), f.metadata.get("shape", ())) for f in fields(declared)]
    return np.dtype(each, align=True)


STATE, SAMPLE = layout_of(State), layout_of(Sample)
