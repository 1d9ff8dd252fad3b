"""A session with an arm that moves: the tool's inertia is subtracted where the robot's poses tell the motion, and never
from old ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.cli.live_terminal import instruction
from contactwrench.live.replay import Replay
from contactwrench.live.session import Session
from contactwrench.live.source import Batch, EndOfStreamError
from tests.live.sources.test_ur_decoder import data, decoded
from tests.support.live_motion import SENSOR, T0, Devices, Felt, dynamic, fed, felt, swung

NOT_SUBTRACTED = (
    "the robot's poses have no {}: the tool's inertia is not subtracted, and reads as contact while the arm "
    "accelerates; let it send {}"
)
SUBTRACTED = "the tool's inertia is subtracted: the robot's poses tell how the arm moves"
MOVES = 2.0
"""s: from when on the arm moves fast."""


@lru_cache
def at_rest() -> Felt:
    """What it is where nothing tells the motion."""
    return felt(swung(), Devices(pose_rate=125, position=False))


felt_once = lru_cache(felt)
"""The same for each test that asks no more of it than what was felt."""


def inertia_said(found: Felt) -> list[tuple[str, str, str]]:
    return [each for each in found.said if each[0] in ("inertia", "no_motion")]


@pytest.mark.parametrize(("pose_rate", "less", "jitter"), [(500, 40.0, 0.0), (500, 40.0, 0.005), (125, 13.0, 0.005)])
def test_free_motion_is_no_contact(pose_rate: int, less: float, jitter: float) -> None:
    """Also where a network is up to 5 ms late: times are the devices' own."""
    found = felt_once(swung(), Devices(pose_rate, jitter))
    assert found.rms(MOVES) < at_rest().rms(MOVES) / less
    assert found.rows.valid.all()
    assert not (found.rows.contact == 1).any()
    assert (at_rest().between(MOVES, 4.0).contact == 1).mean() > 0.9
    assert inertia_said(found) == [("inertia", "note", SUBTRACTED)]
    snapshot = found.session.snapshot(T0 + 5.0)
    assert snapshot.running is not None
    assert snapshot.running.inertia is True
    assert instruction(snapshot) == "Running. The tool's inertia is subtracted."


def test_what_poses_tell_that_come_alone_is_said_with_the_next_reading() -> None:
    """It was said of a turn with both, and lost else."""
    turns = Devices(125).turns(swung())
    apart = (part for now, sensor, poses in turns for part in ((now, Batch(), poses), (now, sensor, Batch())))
    assert inertia_said(fed(apart)) == [("inertia", "note", SUBTRACTED)]


@pytest.mark.parametrize(("pose_rate", "force"), [(500, 5.0), (125, 10.0)])
def test_a_push_in_motion_is_found(pose_rate: int, force: float) -> None:
    arm = swung(force)
    (contact,) = felt(arm, Devices(pose_rate, jitter=0.005)).rows.contacts
    assert 0.0 <= contact.onset - T0 - arm.begin - 1.2 < 0.04
    assert contact.release == pytest.approx(T0 + arm.begin + 1.6, abs=0.06)
    assert np.linalg.norm(contact.peak[:3]) == pytest.approx(force, abs=0.5)


def test_poses_with_noise_widen_the_std_and_make_no_contact() -> None:
    """0.01 mm and 0.001 deg."""
    found = felt(swung(), Devices(jitter=0.005, noise=1e-5))
    moving = found.between(MOVES, 4.0)
    assert (moving.contact == 1).mean() < 0.01
    assert found.rms(MOVES) < 2.0 * float(np.sqrt(np.nanmean(np.sum(moving.std[:, :3] ** 2, axis=1))))
    (contact,) = felt(swung(10.0), Devices(125, jitter=0.005, noise=1e-5)).rows.contacts
    assert np.linalg.norm(contact.peak[:3]) == pytest.approx(10.0, abs=1.0)


def test_without_positions_the_arm_is_at_rest_and_that_is_said_once() -> None:
    assert inertia_said(at_rest()) == [("no_motion", "warning", NOT_SUBTRACTED.format("position", "x, y, z too"))]
    assert at_rest().rows.valid.all()
    snapshot = at_rest().session.snapshot(T0 + 5.0)
    assert snapshot.running is not None
    assert snapshot.running.inertia is False
    assert instruction(snapshot) == "Running. The tool's inertia is not subtracted."


