"""The Compensator on tools whose readings are known: what comes out, how sure it is, when something touches."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time
from copy import copy, deepcopy
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.bias_tracking import TYPICAL_DRIFT
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.compensate.filters import LowPass
from contactwrench.errors import InputError, MissingExtraError
from tests.support.live import RATE, calibrated, free, still, swinging, times
from tests.support.rigs import NOISE, seeds
from tests.support.world import Array, random_rotations, readings

EVERYTHING: dict[str, Any] = {
    "rate": RATE,
    "noise": NOISE,
    "lowpass": LowPass(60.0, 3),
    "sensor_filter": 80.0,
    "delay": 0.0123,
    "delay_std": 0.002,
    "drift": TYPICAL_DRIFT,
    "temperature_coefficient": np.full(6, 0.01),
}


def _compensator(calibration: cw.Calibration, **settings: Any) -> cw.Compensator:
    return cw.Compensator(calibration, noise=NOISE, **({"rate": RATE} | settings))


def _same(one: ContactWrenches, other: ContactWrenches) -> None:
    for name in ("wrench", "std", "t", "valid", "contact", "statistic", "threshold"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name
    assert one.reason == other.reason
    assert [(c.onset, c.release, c.mean.tolist()) for c in one.contacts] == [
        (c.onset, c.release, c.mean.tolist()) for c in other.contacts
    ]


@pytest.mark.slow
@settings(deadline=None, max_examples=2)
@given(seed=seeds)
def test_a_contact_comes_back_whatever_the_tool_and_its_mounting(seed: int) -> None:
    calibration, rig, rng = calibrated(seed, exact=True)
    R = swinging(rng, 50)
    contact = rng.normal(size=(50, 6))
    compensator = _compensator(calibration)
    wrench, turns, t = readings(rig, R) + contact, Rotation.from_matrix(R), times(50)
    batch = compensator.run(wrench, turns.as_quat(), t)
    assert np.abs(batch.wrench - contact).max() < 1e-7
    assert batch.valid.all()
    assert np.array_equal(_compensator(calibration).run(wrench, turns, t).wrench, batch.wrench)
    assert np.array_equal(_compensator(calibration)(wrench[0], turns[0], float(t[0])).wrench, batch.wrench[0])


@settings(deadline=None, max_examples=4)
@given(seed=seeds)
def test_a_free_tool_is_zero_within_its_std(seed: int) -> None:
    calibration, rig, rng = calibrated(seed)
    R = swinging(rng, 400)
    batch = _compensator(calibration).run(free(rig, R, rng), R, times(400))
    z = batch.wrench / batch.std
    assert np.abs(z).max() < 6.5
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.7


@settings(deadline=None, max_examples=4)
@given(seed=seeds)
def test_a_rotated_base_with_rotated_gravity_changes_nothing(seed: int) -> None:
    calibration, rig, rng = calibrated(seed)
    R = swinging(rng, 60)
    wrench, turn = free(rig, R, rng), Rotation.random(random_state=rng).as_matrix()
    here = _compensator(calibration, drift=TYPICAL_DRIFT).run(wrench, R, times(60))
    gravity = turn @ calibration.gravity_direction
    there = _compensator(calibration, drift=TYPICAL_DRIFT, gravity=gravity).run(wrench, turn @ R, times(60))
    assert there.wrench == pytest.approx(here.wrench, abs=1e-9)
    assert there.std == pytest.approx(here.std, rel=1e-6)


def _eventful(seed: int, n: int = 700) -> tuple[cw.Calibration, Array, Array, Array, Array]:
    """A calibration; readings with a contact, a NaN and a gap; quaternions, stamps and temperatures."""
    calibration, rig, rng = calibrated(seed)
    R = swinging(rng, n)
    wrench, t = free(rig, R, rng), times(n)
    wrench[150:300, 1] += 2.0
    wrench[400, 3] = np.nan
    t[500:] += 0.4
    return calibration, wrench, Rotation.from_matrix(R).as_quat(), t, np.linspace(20.0, 21.0, n)


@pytest.mark.slow
@settings(deadline=None, max_examples=2)
@given(seed=seeds, cuts=st.lists(st.integers(0, 700), max_size=4), given_rate=st.booleans())
def test_batches_are_sample_by_sample(seed: int, cuts: list[int], given_rate: bool) -> None:
    calibration, wrench, quat_xyzw, t, heat = _eventful(seed)
    settings = EVERYTHING | ({} if given_rate else {"rate": None})
    whole = cw.Compensator(calibration, **settings).run(wrench, quat_xyzw, t, heat)
    parts = cw.Compensator(calibration, **settings)
    edges = [0, *sorted(cuts), 700]
    batches = [parts.run(wrench[a:b], quat_xyzw[a:b], t[a:b], heat[a:b]) for a, b in pairwise(edges)]
    assert np.array_equal(np.concatenate([batch.wrench for batch in batches]), whole.wrench, equal_nan=True)
    assert sum((batch.reason for batch in batches), ()) == whole.reason
    assert [c.onset for batch in batches for c in batch.contacts] == [c.onset for c in whole.contacts]
    single = cw.Compensator(calibration, **settings)
    for k in range(700):
        sample = single(wrench[k], quat_xyzw[k], t[k], heat[k])
        assert np.array_equal(sample.wrench, whole.wrench[k], equal_nan=True)
        assert np.array_equal(sample.std, whole.std[k], equal_nan=True)
        assert (sample.t, sample.valid, sample.reason) == (t[k], whole.valid[k], whole.reason[k])
        assert sample.contact is {1: True, 0: False, -1: None}[int(whole.contact[k])]


@pytest.mark.slow
@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
@pytest.mark.parametrize(("seed", "model"), [(0, "mount"), (1, "affine")])
def test_compiled_is_plain_to_the_last_bit(seed: int, model: str) -> None:
    """Batches of quaternions and matrices, with and without drift and filters, and samples one by one; a batch is the
    calls.
    """
    calibration, wrench, quat_xyzw, t, heat = _eventful(seed)
    if model == "affine":
        _, rig, rng = calibrated(seed)
        poses = random_rotations(30, rng)
        calibration = cw.calibrate(cw.Samples(free(rig, poses, rng), poses), "affine")
    R = Rotation.from_quat(quat_xyzw).as_matrix()
    for told in (EVERYTHING, EVERYTHING | {"rate": None, "drift": 0.5, "delay": -0.004}, {"noise": NOISE}):
        plain, compiled, single = (cw.Compensator(calibration, fast=fast, **told) for fast in (False, True, True))
        for orientation, start in ((quat_xyzw, 0.0), (R, 10.0)):
            one, other = (each.run(wrench, orientation, t + start, heat) for each in (plain, compiled))
            _same(one, other)
            assert np.array_equal(one.covariance_of, other.covariance_of)
            assert np.array_equal(one.covariance, other.covariance, equal_nan=True)  # type: ignore[arg-type]
            assert np.array_equal(plain.drift, compiled.drift)
            assert len(one.contacts) >= 1
            for k in range(700):
                sample = single(wrench[k], orientation[k], t[k] + start, heat[k])
                assert np.array_equal(sample.wrench, one.wrench[k], equal_nan=True)
                assert np.array_equal(sample.std, one.std[k], equal_nan=True)
                assert (sample.valid, sample.reason) == (one.valid[k], one.reason[k])
                assert sample.contact is {1: True, 0: False, -1: None}[int(one.contact[k])]
        plain_last, compiled_last = plain.last_contact, compiled.last_contact
        assert plain_last is not None
        assert compiled_last is not None
        assert np.array_equal(plain_last.covariance, compiled_last.covariance)


@pytest.mark.parametrize(
    "fast", [False, pytest.param(True, marks=pytest.mark.skipif(not find_spec("numba"), reason=""))]
)
def test_a_copy_goes_on_by_itself(fast: bool) -> None:
    calibration, wrench, quat_xyzw, t, heat = _eventful(3)
    whole = cw.Compensator(calibration, **(EVERYTHING | {"fast": fast}))
    expected = whole.run(wrench, quat_xyzw, t, heat)
    first = cw.Compensator(calibration, **(EVERYTHING | {"fast": fast}))
    first.run(wrench[:200], quat_xyzw[:200], t[:200], heat[:200])
    for other in (copy(first), deepcopy(first), pickle.loads(pickle.dumps(first))):
        found = other.run(wrench[200:], quat_xyzw[200:], t[200:], heat[200:])
        assert np.array_equal(found.wrench, expected.wrench[200:], equal_nan=True)
    sample = first(wrench[200], quat_xyzw[200], t[200], heat[200])
    assert np.array_equal(sample.wrench, expected.wrench[200])


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
def test_the_first_compilation_is_said_on_a_terminal_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from contactwrench.compensate import runner

    monkeypatch.setattr(runner, "MOMENT", 0.01)
    for terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal)
        with runner.said_while_it_lasts("compiling"):
            time.sleep(0.1)
        with runner.said_while_it_lasts("quick"):
            pass
        assert capsys.readouterr().err == ("compiling ...\n" if terminal else "")


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
def test_nothing_is_compiled_at_the_first_sample() -> None:
    """A sample of another kind of array than at construction (read-only, transposed) compiles nothing either."""
    from contactwrench.compensate.runner import compiled

    calibration, rig, rng = calibrated(3)
    compensator = cw.Compensator(calibration, rate=RATE, noise=NOISE, fast=True)
    kernel: Any = compiled(False)
    before = len(kernel.signatures)
    R = swinging(rng, 20)
    samples = cw.Samples(free(rig, R, rng), R, times(20))
    compensator.run(samples.wrench, samples.R_base_flange, times(20))
    compensator(samples.wrench[3], R[3].T.copy().T, 101.0)
    compensator([0.0] * 6, [0.0, 0.0, 0.0, 1.0], 102)
    compensator.run(np.asfortranarray(samples.wrench), R.astype(np.float32), times(20) + 10.0)
    assert len(kernel.signatures) == before


def test_the_low_pass_is_scipys_and_starts_at_rest() -> None:
    calibration, rig, rng = calibrated(4, exact=True)
    R = swinging(rng, 300)
    push = rng.normal(size=(300, 6)) + 5.0
    batch = _compensator(calibration, lowpass=LowPass(30.0, 4)).run(readings(rig, R) + push, R, times(300))
    sections = butter(4, 30.0, fs=RATE, output="sos")
    start = sosfilt_zi(sections)[:, :, None] * push[0]
    expected, _ = sosfilt(sections, push, axis=0, zi=start)
    assert batch.wrench == pytest.approx(expected, abs=1e-6)
    assert np.abs(batch.wrench[0] - push[0]).max() < 1e-6


def test_the_rate_is_taken_from_the_stamps() -> None:
    """From the 26th sample on the filter is that of the rate that the stamps have."""
    calibration, rig, rng = calibrated(5, exact=True)
    R, push = swinging(rng, 400), rng.normal(size=(400, 6))
    wrench, t = readings(rig, R) + push, times(400, 500.0)
    found = _compensator(calibration, rate=None, lowpass=20.0).run(wrench, R, t)
    assert found.wrench[:25] == pytest.approx(push[:25], abs=1e-6)
    told = _compensator(calibration, rate=500.0, lowpass=20.0).run(wrench[25:], R[25:], t[25:])
    assert found.wrench[25:] == pytest.approx(told.wrench, abs=1e-6)
    assert found.valid.all()


def _turn(rig: Any, rng: np.random.Generator, delay: float, cutoff: float | None) -> tuple[Array, Array, Array]:
    """Readings (n, 6) and orientations of a smooth turn up to 60 deg/s, behind the sensor's filter and a delay."""
    fine, n = 10, 26_000
    t = np.arange(n) / (fine * RATE)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    begin = Rotation.random(random_state=rng)

    def course(at: Array) -> Array:
        angle = 2.0 * np.deg2rad(60.0) / np.pi * (1.0 - np.cos(np.pi * np.clip(at - 0.3, 0.0, 2.0) / 2.0))
        matrices: Array = (begin * Rotation.from_rotvec(angle[:, None] * axis)).as_matrix()
        return matrices

    wrench = readings(rig, course(t - delay))
    if cutoff is not None:
        kept = np.exp(-2.0 * np.pi * cutoff / (fine * RATE))
        wrench = wrench[0] + lfilter([1.0 - kept], [1.0, -kept], wrench - wrench[0], axis=0)
    wrench += 1e-4 * NOISE * rng.normal(size=wrench.shape)
    return wrench[::fine], course(t)[::fine], t[::fine] + 7.0


