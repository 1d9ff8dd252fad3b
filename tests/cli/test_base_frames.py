"""Topics and base frames: what a bag says of them is kept with the calibration and held against the next recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from tests.assess.test_robot_arms import poses_by_pinocchio, urdf_of
from tests.support.bags import joint_state, pose_stamped, tf, transform, wrench_stamped, write_bag
from tests.support.recordings import (
    MATRIX,
    WRENCH,
    Run,
    beside_its_doubt,
    csv_text,
    run,
    run_quietly,
    wrenches_written,
    written,
)
from tests.support.rigs import example
from tests.support.world import Array, readings, tilted_down, with_down

Capture = pytest.CaptureFixture[str]

JOINT_NAMES = [f"{part}_joint" for part in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Of base_link against the controller's base: Universal_Robots_ROS2_Description, urdf/ur_macro.xacro."""

RIG, _, RNG = example(5)
RIG = with_down(RIG, tilted_down(np.deg2rad(4.0), RNG))
JOINTS, WORK_JOINTS = RNG.uniform(-3.0, 3.0, (16, 6)), RNG.uniform(-3.0, 3.0, (8, 6))
PUSHED = RNG.normal(size=(8, 6)) * [3.0, 3.0, 3.0, 0.2, 0.2, 0.2]


def _orientations(joints: Array) -> Array:
    """`R_base_flange` (n, 3, 3) in the controller's base."""
    return poses_by_pinocchio(urdf_of("ur5e"), "tool0", joints)[0]


R, WORK = _orientations(JOINTS), _orientations(WORK_JOINTS)
FREE_READINGS, WORK_READINGS = readings(RIG, R), readings(RIG, WORK) + PUSHED


def _bag(path: Path, kind: str, R: Array, joints: Array, wrench: Array, topic: str = "/wrench") -> Path:
    """Still poses, a second apart, as joint states, as the transforms of a frame over tool0, or as poses in it."""
    messages = []
    for k, row in enumerate(wrench):
        t = float(k)
        messages.append(wrench_stamped(t, row, topic))
        if kind == "joints":
            messages.append(joint_state(t, JOINT_NAMES, joints[k]))
            continue
        in_frame = HALF_TURN @ R[k] if kind.endswith("base_link") else R[k]
        if kind.startswith("tf "):
            messages.append(tf(t, [transform(t, kind.removeprefix("tf "), "tool0", in_frame, np.zeros(3))]))
        else:
            messages.append(pose_stamped(t, in_frame, np.zeros(3), frame=kind))
    return write_bag(path, messages)


def _notes(done: Run) -> list[str]:
    """What is said on stderr, but of the delay, which poses at rest do not tell, and of doubts."""
    return [line for line in beside_its_doubt(done.err).splitlines() if "delay" not in line]


FLAGS = {
    "joints": ["--robot", "ur5e"],
    "tf base_link": ["--frames", "base_link,tool0"],
    "tf base": ["--frames", "base,tool0"],
}
TURNED = "Note: orientations are in {}, half a turn about z from the calibration's {}: it was turned into that"


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A calibration from each kind of bag, the base's tilt found."""
    tmp_path, tools = tmp_path_factory.mktemp("tools"), {}
    for kind in (*FLAGS, "/base_link", "world"):
        bag = _bag(tmp_path / f"free {kind.strip('/')}.mcap", kind, R, JOINTS, FREE_READINGS)
        tools[kind] = tmp_path / f"{kind.strip('/')}.json"
        flags = FLAGS.get(kind, [])
        assert run_quietly(["calibrate", bag, "-o", tools[kind], "--model", "mount+base", *flags]) == 0
    return tools


def test_the_base_of_every_kind_of_pose_is_kept(tools: dict[str, Path]) -> None:
    kept = {kind: json.loads(path.read_text())["provenance"] for kind, path in tools.items()}
    assert {kind: provenance["base_frame"] for kind, provenance in kept.items()} == {
        "joints": "ur5e base",
        "tf base_link": "base_link",
        "tf base": "base",
        "/base_link": "base_link",
        "world": "world",
    }
    assert (kept["joints"]["robot"], kept["joints"]["pose_topic"]) == ("ur5e", "/joint_states")
    assert (kept["tf base"]["frames"], kept["tf base"]["wrench_topic"]) == ("base,tool0", "/wrench")
    assert kept["world"]["pose_topic"] == "/pose"
    assert "orientation" not in kept["world"]


