"""`contactwrench plan`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..files import STDOUT
from ..geometry.ranges import HEIGHT, JOINT, MOTION_TIME, NEAR, POSES
from . import options
from .outputs import output_option
from .recordings import Recordings, with_reading_options

if TYPE_CHECKING:
    from ..assess.robot_arms import Arm, Reach
    from ..geometry.arrays import Array

POSES_ALONE, POSES_OF_YAW = 8, 6
"""Where only the yaw of the mounting is open, the paper's six do; with six and a mounting that is far off nominal, too
few degrees of freedom were left in 9 of 40 tables, with eight in none.
"""


@with_reading_options
def plan(
    *,
    n: int | None = options.number(
        POSES,
        "N",
        f"Number of poses. [default: {POSES_ALONE}; with --model yaw {POSES_OF_YAW}, with --dynamic 12]",
        "-n",
    ),
    recorded: Path | None = options.text("FILE", "Plan the next poses after those in this recording.", "--from"),
    robot: str | None = options.text(
        "NAME|URDF[:LINK]",
        "Only what its wrist reaches: iiwa7, iiwa14, ur3e, ur5e, ur10e, ur16e, ur20, panda, fr3, or a URDF.",
    ),
    around: str | None = options.text(
        "Q1,Q2,...", "Where the arm stands, rad; all joints but the last three stay there."
    ),
    output: Path | None = output_option(
        "PLAN.csv",
        "Write the poses; with --dynamic times and joints, or a program, PLAN.script (URScript) or PLAN.src "
        f"(KUKA KRL); {options.OUTPUT_HELP} stdout.",
    ),
    model: str = options.text(
        "M", "What will be fitted, with --dynamic to the stops: auto, yaw, mount, mount+base.", default="auto"
    ),
    dynamic: bool = options.switch(
        "--dynamic", "A recording for model dynamic: the poses as stops, then a motion that tells the inertia."
    ),
    duration: float | None = options.number(MOTION_TIME, "S", "Of the motion, at most, s. [default: 30]"),
    above: float | None = options.number(
        HEIGHT, "M", "Keep the flange so far above the plane of the base, m. [default: 0.15]"
    ),
    within: float | None = options.number(
        NEAR, "M", "Keep the motion so near to where the flange starts, m. [default: 0.1]"
    ),
    json: bool = options.JSON,
    written: Recordings,
    gravity: str | None = options.GRAVITY,
) -> None:
    """Choose the next poses to record: those that make the contact wrench most certain, in a short order."""
    from ..assess.plan import expected_tool, recorded_orientations
    from ..assess.plan import plan as choose
    from ..assess.plan_motion import STOPS, plan_motion
    from ..files import write_text
    from ..report.motion_program import program_of
    from ..report.plan import dynamic_plan_json, dynamic_plan_text, plan_csv, plan_json, plan_text

    to_stdout = str(output) == STDOUT
    if json and to_stdout:
        raise InputError("--json and --output - both write to stdout, expected one of them: name a file for --output")
    if recorded is None and written.stated:
        stated_so = ", ".join(f"--{name.replace('_', '-')}" for name in written.stated)
        raise InputError(f"found {stated_so} and no recording to read so: give --from FILE, or leave them out")
    motion = {"duration": duration, "above": above, "within": within}
    stated = {name: value for name, value in motion.items() if value is not None}
    if dynamic:
        arm, joints = _arm(robot, around)
        in_file = program_of(output, arm)
    else:
        _require_poses_alone(stated, output)
    samples = None if recorded is None else written.beside(recorded).read()
    options.note(*options.doubtful_ends(recorded))
    expected = expected_tool(samples, model, options.gravity_direction(gravity))
    if dynamic:
        moving = plan_motion(arm, joints, n or STOPS, expected, model=model, **stated)
        if output is not None:
            write_text(output, in_file(moving, output.stem))
        if not to_stdout:
            options.print_result(moving, json, dynamic_plan_json, dynamic_plan_text)
    else:
        known = None if samples is None else recorded_orientations(samples)
        n = n or (POSES_OF_YAW if model == "yaw" else POSES_ALONE)
        result = choose(n, expected, model=model, recorded=known, reach=_reach(robot, around))
        if output is not None:
            write_text(output, plan_csv(result))
        if not to_stdout:
            options.print_result(result, json, plan_json, plan_text)
    if output is not None and not (json or to_stdout):
        options.say(f"Wrote the {'motion' if dynamic else 'poses'} to {output}")


def _arm(robot: str | None, around: str | None) -> tuple[Arm, Array | None]:
    """The arm that moves, and the joint angles that --around states."""
    from ..recording.urdf import arm_of

    if robot is None:
        raise InputError("--dynamic plans how the joints move, and there is no robot: give --robot NAME or a URDF")
    joints = None if around is None else options.numbers(around, "--around", "joint angles Q1,Q2,...", JOINT)
    return arm_of(robot), joints


def _require_poses_alone(stated: Collection[str], output: Path | None) -> None:
    """Raise `InputError` for what only a motion has."""
    if stated:
        raise InputError(f"found --{next(iter(stated))}, which is of a motion: add --dynamic, or leave it out")
    if output is not None and output.suffix.lower() in (".script", ".src"):
        raise InputError(f"--output is {output}, and a program moves: add --dynamic, or name a .csv")


def _reach(robot: str | None, around: str | None) -> Reach | None:
    """What the robot's wrist reaches around the joint angles that --around states."""
    from ..assess.robot_arms import reach

    if robot is None:
        if around is not None:
            raise InputError("--around says where a robot stands, and there is none: give --robot, or leave it out")
        return None
    return reach(*_arm(robot, around))