@pytest.mark.parametrize("seed", range(3))
def test_behind_the_sensors_filter_no_gravity_is_left_over(seed: int) -> None:
    calibration, rig, rng = calibrated(seed, exact=True)
    wrench, R, t = _turn(rig, rng, 0.0, 10.0)
    without, left = (
        np.linalg.norm(_compensator(calibration, sensor_filter=each).run(wrench, R, t).wrench[:, :3], axis=1).max()
        for each in (None, 10.0)
    )
    assert without > 0.01 * rig.weight
    assert without > 20.0 * left


@pytest.mark.parametrize(("delay", "ratio"), [(0.0273, 100.0), (0.004, 100.0), (-0.015, 10.0)])
def test_the_delay_is_taken_into_account(delay: float, ratio: float) -> None:
    calibration, rig, rng = calibrated(11, exact=True)
    wrench, R, t = _turn(rig, rng, delay, None)
    without, left = (
        np.linalg.norm(_compensator(calibration, delay=each).run(wrench, R, t).wrench[:, :3], axis=1).max()
        for each in (0.0, delay)
    )
    assert without > ratio * left


def test_the_calibrations_delay_counts_where_it_is_significant() -> None:
    from dataclasses import replace

    calibration, _, _ = calibrated(6)
    assert _compensator(calibration).delay == 0.0
    assert _compensator(replace(calibration, delay=0.01, delay_std=0.001)).delay == 0.01
    assert _compensator(replace(calibration, delay=0.01, delay_std=0.005)).delay == 0.0
    assert _compensator(replace(calibration, delay=0.01, delay_std=0.001), delay=0.0).delay == 0.0


