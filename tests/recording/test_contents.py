"""`contactwrench info`: what is in a bag or a table, in tables of 80 columns, times from the start of the recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.recording.contents import BagContents, FrameContent, bag_contents, rhythm, table_contents
from contactwrench.report.text import contents_text
from tests.support.bags import (
    KINDS,
    ODOMETRY,
    START,
    STRING,
    TF,
    WRENCH_STAMPED,
    Message,
    any_rotations,
    header,
    joint_state,
    ns,
    pose_stamped,
    tf,
    transform,
    wrench_stamped,
    write_bag,
)
from tests.support.recordings import run, written


def _messages() -> list[Message]:
    """2 s: readings at 1 kHz but from 0.5 to 0.9 s; poses at 100 Hz, odometry with a clock of its own, a tree."""
    R, ones = any_rotations(200, 1), np.ones(3)
    static = [transform(0.0, "world", "base_link", R[0], ones), transform(0.0, "tool0", "ft_sensor", R[1], ones)]
    messages = [tf(0.0, static, topic="/tf_static")]
    for k in range(2000):
        t = 1e-3 * k
        if not 500 < k < 900:
            messages.append(wrench_stamped(t, np.ones(6)))
        if k % 10 == 0:
            messages.append(pose_stamped(t, R[k // 10], ones))
            edges = [transform(t, "base_link", "link_1", R[k // 10], ones), transform(t, "link_1", "tool0", R[0], ones)]
            messages.append(tf(t, edges))
            messages.append(joint_state(t, ["a", "b"], [1.0, 2.0]))
            messages.append(Message("/camera/arm_left/color/info_with_a_long_name", STRING, ns(t), {"data": "x" * k}))
            pose = {"pose": {"orientation": {"w": 1.0}}}
            messages.append(Message("/odom", ODOMETRY, ns(t), {"header": header(t - 70.0, "odom"), "pose": pose}))
    return messages


TEXT = """\
{path}
{kind}, 2,602 messages in 1.999 s from 2023-11-14 22:13:20 UTC

  topic          type           messages rate Hz  longest gap
Wrench
  /unused        WrenchStamped         0
  /wrench        WrenchStamped     1,601    1000  0.4 s at 0.500 s
Pose
  /odom          Odometry            200     100  0.01 s
    stamps in its headers are 70 s behind the bag's own
  /pose          PoseStamped         200     100  0.01 s
Pose with --robot NAME
  /joint_states  JointState          200     100  0.01 s
Pose with --frames BASE,FLANGE
  /tf            TFMessage           200     100  0.01 s
  /tf_static     TFMessage             1          at 0.000 s
Other
  /camera/arm_left/color/info_with_a_long_name
                 String              200     100  0.01 s

Frames (= never moves against the one above)
  world
    = base_link
      link_1
        = tool0
          = ft_sensor

