"""Stamps that go back, and those that are none or of two clocks: nothing is paired with a pose of another time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.geometry.arrays import Array
from contactwrench.geometry.quaternions import Quat
from contactwrench_ros import session
from contactwrench_ros.chain import Transform
from contactwrench_ros.monitoring import ERROR, OK, WARN
from contactwrench_ros.session import Session
from contactwrench_ros.track import Pose
from tests.ros2.free_tool import free, quat, second, settings

T0, STEP, END = 1.79e9, 1.3, 2.5
"""s: of the clock at the start; of the recording when it is set back, as the flange turns fastest, and at its end."""
TURN = Rotation.from_rotvec([0.4, -0.7, 0.2])
ONCE = (0.1, 0.0, 0.2)


def turned(t: float) -> Rotation:
    """Of the flange at `t` s: by up to 0.9 rad/s."""
    return Rotation.from_rotvec(0.375 * np.sin(2.4 * t) * np.array([0.6, 0.0, 0.8])) * TURN


@cache
def free_then(t: float) -> Array:
    """What a free tool reads at `t` s."""
    return free(turned(t))


@cache
def quats(t: float) -> tuple[Quat, Quat, Quat]:
    """Of the flange in the base, and by way of an elbow, at `t` s."""
    elbow = Rotation.from_rotvec([0.0, 0.3 * np.sin(t), 0.0])
    return quat(turned(t)), quat(elbow), quat(elbow.inv() * turned(t))


def tell(session: Session, source: str, t: float, stamp: float) -> None:
    """The pose at `t` s of the recording; of tf in two messages, as two publishers send it."""
    whole, elbow, beyond = quats(t)
    if source == "pose":
        session.pose(Pose(stamp, whole, ONCE))
        return
    session.transforms([Transform("base_link", "elbow", stamp, elbow, ONCE)], False)
    session.transforms([Transform("elbow", "tool0", stamp, beyond, ONCE)], False)


def events(late: int) -> Iterator[tuple[float, bool]]:
    """Times, s, of readings at 500 Hz and poses at 100 Hz, in the order in which they come: the poses by so many ms
    later than the readings (less than 0: earlier).
    """
    coming = [(k, False) for k in range(0, round(1e3 * END), 2)] + [(k, True) for k in range(0, round(1e3 * END), 10)]
    yield from ((1e-3 * k, is_pose) for k, is_pose in sorted(coming, key=lambda each: each[0] + late * each[1]))


def felt(session: Session, by: float, source: str = "tf", late: int = 1, only: str = "") -> tuple[Array, Array]:
    """Times (n,), s, and the forces (n,), N, that are published of a free tool where the clock is set back by `by`
    s; of readings or poses `only`, where that is said.
    """
    t, force = [], []
    for at, is_pose in events(late):
        kind = "poses" if is_pose else "readings"
        stamp = T0 + at - by * (at >= STEP) * (only in ("", kind))
        if is_pose:
            tell(session, source, at, stamp)
        elif (found := session.read(stamp, free_then(at))) is not None:
            t.append(at)
            force.append(float(np.linalg.norm(found[:3])))
    return np.array(t), np.array(force)


@pytest.mark.parametrize("by", [0.15, 0.3, 3.0, 30.0])
@pytest.mark.parametrize("source", ["tf", "pose"])
@pytest.mark.parametrize("late", [-25, 1, 25])
def test_a_clock_that_is_set_back_makes_no_contact(by: float, source: str, late: int, saved: str) -> None:
    """A looped bag, a simulator that begins anew, a step of NTP; whichever comes first, and whatever is under way then.
    Until a second pose comes the first is held, as at the start.
    """
    session = Session(settings(calibration=saved, pose_source=source))
    t, force = felt(session, by, source, late)
    assert force[t >= STEP].max() < max(1.3 * force[t < STEP].max(), 0.05)
    assert np.diff(t[t < STEP]).max() < 0.003
    assert t[t >= STEP][0] < STEP + 0.06
    assert np.diff(t[t > STEP + 0.06]).max() < 0.003
    status = session.status(END)
    assert status.level == WARN
    assert re.search(
        r"; stamps went back, (of (readings|tf|poses) by [0-9.]+ s(, )?)+: poses of before", status.message
    )
    assert status.message.endswith(": poses of before are forgotten")
    assert int(status.values["stamps went back"]) >= 1


def test_stamps_in_order_are_not_said_to_go_back(saved: str) -> None:
    session = Session(settings(calibration=saved))
    t, _ = felt(session, 0.0, late=-25)
    assert len(t) == 1250
    status = session.status(END)
    assert (status.level, status.message) == (OK, "contact wrenches at 500 Hz")
    assert status.values["stamps went back"] == "0"


def test_it_is_said_in_its_period_though_all_is_valid_by_its_end(saved: str) -> None:
    session = Session(settings(calibration=saved))
    second(session, TURN, 100.0)
    session.tally.went_back("readings", 3.0)
    session.tally.went_back("tf", 0.25)
    status = session.status(1.0)
    said = "stamps went back, of readings by 3 s, of tf by 0.25 s: poses of before are forgotten"
    assert (status.level, status.message, status.values["stamps went back"]) == (WARN, said, "2")
    second(session, TURN, 101.0)
    status = session.status(1.0)
    assert (status.level, status.values["stamps went back"]) == (OK, "2")


def test_a_fault_that_is_planted_is_found(saved: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rule of before: a clock that is set back by less than 10 s was not seen."""
    monkeypatch.setattr(session, "DISORDER", 10.0)
    for by in (0.3, 1.0):
        assert felt(Session(settings(calibration=saved)), by)[1].max() > 2.0


