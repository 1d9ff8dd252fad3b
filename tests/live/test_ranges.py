"""A reading at the end of a sensor's range is none."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.live.session import Session
from tests.support.live_world import ROBOT, SENSOR, LiveWorld


def test_a_reading_beyond_the_range_that_a_sensor_states_is_not_valid() -> None:
    """Also where the calibration was there before the sensor was open."""
    true = LiveWorld(1, rate=250, pose_rate=125)
    R = Rotation.random(12, random_state=1)
    session = Session(cw.calibrate(cw.Samples(true.wrench(R, np.zeros((12, 3))), R.as_matrix()), noise=[0.02] * 6))
    session.opened("sensor", replace(SENSOR, ranges=(40.0, 40.0, 40.0, 4.0, 4.0, 4.0)), true.t)
    session.opened("robot", ROBOT, true.t)
    seen = []
    for sensor, robot in chain(true.stand(0.3), true.hold(0.5, np.array([0.0, 0.0, -50.0]))):
        turn = session.feed(sensor, robot, t=true.t)
        assert turn.contact is not None
        seen += list(zip(turn.wrench[:, 2].tolist(), turn.contact.valid.tolist(), strict=True))
    over = [valid for fz, valid in seen if abs(fz) > 40.0]
    assert over
    assert not any(over)
    assert any(valid for fz, valid in seen if abs(fz) < 39.0)