def test_the_bias_is_learned_in_free_space_and_kept_in_contact() -> None:
    calibration, rig, rng = calibrated(7)
    n = 6000
    R = still(rng, n)
    wrench, moved = free(rig, R, rng), np.array([0.1, -0.08, 0.05, 0.004, 0.003, -0.003])
    wrench += np.minimum(np.arange(n) / 3000.0, 1.0)[:, None] * moved
    wrench[4000:5500, 2] -= 1.0
    follows = _compensator(calibration, drift=100.0 * TYPICAL_DRIFT)
    follows.run(wrench[:4000], R[:4000], times(n)[:4000])
    learned = follows.drift + calibration.predict(R[0]) - readings(rig, R[:1])[0]
    assert learned == pytest.approx(moved, abs=0.3 * NOISE.max())
    before = follows.drift
    batch = follows.run(wrench[4000:5500], R[4000:5500], times(n)[4000:5500])
    assert np.array_equal(before, follows.drift)
    assert batch.contact[20:].all()
    assert batch.std[1400, 0] > batch.std[100, 0]
    stays = _compensator(calibration)
    stays.run(wrench, R, times(n))
    assert not stays.drift.any()


def test_temperature_moves_the_bias_as_told() -> None:
    calibration, rig, rng = calibrated(8, exact=True)
    R, heat = swinging(rng, 200), np.linspace(20.0, 30.0, 200)
    per_kelvin = np.array([0.1, -0.2, 0.05, 0.001, 0.0, 0.002])
    wrench = readings(rig, R) + np.outer(heat - 20.0, per_kelvin)
    batch = _compensator(calibration, temperature_coefficient=per_kelvin).run(wrench, R, times(200), heat)
    assert np.abs(batch.wrench).max() < 1e-6
    without = _compensator(calibration).run(wrench, R, times(200), heat)
    assert np.abs(without.wrench[-1]).max() == pytest.approx(2.0, abs=1e-3)
    unknown = _compensator(calibration, temperature_coefficient=per_kelvin)(wrench[0], R[0], 1.0, np.nan)
    assert np.abs(unknown.wrench).max() < 1e-6


