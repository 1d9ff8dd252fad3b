"""What happens to readings, without ROS: known answers, calibrating, refusals, and what /diagnostics says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.geometry.arrays import Array
from contactwrench_ros.monitoring import ERROR, OK, WARN
from contactwrench_ros.parameters import PARAMETERS, defaults, meant
from contactwrench_ros.session import Session
from tests.ros2.free_tool import MOUNTING, NOISE, WEIGHT, free, quat, second, settings

PUSH = np.array([1.5, -2.0, 4.0, 0.1, 0.2, -0.05])


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
@pytest.mark.parametrize("sign", ["pull", "reaction"])
def test_an_injected_wrench_comes_out_in_the_axes_asked_for(frame: str, sign: str, saved: str) -> None:
    session = Session(settings(calibration=saved, output_frame=frame, sign=sign))
    for seed in range(5):
        R = Rotation.random(random_state=seed)
        x, y, z, w = R.as_quat().tolist()
        session.orientations.hear(1.0 + seed, (x, y, z, w))
        found = session.read(1.0 + seed, (free(R) + PUSH) * (1.0 if sign == "pull" else -1.0))
        axes = {"sensor": Rotation.identity(), "flange": MOUNTING, "base": R * MOUNTING}[frame]
        assert found == pytest.approx(np.hstack([axes.apply(PUSH[:3]), axes.apply(PUSH[3:])]), abs=1e-3)


def test_a_stale_orientation_makes_no_wrench(saved: str) -> None:
    session, R = Session(settings(calibration=saved)), Rotation.random(random_state=9)
    assert all(found is not None for found in second(session, R, 100.0))
    late = [session.read(101.0 + k / 500.0, free(R)) for k in range(200)]
    assert late[0] is not None
    assert late[60:] == [None] * 140
    status = session.status(1.0)
    assert status.level == WARN
    assert "orientation: the last is 0." in status.message
    assert "found no tf chain from base_link to tool0" in status.message
    assert int(status.values["not published, stale orientation"]) >= 140


def test_diagnostics_tell_what_there_is(saved: str) -> None:
    session, R = Session(settings(calibration=saved, pose_source="pose")), Rotation.random(random_state=9)
    assert session.status(1.0).level == ERROR
    second(session, R, 100.0)
    status = session.status(1.0)
    assert (status.level, status.message) == (OK, "contact wrenches at 500 Hz")
    assert status.values["rate in (Hz)"] == "500.0"
    assert {f"drift {axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")} <= status.values.keys()
    session.read(102.0, [float("nan")] * 6)
    assert session.status(1.0).level == ERROR


def calibrating(path: Path) -> Session:
    session = Session(settings(save_to=str(path), pose_source="pose"))
    assert session.start().success
    return session


def capture(session: Session, R: Rotation, start: float, **more: Any) -> tuple[bool, str]:
    assert session.gather() is None
    second(session, R, start, **more)
    answer = session.capture()
    return answer.success, answer.message


def test_a_calibration_from_captures_is_saved_and_used(tmp_path: Path) -> None:
    session = calibrating(tmp_path / "cal.json")
    assert "no calibration" in session.status(1.0).message or session.tally.readings == 0
    for seed in range(12):
        done, said = capture(session, Rotation.random(random_state=seed), 10.0 * seed, seed=seed)
        assert done, said
        assert said.startswith(f"pose {seed + 1}: 500 readings, mean force")
    assert "deg from the nearest pose before" in said
    answer = session.finish()
    assert answer.success, answer.message
    assert answer.message.startswith("good; at a new orientation expect an error of")
    calibration = cw.Calibration.load(tmp_path / "cal.json")
    assert calibration.weight == pytest.approx(WEIGHT, abs=0.01)
    assert calibration.provenance["base_frame"] == "base_link"
    R = Rotation.random(random_state=50)
    found = [wrench for wrench in second(session, R, 500.0) if wrench is not None]
    assert len(found) == 500
    assert np.abs(np.mean(found, axis=0)[:3]).max() < 0.01


def test_what_a_capture_refuses(tmp_path: Path) -> None:
    session = calibrating(tmp_path / "cal.json")
    for seed in range(3):
        assert capture(session, Rotation.random(random_state=seed), 10.0 * seed, seed=seed)[0]
    R, rng = Rotation.random(random_state=1), np.random.default_rng(7)
    k, still = np.arange(500)[:, None] / 500.0, np.zeros((500, 3))
    force = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    cases: dict[str, tuple[Array, Any]] = {
        "found that the arm moves": (np.hstack([0.02 * k, 0.0 * k, 0.0 * k]), 0.0),
        "though the arm stands: contact, drift or vibration": (still, 10.0 * NOISE * rng.normal(size=(500, 6))),
        "pose 4: found that the reading moves": (still, 0.2 * force * (k > 0.5)),
        "of 1 s the reading takes": (still, 0.2 * force * k),
    }
    for number, (said, (turn, more)) in enumerate(cases.items()):
        assert session.gather() is None
        wrench = free(R) + more + NOISE * rng.normal(size=(500, 6))
        for row in range(500):
            x, y, z, w = (Rotation.from_rotvec(turn[row]) * R).as_quat().tolist()
            t = 100.0 + 10.0 * number + row / 500.0
            session.orientations.hear(t, (x, y, z, w))
            session.read(t, wrench[row])
        answer = session.capture()
        assert not answer.success
        assert said in answer.message
    assert session.gather() is None
    assert session.gather() is not None
    assert "found 0 readings with an orientation" in session.capture().message
    assert session.captures is not None
    assert len(session.captures) == 3


def test_readings_at_rest_are_hardly_ever_refused(tmp_path: Path) -> None:
    session = calibrating(tmp_path / "cal.json")
    R = Rotation.random(random_state=1)
    refused = [not capture(session, R, 10.0 * seed, seed=seed)[0] for seed in range(30)]
    assert sum(refused) <= 1


def test_finishing_needs_poses_and_keeps_them_when_it_fails(tmp_path: Path) -> None:
    session = calibrating(tmp_path / "no such folder" / "cal.json")
    assert session.finish().message.startswith("found no poses")
    capture(session, Rotation.identity(), 0.0)
    refused = session.finish()
    assert not refused.success
    assert "\n" not in refused.message
    for seed in range(6):
        capture(session, Rotation.random(random_state=seed), 10.0 + 10.0 * seed)
    assert "no such folder" in session.finish().message
    session.set({"save_to": ""})
    assert session.status(1.0).values["calibration"] == "none"
    assert session.finish().message.endswith("not saved, as the parameter save_to is empty")
    assert session.status(1.0).values["calibration"] == "of ~/finish_calibration, not saved"


def test_a_zero_takes_away_what_moved(saved: str) -> None:
    session, R = Session(settings(calibration=saved, noise=0.02)), Rotation.random(random_state=4)
    assert session.gather() is None
    second(session, R, 0.0, push=0.3)
    answer = session.zero()
    assert answer.success, answer.message
    assert answer.message.startswith("zeroed: the bias had moved by [0.")
    found = [wrench for wrench in second(session, R, 1.0, push=0.3, seed=1) if wrench is not None]
    assert np.abs(np.mean(found, axis=0)).max() < 0.01
    assert "found no calibration" in Session(settings()).zero().message


def at_rest(session: Session, start: float, seconds: float, more: Array | float) -> None:
    """Readings at 100 Hz, with a pose each, of a tool on which `more` acts, or whose bias has moved by that."""
    R, rng = Rotation.random(random_state=4), np.random.default_rng(round(start))
    for k in range(round(100.0 * seconds)):
        session.orientations.hear(start + 0.01 * k, quat(R))
        session.read(start + 0.01 * k, free(R) + more + NOISE * rng.normal(size=6))


def test_a_bias_that_moved_is_said_and_can_be_zeroed(saved: str) -> None:
    """As a tare while it runs leaves it: a contact at first, which a new zero would hide."""
    session, tared = Session(settings(calibration=saved, noise=0.02)), np.array([3.0, -5.0, 12.0, 0.0, 0.0, 0.0])
    at_rest(session, 0.0, 2.0, 0.0)
    assert session.status(1.0).level == OK
    session.gather()
    at_rest(session, 2.0, 9.0, tared)
    assert session.zero().message == (
        "no new zero: found a contact, expected a free tool: let go of it; if nothing touches it, ask again once that "
        "has stayed the same for 10 s"
    )
    status = session.status(1.0)
    assert (status.level, status.values["contact"]) == (OK, "True")
    at_rest(session, 11.0, 2.0, tared)
    status = session.status(1.0)
    assert status.level == WARN
    assert status.message == "contact or bias: nothing has changed for 11 s; ~/zero where nothing touches"
    session.gather()
    at_rest(session, 13.0, 1.0, tared)
    assert session.zero().success
    session.status(1.0)
    at_rest(session, 14.0, 1.0, tared)
    status = session.status(1.0)
    assert (status.level, status.values["contact"]) == (OK, "False")


def test_what_cannot_be_meant_is_refused_in_one_line(saved: str, tmp_path: Path) -> None:
    for changes, said in {
        ("pose_source", "odometry"): "pose_source is 'odometry', expected tf, pose, joints",
        ("sign", "up"): "sign is 'up', expected pull or reaction",
        ("calibration", str(tmp_path / "none.json")): "none.json",
        ("output_frame", "world"): "output frame is 'world'",
    }.items():
        with pytest.raises(cw.ContactWrenchError, match=said):
            Session(settings(**dict([changes])))
    session = Session(settings(calibration=saved))
    for name, value in {"output_frame": "world", "lowpass": -1.0}.items():
        with pytest.raises(cw.ContactWrenchError):
            session.set({name: value})
        assert session.settings[name] == defaults()[name]
    session.set({"lowpass": 20.0, "output_frame": "base"})
    assert session.settings["output_frame"] == "base"


def test_another_base_frame_is_refused_or_turned(saved: str) -> None:
    with pytest.raises(cw.ContactWrenchError, match="base_frame is table, expected base_link as for"):
        Session(settings(calibration=saved, base_frame="table"))


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("lowpass", "20", "lowpass is '20', expected a number: write it as 0.0, without quotes"),
        ("noise", True, "noise is True, expected a number: write it as 0.0, without quotes"),
        ("drift", None, "drift is None, expected a number: write it as 0.0, without quotes"),
        ("lowpass", -1.0, "lowpass is -1, expected 0 to 10000"),
        ("stale_after", 0.0, "stale_after is 0, expected 0.001 to 10"),
        ("stale_after", float("nan"), "stale_after is nan, expected 0.001 to 10"),
        ("wrench_topic", "", "wrench_topic is empty, expected a text such as /wrench"),
        ("base_frame", "", "base_frame is empty, expected a text such as base_link"),
        ("urdf", 5, "urdf is 5, expected a text: write it in quotes"),
    ],
)
def test_a_parameter_of_a_wrong_type_or_range_is_refused(name: str, value: Any, said: str, saved: str) -> None:
    with pytest.raises(InputError) as refused:
        Session(settings(**{name: value}))
    assert str(refused.value) == said
    session = Session(settings(calibration=saved))
    with pytest.raises(InputError) as refused:
        session.set({name: value})
    assert str(refused.value) == said
    assert session.settings == settings(calibration=saved)


def test_a_whole_number_is_taken_for_a_number(saved: str) -> None:
    session = Session(settings(calibration=saved, lowpass=20))
    assert repr(session.settings["lowpass"]) == "20.0"
    session.set({"stale_after": 1})
    assert repr(session.settings["stale_after"]) == "1.0"
    assert meant("calibration", "") == ""


def test_the_page_has_every_parameter() -> None:
    page = (Path(__file__).parents[2] / "docs" / "ros2.md").read_text(encoding="utf-8")
    for name, parameter in PARAMETERS.items():
        default = f"`{parameter.default}`" if parameter.default != "" else "empty"
        assert f"| `{name}` | {default} | {'yes' if parameter.live else ''} | {parameter.description} |" in page
