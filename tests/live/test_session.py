"""A session from connect to run, fed by a world that knows the truth."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.files import already_there
from contactwrench.live.fitting import NOT_TESTED
from contactwrench.live.snapshot import Command, Phase
from contactwrench.live.source import About, Batch, Sample
from contactwrench.live.wizard import Wish
from tests.support.live_drive import Driver
from tests.support.live_world import SENSOR, LiveWorld

WISH = Wish(poses=6)
FLIPPED = Rotation.from_euler("zx", [-120.0, 176.0], degrees=True)


def refused(_: cw.Calibration) -> str:
    raise already_there("cal.json")


def world(seed: int, **named: object) -> LiveWorld:
    return LiveWorld(seed, rate=125, pose_rate=125, **named)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def at_poses() -> dict[int, Driver]:
    """A session of the usual world that nobody touches, kept when 2, 5, 6 and 8 poses are taken: for copies of it. What
    it accepts it would write where a file is.
    """
    drive, kept = Driver(world(6), wish=WISH, save=refused, save_accepted=True), dict[int, Driver]()
    drive.push_test()
    for count in (2, 5, 6, 8):
        drive.poses(count)
        kept[count] = deepcopy(drive)
    return kept


@pytest.fixture(scope="module")
def at_fit(at_poses: dict[int, Driver]) -> Driver:
    """The same, when six poses are fitted."""
    drive = deepcopy(at_poses[6])
    drive.do(Command.NEXT)
    return drive


@pytest.fixture(scope="module")
def calibration(at_poses: dict[int, Driver]) -> cw.Calibration:
    """Of the usual world, by a session."""
    drive = deepcopy(at_poses[8])
    drive.do(Command.NEXT)
    assert drive.session.calibration is not None
    return drive.session.calibration


WORLDS = {
    "pull, upright": {},
    "reaction, from the ceiling, late": {
        **{"sign": -1.0, "delay": 0.04, "down": (0.0, 0.0, 1.0)},
        **{"mounting": FLIPPED, "com": (0.01, -0.02, -0.06)},
    },
}


@pytest.mark.parametrize("named", WORLDS.values(), ids=WORLDS)
def test_the_wizard_finds_the_tool_the_sign_and_the_delay(named: dict[str, object], tmp_path: Path) -> None:
    """Free air is the same for a sensor of the other sign on a robot that hangs: the pushes tell."""
    true, saved = world(1, **named), tmp_path / "saved.json"
    drive = Driver(true, wish=WISH, save=lambda cal: cal.save(saved) or str(saved))
    drive.calibrated()
    drive.do(Command.SAVE)
    cal = cw.Calibration.load(saved)
    assert cal.weight is not None
    assert cal.com is not None
    assert cal.R_flange_sensor is not None
    assert cal.delay is not None
    assert cal.delay_std is not None
    assert abs(cal.weight - true.weight) < 4.0 * cal.std["weight"]
    assert (np.abs(cal.com - true.com) < 4.0 * cal.std["com"]).all()
    assert (np.abs(cal.bias - true.bias) < 4.0 * cal.std["bias"]).all()
    assert (Rotation.from_matrix(cal.R_flange_sensor) * true.mounting.inv()).magnitude() < 4.0 * max(cal.std["mount"])
    assert cal.gravity_direction @ true.down > np.cos(np.deg2rad(0.2))
    assert cal.provenance.get("sign", "pull") == ("pull" if true.sign > 0.0 else "reaction")
    assert "9.0 N towards the flange's +x" in str(cal.provenance["push_test"])
    hangs = [finding.text for finding in cal.findings if finding.kind == "sign_not_confirmed"]
    assert len(hangs) == (true.down[2] > 0.0)  # which nobody stated
    assert abs(cal.delay - true.delay) < 2e-3
    assert (abs(cal.delay) > 3.0 * cal.delay_std) == (true.delay > 0.0)
    drive.verified()
    assert drive.shown().verified.startswith("passed")
    assert drive.session.phase is Phase.RUN
    free = np.concatenate([turn.contact.wrench for turn in drive.play(true.stand(1.0)) if turn.contact is not None])
    assert np.abs(free.mean(axis=0)).max() < 0.01
    turns = drive.play(true.stand(3.0, (4.0, -3.0, 0.0)))
    contact = np.concatenate([turn.contact.wrench for turn in turns if turn.contact is not None])
    pushed = contact[np.linalg.norm(contact[:, :3], axis=1) > 4.5].mean(axis=0)
    expected = (true.R_base_flange * true.mounting).inv().apply([4.0, -3.0, 0.0])
    assert np.allclose(pushed[:3], expected, atol=0.05)
    assert np.allclose(pushed[3:], np.cross(true.hook, expected), atol=0.01)
    drive.play(true.stand(1.5))
    assert [text for text in drive.said("contact") if "ended" in text]


def test_pushes_that_contradict_the_poses_are_said(at_poses: dict[int, Driver]) -> None:
    """A push towards +y where +x was asked for would settle the sign by chance: it is refused. Made after the poses."""
    drive = deepcopy(at_poses[6])
    for command in (Command.BACK, Command.RETAKE, Command.BACK):
        drive.do(command)
    drive.push_test(along=(0.0, 1.0, 0.0))
    drive.do(Command.NEXT)
    fit = drive.shown().fit
    assert fit is not None
    assert fit.refusal.startswith("the push towards the flange's +x reads 90 deg away from where these poses put it")
    assert Command.NEXT not in drive.session.commands()


def test_a_hand_that_was_there_before_the_push_test_makes_no_push_of_its_release() -> None:
    drive = Driver(world(13), wish=WISH)
    drive.play(drive.world.stand(1.6))
    drive.do(Command.NEXT)
    drive.play(drive.world.hold(1.5, np.array([0.0, 0.0, -9.0])))
    drive.play(drive.world.hold(7.5, np.zeros(3)))
    assert [text for text in drive.said("push") if text.startswith("felt ")] == []
    assert drive.said("push")[-1].startswith("a hand was at the tool before, or is: ")
    drive.play(drive.world.stand(2.5, (0.0, 0.0, -9.0)))
    assert drive.said("push")[-1] == "felt 9.0 N for the push down"


def test_a_pose_that_is_pushed_while_it_is_taken_is_refused_by_name(at_poses: dict[int, Driver]) -> None:
    drive = deepcopy(at_poses[5])
    poses = drive.shown().poses
    assert poses is not None
    drive.play(drive.world.move(Rotation.from_quat(poses.targets[0]), 1.5))
    world_, push = drive.world, np.array([2.0, 1.0, 0.0])
    still = Rotation.from_quat(world_.R_base_flange.as_quat())
    drive.play(world_.hold(2.0, push))
    assert len(drive.shown().poses.taken) == 5  # type: ignore[union-attr]
    assert drive.said("pose_refused")[-1].startswith("pose 6: reads 2.2 N off what the other poses predict")
    drive.play(world_.hold(2.5, np.zeros(3)))
    assert (still.inv() * world_.R_base_flange).magnitude() < 1e-9
    assert len(drive.shown().poses.taken) == 6  # type: ignore[union-attr]


def test_a_touch_while_a_pose_is_under_way_is_said_by_its_number(at_poses: dict[int, Driver]) -> None:
    drive = deepcopy(at_poses[2])
    drive.play(drive.world.move(Rotation.from_quat(drive.shown().poses.targets[0]), 1.5))  # type: ignore[union-attr]
    drive.play(drive.world.hold(0.8, np.zeros(3)))
    assert drive.shown().poses.progress > 0.3  # type: ignore[union-attr]
    drive.play(drive.world.hold(0.5, np.array([9.0, 0.0, 0.0])))
    (said,) = drive.said("pose_refused")
    assert said.startswith("pose 3, under way: the reading moves by ")
    assert said.endswith(": keep hands off the tool; it begins anew")
    assert "e+" not in said
    drive.play(drive.world.hold(2.5, np.zeros(3)))
    assert len(drive.shown().poses.taken) == 3  # type: ignore[union-attr]


def test_a_hand_that_lets_go_after_the_pose_voids_it(at_poses: dict[int, Driver]) -> None:
    """Before the fifth pose nothing predicts the reading: the jump while the arm stands tells."""
    drive = deepcopy(at_poses[2])
    drive.play(drive.world.move(Rotation.from_quat(drive.shown().poses.targets[0]), 1.5))  # type: ignore[union-attr]
    drive.play(drive.world.hold(2.2, np.array([1.0, 1.0, 0.0])))
    assert len(drive.shown().poses.taken) == 3  # type: ignore[union-attr]
    drive.play(drive.world.hold(2.5, np.zeros(3)))
    assert drive.said("pose_refused")[-1].startswith("pose 3: the reading changed by 1.4 N while the arm stood")
    assert len(drive.shown().poses.taken) == 3  # type: ignore[union-attr]


def test_no_pose_is_refused_where_nobody_touches(at_poses: dict[int, Driver]) -> None:
    drive = at_poses[8]
    assert drive.said("pose_refused") == []
    assert len(drive.said("pose")) == 8


def test_an_old_orientation_never_makes_a_valid_contact_wrench(calibration: cw.Calibration) -> None:
    drive = Driver(world(7), calibration)
    drive.play(drive.world.stand(1.0))
    assert drive.shown().contact.valid  # type: ignore[union-attr]
    silent = drive.world.t
    turns = drive.play((sensor, None) for sensor, _ in drive.world.stand(1.0))
    late = np.concatenate([turn.t for turn in turns]) - silent
    valid = np.concatenate([turn.contact.valid for turn in turns if turn.contact is not None])
    wrench = np.concatenate([turn.contact.wrench for turn in turns if turn.contact is not None])
    assert not valid[late > 0.05].any()
    assert np.isnan(wrench[late > 0.05]).all()
    assert drive.shown().contact.reason.startswith("stale: the orientation is ")  # type: ignore[union-attr]
    event = next(event for event in drive.events if event.kind == "silent")
    assert event.device == "ur://robot"
    assert event.t - silent < 0.5
    drive.play(drive.world.stand(0.5))
    assert drive.shown().contact.valid  # type: ignore[union-attr]
    assert drive.said("back") == ["samples come again"]


@pytest.mark.parametrize(("seconds", "said"), [(0.8, []), (1.5, ["stale: no orientation has come"])])
def test_a_robot_is_asked_a_moment_after_the_sensor(
    calibration: cw.Calibration, seconds: float, said: list[str]
) -> None:
    """What that has sent by then has no orientation, as anybody expects; one that does not come is said."""
    drive = Driver(world(13), calibration)
    turns = drive.play((sensor, None) for sensor, _ in drive.world.stand(seconds))
    assert not any(turn.contact.valid.any() for turn in turns if turn.contact is not None)
    drive.play(drive.world.stand(1.5))
    assert drive.shown().contact.valid  # type: ignore[union-attr]
    assert drive.said("stale") == said


def test_a_sensor_that_says_nothing_shows_no_contact_wrench(calibration: cw.Calibration) -> None:
    drive = Driver(world(12), calibration)
    drive.play(drive.world.stand(1.0))
    drive.play((None, robot) for _, robot in drive.world.stand(0.6))
    contact = drive.shown().contact
    assert contact is not None
    assert not contact.valid
    assert contact.wrench == (None,) * 6
    assert contact.reason.startswith("silent: ")


def test_a_flawed_reading_is_not_used_and_says_why(calibration: cw.Calibration) -> None:
    drive = Driver(world(8), calibration)
    drive.play(drive.world.stand(1.0))
    for sensor, robot in drive.world.stand(0.2):
        bad = Batch([sample._replace(flaw="saturated: fx") for sample in sensor.samples])
        turn = drive.play([(bad, robot)])[0]
        assert turn.contact is not None
        assert not turn.contact.valid.any()
        assert set(turn.contact.reason) == {"saturated: fx"}
    assert drive.shown().contact.reason == "saturated: fx"  # type: ignore[union-attr]


def test_what_is_not_possible_now_is_said() -> None:
    drive = Driver(world(9))
    drive.do(Command.ZERO)
    assert drive.said("refusal") == ["zero is not possible now"]
    drive.play(drive.world.stand(1.0))
    drive.do(Command.RETAKE, 3)
    assert drive.said("refusal")[-1] == "retake is not possible now"


def test_a_new_zero_is_taken_and_a_touched_tool_gives_none(calibration: cw.Calibration) -> None:
    drive = Driver(world(10), calibration)
    drive.play(drive.world.stand(1.5))
    drive.do(Command.ZERO)
    assert drive.said("zero")[0].startswith("the zero moved by ")
    drive.play(drive.world.hold(1.0, np.array([5.0, 0.0, 0.0])))
    drive.do(Command.ZERO)
    assert drive.said("refusal")[0].startswith("no new zero: ")


def test_readings_of_before_a_silence_give_no_zero_and_no_pose(calibration: cw.Calibration) -> None:
    running, guided = Driver(world(10), calibration), Driver(world(11))
    running.play(running.world.stand(1.5))
    guided.push_test()
    guided.play(guided.world.move(Rotation.random(random_state=2)))
    guided.play(guided.world.hold(0.4, np.zeros(3)))
    for drive in (running, guided):
        drive.world.t += 1.5
    running.do(Command.ZERO)
    guided.do(Command.CAPTURE)
    expected = "no new zero: no reading comes that can be used, expected both streams: wait for them"
    assert running.said("refusal") == [expected]
    assert guided.said("refusal") == ["no pose: readings or orientations are missing; wait until both come"]
    for drive in (running, guided):
        drive.play(drive.world.hold(1.0, np.zeros(3)))
    running.do(Command.ZERO)
    guided.do(Command.CAPTURE)
    assert [len(drive.said("refusal")) for drive in (running, guided)] == [1, 1]
    assert running.said("zero")
    assert guided.said("pose")


def test_a_zero_that_moved_is_taken_anew(calibration: cw.Calibration) -> None:
    """From the first reading on, so that its contact began when nobody looked; while the arm runs it takes ten s."""
    moved = np.array([0.5, -0.3, 0.4, 0.02, 0.0, 0.01])
    drive = Driver(world(10), calibration)
    drive.world.bias = tuple(np.add(drive.world.bias, moved))
    drive.play(drive.world.stand(1.5))
    assert drive.shown().contact.contact  # type: ignore[union-attr]
    drive.do(Command.ZERO)
    assert drive.said("zero")[0].startswith("the zero moved by 0.7")
    drive.play(drive.world.stand(1.5))
    assert not drive.shown().contact.contact  # type: ignore[union-attr]
    drive.world.bias = tuple(np.add(drive.world.bias, moved))
    drive.play(drive.world.stand(5.0))
    drive.do(Command.ZERO)
    assert drive.said("refusal")[-1].startswith("no new zero: in contact since ")
    drive.play(drive.world.stand(6.5))
    drive.do(Command.ZERO)
    assert len(drive.said("zero")) == 2
    before = len(drive.said("contact"))
    drive.play(drive.world.stand(3.0, (10.0, 0.0, 0.0)))
    drive.play(drive.world.stand(1.0))
    said = drive.said("contact")[before:]
    assert len(said) == 2
    assert said[0].startswith("contact: ")
    assert " ended, 10" in said[1]


def test_a_session_of_one_device_that_gives_both() -> None:
    true = world(11)
    drive = Driver(true)
    session = cw.live.Session(sensor="udp://:9000", robot=None)
    for sensor, robot in true.stand(1.0):
        poses = {sample.arrival: sample for sample in robot.samples}
        for sample in sensor.samples:
            pose = poses.get(sample.arrival)
            if pose is not None:
                both = Batch([sample._replace(orientation=pose.orientation)])
                session.feed(both, t=sample.arrival)
    snapshot = session.snapshot(true.t)
    assert snapshot.still
    assert [device.role for device in snapshot.devices] == ["sensor and robot"]
    assert drive.session.phase is Phase.CONNECT


def test_a_calibration_that_changed_since_it_was_saved_can_be_saved_again(calibration: cw.Calibration) -> None:
    drive = Driver(world(14), calibration, save=lambda _: "cal.json")
    drive.do(Command.SAVE)
    assert drive.session.saved == "cal.json"
    assert Command.SAVE not in drive.session.commands()
    drive.do(Command.BACK)
    assert drive.session.saved == ""


@pytest.mark.parametrize("pushed", [True, False])
def test_why_a_verdict_is_not_good_is_said(at_poses: dict[int, Driver], pushed: bool) -> None:
    drive = deepcopy(at_poses[8])
    if not pushed:
        drive.do(Command.BACK)
        drive.do(Command.SKIP)
    drive.do(Command.NEXT)
    assert drive.said("fit") == [f"8 poses: verdict {'good' if pushed else 'doubtful'}"]
    said = [(event.severity, event.text) for event in drive.events if event.kind == "finding"]
    assert said == [] if pushed else [("warning", f"doubtful: {NOT_TESTED}")]


def test_what_is_accepted_is_written_where_that_is_wanted(at_fit: Driver, tmp_path: Path) -> None:
    """Going on from the fit accepts it; a check that then fails is in the file, too."""
    saved, written = tmp_path / "cal.json", deepcopy(at_fit)

    def save(cal: cw.Calibration) -> str:
        cal.save(saved)
        return "cal.json"

    written.session._save = save
    assert not saved.exists()
    written.do(Command.NEXT)
    assert written.said("saved") == ["calibration written to cal.json"]
    assert cw.Calibration.load(saved).verdict == "good"
    assert Command.SAVE not in written.session.commands()
    written.world.bias = tuple(np.add(written.world.bias, 0.5))
    for _ in range(2):
        written.turn_to(written.shown().poses.targets[0])  # type: ignore[union-attr]
    assert written.said("verified")[0].startswith("failed: ")
    assert len(written.said("saved")) == 2
    assert cw.Calibration.load(saved).verdict == "doubtful"
    written.do(Command.NEXT)
    assert written.session.phase is Phase.RUN
    assert len(written.said("saved")) == 2


@pytest.mark.parametrize("wanted", [True, False])
def test_a_file_that_is_there_is_kept_and_said(at_fit: Driver, wanted: bool) -> None:
    drive = deepcopy(at_fit)
    drive.session._save_accepted = wanted
    drive.do(Command.NEXT)
    assert drive.session.phase is Phase.VERIFY
    assert drive.session.saved == ""
    assert drive.said("refusal") == [str(already_there("cal.json"))] * wanted


ROLES = "expected sensor or robot: name one of them"
LOAD = "expected a Calibration: cw.Calibration.load(path)"


def fed(batch: object) -> object:
    session = cw.live.Session(sensor="mine")
    session.feed(Batch([Sample(0.0, wrench=(0.0,) * 6, orientation=(0.0, 0.0, 0.0, 1.0))]), t=0.0)  # a good one first
    return session.feed(batch, t=0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: cw.live.Session("a.json"), f"found str, {LOAD}"),  # type: ignore[arg-type]
        (lambda: cw.live.Session().opened("Sensor", SENSOR, 0.0), f"role is 'Sensor', {ROLES}"),
        (lambda: cw.live.Session().down("arm", "gone", 0.0), f"role is 'arm', {ROLES}"),
        (lambda: fed(np.zeros(6)), "mine: found ndarray, expected a Batch: Batch([Sample(arrival, wrench=...)])"),
        (lambda: fed(Batch([Sample(0.0, wrench=np.zeros(6))])),  # type: ignore[arg-type]
         "mine: found wrench as ndarray of 6, expected a tuple of 6, as tuple(wrench.tolist())"),
        (lambda: fed(Batch([Sample(0.0, orientation=(1.0, 0.0, 0.0))])),  # type: ignore[arg-type]
         "mine: found orientation as tuple of 3, expected a tuple of 4, as tuple(orientation.tolist())"),
    ],
)  # fmt: skip
def test_what_a_program_gives_that_is_none_is_said_in_one_line(call: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError) as raised:
        call()
    assert str(raised.value) == said


def test_a_time_is_a_number() -> None:
    text = "t has text, expected numbers: convert them, as by .astype(float)"
    for t, said in ((None, "t is None, expected numbers"), ("1", text)):
        with pytest.raises(InputError) as raised:
            cw.live.Session().feed(t=t)  # type: ignore[arg-type]
        assert str(raised.value) == said


@pytest.mark.parametrize("way", [deepcopy, lambda session: pickle.loads(pickle.dumps(session))])
def test_a_session_can_be_pickled_and_a_copy_goes_its_own_way(
    way: Callable[[cw.live.Session], cw.live.Session], calibration: cw.Calibration
) -> None:
    for session in (cw.live.Session(), cw.live.Session(calibration)):
        for role in ("sensor", "robot"):
            session.opened(role, SENSOR, 0.0)
        session.feed(
            Batch([Sample(0.0, wrench=(0.0,) * 6)]), Batch([Sample(0.0, orientation=(0.0, 0.0, 0.0, 1.0))]), t=0.0
        )
        copied = way(session)
        assert copied.phase is session.phase
        for each in (session, copied):
            assert each.feed(Batch([Sample(0.01, wrench=(1.0,) * 6)]), t=0.01).rows == 1
        assert copied._wizard._streams.__self__ is copied  # type: ignore[attr-defined]


def test_what_a_program_gives_may_lack_any_part(calibration: cw.Calibration) -> None:
    session = cw.live.Session(calibration)
    for role in ("sensor", "robot"):
        session.opened(role, SENSOR, 0.0)
    assert session.feed(Batch([Sample(0.0, wrench=(0.0,) * 6)]), Batch([Sample(0.0)]), t=0.0).rows
    assert session.feed(None, None, t=0.0).rows == 0


def test_what_a_device_says_of_itself_is_told() -> None:
    """As that its readings are not the sensor's own."""
    session = cw.live.Session(sensor="netft://box")
    session.opened("sensor", About("ATI Gamma", True, False, settings={"zero": "the box zeroed itself"}), 1.0)
    (event,) = session.events()
    assert event.text == "ATI Gamma: connected; zero: the box zeroed itself"


def test_what_happened_is_said_in_the_order_of_its_times() -> None:
    """A recording's readings begin before the program knows of it."""
    session = cw.live.Session(sensor="run.csv", robot=None)
    session.opened("sensor", About("run.csv", wrench=True, orientation=True, replay=True), 2.0)
    session.outlet_ended("the disk is full", 1.0)
    session.outlet_ended("the disk is full", 3.0)
    assert [event.t for event in session.events()] == [2.0, 2.0, 3.0]


def test_a_sample_that_came_at_no_time_is_refused() -> None:
    """It was an IndexError of a queue."""
    session = cw.live.Session()
    session.opened("sensor", SENSOR, 0.0)
    with pytest.raises(InputError) as refused:
        session.feed(Batch([Sample(0.0, wrench=(0.0,) * 6), Sample(float("nan"), wrench=(0.0,) * 6)]), None, t=0.1)
    assert str(refused.value) == "found a sample with arrival=nan, expected s, by the clock of t: say when it came"
