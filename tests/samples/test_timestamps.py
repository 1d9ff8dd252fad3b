"""Stamps that are put at a pace, where there is one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.samples.timestamps import at_pace
from tests.support.world import Array

SECONDS = 30.0


def poses_at(t: Array) -> Array:
    """Rotations (n, 9) of a slow motion."""
    rng = np.random.default_rng(1)
    sines = [rng.normal(size=3) * np.sin(2.0 * np.pi * f * t[:, None] + f) / f**0.5 for f in (0.1, 0.23, 0.5, 0.9)]
    return np.asarray(Rotation.from_rotvec(0.1 * np.sum(sines, axis=0)).as_matrix()).reshape(-1, 9)


def errors(sent: Array, jitter: float, came: Array | None = None) -> tuple[Array, Array]:
    """By how much stamps (n,) are off, less what all of them are, s: as they came, and at their pace."""
    stamps = (sent if came is None else came) + jitter * np.random.default_rng(2).normal(size=len(sent))
    order = np.argsort(stamps)
    sent, stamps = sent[order], stamps[order]
    off = stamps - sent, at_pace(stamps, poses_at(sent)) - sent
    before, after = (each - np.median(each) for each in off)
    return before, after


EVEN = np.arange(0.0, SECONDS, 0.008)
KEPT = np.random.default_rng(3).random(len(EVEN))
SENT_EVENLY = {
    "all": (EVEN, 1e-3),
    "some lost": (EVEN[KEPT > 0.02], 5e-4),
    "a gap of two seconds": (np.r_[EVEN[EVEN < 12.0], EVEN[EVEN > 14.0] + 0.0037], 1e-3),
    "60 Hz": (np.arange(0.0, SECONDS, 1.0 / 60.0), 1e-3),
}


@pytest.mark.parametrize(("sent", "jitter"), SENT_EVENLY.values(), ids=SENT_EVENLY)
def test_what_was_sent_evenly_is_put_there(sent: Array, jitter: float) -> None:
    before, after = errors(sent, jitter)
    assert after.std() < 0.3 * before.std()
    assert np.abs(after).max() < 0.5 * np.abs(before).max()


def test_stamps_in_whole_ms_are_put_between_them() -> None:
    sent = np.arange(0.0, SECONDS, 1.0 / 120.0)
    before, after = errors(sent, 0.0, np.round(sent, 3))
    assert before.std() > 2e-4
    assert np.abs(after).max() < 1e-4


RATES = np.random.default_rng(4)
SENT_UNEVENLY = {
    "100, then 71 Hz": np.r_[np.arange(0.0, 15.0, 0.010), np.arange(15.0, SECONDS, 0.014)],
    "125, then 62 Hz": np.r_[np.arange(0.0, 15.0, 0.008), np.arange(15.0, SECONDS, 0.016)],
    "a rate that wobbles": np.cumsum(0.010 + 0.003 * np.sin(2.0 * np.pi * np.arange(3000) / 500.0)),
    "any steps": np.cumsum(RATES.uniform(0.004, 0.012, 3000)),
    "most lost": EVEN[KEPT > 0.6],
    "few": EVEN[:7],
}


@pytest.mark.parametrize("jitter", [0.0, 2e-4, 1e-3])
@pytest.mark.parametrize("sent", SENT_UNEVENLY.values(), ids=SENT_UNEVENLY)
def test_what_was_not_sent_evenly_is_no_worse_than_it_came(sent: Array, jitter: float) -> None:
    before, after = errors(sent, jitter)
    assert after.std() <= 1.01 * before.std() + 1e-9
    assert np.abs(after).max() <= 1.05 * np.abs(before).max() + 1e-9


def test_a_late_message_now_and_then_is_no_other_pace() -> None:
    before, after = errors(EVEN, 2e-4, EVEN + 0.03 * (KEPT < 0.01))
    assert after.std() <= before.std()