@pytest.mark.parametrize(
    ("of_tool", "of_work"), [("joints", "tf base_link"), ("tf base_link", "joints"), ("joints", "tf base")]
)
def test_bases_of_universal_robots_are_turned_into_each_other(
    tmp_path: Path, capsys: Capture, tools: dict[str, Path], of_tool: str, of_work: str
) -> None:
    work = _bag(tmp_path / "work.mcap", of_work, WORK, WORK_JOINTS, WORK_READINGS)
    outputs = []
    for tool, frame in ((of_tool, "sensor"), (of_work, "sensor"), (of_tool, "base"), (of_work, "base")):
        out = tmp_path / "out.csv"
        files = ("-c", tools[tool], "--force", "-o", out)
        done = run(capsys, "compensate", work, *files, "--output-frame", frame, *FLAGS[of_work])
        outputs.append(wrenches_written(out))
        names = {"joints": "ur5e base", "tf base_link": "base_link"}
        said = [TURNED.format(names[of_work], names[tool])] if tool != of_work != "tf base" else []
        assert _notes(done) == said
    np.testing.assert_allclose(outputs[0], outputs[1], atol=1e-9)
    np.testing.assert_allclose(outputs[2], outputs[3], atol=1e-9)
    np.testing.assert_allclose(outputs[0], PUSHED, atol=1e-6)
    free = _bag(tmp_path / "again.mcap", of_work, R, JOINTS, FREE_READINGS)
    verified = [
        run(capsys, "verify", free, "-c", tools[tool], *FLAGS[of_work], "--limit-force", "0.001")
        for tool in tools
        if tool in (of_tool, of_work)
    ]
    assert [done.status for done in verified] == [0, 0]


def test_what_gave_the_pose_is_taken_from_the_calibration(
    tmp_path: Path, capsys: Capture, tools: dict[str, Path]
) -> None:
    out = tmp_path / "out.csv"
    for kind, flags in FLAGS.items():
        work = _bag(tmp_path / f"{kind}.mcap", kind, WORK, WORK_JOINTS, WORK_READINGS)
        done = run(capsys, "compensate", work, "-c", tools[kind], "--force", "-o", out)
        np.testing.assert_allclose(wrenches_written(out), PUSHED, atol=1e-6)
        topic = "--pose-topic /joint_states " if kind == "joints" else ""
        assert _notes(done) == [f"Note: read as the calibration was: {topic}{' '.join(flags)}"]


@pytest.mark.parametrize("verb", ["compensate", "verify", "weigh"])
def test_bases_that_nobody_knows_are_refused_with_both_names(
    tmp_path: Path, capsys: Capture, tools: dict[str, Path], verb: str
) -> None:
    work = _bag(tmp_path / "work.mcap", "base_link", WORK, WORK_JOINTS, readings(RIG, WORK))
    assert run(capsys, verb, work, "-c", tools["world"]).complaint == (
        f"{work}: found orientations in base_link, expected the calibration's base, world: if the two are one, say "
        "--base-frame world, else which way gravity points in base_link, with --gravity X,Y,Z"
    )
    refused = run(capsys, verb, work, "-c", tools["tf base"], "--pose-topic", "/pose").complaint
    assert "found orientations in base_link, expected the calibration's base, base: " in refused
    down = ",".join(map(str, HALF_TURN @ RIG.down))
    done = run(capsys, verb, work, "-c", tools["world"], "--gravity", down)
    assert (done.status, _notes(done)) == (0, [])
    of_controller = _bag(tmp_path / "same.mcap", "base", WORK, WORK_JOINTS, readings(RIG, WORK))
    done = run(capsys, verb, of_controller, "-c", tools["world"], "--base-frame", "world")
    assert (done.status, _notes(done)) == (0, [])