@pytest.mark.parametrize("only", ["poses", "readings"])
def test_one_of_two_clocks_that_is_set_back_is_said(only: str, saved: str) -> None:
    session = Session(settings(calibration=saved))
    t, _ = felt(session, 1.0, only=only)
    assert not ((t > STEP + 0.11) & (t < STEP + 0.9)).any()
    assert ("of readings by 0.994 s" in session.status(END).message) == (only == "readings")


@pytest.mark.parametrize("late", [0.12, 0.2, 3.0])
def test_poses_of_a_second_publisher_that_are_late_are_passed_over(late: float, saved: str) -> None:
    """Over a slow network, with each pose of the first; of a message that is sent again, as well."""
    session, found = Session(settings(calibration=saved)), []
    for k in range(2000):
        t = 0.002 * k
        if k % 5 == 0:
            tell(session, "tf", t, T0 + t)
        if k % 5 == 1 and t > late:
            tell(session, "tf", t - late, T0 + t - late)
        found.append(session.read(T0 + t - 0.04, free_then(t - 0.04)))
    assert all(wrench is not None and np.linalg.norm(wrench[:3]) < 0.3 for wrench in found[200:])
    assert session.tally.backs == 0


def test_readings_that_are_sent_again_are_no_clock_that_was_set_back(saved: str) -> None:
    session, found = Session(settings(calibration=saved)), []
    for k in range(1000):
        t = 0.002 * k
        if k % 5 == 0:
            tell(session, "tf", t, T0 + t)
        found.append(session.read(T0 + t, free_then(t)))
        if t > 0.5 and k % 10 == 3:
            assert session.read(T0 + t - 0.3, free_then(t - 0.3)) is None
    assert all(wrench is not None for wrench in found[20:])
    assert session.tally.backs == 0
    late = "reading: stamped 0.300 s before the last, expected them in order"
    assert session.status(2.0).message == f"75 of 1075 readings not compensated: {late}"


@pytest.mark.parametrize("apart", [0.0, 0.02, 0.08])
def test_disorder_of_several_publishers_is_not_taken_for_it(apart: float, saved: str) -> None:
    """Of tf, of a camera's frames in the same tree by any time, and of poses that overtake each other."""
    session, elbow = Session(settings(calibration=saved)), Rotation.from_rotvec([0.0, 0.2, 0.0])
    wrist, held = quat(elbow.inv() * TURN), quat(elbow)
    found = []
    for k in range(400):
        t = T0 + 0.01 * k
        session.transforms([Transform("elbow", "tool0", t, wrist, ONCE)], False)
        session.transforms([Transform("base_link", "elbow", t - apart, held, ONCE)], False)
        session.transforms([Transform("base_link", "elbow", t - apart - 0.05, held, ONCE)], False)
        session.transforms([Transform("base_link", "camera", t - 3.0 * (k % 2), held, ONCE)], False)
        found.append(session.read(t, free(TURN) + 1e-3 * (k % 7)))
    assert all(wrench is not None for wrench in found[20:])
    assert session.tally.backs == 0


def test_readings_of_two_clocks_are_not_gathered_together(saved: str) -> None:
    session = Session(settings(calibration=saved))
    assert session.gather() is None
    second(session, TURN, 100.0)
    second(session, TURN, 97.0)
    assert session.gathered is not None
    assert {reading.t < 98.0 for reading in session.gathered} == {True}


def test_what_has_no_stamp_is_said(saved: str) -> None:
    session = Session(settings(calibration=saved))
    for k in range(100):
        tell(session, "tf", 0.0, T0 + 0.01 * k)
        assert session.read(0.0, free_then(0.0)) is None
    status, none = (
        session.status(1.0),
        "it is stamped 0, expected the time of its measurement: let whoever sends it stamp it",
    )
    assert status.level == ERROR
    assert status.message == f"100 of 100 readings not compensated: reading: {none}"
    assert status.values["not published, no stamp"] == "100"
    session = Session(settings(calibration=saved))
    for k in range(100):
        tell(session, "pose", 0.0, 0.0)
        assert session.read(T0 + 0.01 * k, free_then(0.0)) is None
    assert session.status(1.0).message.startswith(f"100 of 100 readings not compensated: orientation: {none}")


def test_a_clock_that_begins_at_0_has_stamps(saved: str) -> None:
    session, q = Session(settings(calibration=saved)), quat(TURN)
    for k in range(20):
        session.pose(Pose(0.01 * k, q, ONCE))
        assert session.read(0.01 * k, free(TURN)) is not None


@pytest.mark.parametrize(
    ("ahead", "said"),
    [
        (0.4, "the last is 0.400 s old, expected at most 0.1 s"),
        (-600.0, "the oldest is 600.000 s after the reading"),
    ],
)
def test_clocks_of_two_computers_are_named_and_no_transform(ahead: float, said: str, saved: str) -> None:
    session = Session(settings(calibration=saved))
    for k in range(100):
        t = T0 + 0.01 * max(k, 1) if ahead > 0.0 else T0
        tell(session, "tf", 0.01 * k, T0 + 0.01 * k)
        session.read(t + ahead + 1e-6 * k, free(TURN))
    status = session.status(1.0)
    assert status.level == ERROR
    assert status.message == (
        f"100 of 100 readings not compensated: orientation: {said}, though poses come: let the computers that stamp "
        "poses and readings agree on the time, by chrony or PTP"
    )


def test_poses_that_stop_are_no_matter_of_clocks(saved: str) -> None:
    session = Session(settings(calibration=saved))
    session.pose(Pose(T0, quat(TURN), ONCE))
    for k in range(100):
        session.read(T0 + 0.01 * k, free(TURN))
    assert "though poses come" not in session.status(1.0).message
