"""What the motion between the poses of a wizard tells of the tool's inertia: all or nothing, never from a motion that
is not what it seems.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from contactwrench.live import fitting
from contactwrench.live.fitting import with_delay, with_inertia
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from tests.support.in_motion import Moving, moving
from tests.support.world import Array

SEED, LATE = 61, 0.02
"""s by which the wrench is stamped behind the orientation."""


@lru_cache
def stopped_and_gone() -> Moving:
    """Twelve stops, and little else."""
    return moving(SEED, stops=12, seconds=0.1, rate=500.0)


@lru_cache
def of_stops() -> cw.Calibration:
    """As a session has it from the poses that it took."""
    return cw.calibrate(stopped_and_gone().samples())


def streams_of(arm: Moving, *, push: Array | None = None, position: Array | None = None, rate: int = 125) -> Streams:
    """As the devices send them, `push` (n, 6) beside; the robot at that rate, with a `position` (m, 3) of its own."""
    rec = arm.recorded
    every = slice(None, None, 500 // rate)
    place = rec.position[every] if position is None else position
    wrench = rec.wrench + (0.0 if push is None else push)
    return Streams(WrenchStream(rec.t + LATE, wrench), OrientationStream(rec.t[every], rec.R_base_flange[every], place))


@lru_cache
def delayed() -> cw.Calibration:
    """With the delay that the motion tells."""
    return with_delay(of_stops(), streams_of(stopped_and_gone()))


@lru_cache
def moved() -> cw.Calibration:
    """And with the inertia."""
    return with_inertia(delayed(), streams_of(stopped_and_gone()))


def test_the_motion_between_the_poses_tells_the_inertia() -> None:
    arm, found = stopped_and_gone(), moved()
    assert found.dynamics is not None
    assert found.inertia is not None
    assert found.sensor_offset is not None
    xx, xy, xz, yy, yz, zz = arm.settings.tool.inertia
    true = np.array([xx, xy, xz, yy, yz, zz])
    told = found.inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    assert (np.abs(told - true) < 4.0 * found.std["inertia"]).all()
    assert (np.abs(found.sensor_offset - arm.offset) < 4.0 * found.std["sensor_offset"]).all()
    assert found.verdict == "good"
    assert found.delay is not None
    assert 0.0 < found.delay - LATE < 0.5 / np.pi / arm.settings.sensor.low_pass  # its filter makes readings late, too
    assert found.weight == of_stops().weight
    work = moving(SEED + 10, stops=0, seconds=4.0, rate=500.0).samples()
    assert work.t is not None
    left = cw.Compensator(found, delay=0.0, noise=0.05, lowpass=20.0).run(
        work.wrench, work.R_base_flange, work.t, position=work.position
    )
    assert not (left.contact == 1).any()


def test_few_of_the_readings_tell_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    streams, whole = streams_of(stopped_and_gone()), moved()
    monkeypatch.setattr(fitting, "MOST_ROWS", len(streams.wrench) * 2 // 3)
    half = with_inertia(delayed(), streams)
    assert whole.inertia is not None
    assert half.inertia is not None
    assert not (half.inertia == whole.inertia).all()  # no more than so many
    assert half.inertia == pytest.approx(whole.inertia, abs=3.0 * float(np.max(whole.std["inertia"])))


def dragged(arm: Moving) -> Array:
    """Who leads the arm by its tool: some N along the way that it goes, at the hook, sensor axes."""
    rec = arm.recorded
    velocity = np.gradient(rec.position, rec.t, axis=0)
    force = 40.0 * np.einsum("nji,nj->ni", rec.R_base_flange, velocity)
    return np.hstack([force, np.cross([0.0, 0.0, 0.15], force)])


def test_nothing_is_taken_from_a_motion_that_is_not_free_or_not_told() -> None:
    arm = stopped_and_gone()
    place = arm.recorded.position[::4]
    rng = np.random.default_rng(SEED)
    cases = {
        "led by the tool": streams_of(arm, push=dragged(arm)),
        "in mm": streams_of(arm, position=1e3 * place),
        "mirrored": streams_of(arm, position=place * [-1.0, 1.0, 1.0]),
        "axes exchanged": streams_of(arm, position=place[:, [1, 0, 2]]),
        "all zero": streams_of(arm, position=0.0 * place),
        "rare": streams_of(arm, rate=25),
        "noisy": streams_of(arm, position=place + rng.normal(0.0, 0.02, place.shape)),
    }
    without = streams_of(arm)
    cases["without"] = replace(without, orientation=replace(without.orientation, position=None))
    why = {
        "in mm": "found the flange accelerating at ",
        "all zero": "found positions that are all 0",
        "rare": "poses came less than 28 times a second",
        "without": "the robot's poses have no positions",
    }
    for name, streams in cases.items():
        found = with_inertia(delayed(), streams)
        assert found.dynamics is None, name
        (said,) = (finding.text for finding in found.findings if finding.kind is Kind.UNTOLD_BY_MOTION)
        told = "the tool's inertia is not known, and reads as contact while the arm accelerates: "
        assert said.startswith(told + why.get(name, "")), name
        assert found.verdict == of_stops().verdict
    assert with_inertia(of_stops(), None) is of_stops()
