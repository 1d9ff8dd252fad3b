"""The shaking of drives and links: as large as is set, at its two frequencies, felt by the sensor, seen by no pose."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

from contactwrench.simulate.recording import record_motion
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import DAMPING, MODES, Motion, exciting, shaking
from tests.support.world import Array

RATE, SECONDS = 500.0, 20.0
PURE = ["sensor.low_pass=0", "sensor.delay=0", "sensor.noise.force=0", "sensor.noise.torque=0", "sensor.quantum=0"]


def _motion(seconds: float = SECONDS) -> Motion:
    return exciting(seconds, RATE, np.random.default_rng(1))


def _steady(speed: float) -> Motion:
    """One joint turns, about the vertical, at one speed."""
    t = np.arange(0.0, 60.0, 1.0 / RATE)
    joints, velocity = np.zeros((len(t), 7)), np.zeros((len(t), 7))
    joints[:, 0], velocity[:, 0] = 0.02 * np.sin(speed / 0.02 * t), speed
    return Motion(t, joints, velocity, np.zeros_like(joints))


def test_nothing_shakes_unless_it_is_set() -> None:
    assert shaking(build(Settings()), _motion(2.0), np.random.default_rng(0)) is None


def test_it_is_as_large_as_the_speed_says() -> None:
    rig = build(changed(Settings(), ["arm.vibration=[0,0.5]"]))
    shaken = shaking(rig, _steady(0.4), np.random.default_rng(3))
    assert shaken is not None
    assert np.sqrt(np.mean(shaken**2, axis=0)) == pytest.approx([0.2] * 3, rel=0.1)


def test_it_has_two_damped_modes() -> None:
    rig = build(changed(Settings(), ["arm.vibration=[0,0.5]"]))
    shaken = shaking(rig, _steady(0.4), np.random.default_rng(3))
    power = np.sum(np.abs(np.fft.rfft(np.asarray(shaken), axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(np.asarray(shaken)), 1.0 / RATE)
    near = [np.abs(frequency - mode) < 4.0 * DAMPING * mode for mode in MODES]
    parts = [float(power[band].sum() / power.sum()) for band in near]
    assert sum(parts) > 0.8
    assert parts[0] == pytest.approx(parts[1], abs=0.1)


def test_it_grows_with_the_arms_own_acceleration_and_ends_with_it() -> None:
    motion = _motion()
    once, twice = (
        shaking(build(changed(Settings(), [f"arm.vibration=[{size},0]"])), motion, np.random.default_rng(5))
        for size in (0.1, 0.2)
    )
    assert once is not None
    assert twice == pytest.approx(2.0 * once)
    ends = np.sqrt(np.mean(once[:100] ** 2)), np.sqrt(np.mean(once[len(once) // 2 :][:100] ** 2))
    assert ends[0] < 0.1 * ends[1]


def test_the_sensor_feels_it_as_the_tools_acceleration_and_no_pose_shows_it() -> None:
    still = changed(Settings(), [*PURE, "tool.mass=1", "recording.rate=500", "sensor.bias=0"])
    shaken = changed(still, ["arm.vibration=[0.1,0.2]"])
    motion = _motion(5.0)
    quiet, loud = (record_motion(each, motion, rng=np.random.default_rng(7)) for each in (still, shaken))
    assert np.array_equal(quiet.R_base_flange, loud.R_base_flange)
    assert np.array_equal(quiet.position, loud.position)
    acceleration = np.asarray(shaking(build(shaken), motion, np.random.default_rng(7)))
    R_sensor_base = (loud.R_base_flange @ shaken.R_flange_sensor).transpose(0, 2, 1)
    force: Array = -np.einsum("nij,nj->ni", R_sensor_base, acceleration)
    assert np.allclose(loud.wrench[:, :3] - quiet.wrench[:, :3], force, rtol=0.0, atol=1e-9)
    torque = np.cross(shaken.tool.com, force)
    assert np.allclose(loud.wrench[:, 3:] - quiet.wrench[:, 3:], torque, rtol=0.0, atol=1e-9)


def test_it_is_the_same_at_every_run() -> None:
    settings = changed(Settings(), ["recording.rate=500", "arm.vibration=[0.1,0.2]"])
    first, second = (record_motion(settings, _motion(2.0), rng=np.random.default_rng(9)) for _ in range(2))
    assert np.array_equal(first.wrench, second.wrench)
    other = record_motion(settings, _motion(2.0), rng=np.random.default_rng(10))
    assert not np.array_equal(first.wrench, other.wrench)


def test_modes_that_the_rate_cannot_show_are_left_out() -> None:
    rig = build(changed(Settings(), ["arm.vibration=[0,0.5]"]))
    slow = exciting(5.0, 20.0, np.random.default_rng(1))
    assert shaking(rig, slow, np.random.default_rng(0)) is None
