"""The admittance controller against the closed form of a mass on a damper and a spring."""

from __future__ import annotations

import numpy as np
import pytest

from contactwrench.errors import InputError
from reproduction.admittance import Admittance


def test_a_step_of_force_moves_it_as_the_closed_form_of_a_damped_oscillator_says() -> None:
    mass, damping, stiffness, force = np.array([2.0, 0.5]), np.array([12.0, 1.0]), np.array([200.0, 40.0]), 3.0
    controller = Admittance(mass, damping, stiffness)
    period, steps = 1e-4, 12_000
    displacement, velocity = np.zeros(2), np.zeros(2)
    for _ in range(steps):
        displacement, velocity = controller.step(displacement, velocity, np.full(2, force), period)
    t = period * steps
    decay = damping / (2.0 * mass)
    ringing = np.sqrt(stiffness / mass - decay**2)
    swing = np.exp(-decay * t) * (np.cos(ringing * t) + decay / ringing * np.sin(ringing * t))
    assert displacement == pytest.approx(force / stiffness * (1.0 - swing), rel=2e-3)


def test_without_a_spring_a_force_ends_in_the_speed_of_the_damper() -> None:
    controller = Admittance(np.array([4.0]), np.array([800.0]), np.array([0.0]))
    displacement, velocity = np.zeros(1), np.zeros(1)
    for _ in range(100):
        displacement, velocity = controller.step(displacement, velocity, np.array([12.0]), 0.008)
    assert velocity == pytest.approx([12.0 / 800.0], rel=1e-9)
    assert displacement == pytest.approx([12.0 / 800.0 * 0.8 - 12.0 / 800.0 * 4.0 / 800.0], rel=1e-6)


def test_no_stiffness_and_no_period_makes_it_unstable() -> None:
    controller = Admittance(np.array([0.01]), np.array([0.0]), np.array([1e6]))
    displacement, velocity = np.array([1.0]), np.zeros(1)
    for _ in range(1000):
        displacement, velocity = controller.step(displacement, velocity, np.zeros(1), 0.05)
    assert abs(displacement[0]) < 1.0


def test_a_massless_or_negative_one_is_refused() -> None:
    one = np.ones(1)
    for mass, damping, stiffness in ((0.0 * one, one, one), (one, -one, one), (one, one, -one)):
        with pytest.raises(InputError, match=r"expected every mass to be more than 0 and nothing negative"):
            Admittance(mass, damping, stiffness)
