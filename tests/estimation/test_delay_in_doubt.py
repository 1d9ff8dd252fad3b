"""A delay that is not told from zero is not made up for: that is said where it matters while the arm turns."""

from __future__ import annotations

from dataclasses import replace

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


def test_positions_that_are_there_are_not_asked_for() -> None:
    rig, R, rng = example(3)
    t, place = 5.0 * np.arange(float(len(R))), rng.normal(size=(len(R), 3))
    samples = cw.Samples(noisy_readings(rig, R, 0.1 * NOISE, rng), R, t, place, delay=0.0, delay_std=0.05)
    (text,) = [each.text for each in cw.calibrate(samples, "mount").findings if each.kind is Kind.DELAY_IN_DOUBT]
    assert text.endswith(" N off; turn faster between the stops, or give compensate its --delay")


def _clocks_apart(delay: float, std: float) -> list[str]:
    rig, R, rng = example(3)
    samples = cw.Samples(noisy_readings(rig, R, NOISE, rng), R, 5.0 * np.arange(float(len(R))))
    found = cw.calibrate(replace(samples, delay=delay, delay_std=std), "mount")
    return [finding.text for finding in found.findings if finding.kind is Kind.CLOCKS_APART]


@pytest.mark.parametrize(("delay", "by"), [(0.4, "0.4 s later"), (-5.0, "5 s earlier")])
def test_one_that_no_sensor_has_is_two_clocks(delay: float, by: str) -> None:
    assert _clocks_apart(delay, 0.0001) == [
        f"doubtful: the wrench is stamped {by} than the orientation, as by two clocks: that holds for this recording; "
        "set them by one clock, or give what is compensated its own --delay"
    ]


@pytest.mark.parametrize(("delay", "std"), [(0.2, 0.001), (-0.02, 0.0001), (0.4, 0.2), (5.0, 0.0)])
def test_one_of_a_sensor_that_is_not_told_or_that_is_stated_is_not(delay: float, std: float) -> None:
    assert _clocks_apart(delay, std) == []
