"""The node on real rclpy while the arm swings a tool whose inertia the calibration knows."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from contactwrench.live.running import NOT_SUBTRACTED

from .rig import NOISE, ON_WRIST, Rig
from .swing import WRIST_TO_TOOL, Swing, readings, save_dynamic_calibration

SECONDS, RATE, AHEAD = 3.0, 500, 4
"""s; readings in a second, with every other of which comes a pose; and by how many of them a pose is ahead, which no
machine that stalls may turn around.
"""


@pytest.fixture(scope="module")
def dynamic(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = str(tmp_path_factory.mktemp("motion") / "swing.json")
    save_dynamic_calibration(path)
    return path


def swung(swing: Swing) -> Any:
    """Force and torque (n, 6) that are published of a free tool from half a second of swinging on."""
    one, rng = swing.one, np.random.default_rng(4)
    t = np.arange(round(SECONDS * RATE)) / RATE
    pure, start = readings(t), time.time()
    for row in range(len(t) + AHEAD):
        time.sleep(max(0.0, start + row / RATE - time.time()))
        one.wait(lambda: len(one.sent) - len(one.found) < 100)
        if row % 2 == 0:
            swing.tell(row / RATE, start + row / RATE)
        if row >= AHEAD:
            at = row - AHEAD
            one.read(pure[at] + NOISE * rng.normal(size=6), start + t[at])
    one.wait(lambda: len(one.found) > len(t) - 100)
    found = [[getattr(part, axis) for part in (m.wrench.force, m.wrench.torque) for axis in "xyz"] for m in one.found]
    return np.array(found)[RATE // 2 :]


@pytest.mark.parametrize("pose_source", ["tf", "pose", "joints"])
def test_free_motion_is_within_the_noise(pose_source: str, rig: Callable[..., Rig], dynamic: str) -> None:
    """At most 1.3 times it, as accelerations are one pose old; without the inertia 18 to 62 times."""
    one = rig(calibration=dynamic, pose_source=pose_source, urdf="ur5e", noise=0.02)
    one.say([("wrist", "tool0", ON_WRIST)], 0.0, True, places=[WRIST_TO_TOOL])
    rms = np.sqrt(np.mean(swung(Swing(one, pose_source)) ** 2, axis=0))
    print(pose_source, rms / NOISE)
    assert (rms < 1.5 * NOISE).all()
    assert one.contacts in ([], [False])
    one.wait(lambda: any(value.value == "yes" for status in one.said for value in status.values))


def test_without_positions_that_is_said(rig: Callable[..., Rig], dynamic: str) -> None:
    one = rig(calibration=dynamic, pose_source="tf", noise=0.02)
    rms = np.sqrt(np.mean(swung(Swing(one, "tf", placed=False)) ** 2, axis=0))
    print(rms / NOISE)
    assert np.linalg.norm(rms[:3]) > 0.5
    missing = NOT_SUBTRACTED.format("position", "x, y, z too")
    one.wait(lambda: any(status.message == missing for status in one.said))