def test_a_temperature_coefficient_asks_for_temperatures() -> None:
    calibration, rig, rng = calibrated(8, exact=True)
    R = swinging(rng, 20)
    wrench, asks = readings(rig, R), _compensator(calibration, temperature_coefficient=np.full(6, 0.1))
    for call in (lambda: asks(wrench[0], R[0], 0.0), lambda: asks.run(wrench, R, times(20))):
        with pytest.raises(InputError) as raised:
            call()
        assert str(raised.value) == (
            "found no temperature, expected one with each reading, as there is a temperature_coefficient: pass it, NaN "
            "where it is not known"
        )
    assert asks.run(wrench, R, times(20), np.full(20, np.nan)).valid.all()
    for none in (None, np.zeros(6)):
        plain = _compensator(calibration, temperature_coefficient=none)
        assert plain(wrench[0], R[0], 0.0).valid
        assert plain.run(wrench, R, times(20) + 1.0).wrench.shape == (20, 6)


@pytest.mark.parametrize("fast", ["a", 2, 0.5])
def test_fast_is_said_or_left_open(fast: Any) -> None:
    with pytest.raises(InputError) as raised:
        cw.Compensator(calibrated(8, exact=True)[0], fast=fast)
    assert str(raised.value) == (
        f"fast is {fast!r}, expected True, False or None: None takes numba where it is installed"
    )


