"""The low-pass of `compensate` along a recording: what stamps and gaps do to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from contactwrench.compensate.filters import LowPass
from contactwrench.errors import InputError
from contactwrench.recording.compensate import Treatment, compensated
from contactwrench.recording.options import Options
from tests.support.live import RATE, calibrated, free, swinging, times
from tests.support.recordings import MATRIX, WRENCH, csv_text, written
from tests.support.world import Array

N = 2000
AT_10_HZ = LowPass(10.0, 2)


def smoothed(folder: Path, t: Array, low_pass: LowPass | None = AT_10_HZ) -> Array:
    """Contact wrenches (n, 6) of a free tool on a swinging arm, its readings stamped t (n,)."""
    calibration, rig, rng = calibrated(3)
    R = swinging(rng, N)
    table = np.column_stack([t, free(rig, R, rng), R.reshape(N, 9)])
    path = written(folder, csv_text(("t", *WRENCH, *MATRIX), table))
    parts = list(compensated(path, Options(), calibration, Treatment(low_pass=low_pass)))
    return np.concatenate([part.wrench for part in parts])


def test_each_stretch_between_gaps_by_itself(tmp_path: Path) -> None:
    t = times(N)
    t[700:] += 1.0
    raw = smoothed(tmp_path, t, None)
    sections = butter(2, 10.0, fs=RATE, output="sos")
    expected = np.concatenate([sosfiltfilt(sections, part, axis=0) for part in (raw[:700], raw[700:])])
    assert np.allclose(smoothed(tmp_path, t), expected, rtol=0.0, atol=1e-9)


def test_stamps_that_repeat_or_come_a_little_late_cut_nothing(tmp_path: Path) -> None:
    usual, t = smoothed(tmp_path, times(N)), times(N)
    t[10::10] = t[9:-1:10]
    assert np.allclose(smoothed(tmp_path, t), usual, rtol=0.0, atol=1e-3)
    assert np.allclose(smoothed(tmp_path, np.repeat(times(N)[::2], 2)), usual, rtol=0.0, atol=1e-3)
    late = times(N)
    late[500:510] -= 0.02
    assert np.allclose(smoothed(tmp_path, late)[:400], usual[:400], rtol=0.0, atol=1e-3)
    assert smoothed(tmp_path, late).std(axis=0) == pytest.approx(usual.std(axis=0), rel=0.1)


def test_times_that_stand_still(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found times that stand still, expected a recording with a rate"):
        smoothed(tmp_path, np.full(N, 5.0))