def test_a_calibration_that_knows_no_inertia_says_so_once() -> None:
    without = Session(replace(dynamic(), dynamics=None))
    without.opened("sensor", SENSOR, T0)
    for now, sensor, poses in islice(Devices(125).turns(swung()), 100):
        without.feed(sensor, poses, t=now)
    said = [(event.severity, event.text) for event in without.events() if event.kind in ("inertia", "no_motion")]
    text = (
        "the calibration knows no inertia of the tool, which reads as contact while the arm accelerates: calibrate "
        "with --model dynamic, or in a session whose robot sends positions"
    )
    assert said == [("note", text)]


def test_by_times_of_arrival_nothing_is_subtracted() -> None:
    found = felt(swung(), Devices(125, clock=False))
    missing = NOT_SUBTRACTED.format("time of their own", "t too, by its own clock")
    assert inertia_said(found) == [("no_motion", "warning", missing)]
    assert found.rms(MOVES) == pytest.approx(at_rest().rms(MOVES), rel=0.01)


@pytest.mark.parametrize("lost", ["robot", "position"])
def test_a_motion_that_is_old_is_not_subtracted(lost: str) -> None:
    """The robot's stream is cut for 0.3 s, or its positions are, while the arm moves."""
    found = felt(swung(), Devices(500, lost=lost, cut=(2.5, 2.8)))  # type: ignore[arg-type]
    gone = found.between(2.525, 2.8)
    assert not gone.valid.any()
    assert np.isnan(gone.wrench).all()
    assert {reason.kind for reason in gone.reason if reason is not None} == {"stale"}
    assert found.between(2.815, 4.0).valid.all()
    assert found.between(0.5, 2.515).valid.all()
    assert not (found.rows.contact == 1).any()
    assert found.rms(MOVES) < at_rest().rms(MOVES) / 40.0
    if lost == "position":
        assert str(gone.reason[0]) == "stale: the position is 0.03 s old"
    back = found.between(2.8, 2.82)
    unknown = [str(reason) for reason in back.reason if reason is not None and reason.kind == "stale"]
    assert unknown[-1] == "stale: the motion is not known yet, 3 poses in a row tell it"


def test_positions_that_are_no_numbers_grow_old() -> None:
    nowhere = (np.nan, np.nan, np.nan)

    def spoilt(robot: Batch) -> Batch:
        return Batch([each._replace(position=nowhere) if each.device > 2.5 else each for each in robot.samples])

    found = fed((now, sensor, spoilt(robot)) for now, sensor, robot in Devices(500).turns(swung()))
    assert not found.between(2.53, 4.0).valid.any()
    assert str(found.between(2.53, 4.0).reason[0]).startswith("stale: the position is 0.03 s old")


def test_the_offset_of_a_tcp_is_undone() -> None:
    """A TCP 0.2 m off, and turned, whose place has other accelerations than the flange's."""
    arm = swung()
    rec, offset = arm.recorded, np.array([0.05, -0.1, 0.2, 0.3, -0.5, 0.4])
    turn = Rotation.from_matrix(rec.R_base_flange)
    tcp = np.hstack([rec.position + turn.apply(offset[:3]), (turn * Rotation.from_rotvec(offset[3:])).as_rotvec()])
    packets = [data(t, pose, offset) for t, pose in zip(rec.t[::2].tolist(), tcp[::2].tolist(), strict=True)]
    told = decoded(packets).samples

    def of_tcp(batch: Batch) -> Batch:
        return Batch(
            [told[round(500.0 * each.device)]._replace(arrival=each.arrival, wrench=None) for each in batch.samples]
        )

    found = fed((now, sensor, of_tcp(robot)) for now, sensor, robot in Devices(500).turns(arm))
    assert found.rms(MOVES) == pytest.approx(felt_once(arm, Devices(500)).rms(MOVES), rel=0.02)


def played(replay: Replay) -> Iterator[tuple[float, Batch, Batch]]:
    with suppress(EndOfStreamError):
        while True:
            batch = replay.read(0.1)
            yield batch.samples[-1].arrival, batch, Batch()


def test_a_recording_that_is_played_is_the_same(tmp_path: Path) -> None:
    """Its poses come long before the readings that need them, and are taken at their times all the same."""
    rec = swung().recorded
    turn = Rotation.from_matrix(rec.R_base_flange).as_quat()
    path = tmp_path / "run.csv"
    table = np.column_stack([rec.t, rec.wrench, turn, rec.position])
    np.savetxt(path, table, "%.9g", ",", header="t,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,x,y,z", comments="")
    replay = Replay(path, speed=0.0)
    replay.open()
    found = fed(played(replay), robot=None)
    assert found.rows.valid.mean() > 0.99
    assert not (found.rows.contact == 1).any()
    assert found.rms() < at_rest().rms() / 40.0
