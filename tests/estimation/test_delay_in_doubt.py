"""A delay that is not told from zero is not made up for: that is said where it matters while the arm turns."""

from __future__ import annotations

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.findings import Kind, Severity
from tests.support.rigs import NOISE, example
from tests.support.world import noisy_readings


def said_of(delay: float | None, std: float | None, noise: float = 0.1) -> list[str]:
    rig, R, rng = example(3)
    wrench = noisy_readings(rig, R, noise * NOISE, rng)
    samples = cw.Samples(wrench, R, 5.0 * np.arange(float(len(R))), delay=delay, delay_std=std)
    said = [finding for finding in cw.calibrate(samples, "mount").findings if finding.kind is Kind.DELAY_IN_DOUBT]
    assert all(finding.severity is Severity.WARNING for finding in said)
    return [finding.text for finding in said]


@pytest.mark.parametrize(("delay", "std", "within"), [(-0.023, 0.014, "27"), (0.0, 0.05, "50"), (0.4, 10.0, "10000")])
def test_one_that_may_be_anything_is_said(delay: float, std: float, within: str) -> None:
    rig, _, _ = example(3)
    late = float(np.hypot(delay, std))
    (text,) = said_of(delay, std)
    known, off = text.split("contact forces may be ")
    assert known == (
        f"the delay between wrench and orientation is known within {within} ms only, and not made up for: "
        "while the arm turns at 60 deg/s "
    )
    assert off.endswith(" N off; turn faster between the stops, record positions too, or give compensate its --delay")
    assert float(off.split()[0]) == pytest.approx(min(late * np.pi / 3.0, 2.0) * rig.weight, rel=0.1)


@pytest.mark.parametrize(
    ("delay", "std", "noise"),
    [
        (None, None, 0.1),
        (0.03, 0.0, 0.1),
        (-0.03, 0.002, 0.1),
        (0.003, 0.007, 0.1),
        (0.0, 0.02, 5.0),
        (0.01, np.inf, 0.1),
    ],
)
def test_one_that_is_known_stated_made_up_for_or_lost_in_noise_is_not(
    delay: float | None, std: float | None, noise: float
) -> None:
    assert said_of(delay, std, noise) == []