def test_std_has_calibration_and_noise() -> None:
    calibration, rig, rng = calibrated(9)
    R = still(rng, 500)
    sample = _compensator(calibration)(free(rig, R, rng)[0], R[0], 0.0)
    assert sample.std == pytest.approx(np.hypot(calibration.wrench_std(R[0]), NOISE), rel=0.3)
    assert (sample.std >= np.hypot(calibration.wrench_std(R[0]), NOISE) * (1.0 - 1e-9)).all()
    filtered = _compensator(calibration, lowpass=10.0).run(free(rig, R, rng), R, times(500))
    assert filtered.std[0] == pytest.approx(sample.std)
    assert (filtered.std[-1] < 0.7 * sample.std).all()
    assert (filtered.std[-1] >= calibration.wrench_std(R[0])).all()


def test_one_number_stands_for_forces_and_for_torques_at_a_lever_of_5_cm() -> None:
    calibration, rig, rng = calibrated(9)
    R = still(rng, 400)
    wrench, six = free(rig, R, rng), 0.05 * np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    told, short = (
        cw.Compensator(calibration, rate=RATE, noise=2.0 * each, drift=each).run(wrench, R, times(400))
        for each in (six, 0.05)
    )
    _same(told, short)
    assert pytest.approx(six) == TYPICAL_DRIFT


@pytest.mark.slow
@pytest.mark.parametrize("drift", [None, TYPICAL_DRIFT])
def test_std_is_honest_after_turns(drift: Array | None) -> None:
    """Mean readings of random tools, with a Compensator that has seen other orientations before, in stated stds."""
    z = []
    for seed in range(6):
        calibration, rig, rng = calibrated(seed)
        compensator = _compensator(calibration, drift=drift)
        for k in range(4):
            R = still(rng, 400)
            batch = compensator.run(free(rig, R, rng), R, times(400) + 0.4 * k)
            first = batch.wrench[:50].mean(axis=0)
            systematic = batch.std[0] ** 2 - NOISE**2
            z.append(first / np.sqrt(systematic + NOISE**2 / 50.0))
    rms = np.sqrt(np.mean(np.square(z)))
    assert 0.75 < rms < 1.2
    assert np.mean(np.abs(z) > 1.96) < 0.08


def test_results_are_read_only() -> None:
    calibration, rig, rng = calibrated(10)
    R = still(rng, 3)
    wrench, compensator = free(rig, R, rng), _compensator(calibration)
    sample, batch = compensator(wrench[0], R[0], 0.0), compensator.run(wrench, R, times(3))
    for array in (sample.wrench, sample.std, batch.wrench, batch.contact, compensator.drift):
        assert not array.flags.writeable
    assert len(batch) == 3
    kept = sample.wrench.copy()
    compensator(wrench[1], R[1], 200.0)
    assert np.array_equal(sample.wrench, kept)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rate": 0.0}, "rate is 0, expected 0.001 to 1e+06 Hz"),
        (
            {"noise": np.ones(3)},
            "noise has shape (3,), expected (6,) standard deviations of a sample, or a recording at",
        ),
        ({"noise": np.nan}, "noise is nan, expected 0 to 1e+06 N or N m"),
        ({"noise": "a"}, "found 'a', expected numbers: one in N, or six, N of forces and N m of torques"),
        ({"drift": "a"}, "found 'a', expected numbers: one in N, or six, N of forces and N m of torques"),
        ({"noise": -np.ones(6)}, "noise is -1, expected 0 to 1e+06 N or N m"),
        ({"delay": 8.0}, "delay is 8, expected -1 to 1 s (is it in ms?)"),
        ({"delay": np.nan}, "delay is nan, expected -1 to 1 s (is it in ms?)"),
        ({"delay_std": -0.01}, "delay_std is -0.01, expected 0 to 10 s (is it in ms?)"),
        ({"drift": -np.ones(6)}, "drift is -1, expected 0 to 1e+06 N or N m"),
        ({"ranges": np.ones(2)}, "range is array([1., 1.]), expected numbers (6,), 1e-06 to 1e+09 N or N m"),
        ({"false_alarm_rate": 0.5}, "false-alarm rate is 0.5, expected 1e-09 to 0.01 per sample"),
        ({"minimum_duration": -1.0}, "minimum duration is -1, expected 1e-06 to 1e+06 s"),
        ({"lowpass": 600.0}, "cut-off of a low-pass is 600 Hz at 1000 Hz, expected less than half the rate, 500 Hz"),
        ({"gravity": np.zeros(3)}, "gravity is 0,0,0, expected three finite numbers"),
    ],
)
def test_settings_that_cannot_be_meant(settings: dict[str, Any], message: str) -> None:
    calibration, _, _ = calibrated(1)
    with pytest.raises(InputError) as caught:
        cw.Compensator(calibration, **({"rate": RATE} | settings))
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("per_second", [1e3, 1e6, 1e9])
def test_times_that_are_no_seconds_are_refused_and_change_nothing(per_second: float) -> None:
    """Else each was a gap of years, and no row valid; one of them alone is a fault of its row."""
    calibration, wrench, quat_xyzw, _, _ = _eventful(2)
    unix, compensator = 1.79e9 + np.arange(len(wrench)) / RATE, _compensator(calibration)
    with pytest.raises(InputError) as caught:
        compensator.run(wrench, quat_xyzw, (per_second * unix).astype(np.int64))
    assert str(caught.value) == (
        f"t is up to {per_second * 1.79e9:.6g}, a time since 1970, expected s: divide it by {per_second:,.0f}"
    )
    unix[[0, 300]] = np.nan, per_second * unix[300]
    found, expected = (each.run(wrench, quat_xyzw, unix) for each in (compensator, _compensator(calibration)))
    assert np.array_equal(found.wrench, expected.wrench, equal_nan=True)
    assert str(found.reason[300]).startswith("gap: nothing for 1.7")