def test_a_base_without_a_name_is_taken_to_be_the_same_and_said(
    tmp_path: Path, capsys: Capture, tools: dict[str, Path]
) -> None:
    out = tmp_path / "out.csv"
    table = csv_text((*WRENCH, *MATRIX), np.column_stack([WORK_READINGS, WORK.reshape(-1, 9)]))
    work = written(tmp_path, table, "work.csv")
    done = run(capsys, "compensate", work, "-c", tools["joints"], "-o", out)
    assert done.err == "Note: this recording does not name its base: taken to be ur5e base (--base-frame names it)\n"
    done = run(capsys, "compensate", work, "-c", tools["joints"], "--force", "-o", out, "--base-frame", "base")
    assert done.err == ""
    assert wrenches_written(out) == pytest.approx(PUSHED, abs=1e-6)
    in_base_link = csv_text((*WRENCH, *MATRIX), np.column_stack([WORK_READINGS, (HALF_TURN @ WORK).reshape(-1, 9)]))
    other = written(tmp_path, in_base_link, "other.csv")
    done = run(capsys, "compensate", other, "-c", tools["joints"], "--force", "-o", out, "--base-frame", "/base_link")
    assert done.err == TURNED.format("base_link", "ur5e base") + "\n"
    assert wrenches_written(out) == pytest.approx(PUSHED, abs=1e-6)
    cw.calibrate(cw.Samples(FREE_READINGS, R), "mount+base").save(tmp_path / "arrays.json")
    bag = _bag(tmp_path / "work.mcap", "base", WORK, WORK_JOINTS, WORK_READINGS)
    done = run(capsys, "compensate", bag, "-c", tmp_path / "arrays.json", "--force", "-o", out)
    assert _notes(done) == ["Note: the calibration does not name its base: taken to be base (--base-frame names it)"]


def test_a_turned_calibration_is_one(tmp_path: Path, tools: dict[str, Path]) -> None:
    """Any turn: what it predicts, its std and the poses that it holds are those of the same tool in the other base."""
    calibration = cw.Calibration.load(tools["joints"])
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    turned = calibration.with_base(turn, "cell")
    np.testing.assert_allclose(turned.predict(turn @ WORK), calibration.predict(WORK), atol=1e-12)
    np.testing.assert_allclose(turned.wrench_std(turn @ WORK), calibration.wrench_std(WORK), rtol=1e-9)
    left = [pose.wrench - turned.predict(pose.R_base_flange) for pose in turned.poses]
    assert np.abs(left).max() < 1e-6
    turned.save(tmp_path / "turned.json")
    assert cw.Calibration.load(tmp_path / "turned.json").provenance["base_frame"] == "cell"


def test_the_bias_anew_in_the_other_base(tmp_path: Path, capsys: Capture, tools: dict[str, Path]) -> None:
    shift = np.array([0.5, -1.0, 2.0, 0.05, 0.02, -0.03])
    one = _bag(tmp_path / "one.mcap", "tf base_link", R[:2], JOINTS, FREE_READINGS[:2] + shift)
    files = ("--prior", tools["joints"], "--force", "-o", tmp_path / "now.json")
    done = run(capsys, "calibrate", one, *files, "--frames", "base_link,tool0")
    assert (done.status, _notes(done)) == (0, [TURNED.format("base_link", "ur5e base")])
    now = cw.Calibration.load(tmp_path / "now.json")
    assert now.bias == pytest.approx(RIG.bias + shift, abs=1e-5)
    assert now.provenance["base_frame"] == "base_link"


def test_recordings_that_share_gravity_share_their_base(capsys: Capture, tools: dict[str, Path]) -> None:
    files = [tools["world"].parent / f"free {base}.mcap" for base in ("base_link", "world")]
    done = run(capsys, "calibrate", *files, "--shared", "mount,gravity")
    said = "found orientations in base_link and in world, expected one base that the recordings share"
    assert (done.status, _notes(done)) == (2, [f"contactwrench: {said}"])