Read without options
  wrench: /wrench
  pose: found 2 topics with poses: /odom (nav_msgs/Odometry, 200 messages), /pose (geometry_msgs/PoseStamped, 200 \
messages), expected one: choose with --pose-topic /odom
"""

KIND_NAMES = dict(zip(KINDS, ["ROS 1 bag", "MCAP file", "ROS 2 sqlite3 bag", "ROS 2 bag folder"], strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_in_one_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path(f"run{kind}")
    write_bag(path, _messages(), {"/unused": WRENCH_STAMPED})
    done = run(capsys, "info", path)
    assert done.status == 0
    # Where all gaps are alike, the last digit of a float decides which is the longest.
    lines = done.out.splitlines()
    shown = [line.partition(" at ")[0] if "0.01 s at" in line else line for line in lines]
    assert shown == TEXT.format(path=path, kind=KIND_NAMES[kind]).splitlines()
    assert max(map(len, lines[: lines.index("Read without options")])) <= 80


@pytest.mark.parametrize(
    ("edges", "shown"),
    [
        ([("a", "b"), ("b", "a")], ["a", "  b", "    a"]),
        (
            [("a", "b"), ("a", "c"), ("b", "d"), ("c", "d"), ("d", "e")],
            ["a", "  b", "    d", "      e", "  c", "    d"],
        ),
        ([(f"{k}", f"{k + 1}") for k in range(5000)], [f"{'  ' * k}{k}" for k in range(60)] + ["and 4941 more"]),
    ],
    ids=["a circle", "two parents", "a chain"],
)
def test_frames_that_are_no_usual_tree(edges: list[tuple[str, str]], shown: list[str]) -> None:
    frames = tuple(FrameContent(child, parent, True, 1) for parent, child in edges)
    text = contents_text(BagContents("run.mcap", "MCAP file", 0.0, 1.0, (), frames, ()))
    part = text.partition("above)\n")[2].partition("\n\n")[0]
    assert part.splitlines() == [f"  {line}" for line in shown]


def test_a_bag_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_bag(tmp_path / "run.mcap", _messages())
    done = run(capsys, "info", path, "--json")
    contents = json.loads(done.out)
    assert contents["start"] == pytest.approx(1e-9 * START)
    assert contents["duration"] == pytest.approx(1.999)
    wrench = next(topic for topic in contents["topics"] if topic["name"] == "/wrench")
    assert (wrench["type"], wrench["gives"], wrench["clock"]) == ("geometry_msgs/WrenchStamped", "wrench", None)
    assert wrench["rhythm"] == {
        "count": 1601,
        "first": 0.0,
        "last": pytest.approx(1.999, abs=1e-6),
        "rate": pytest.approx(1000.0, rel=1e-3),
        "longest_gap": pytest.approx(0.4, abs=1e-6),
        "gap_at": pytest.approx(0.5, abs=1e-6),
    }
    odometry = next(topic for topic in contents["topics"] if topic["name"] == "/odom")
    assert odometry["clock"] == pytest.approx(70.0, abs=1e-6)
    assert {"name": "tool0", "parent": "link_1", "moves": False, "count": 200} in contents["frames"]


def test_an_empty_bag_and_one_message(tmp_path: Path) -> None:
    text = contents_text(bag_contents(write_bag(tmp_path / "empty.bag", [], {"/tf": TF})))
    assert "ROS 1 bag, 0 messages in 0 s\n" in text
    text = contents_text(bag_contents(write_bag(tmp_path / "one.mcap", [wrench_stamped(0.0, np.ones(6))], {"/tf": TF})))
    assert "  /wrench  WrenchStamped         1          at 0.000 s\n" in text
    assert "  /tf      TFMessage             0\n" in text


def test_a_table_with_times_and_one_without(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{t},1,2,3,4,5,6\n" for t in [100.0, 100.01, 100.02, 100.52, 100.53])
    path = written(tmp_path, "t,fx,fy,fz,tx,ty,tz\n" + rows, "run.csv")
    assert run(capsys, "info", path).out == (
        f"{path}\nTable, 5 rows of 7 columns\n  t, fx, fy, fz, tx, ty, tz\n  times: 0.53 s\n  rate: 100 Hz, longest "
        "gap 0.5 s at 0.020 s\n\nRead without options\n  wrench: fx fy fz tx ty tz\n"
        "  orientation: found no orientation columns, expected qx qy qz qw, r11..r33, a b c "
        "(KUKA), w p r (FANUC), rx ry rz (UR) or roll pitch yaw: rename "
        "them, or --orientation NAME:COLUMNS, or "
        "--wrench W.csv --pose P.csv (found t, fx, fy, fz, tx, ty, tz)\n  times: t\n"
    )
    contents = json.loads(run(capsys, "info", path, "--json").out)
    assert contents["rhythm"]["longest_gap"] == pytest.approx(0.5)
    bare = written(tmp_path, "fx,note\n1,a\n2,b\n", "bare.csv")
    assert run(capsys, "info", bare).out == (
        f"{bare}\nTable, 2 rows of 2 columns\n  fx, note\n  no times, so no rate and no gaps\n\nRead without options\n"
        "  wrench: found no column fy, expected fx fy fz tx ty tz and an orientation: add it, or name the six with "
        "--wrench-columns A,B,C,D,E,F (found fx, note)\n  orientation: found no orientation columns, expected qx qy qz "
        "qw, r11..r33, a b c (KUKA), w p r (FANUC), rx ry rz (UR) or roll pitch yaw: rename them, or --orientation "
        "NAME:COLUMNS (found fx, note)\n  times: found none: add a column t, name one with --time-column, or state "
        "--rate HZ\n"
    )
    milliseconds = written(tmp_path, "t_ms\n0\n10\n20\n", "ms.csv")
    found = table_contents(milliseconds).rhythm
    assert found is not None
    assert found.rate == pytest.approx(100.0)


def test_a_table_with_names_as_people_write_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header = "Time (ms),Force X (N),Force Y (N),Force Z (N),Mx [Nmm],My [Nmm],Mz [Nmm],Roll (deg),Pitch (deg),Yaw (deg)"
    path = written(tmp_path, f"{header}\n0,1,2,3,4,5,6,7,8,9\n10,1,2,3,4,5,6,7,8,9\n")
    told = run(capsys, "info", path).out.partition("Read without options\n")[2]
    assert told == (
        '  wrench: fx..fz from "Force X (N)".."Force Z (N)", tx..tz from "Mx [Nmm]".."Mz [Nmm]" in N mm\n'
        '  orientation: roll..yaw from "Roll (deg)".."Yaw (deg)" in deg\n'
        '  times: t from "Time (ms)" in ms\n'
    )


def test_dates_do_not_keep_a_table_from_being_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "Timestamp,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw\n05/01/2024 12:00:00,1,2,3,4,5,6,0,0,0,1\n")
    told = run(capsys, "info", path).out
    assert "Table, 1 rows of 11 columns\n" in told
    complaint = (
        "row 2, column Timestamp: found '05/01/2024 12:00:00', a date or time of day, expected s, or "
        "2024-05-01 12:00:00: write those, or leave the times out, if the rows are poses, with --time-column none"
    )
    assert f"  times: {complaint}\n" in told
    assert f"{path}: {complaint}" in run(capsys, "calibrate", path).err
    assert cw.read(path, time_column="none").t is None


def test_a_table_of_several_blocks_is_one(tmp_path: Path) -> None:
    t = 1e-3 * np.arange(40_000)
    t[35_000:] += 7.0
    path = written(tmp_path, "t,fx\n" + "".join(f"{at},1\n" for at in t.tolist()))
    told: list[float] = []
    found = table_contents(path, told.append)
    assert found.rhythm is not None
    assert (found.rows, found.rhythm.count, told[-1]) == (40_000, 40_000, 1.0)
    assert found.rhythm.longest_gap == pytest.approx(7.001)


def test_the_rhythm_of_few_and_of_equal_times() -> None:
    assert rhythm(np.empty(0), 0.0).count == 0
    assert rhythm(np.array([3.0]), 1.0).first == 2.0
    assert rhythm(np.array([3.0, 3.0]), 1.0).rate is None


def test_what_cannot_be_said_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = tmp_path / "run.mcap"
    done = run(capsys, "info", missing)
    assert done.status == 2
    assert done.err == f"contactwrench: {missing}: there is no such file, expected a readable file: check the path\n"