def test_shapes_are_refused() -> None:
    calibration, _, _ = calibrated(1)
    compensator = _compensator(calibration)
    with pytest.raises(InputError) as caught:
        compensator(np.zeros(5), np.eye(3), 0.0)
    assert str(caught.value) == ("wrench and orientation have shapes (5,) and (3, 3), expected (6,) and (3, 3) or (4,)")
    with pytest.raises(InputError) as caught:
        compensator.run(np.zeros((5, 6)), np.zeros((4, 4)), np.zeros(5))
    assert str(caught.value) == (
        "orientation, t and temperature have shapes (4, 4), (5,) and (5,), expected (5, 3, 3) or (5, 4), (5,) and (5,) "
        "for 5 readings"
    )
    assert len(compensator.run(np.zeros((0, 6)), np.zeros((0, 4)), np.zeros(0))) == 0


def test_memory_does_not_grow() -> None:
    calibration, rig, rng = calibrated(2)
    rate = 40  # the buffers hold seconds
    R = swinging(rng, rate)
    wrench = free(rig, R, rng)
    slow = {"fast": False, "rate": float(rate), "lowpass": LowPass(14.0, 3), "sensor_filter": 18.0}
    compensator = cw.Compensator(calibration, **(EVERYTHING | slow))
    import tracemalloc

    def one_second(start: float) -> None:
        for k in range(rate):
            compensator(wrench[k], R[k], start + k / rate, 20.0)

    tracemalloc.start()  # before the buffers are filled: what they hold is replaced, not added
    for second in range(12):
        one_second(float(second))
    before = tracemalloc.get_traced_memory()[0]
    one_second(12.0)
    one_second(13.0)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 2000


def test_a_compiled_step_without_numba_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from contactwrench.compensate.runner import compiled

    calibration, _, _ = calibrated(1)
    compiled.cache_clear()
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(MissingExtraError) as caught:
        cw.Compensator(calibration, fast=True)
    assert str(caught.value) == (
        "numba is not installed, expected for a compiled step: pip install 'contactwrench[fast]'"
    )
    compiled.cache_clear()


def test_import_stays_light() -> None:
    script = (
        "import sys, contactwrench as cw\n"
        "print(sorted({name.partition('.')[0] for name in sys.modules} & {'scipy', 'numba'}), cw.Compensator.__name__)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[] Compensator\n"


def test_a_file_is_no_calibration() -> None:
    with pytest.raises(InputError, match=r"^found str, expected a Calibration: cw\.Calibration\.load\(path\)$"):
        cw.Compensator("gripper.json")  # type: ignore[arg-type]
