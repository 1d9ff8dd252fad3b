"""Times of samples from a device's clock and the times of their arrival, of networks that delay as they like."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactwrench.live.clock import FASTEST, Clock, line_under

PERIOD = 0.01


def timed(device: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    clock = Clock()
    return np.array([clock.times([pair])[0][0] for pair in zip(arrival.tolist(), device.tolist(), strict=True)])


@pytest.mark.parametrize("ppm", [0.0, 80.0, -300.0])
def test_jitter_does_not_enter_the_times_and_a_clock_that_drifts_is_followed(ppm: float) -> None:
    rng = np.random.default_rng(1)
    true = 1.7e9 + PERIOD * np.arange(6_000)
    device = (true - true[0]) * (1.0 + 1e-6 * ppm) + 5.0
    found = timed(device, true + 2e-4 + rng.exponential(4e-3, len(true)))
    assert np.abs(found - true - 2e-4)[1_000:].max() < 1e-3


@given(st.integers(0, 10_000), st.integers(2, 60), st.floats(1e-6, 1.0))
def test_no_offset_lies_below_the_line(seed: int, n: int, spread: float) -> None:
    """Also where delays that grow or shrink ask for a rate that no quartz has."""
    rng = np.random.default_rng(seed)
    trend = rng.choice([0.0, 1e-2, -1e-2])
    t = np.cumsum(rng.uniform(0.4, 0.6, n))
    points = list(zip(t.tolist(), (trend * t + rng.exponential(spread, n)).tolist(), strict=True))
    slope, (at, offset) = line_under(points)
    assert abs(slope) <= FASTEST
    assert min(y - offset - slope * (x - at) for x, y in points) == pytest.approx(0.0, abs=1e-12)


def test_delays_that_grow_are_no_time() -> None:
    """A queue on the way that fills over 20 s makes the samples no later than the fastest quartz would."""
    true = 1.7e9 + PERIOD * np.arange(3_000)
    filling = np.clip((true - true[0] - 5.0) / 20.0, 0.0, 1.0) * 0.04
    found = timed(true - 1.7e9, true + filling)
    assert np.abs(found - true).max() < 30.0 * FASTEST


def test_a_device_that_begins_anew_within_what_came_together_is_timed_at_once() -> None:
    true = 1.7e9 + PERIOD * np.arange(200)
    device = np.r_[1_000.0 + PERIOD * np.arange(100), PERIOD * np.arange(100)]
    clock, found = Clock(), list[float]()
    for k in range(0, 200, 8):
        found += [
            t for t, _ in clock.times(list(zip(true[k : k + 8].tolist(), device[k : k + 8].tolist(), strict=True)))
        ]
    assert np.abs(found - true).max() < 1e-4


@pytest.mark.parametrize("pace", [1.05, 1.1, 2.0])
@pytest.mark.parametrize("each", [1, 40])
def test_a_clock_that_is_fast_is_known_in_two_seconds(pace: float, each: int) -> None:
    """A box at 5 % more than its rate, a bag that is played at twice its pace: no queue that is read takes as long."""
    arrival = 1.7e9 + PERIOD * np.arange(10_000)
    device = pace * PERIOD * np.arange(10_000)
    arrival = np.repeat(arrival[each - 1 :: each], each)
    clock, known = Clock(), list[bool]()
    for k in range(0, len(arrival), each):
        pieces = list(zip(arrival[k : k + each].tolist(), device[k : k + each].tolist(), strict=True))
        known += [is_known for _, is_known in clock.times(pieces)]
    begin = int(2.1 / PERIOD)
    assert all(known[begin:])
