"""The node's session while the arm moves: inertia is subtracted where poses tell the motion, never from old ones."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from contactwrench.live.pose_track import PoseFeed
from contactwrench.live.running import NOT_SUBTRACTED, OF_ACCELEROMETER
from contactwrench_ros.monitoring import OK, WARN
from contactwrench_ros.parameters import defaults
from contactwrench_ros.session import Session
from contactwrench_ros.track import Track
from tests.support.accelerometer import calibrated_by_accelerometer
from tests.support.live_motion import T0, dynamic, swung
from tests.support.ros_motion import MOVES, Arm, at_rest, felt, felt_once, in_a_batch, session_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ros_motion")


@pytest.mark.parametrize(
    ("rate", "most", "tf"), [(500, 0.06, True), (500, 0.06, False), (125, 0.19, True), (100, 0.26, False)]
)
def test_free_motion_is_no_contact(rate: int, most: float, tf: bool, folder: Path) -> None:
    """At 500 Hz no more is left than of the whole recording; at less, the poses are older than the readings."""
    found = felt(Arm(rate, tf), folder)
    assert found.rms() < most
    assert found.rms() < in_a_batch() or rate < 500
    assert at_rest(folder).rms() > 3.0
    assert np.isfinite(found.wrench[found.between(0.1)]).all()
    assert not found.contact.any()
    assert at_rest(folder).contact[found.between(MOVES)].mean() > 0.9
    status = found.session.status(4.5)
    assert status.values["inertia subtracted"] == "yes"
    assert found.session.lacking == ""


@pytest.mark.parametrize(
    ("tells", "least", "most"),
    [
        (Arm(50), 0.5, 0.65),
        (Arm(500, scatter=1e-4), 0.9, 1.4),
        (Arm(100, scatter=1e-4), 0.4, 0.7),
        (Arm(500, scatter=2e-5), 0.1, 0.3),
    ],
)
def test_poses_that_are_slow_or_stamped_wrong_leave_more(tells: Arm, least: float, most: float, folder: Path) -> None:
    """As the page has it. The test for contact is blunter then, and free motion hardly ever counts as one."""
    found = felt(tells, folder)
    assert least < found.rms() < most
    assert found.contact[found.between(MOVES)].mean() < 0.1


@pytest.mark.parametrize("tf", [True, False])
def test_a_push_in_motion_is_felt(tf: bool, folder: Path) -> None:
    arm = swung(5.0)
    found = felt(Arm(500, tf), folder, arm)
    touching = found.t[found.contact] - arm.begin
    assert 1.2 < touching[0] < 1.24
    assert 1.6 < touching[-1] < 1.66
    pushed = found.wrench[found.between(arm.begin + 1.35, arm.begin + 1.55), :3]
    assert np.linalg.norm(pushed, axis=1) == pytest.approx(5.0, abs=0.5)


def test_links_that_are_stamped_apart_tell_a_motion_where_both_are_heard_anew(folder: Path) -> None:
    """At 100 Hz, 4 ms apart, so that a pose is known 6 ms later; in between one of them would be on a straight line,
    whose ends are accelerations.
    """
    found = felt_once(Arm(100, apart=4), folder)
    assert found.rms() < 1.7 * felt_once(Arm(100), folder).rms()
    assert np.isfinite(found.wrench[found.between(0.1)]).all()
    assert not found.contact.any()


@pytest.mark.parametrize("rate", [500, 100])
def test_readings_that_are_stamped_late_are_of_a_motion_that_is_known(rate: int, folder: Path) -> None:
    """Nothing more is left of them than of a whole recording."""
    assert felt_once(Arm(rate, late=0.03), folder).rms() == pytest.approx(in_a_batch(), rel=0.03)


@pytest.mark.parametrize(
    "tells", [Arm(tf=False, position_lost=(2.5, 2.8)), Arm(lost=(2.5, 2.8)), Arm(100, lost=(2.5, 2.8))]
)
def test_a_motion_that_is_old_is_not_published(tells: Arm, folder: Path) -> None:
    """For five periods of the poses, 20 ms at the least, as in a live session."""
    found = felt(tells, folder)
    patience = max(0.02, 5.0 / tells.rate) + 0.006
    gone = found.between(2.5 + patience, 2.8)
    assert np.isnan(found.wrench[gone]).all()
    told = {found.why[row].partition(": ")[0] for row in np.flatnonzero(gone)}
    assert told <= {"motion", "orientation"}
    first = found.why[int(np.flatnonzero(gone)[0])]
    assert first.startswith("motion: the position is 0.0")
    assert first.endswith(" s old")
    back = found.between(2.8, 2.8 + 3.5 * max(1.0 / tells.rate, 0.004) + 0.01)
    assert "motion: the motion is not known yet, 3 poses in a row tell it" in {
        found.why[row] for row in np.flatnonzero(back)
    }
    assert np.isfinite(found.wrench[found.between(2.85)]).all()
    assert not found.contact.any()
    assert found.rms() < at_rest(folder).rms() / 10.0
    status = found.session.status(4.5)
    assert status.level == WARN
    assert int(status.values["not published, stale motion"]) > 5


def test_positions_that_stop_are_said_in_one_line(folder: Path) -> None:
    session = felt(Arm(tf=False, position_lost=(2.5, np.inf)), folder).session
    status = session.status(4.5)
    assert status.level == WARN
    assert status.message.endswith(" of 4500 readings not compensated: motion: the position is 2.00 s old")


@dataclass(frozen=True)
class SetBack(Arm):
    """Stamps go back by so many s."""

    by: float = 0.0

    def stamp(self, t: float) -> float:
        """Of the recording's time, s."""
        return T0 + t - self.by * (t >= self.anew)