def _two_topics(path: Path, *topics: str) -> Path:
    """Readings in the first topic and others, which are none of the sensor's, in the second."""
    messages = []
    for k in range(8):
        messages += [wrench_stamped(float(k), WORK_READINGS[k] * (10.0**n), name) for n, name in enumerate(topics)]
        messages.append(pose_stamped(float(k), WORK[k], np.zeros(3), frame="base"))
    return write_bag(path, messages)


def test_the_topic_of_the_wrench_is_the_calibrations(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a long path would be shortened
    free = _bag(Path("free.mcap"), "base", R, JOINTS, FREE_READINGS, topic="/ft")
    tool, out = Path("tool.json"), Path("out.csv")
    run(capsys, "calibrate", free, "-o", tool, "--model", "mount+base")
    both = _two_topics(Path("both.mcap"), "/ft", "/ft_scaled")
    done = run(capsys, "compensate", both, "-c", tool, "-o", out)
    assert _notes(done) == ["Note: read as the calibration was: --wrench-topic /ft"]
    np.testing.assert_allclose(wrenches_written(out), PUSHED, atol=1e-6)
    other = _two_topics(Path("other.mcap"), "/wrench")
    assert run(capsys, "compensate", other, "-c", tool, "--force", "-o", out).complaint == (
        f"{other}: found no topic /ft, expected one of /pose (geometry_msgs/PoseStamped), /wrench "
        "(geometry_msgs/WrenchStamped): --wrench-topic (as the calibration was read: --wrench-topic /ft "
        "--pose-topic /pose)"
    )
    done = run(capsys, "compensate", other, "-c", tool, "--force", "-o", out, "--wrench-topic", "/wrench")
    assert _notes(done) == ["Note: --wrench-topic was /ft for the calibration and is /wrench for this recording"]
    np.testing.assert_allclose(wrenches_written(out), PUSHED, atol=1e-6)


def test_a_sign_from_a_bag_is_asked_for_of_a_table(tmp_path: Path, capsys: Capture) -> None:
    free = _bag(tmp_path / "free.mcap", "base", R, JOINTS, -FREE_READINGS)
    tool = tmp_path / "tool.json"
    run(capsys, "calibrate", free, "-o", tool, "--model", "mount+base", "--sign", "reaction")
    table = written(tmp_path, csv_text((*WRENCH, *MATRIX), np.column_stack([FREE_READINGS, R.reshape(-1, 9)])))
    assert run(capsys, "verify", table, "-c", tool).complaint == (
        f"{table}: found a table, and a calibration read with --sign reaction, expected to be told whether that holds "
        "here: repeat it, or say --sign pull"
    )
    done = run(capsys, "verify", table, "-c", tool, "--sign", "pull", "--base-frame", "base")
    assert done.err == "Note: --sign was reaction for the calibration and is pull for this recording\n"
    assert done.status == 0
    of_bag = run(capsys, "verify", free, "-c", tool)
    assert (of_bag.status, _notes(of_bag)) == (0, ["Note: read as the calibration was: --sign reaction"])


def test_an_inverse_orientation_is_in_a_frame_that_is_no_base(tmp_path: Path, capsys: Capture) -> None:
    tool, out = tmp_path / "tool.json", tmp_path / "out.csv"
    flags = ("--model", "mount+base", "--inverse-orientation")
    free = _bag(tmp_path / "free.mcap", "tool0", R.transpose(0, 2, 1), JOINTS, FREE_READINGS)
    assert run(capsys, "calibrate", free, "-o", tool, *flags).status == 0
    assert "base_frame" not in cw.Calibration.load(tool).provenance
    work = _bag(tmp_path / "work.mcap", "flange", WORK.transpose(0, 2, 1), WORK_JOINTS, WORK_READINGS)
    done = run(capsys, "compensate", work, "-c", tool, "-o", out)
    assert _notes(done) == ["Note: read as the calibration was: --inverse-orientation"]
    np.testing.assert_allclose(wrenches_written(out), PUSHED, atol=1e-6)
