"""Contact wrenches in sensor, flange and base axes, about the sensor or the TCP, against world-frame physics."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import contact_wrenches
from contactwrench.errors import InputError
from tests.support.rigs import NOISE, example, noise_free, noisy, samples_of_a_design
from tests.support.world import Array, Rig, random_rotations, readings

TCP = np.array([0.02, -0.03, 0.21])


def _pushed(rig: Rig, n: int, rng: np.random.Generator) -> tuple[cw.Samples, Array, Array, Array]:
    """Readings while the world pushes at the TCP with a force and a torque in base axes."""
    R = random_rotations(n, rng)
    force, torque = rng.normal(size=(n, 3)), 0.1 * rng.normal(size=(n, 3))
    R_base_sensor = R @ rig.R_flange_sensor
    about_sensor = torque + np.cross(R_base_sensor @ TCP, force)
    in_sensor = [np.einsum("nji,nj->ni", R_base_sensor, part) for part in (force, about_sensor)]
    return cw.Samples(readings(rig, R) + np.hstack(in_sensor), R, t=np.linspace(0, 1, n)), R, force, torque


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
def test_a_push_at_the_tcp_comes_out_as_it_was(frame: str) -> None:
    rig, R, rng = example(1)
    calibration = cw.calibrate(noise_free(rig, R), "mount")
    samples, orientations, force, torque = _pushed(rig, 50, rng)
    found = contact_wrenches(calibration, samples, frame, point=TCP)
    to_base = {"sensor": orientations @ rig.R_flange_sensor, "flange": orientations, "base": np.eye(3)[None]}[frame]
    assert np.einsum("nij,nj->ni", np.broadcast_to(to_base, (50, 3, 3)), found.wrench[:, :3]) == pytest.approx(force)
    in_base = np.einsum("nij,nj->ni", np.broadcast_to(to_base, (50, 3, 3)), found.wrench[:, 3:])
    assert in_base == pytest.approx(torque, abs=1e-7)
    assert found.t == pytest.approx(samples.t)


@cache
def _repeated() -> tuple[cw.Samples, list[cw.Calibration]]:
    """Pushes, and calibrations of their tool from as many recordings."""
    rig, R, rng = example(2, poses=6)
    samples = _pushed(rig, 6, rng)[0]
    return samples, [cw.calibrate(each, "mount", noise=NOISE) for each in samples_of_a_design(rig, R, 38, rng)]


@pytest.mark.slow
@pytest.mark.parametrize(("frame", "point"), [("sensor", None), ("flange", TCP), ("base", TCP)])
def test_std_is_carried_along(frame: str, point: Array | None) -> None:
    """Against the scatter of the result over repeated calibrations."""
    samples, calibrations = _repeated()
    found, stds = [], []
    for calibration in calibrations:
        result = contact_wrenches(calibration, samples, frame, point)
        found.append(result.wrench)
        stds.append(result.std)
    ratio = np.mean(stds, axis=0) / np.std(found, axis=0)
    assert ratio == pytest.approx(np.ones((6, 6)), abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["flange", "base"])
def test_std_of_a_strong_push_counts_the_axes_that_are_uncertain(frame: str) -> None:
    """100 N turned from sensor axes by a mounting that is known to a few mrad: an error of tenths of a newton."""
    rig, _, rng = example(2, poses=6)
    at = random_rotations(1, rng)
    strong = cw.Samples(readings(rig, at) + np.array([[0.0, 0.0, 100.0, 0.0, 0.0, 0.0]]), at)
    found, stds = [], []
    for calibration in _repeated()[1]:
        result = contact_wrenches(calibration, strong, frame)
        found.append(result.wrench[0])
        stds.append(result.std[0])
    assert np.mean(stds, axis=0) / np.std(found, axis=0) == pytest.approx(np.ones(6), abs=0.3)


def test_about_the_sensors_origin_by_default() -> None:
    rig, R, rng = example(3)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    samples = _pushed(rig, 20, rng)[0]
    plain, at_origin = contact_wrenches(calibration, samples), contact_wrenches(calibration, samples, point=np.zeros(3))
    assert plain.wrench == pytest.approx(calibration.compensate(samples.wrench, samples.R_base_flange))
    assert at_origin.wrench == pytest.approx(plain.wrench)
    assert at_origin.std == pytest.approx(plain.std)


def test_a_recording_on_a_base_that_stands_otherwise() -> None:
    rig, R, rng = example(4)
    calibration, turn = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(1, rng)[0]
    samples = _pushed(rig, 20, rng)[0]
    moved = cw.Samples(samples.wrench, turn @ samples.R_base_flange)
    expected = contact_wrenches(calibration, samples, "flange")
    found = contact_wrenches(calibration, moved, "flange", gravity=turn @ rig.down)
    assert found.wrench == pytest.approx(expected.wrench)
    assert found.std == pytest.approx(expected.std)


def test_more_rows_than_fit_at_once() -> None:
    rig, R, rng = example(5)
    calibration = cw.calibrate(noise_free(rig, R), "mount")
    samples = _pushed(rig, 10_000, rng)[0]
    all_rows = contact_wrenches(calibration, samples, "base", TCP)
    some = samples.select(np.array([0, 4095, 4096, 9999]))
    assert all_rows.wrench[[0, 4095, 4096, 9999]] == pytest.approx(
        contact_wrenches(calibration, some, "base", TCP).wrench
    )


def test_axes_that_a_model_cannot_give() -> None:
    rig, R, rng = example(6)
    samples = noisy(rig, R, rng)
    affine = cw.calibrate(samples, "affine")
    assert contact_wrenches(affine, samples, "sensor").wrench.shape == (24, 6)
    for frame in ("flange", "base"):
        with pytest.raises(InputError, match=f"affine has no mounting, so no {frame} axes"):
            contact_wrenches(affine, samples, frame)
    with pytest.raises(InputError, match="output frame is 'tool', expected sensor, flange, base"):
        contact_wrenches(affine, samples, "tool")
