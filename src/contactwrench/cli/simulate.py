"""`contactwrench simulate`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..files import name_of, write_text
from ..geometry.arrays import Array
from ..geometry.ranges import LOAD, NOISE, PUSHES, SEED
from ..geometry.wrench import WRENCH_AXES
from ..statistics import counted
from . import options
from .outputs import output_option

if TYPE_CHECKING:
    from ..simulate.recording import Recorded
    from ..simulate.settings import Settings

DEFAULT_POSES = "paper"
ONE_OVER_F = 0.035
"""N: as much as the white noise."""
TORQUE_PER_FORCE = 0.02
"""m: of the 1/f noise."""
MOST_POSES, DIGITS = 10_000, 10  # with every load; and of a count


def _with_truth(output: Path, _: Mapping[str, Any]) -> list[Path]:
    from ..simulate.recording import truth_path

    return [output, truth_path(output)] if output.name else [output]


def simulate(
    output: Path = output_option(
        "OUT",
        "The recording: .csv, or .mcap, .db3, .bag with wrench and pose as topics; OUT.truth.json goes beside it.",
        options.REQUIRED,
        files=_with_truth,
    ),
    poses: str | None = options.text(
        "paper|plan[:N]|random:N|FILE",
        "Static poses: the paper's six, planned ones, random ones, or a CSV with q1..q7 (rad) or an "
        f"orientation (and x y z). [default: {DEFAULT_POSES}]",
    ),
    load_g: str | None = options.text("G,G,...", "Loads hung on the tool, g, each in every pose; 0 is none."),
    trajectory: str | None = options.text(
        "stops[:N]|excite|sweep|FILE",
        "A motion instead of static poses, with a stop at each of N planned poses (12) or without any; a FILE "
        "has t and q1..q7 (rad).",
    ),
    pushes: int = options.number(
        PUSHES, "N", "Pushes by a hand on the tool's hook during the motion, 1 to 10 N.", default=0
    ),
    noise: str | None = options.text(
        "1/f[:N]",
        "1/f noise of the sensor beside its white noise: N is the std of a force within a minute. "
        f"[default: none; 1/f alone: {ONE_OVER_F:g}]",
    ),
    seed: int = options.number(SEED, "S", "Of everything random: same seed, same bytes.", default=0),
    settings: list[str] | None = options.text(
        "NAME=VALUE",
        "Change a setting of the rig, as in sensor.noise.force=0.05 or base.on=wall; again for more. A wrong "
        "name lists the right ones.",
        "--set",
    ),
    orientation: str | None = options.text(
        "NAME[:COLUMNS]", "How a file of --poses writes R_base_flange. [default: found from its columns]"
    ),
) -> None:
    """Record a virtual rig: a KUKA iiwa 7 R800 with a six-axis sensor, in MuJoCo, and the truth beside it."""
    from ..recording.bags.open import SUFFIXES_OF_BAGS
    from ..simulate.recording import csv_lines, record_poses, truth_path, write_truth
    from ..simulate.settings import Settings, changed

    rig_settings = changed(Settings(), (settings or []) + _noise(noise))
    if poses is not None and trajectory is not None:
        raise InputError("found both --poses and --trajectory, expected one of them: leave the other out")
    if str(output) == "-" or output.suffix.lower() not in (".csv", *SUFFIXES_OF_BAGS):
        raise InputError(
            f"--output is {output}, expected a name that ends in .csv, .mcap, .db3 or .bag: the truth goes beside it"
        )
    if pushes and trajectory is None:
        raise InputError(f"found --pushes {pushes} without a motion, expected --trajectory: add it")
    if orientation is not None and not Path(poses or "").suffix:
        raise InputError(f"found --orientation {orientation} and no file of poses, expected --poses FILE: leave it out")
    source = trajectory or poses or DEFAULT_POSES
    rng = np.random.default_rng(seed)
    grams = options.numbers("0" if load_g is None else load_g, "--load-g", "numbers like 100,200,500", LOAD)
    loads = tuple((grams / 1000.0).tolist())
    if trajectory is None:
        joints = _joints(rig_settings, source, orientation or "auto", rng)
        if len(joints) * len(loads) > MOST_POSES:
            each = f"{counted(len(joints), 'pose')} with {counted(len(loads), 'load')} each"
            raise InputError(f"found {each}, expected at most {MOST_POSES} readings in all: leave some out")
        recorded = record_poses(rig_settings, joints, loads, rng=rng)
    else:
        recorded = _moving(rig_settings, trajectory, loads, pushes, rng)
    kind = "trajectory" if trajectory else "poses"
    asked = {kind: name_of(source), "load_g": [1000.0 * load for load in loads], "seed": seed}
    if pushes:
        asked["pushes"] = pushes
    write_truth(output, recorded, asked)
    if output.suffix.lower() == ".csv":
        write_text(output, csv_lines(recorded))
    else:
        _write_bag(output, recorded)
    options.say(_said(recorded, output, truth_path(output)))


def _noise(text: str | None) -> list[str]:
    """The setting that `1/f` or `1/f:N` stands for."""
    if text is None:
        return []
    kind, colon, strength = text.partition(":")
    try:
        force = float(strength) if colon else ONE_OVER_F
    except ValueError:
        force = np.nan
    if kind != "1/f" or len(NOISE.outside(np.array([force]))):
        raise InputError(f"--noise is {text}, expected 1/f or 1/f:N with N {NOISE}, as in 1/f:0.05")
    return [f"sensor.noise.one_over_f={[force] * 3 + [TORQUE_PER_FORCE * force] * 3}"]


def _write_bag(output: Path, recorded: Recorded) -> None:
    """Wrench and pose as streams of their own, the pose at its own rate; a bag that is there is replaced."""
    from ..recording.bags.write import write_streams_bag
    from ..samples.samples import OrientationStream, Streams, WrenchStream

    plan = recorded.settings.recording
    posed = slice(None, None, max(round(plan.rate / plan.pose_rate), 1))
    poses = OrientationStream(recorded.t[posed], recorded.R_base_flange[posed], recorded.position[posed])
    write_streams_bag(output, Streams(WrenchStream(recorded.t, recorded.wrench), poses))


def _joints(settings: Settings, poses: str, orientation: str, rng: np.random.Generator) -> Array:
    """Joints (n, 7) of the poses that are asked for."""
    from ..simulate.kinematics import joints_through, paper_joints, random_joints
    from ..simulate.rig import JOINTS, build

    kind, colon, count = poses.partition(":")
    rig = build(settings)
    if poses == "paper":
        return paper_joints(rig)
    if kind == "plan" and (not colon or _is_count(count)):
        return _planned(settings, int(count or 6))
    if kind == "random" and _is_count(count) and 0 < int(count) <= MOST_POSES:
        return random_joints(rig, int(count), rng)
    if not Path(poses).suffix:
        raise InputError(
            f"--poses is {poses}, expected paper, plan, plan:N, random:N (1 to {MOST_POSES}) or a CSV file"
        )
    from ..assess.robot_arms import known_arm, within_limits
    from ..recording.target_poses import read_target_poses

    targets = read_target_poses(poses, JOINTS, orientation)
    if (found := len(targets.R_base_flange if targets.joints is None else targets.joints)) > MOST_POSES:
        raise InputError(f"{poses}: found {found} poses, expected at most {MOST_POSES}: leave rows out")
    try:
        if targets.joints is not None:
            return np.array([within_limits(known_arm("iiwa7"), row) for row in targets.joints])
        return joints_through(rig, targets.R_base_flange, targets.position)
    except InputError as error:
        raise InputError(f"{poses}: {error}") from None


def _is_count(text: str) -> bool:
    return text.isdecimal() and len(text) < DIGITS


def _planned(settings: Settings, n: int) -> Array:
    """Joints of the poses that `contactwrench plan --robot iiwa7` gives for this base."""
    from ..assess.plan import expected_tool, plan
    from ..assess.robot_arms import known_arm, reach

    around_home = reach(known_arm("iiwa7"))
    planned = plan(n, expected_tool(None, "auto", settings.gravity_direction), reach=around_home)
    return around_home.joints[:0] if planned.joints is None else planned.joints


def _moving(
    settings: Settings, trajectory: str, loads: tuple[float, ...], pushes: int, rng: np.random.Generator
) -> Recorded:
    from ..simulate.kinematics import HOME
    from ..simulate.recording import record_motion
    from ..simulate.trajectory import calm, exciting, random_pushes, stopping, sweeping, through

    if len(loads) > 1:
        raise InputError(f"found {len(loads)} loads for a motion, expected one: simulate a file for each")
    duration, rate = settings.recording.duration, settings.recording.rate
    kind, colon, count = trajectory.partition(":")
    if kind == "stops" and (not colon or _is_count(count)):
        stops = np.vstack([HOME, _planned(settings, int(count or 12))])
        motion = stopping(stops, calm(stops), settings.recording.rest, rate)
    elif trajectory == "excite":
        motion = exciting(duration, rate, rng)
    elif trajectory == "sweep":
        motion = sweeping(duration, rate)
    elif not Path(trajectory).suffix:
        raise InputError(
            f"--trajectory is {trajectory}, expected stops, stops:N, excite, sweep or a CSV file with t and q1 to q7"
        )
    else:
        from ..recording.target_poses import read_target_poses
        from ..simulate.rig import JOINTS

        targets = read_target_poses(trajectory, JOINTS)
        if targets.joints is None or targets.t is None:
            missing = "t" if targets.t is None else "q1 to q7"
            raise InputError(f"{trajectory}: found no {missing}, expected t and q1 to q7: add it")
        try:
            motion = through(targets.t, targets.joints, rate)
        except InputError as error:
            raise InputError(f"{trajectory}: {error}") from None
    pushed = random_pushes(pushes, float(motion.t[-1]), rng) if pushes else ()
    return record_motion(settings, motion, loads[0], pushed, rng=rng)


def _said(recorded: Recorded, output: Path, truth: Path) -> str:
    rows = len(recorded.t)
    lines = [f"Wrote {counted(rows, 'row')} to {output}, and what is true to {truth}"]
    stuck = recorded.saturated.sum(axis=0)
    if stuck.any():
        channels = ", ".join(f"{axis} in {n}" for axis, n in zip(WRENCH_AXES, stuck, strict=True) if n)
        lines.append(
            f"  saturated: {channels} of {rows} rows; they show less than there is: leave them out (column saturated), "
            "or give the sensor room (--set sensor.bias=0)"
        )
    below = np.flatnonzero(recorded.position[:, 2] < 0.0)
    if len(below):
        lines.append(
            f"  below: in {len(below)} of {rows} rows, the first of them row {below[0] + 2}, the flange is below the "
            "plane that the robot stands on; nothing stops it here"
        )
    return "\n".join(lines)
