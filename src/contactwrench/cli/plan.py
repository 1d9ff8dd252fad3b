"""`contactwrench plan`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from ..files import STDOUT
from ..geometry.ranges import JOINT, POSES
from . import options
from .outputs import Writes
from .recordings import Recordings, with_reading_options

if TYPE_CHECKING:
    from ..assess.robot_arms import Reach


@with_reading_options
def plan(
    *,
    n: Annotated[int, options.number(POSES, "N", "Number of poses.", "-n")] = 6,
    recorded: Annotated[
        Path | None, typer.Option("--from", metavar="FILE", help="Plan the next poses after those in this recording.")
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|URDF[:LINK]",
            help="Only what its wrist reaches: iiwa7, iiwa14, ur3e, ur5e, ur10e, ur16e, ur20, panda, fr3, or a URDF.",
        ),
    ] = None,
    around: Annotated[
        str | None,
        typer.Option(metavar="Q1,Q2,...", help="Where the arm stands, rad; all joints but the last three stay there."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PLAN.csv", help=f"Write the poses; {options.OUTPUT_HELP} stdout."),
        Writes(),
    ] = None,
    model: Annotated[
        str, typer.Option(metavar="M", help="What will be fitted: auto, yaw, mount, mount+base.")
    ] = "auto",
    json: options.Json = False,
    written: Recordings,
    gravity: options.Gravity = None,
) -> None:
    """Choose the next poses to record: those that make the contact wrench most certain, in a short order."""
    from ..assess.plan import expected_tool, recorded_orientations
    from ..assess.plan import plan as choose
    from ..files import write_text
    from ..report.plan import plan_csv, plan_json, plan_text

    to_stdout = str(output) == STDOUT
    if json and to_stdout:
        raise InputError("--json and --output - both write to stdout, expected one of them: name a file for --output")
    if recorded is None and written.stated:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in written.stated)
        raise InputError(f"found {flags} and no recording to read so: give --from FILE, or leave them out")
    samples = None if recorded is None else written.beside(recorded).read()
    options.note_ends(recorded)
    result = choose(
        n,
        expected_tool(samples, model, options.gravity_direction(gravity)),
        model=model,
        recorded=None if samples is None else recorded_orientations(samples),
        reach=_reach(robot, around),
    )
    if output is not None:
        write_text(output, plan_csv(result))
    if not to_stdout:
        options.print_result(result, json, plan_json, plan_text)
    if output is not None and not (json or to_stdout):
        options.say(f"Wrote the poses to {output}")


def _reach(robot: str | None, around: str | None) -> Reach | None:
    """What the robot's wrist reaches around the joint angles that --around states."""
    from ..assess.robot_arms import reach
    from ..recording.urdf import arm_of

    if robot is None:
        if around is not None:
            raise InputError("--around says where a robot stands, and there is none: give --robot, or leave it out")
        return None
    joints = None if around is None else options.numbers(around, "--around", "joint angles Q1,Q2,...", JOINT)
    return reach(arm_of(robot), joints)
