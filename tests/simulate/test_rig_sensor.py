"""The rig's sensor: each of its effects alone, against what can be worked out by hand."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from contactwrench.errors import InputError
from contactwrench.simulate.sensor import Readings, SensorStream
from contactwrench.simulate.settings import Drift, Noise, Sensor
from tests.support.rigs import seeds
from tests.support.world import Array

NONE = (0.0,) * 6
SILENT = Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
RANGES = (70.0, 70.0, 70.0, 3.0, 1.0, 1.0)


def _perfect(**changes: Any) -> Sensor:
    """A sensor without any effect but those given, and without a limit that a test meets."""
    plain: dict[str, Any] = {
        "overload": 1e6, "bias": NONE, "noise": SILENT, "quantum": 0.0, "low_pass": 0.0, "delay": 0.0
    }  # fmt: skip
    return Sensor(**{**plain, **changes})


def _read(sensor: Sensor, wrench: Array, rate: float = 1000.0, seed: int = 0) -> Readings:
    return SensorStream(sensor, rate, np.random.default_rng(seed)).read(wrench)


def _wrenches(n: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(size=(n, 6)) * RANGES


def test_a_perfect_sensor_reads_what_is_there() -> None:
    wrench = _wrenches(50)
    readings = _read(_perfect(), wrench)
    assert np.array_equal(readings.wrench, wrench)
    assert not readings.saturated.any()


def test_gain_multiplies_axis_by_axis() -> None:
    gain = (0.974, 1.1, 0.5, 2.0, -1.0, 1.01)
    wrench = _wrenches(20)
    assert _read(_perfect(gain=gain), wrench).wrench == pytest.approx(wrench * gain, abs=1e-12)


@pytest.mark.parametrize("shown", range(6))
@pytest.mark.parametrize("felt", range(6))
def test_an_element_of_the_cross_talk_shows_one_axis_on_another(shown: int, felt: int) -> None:
    crosstalk = np.zeros((6, 6))
    crosstalk[shown, felt] = 0.03
    wrench = np.zeros((1, 6))
    wrench[0, felt] = 2.0
    expected = wrench[0].copy()
    expected[shown] += 0.06
    assert _read(_perfect(crosstalk=crosstalk), wrench).wrench[0] == pytest.approx(expected, abs=1e-15)


def test_the_bias_is_added_whatever_the_gain() -> None:
    bias = (3.769, -6.903, 57.657, 2.228, 0.963, -0.002)
    assert _read(_perfect(bias=bias, gain=(2.0,) * 6), np.zeros((3, 6))).wrench == pytest.approx(np.tile(bias, (3, 1)))


def test_warming_up_decays_with_its_time() -> None:
    warm_up = (1.0, -2.0, 5.0, 0.1, 0.2, -0.3)
    sensor = _perfect(drift=Drift(warm_up=warm_up, warm_up_time=100.0))
    readings = _read(sensor, np.zeros((601, 6)), rate=2.0).wrench
    assert readings[0] == pytest.approx(warm_up)
    assert readings[200] == pytest.approx(np.array(warm_up) / np.e)
    assert readings[600] == pytest.approx(np.array(warm_up) * np.exp(-3.0))


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.1, 1.0])
def test_a_random_walk_has_its_variance_after_an_hour_at_any_rate(rate: float) -> None:
    walk = (0.5, 0.1, 2.0, 0.01, 0.02, 0.03)
    sensor, rows = _perfect(drift=Drift(walk=walk)), round(3600 * rate)
    rng = np.random.default_rng(2)
    ends = np.array([SensorStream(sensor, rate, rng).read(np.zeros((rows, 6))).wrench[[rows // 4 - 1, -1]]
                     for _ in range(400)]) / walk  # fmt: skip
    quarter, hour = ends[:, 0].var(), ends[:, 1].var()
    five_sigma = 5.0 * np.sqrt(2.0 / ends[:, 0].size)
    assert hour == pytest.approx(1.0, rel=five_sigma)
    assert quarter == pytest.approx(0.25, rel=five_sigma)


def test_the_filter_answers_a_step_as_a_first_order_one_does() -> None:
    step = np.zeros((60, 6))
    step[1:] = 4.0
    readings = _read(_perfect(low_pass=20.0), step).wrench
    t = np.arange(60) / 1000.0
    expected = 4.0 * (1.0 - np.exp(-2.0 * np.pi * 20.0 * t))
    assert readings == pytest.approx(np.tile(expected[:, None], (1, 6)), abs=1e-12)


@pytest.mark.parametrize(("times", "decibels"), [(0.2, -0.1703), (1.0, -3.0103), (10.0, -20.0432)])
def test_the_filter_takes_3_db_at_its_cut_off(times: float, decibels: float) -> None:
    """20 dB a decade beyond; at a rate far over the cut-off, where a digital filter is as good as an analog one."""
    cut_off, rate = 50.0, 100_000.0
    t = np.arange(20_000) / rate
    wave = np.sin(2.0 * np.pi * cut_off * times * t)
    settled = _read(_perfect(low_pass=cut_off), np.repeat(wave[:, None], 6, axis=1), rate).wrench[10_000:, 0]
    assert 20.0 * np.log10(np.sqrt(2.0) * settled.std()) == pytest.approx(decibels, abs=0.03)


def test_the_filter_begins_settled() -> None:
    wrench = np.tile(_wrenches(1), (30, 1))
    assert _read(_perfect(low_pass=5.0), wrench).wrench == pytest.approx(wrench, abs=1e-12)


@pytest.mark.parametrize(("delay", "rows"), [(0.001, 1), (0.004, 4), (0.0034, 3), (0.0, 0)])
def test_the_delay_is_in_whole_rows(delay: float, rows: int) -> None:
    wrench = _wrenches(40)
    readings = _read(_perfect(delay=delay), wrench).wrench
    assert np.array_equal(readings[rows:], wrench[: 40 - rows])
    assert np.array_equal(readings[:rows], np.repeat(wrench[:1], rows, axis=0))


def test_a_saturated_channel_stops_and_says_so() -> None:
    wrench = np.array([[100.0, -100.0, 83.9, 3.7, -1.21, 1.19], [0.0, 84.0, -83.99, -3.59, 1.2, 0.5]])
    readings = _read(_perfect(overload=1.2), wrench)
    assert readings.wrench == pytest.approx(
        np.array([[84.0, -84.0, 83.9, 3.6, -1.2, 1.19], [0.0, 84.0, -83.99, -3.59, 1.2, 0.5]])
    )
    assert readings.saturated.tolist() == [
        [True, True, False, True, True, False],
        [False, True, False, False, True, False],
    ]


def test_bias_uses_up_the_range() -> None:
    readings = _read(
        _perfect(overload=1.0, bias=(0.0, 0.0, 57.657, 0.0, 0.0, 0.0)), np.array([[0.0, 0.0, 13.0, 0, 0, 0]])
    )
    assert readings.wrench[0, 2] == 70.0
    assert readings.saturated[0].tolist() == [False, False, True, False, False, False]


@given(st.floats(1e-4, 0.5), seeds)
@hypothesis_settings(deadline=None)
def test_readings_are_the_nearest_steps(quantum: float, seed: int) -> None:
    wrench = _wrenches(20, seed)
    readings = _read(_perfect(quantum=quantum), wrench).wrench
    assert np.abs(readings - wrench).max() <= 0.5 * quantum * (1.0 + 1e-9)
    steps = readings / quantum
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_one_over_f_noise_has_its_std_in_a_minute_and_as_much_in_each_octave() -> None:
    std = np.array([0.1, 0.05, 0.02, 0.002, 0.001, 0.0])
    sensor = _perfect(noise=Noise((0.0,) * 3, (0.0,) * 3, tuple(std.tolist())))
    minutes = []
    for seed in range(8):
        stream = SensorStream(sensor, 1000.0, np.random.default_rng(seed))
        parts = [stream.read(np.zeros((n, 6))).wrench for n in (1, 30_000, 29_999)]
        minutes.append(np.concatenate(parts))
    assert np.mean(np.var(minutes, axis=1), axis=0) == pytest.approx(std**2, rel=0.3)
    octaves = []
    for rows in 4 ** np.arange(1, 6):
        means = np.array(minutes)[:, : 60_000 // rows * rows].reshape(8, -1, rows, 6).mean(axis=2)
        octaves.append(np.mean(0.5 * np.diff(means, axis=1) ** 2, axis=(0, 1))[:5] / std[:5] ** 2)
    assert np.array(octaves) == pytest.approx(np.full((5, 5), np.log(4.0) / np.log(30_000.0)), rel=0.35)


def test_noise_has_its_std_in_each_axis_and_no_memory() -> None:
    noise = Noise((0.035, 0.1, 2.0), (0.0015, 0.0005, 0.01))
    readings = _read(_perfect(noise=noise), np.zeros((40_000, 6))).wrench / [*noise.force, *noise.torque]
    assert readings.std(axis=0) == pytest.approx(np.ones(6), abs=5.0 / np.sqrt(2.0 * 40_000))
    assert np.abs(readings.mean(axis=0)).max() < 5.0 / np.sqrt(40_000)
    between = np.corrcoef(np.concatenate([readings[1:], readings[:-1]], axis=1).T) - np.eye(12)
    assert np.abs(between).max() < 5.0 / np.sqrt(40_000)


@pytest.mark.slow
@given(
    st.lists(st.integers(0, 30), max_size=12), st.sampled_from([0.0, 3.0, 60.0]), st.sampled_from([0.0, 0.001, 0.007])
)
@hypothesis_settings(deadline=None)
def test_blocks_of_any_length_read_as_one(lengths: list[int], low_pass: float, delay: float) -> None:
    sensor = _perfect(
        low_pass=low_pass, delay=delay, overload=1.0, bias=(3.0,) * 6,
        gain=(0.97,) * 6, drift=Drift(warm_up=(2.0,) * 6, warm_up_time=0.05),
    )  # fmt: skip
    wrench = _wrenches(sum(lengths))
    whole = _read(sensor, wrench)
    stream = SensorStream(sensor, 1000.0, np.random.default_rng(0))
    ends = np.cumsum([0, *lengths])
    for start, end in pairwise(ends):
        block = stream.read(wrench[start:end])
        assert np.allclose(block.wrench, whole.wrench[start:end], rtol=0.0, atol=1e-12)
        assert np.array_equal(block.saturated, whole.saturated[start:end])


def test_a_walking_bias_goes_on_from_block_to_block() -> None:
    sensor = _perfect(drift=Drift(walk=(1.0,) * 6))
    stream = SensorStream(sensor, 1.0, np.random.default_rng(3))
    blocks = [stream.read(np.zeros((rows, 6))).wrench for rows in (5, 0, 1, 1, 20)]
    steps = np.diff(np.concatenate(blocks), axis=0)
    assert np.abs(steps).max() < 6.0 / 60.0
    assert steps.all()


def test_the_same_seed_reads_the_same() -> None:
    sensor = Sensor(drift=Drift(walk=(1.0,) * 6))
    wrench = _wrenches(100)
    first, again, other = (_read(sensor, wrench, seed=seed).wrench for seed in (7, 7, 8))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_order_is_that_of_the_signals_way() -> None:
    """Gain acts on the wrench, not on the bias; the filter on both; noise comes after it, limits and steps last."""
    sensor = _perfect(
        gain=(2.0,) * 6, bias=(1.0,) * 6, low_pass=20.0, delay=0.002, overload=0.05, quantum=0.25,
        noise=Noise((0.3,) * 3, (0.3,) * 3),
    )  # fmt: skip
    wrench = np.zeros((12, 6))
    wrench[5:] = 1.0
    felt = 1.0 + 2.0 * (1.0 - np.exp(-2.0 * np.pi * 0.02 * np.maximum(np.arange(12) - 6.0, 0.0)))
    felt = felt[:, None] + 0.3 * np.random.default_rng(4).normal(size=(12, 6))
    limit = 0.05 * np.array(RANGES)
    readings = _read(sensor, wrench, seed=4)
    assert readings.wrench == pytest.approx(np.round(np.clip(felt, -limit, limit) * 4.0) / 4.0, abs=1e-12)
    assert np.array_equal(readings.saturated, np.abs(felt) >= limit)


@pytest.mark.parametrize("rate", [0.0, -1000.0])
def test_a_rate_that_cannot_be_is_refused(rate: float) -> None:
    with pytest.raises(InputError) as refused:
        SensorStream(Sensor(), rate, np.random.default_rng(0))
    assert str(refused.value) == f"the rate is {rate:g} Hz, expected more than 0"
