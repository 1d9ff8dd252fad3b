"""Low-pass filters against scipy's frequency responses, a recursion by hand, and noise that is drawn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import sosfreqz

from contactwrench.compensate.filters import LowPass, zero_phase
from contactwrench.errors import InputError

RATE = 1000.0
FILTERS = [LowPass(20.0, order) for order in (0, 1, 2, 3, 4)]


@pytest.mark.parametrize("low_pass", FILTERS)
def test_gain_at_rest_at_the_cut_off_and_far_above(low_pass: LowPass) -> None:
    _, response = sosfreqz(low_pass.sections(RATE), worN=[0.0, 20.0, 200.0], fs=RATE)
    gain = np.abs(response)
    assert gain[0] == pytest.approx(1.0)
    assert gain[1] == pytest.approx(np.sqrt(0.5), rel=0.02 if low_pass.order == 0 else 1e-9)
    assert gain[2] < 1.3 * 0.1 ** max(low_pass.order, 1)


def test_order_0_is_what_sensors_compute() -> None:
    rng = np.random.default_rng(1)
    x, y, kept = rng.normal(size=50), 0.0, np.exp(-2.0 * np.pi * 20.0 / RATE)
    by_hand = []
    for value in x:
        y += (1.0 - kept) * (value - y)
        by_hand.append(y)
    from scipy.signal import sosfilt

    assert sosfilt(LowPass(20.0, 0).sections(RATE), x) == pytest.approx(np.array(by_hand))


@pytest.mark.parametrize("low_pass", FILTERS)
def test_what_is_left_of_white_noise(low_pass: LowPass) -> None:
    """Against the scatter of filters that were started on the first of many drawn signals, once they have settled."""
    from scipy.signal import sosfilt, sosfilt_zi

    sections, gain = low_pass.sections(RATE), low_pass.noise_gain(RATE)
    noise = np.random.default_rng(2).normal(size=(4000, 300))
    start = sosfilt_zi(sections)[:, None, :] * noise[:, 0][None, :, None]
    filtered, _ = sosfilt(sections, noise, axis=1, zi=start)
    scatter = filtered.var(axis=0)
    for k in range(low_pass.settles_in(RATE), 300, 50):
        assert scatter[k] == pytest.approx(gain, rel=0.12)


def test_both_ways_nothing_is_late() -> None:
    t = np.arange(1000) / RATE
    bump = np.exp(-0.5 * ((t - 0.5) / 0.03) ** 2)
    filtered = zero_phase(np.column_stack([bump, 2.0 * bump]), LowPass(10.0, 3), RATE)
    assert filtered.shape == (1000, 2)
    assert np.argmax(filtered[:, 0]) == np.argmax(bump)
    assert filtered[:, 0] == pytest.approx(filtered[::-1, 0][np.r_[999, 0:999]], abs=1e-3)
    assert filtered[:, 1] == pytest.approx(2.0 * filtered[:, 0])


@pytest.mark.parametrize("low_pass", FILTERS)
def test_both_ways_of_a_short_recording_or_a_word_why_not(low_pass: LowPass) -> None:
    for rows in range(1, 40):
        try:
            filtered = zero_phase(np.full((rows, 6), 2.0), low_pass, RATE)
        except InputError as error:
            assert f"found {rows} rows, expected at least " in str(error)  # noqa: PT017
            assert rows < 16
        else:
            assert filtered == pytest.approx(np.full((rows, 6), 2.0))


def test_what_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        LowPass(20.0, 5)
    assert str(caught.value) == "order of a low-pass is 5, expected 1 to 4 (Butterworth) or 0 (y += a (x - y))"
    with pytest.raises(InputError) as caught:
        LowPass(-1.0)
    assert str(caught.value) == "cut-off of a low-pass is -1, expected 0.001 to 1e+06 Hz"
    with pytest.raises(InputError) as caught:
        LowPass(500.0).sections(RATE)
    assert str(caught.value) == "cut-off of a low-pass is 500 Hz at 1000 Hz, expected less than half the rate, 500 Hz"
    with pytest.raises(InputError) as caught:
        zero_phase(np.zeros((5, 6)), LowPass(20.0), RATE)
    assert str(caught.value) == "found 5 rows, expected at least 10 to filter both ways"
    broken = np.zeros((50, 6))
    broken[7, 2] = np.nan
    with pytest.raises(InputError) as caught:
        zero_phase(broken, LowPass(20.0), RATE)
    assert str(caught.value) == "row 7 is not finite, expected numbers: filter the stretches before and after it"
    assert caught.value.row == 7
