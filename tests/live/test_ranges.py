"""A reading at the end of a sensor's range is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.lab.ft300 import Ft300, Robotiq
from contactwrench.lab.truth import Plain
from contactwrench.live.running import Options
from contactwrench.live.session import Session
from contactwrench.live.source import Six
from contactwrench.live.uri import source_of
from tests.support.live_world import ROBOT, SENSOR, LiveWorld

OF_40_N, OF_30_N, OF_300_N = ((n, n, n, 0.1 * n, 0.1 * n, 0.1 * n) for n in (40.0, 30.0, 300.0))


@pytest.mark.parametrize(("own", "stated", "limit"), [(OF_40_N, None, 40.0), (OF_300_N, OF_30_N, 30.0)])
def test_a_reading_beyond_the_range_of_a_sensor_is_not_valid(own: Six, stated: Six | None, limit: float) -> None:
    """That it states itself, or a person does; also where the calibration was there before the sensor was open."""
    true = LiveWorld(1, rate=250, pose_rate=125)
    R = Rotation.random(12, random_state=1)
    known = cw.calibrate(cw.Samples(true.wrench(R, np.zeros((12, 3))), R.as_matrix()), noise=[0.02] * 6)
    session = Session(known, options=Options(ranges=stated))
    session.opened("sensor", replace(SENSOR, ranges=own), true.t)
    session.opened("robot", ROBOT, true.t)
    seen = []
    for sensor, robot in chain(true.stand(0.3), true.hold(0.5, np.array([0.0, 0.0, -50.0]))):
        turn = session.feed(sensor, robot, t=true.t)
        assert turn.contact is not None
        seen += list(zip(turn.wrench[:, 2].tolist(), turn.contact.valid.tolist(), strict=True))
    over = [valid for fz, valid in seen if abs(fz) > limit]
    assert over
    assert not any(over)
    assert any(valid for fz, valid in seen if abs(fz) < limit - 1.0)


@pytest.mark.parametrize("fake", [Ft300, Robotiq])
def test_an_ft_300_states_its_range(fake: Callable[..., Any]) -> None:
    """Beyond which it read 327.67 N of 500, and that was valid."""
    with fake(Plain(wrench=(500.0, 0.0, 0.0, 0.0, 0.0, 0.0))) as sensor:
        source = source_of(sensor.uri)
        assert source.open().ranges == OF_300_N
        source.close()
