"""Poses and two pushes settle the sensor's sign and the base's side, whatever was stated, and say where they cannot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from contactwrench.live.fitting import Fitted, Stated, fitted
from contactwrench.live.pose_taking import Taken
from contactwrench.live.push_test import Push
from tests.support.live_world import LiveWorld

Array = NDArray[np.float64]
DOWN, UP, SIDE = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
ROWS, STRENGTH = 40, 9.0


def found(true: LiveWorld, stated: Stated, pushed_at: Rotation, frame: str = "sensor") -> Fitted:
    """From eight poses at random and both pushes at one orientation."""
    rng = np.random.default_rng(true.seed)

    def read(R: Rotation, push: Array) -> Array:
        reading: Array = true.wrench(Rotation.concatenate([R]), push[None])[0]
        if frame == "mirrored":
            reading = MIRROR @ reading
        elif frame == "base":
            reading = (R * true.mounting).apply(reading.reshape(2, 3)).reshape(6)
        return reading

    poses = []
    for k, R in enumerate(Rotation.random(8, random_state=true.seed)):
        noise = rng.normal(size=(ROWS, 6)) * ([true.noise] * 3 + [0.02 * true.noise] * 3)
        t: Array = 5.0 * k + 0.01 * np.arange(ROWS, dtype=np.float64)
        poses.append(Taken(t, read(R, np.zeros(3)) + noise, np.tile(R.as_quat(), (ROWS, 1))))
    still, turn = read(pushed_at, np.zeros(3)), pushed_at.as_quat()
    pushes = {"down": np.array(true.down), "+x": pushed_at.apply([1.0, 0.0, 0.0])}
    felt = [Push(name, (read(pushed_at, STRENGTH * d) - still)[:3], turn) for name, d in pushes.items()]
    return fitted(tuple(poses), tuple(felt), stated, "test")


@pytest.mark.parametrize(
    ("sign", "down", "stated"),
    [
        *((sign, down, DOWN) for sign in (1.0, -1.0) for down in (DOWN, UP)),
        (1.0, SIDE, DOWN),
        (-1.0, SIDE, (-1.0, 0.0, 0.0)),
        (1.0, DOWN, SIDE),
    ],
    ids=[
        *(f"{sign}, {side}" for sign in ("pull", "reaction") for side in ("stands", "hangs, unstated")),
        *("pull, on a wall, unstated", "reaction, the other wall stated", "pull, stands, a wall stated"),
    ],
)
def test_sign_and_side_are_found_whatever_gravity_was_stated(
    sign: float, down: tuple[float, float, float], stated: tuple[float, float, float]
) -> None:
    true = LiveWorld(3, sign=sign, down=down)
    result = found(true, Stated(gravity=stated), Rotation.random(random_state=9))
    assert result.calibration is not None, result.refusal
    assert result.sign == sign
    assert result.calibration.gravity_direction @ down > np.cos(np.deg2rad(0.5))


@pytest.mark.parametrize("along", [1.0, -1.0])
def test_an_x_that_is_vertical_settles_it_as_well(along: float) -> None:
    """Both pushes are then along one line."""
    true = LiveWorld(4, sign=-1.0)
    upright, _ = Rotation.align_vectors([true.down], [[along, 0.0, 0.0]])
    assert found(true, Stated(), upright).sign == -1.0


def test_a_mirrored_axis_is_the_other_sign_of_a_turned_sensor() -> None:
    """The turn takes it all back: a contact comes out right in flange axes."""
    true = LiveWorld(5)
    result = found(true, Stated(), Rotation.random(random_state=9), "mirrored")
    assert result.sign == -1.0
    c = result.calibration
    assert c is not None
    assert c.R_flange_sensor is not None
    push = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    in_flange = c.R_flange_sensor @ (result.sign * MIRROR @ push).reshape(2, 3).T
    assert np.allclose(in_flange.T, true.mounting.apply(push.reshape(2, 3)), atol=0.02)


def test_a_wrench_in_base_axes_and_a_sign_stated_wrong_are_refused() -> None:
    true = LiveWorld(6)
    assert found(true, Stated(), Rotation.random(random_state=9), "base").calibration is None
    wrong = found(true, Stated("reaction"), Rotation.random(random_state=9))
    assert wrong.calibration is None
    assert wrong.refusal.startswith("the push towards the flange's +x reads 180 deg away")