@pytest.mark.parametrize("tells", [Arm(anew=3.0), SetBack(anew=3.0, by=0.3)])
def test_stamps_that_begin_anew_are_followed(tells: Arm, folder: Path) -> None:
    found = felt(tells, folder)
    assert np.isfinite(found.wrench[found.between(3.05)]).all()
    assert found.rms(3.0) < 0.08
    assert not found.contact.any()


def test_settings_that_change_in_motion_begin_anew(folder: Path) -> None:
    session, arm = session_of(dynamic(), folder), swung()
    tell, rec = Arm().told_to(session, arm), arm.recorded
    left = []
    for row in range(2000, 3000):
        tell(row)
        if row == 2500:
            session.set({"lowpass": 15.0})
        found = session.read(T0 + float(rec.t[row]), rec.wrench[row])
        left.append(np.nan if found is None else float(np.linalg.norm(found[:3])))
    assert np.isnan(left[500:505]).all()
    assert np.isfinite(left[540:]).all()
    assert np.nanmax(left[600:]) < 0.3


@pytest.mark.parametrize(
    ("placed", "subtracted", "level", "message"),
    [
        (True, "yes", OK, "contact wrenches at 1000 Hz"),
        (False, "no", WARN, NOT_SUBTRACTED.format("position", "x, y, z too")),
    ],
)
def test_diagnostics_tell_whether_inertia_is_subtracted(
    placed: bool, subtracted: str, level: int, message: str, folder: Path
) -> None:
    session, rec = session_of(dynamic(), folder, pose_source="pose"), swung().recorded
    assert session.status(1.0).values["inertia subtracted"] == "not yet"
    tell = Arm(tf=False, placed=placed).told_to(session, swung())
    for row in range(2000):
        if row == 1000:
            session.status(1.0)
        tell(row)
        session.read(T0 + float(rec.t[row]), rec.wrench[row])
    status = session.status(1.0)
    assert (status.level, status.message, status.values["inertia subtracted"]) == (level, message, subtracted)
    assert session.lacking == ("" if placed else message)


def test_an_accelerometer_is_not_read_and_that_is_said(folder: Path) -> None:
    session = session_of(calibrated_by_accelerometer(), folder, pose_source="pose")
    rec = swung().recorded
    tell = Arm(tf=False).told_to(session, swung())
    found = []
    for row in range(200):
        tell(row)
        found.append(session.read(T0 + float(rec.t[row]), rec.wrench[row]))
    assert all(wrench is not None for wrench in found[50:])
    assert session.lacking == OF_ACCELEROMETER
    assert session.status(1.0).values["inertia subtracted"] == "no"


def test_poses_that_are_too_slow_are_said(folder: Path) -> None:
    """As those of robot_state_publisher, unless it is told otherwise."""
    found = felt(Arm(20), folder)
    assert found.session.lacking.startswith("poses come at 20 Hz, expected 80 Hz or more: ")
    assert not np.isfinite(found.wrench[found.between(MOVES)]).any()
    assert np.isfinite(found.wrench[found.between(0.5, 1.4)]).all()
    assert "\n" not in found.session.lacking
    assert felt_once(Arm(100), folder).session.lacking == ""


def test_a_calibration_without_inertia_is_as_before(folder: Path) -> None:
    session = session_of(replace(dynamic(), dynamics=None), folder)
    assert session.motion is None
    assert session.status(1.0).values["inertia subtracted"] == "no, the calibration knows none"
    assert "inertia subtracted" not in Session(defaults()).status(1.0).values


def test_faults_that_are_planted_are_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A delay that is counted twice, and a pose between the stamps of its links that counts as one of the arm's."""
    late, apart = Arm(late=0.03), Arm(100, apart=4)
    once, anew = felt_once(late, folder).rms(), felt_once(apart, folder).rms()
    with monkeypatch.context() as patch:
        patch.setattr("contactwrench_ros.motion.PoseFeed", lambda compensator, _: PoseFeed(compensator, 0.03))
        assert felt(late, folder).rms() > 3.0 * once
    with monkeypatch.context() as patch:
        patch.setattr(Track, "newest", lambda *_: np.inf)
        assert felt(apart, folder).rms() > 3.0 * anew
