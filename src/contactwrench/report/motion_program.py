"""A planned recording for model `dynamic` as a file to run: joint angles with times, URScript, or KUKA's KRL.

URScript: Universal Robots, The URScript Programming Language (movej, servoj). KRL: KUKA System Software 8.3, Operating
and Programming Instructions for System Integrators (PTP, PTP_SPLINE, SPTP, TIME_BLOCK). The series begins and ends each
period at rest, so that a program may stop there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ..assess.fourier_motion import HARMONICS
from ..assess.plan_motion import STOP, DynamicPlan
from ..assess.robot_arms import Arm
from ..errors import InputError
from ..files import STDOUT
from ..geometry.arrays import Array

CSV_PERIOD, SERVOJ_PERIOD, KRL_PERIOD = 0.02, 0.008, 0.05
"""s: a spline through the first is off by less than 1 urad; the second is what every controller of Universal Robots
keeps, whose own period is 2 or 8 ms; the third is ten points of the fastest harmonic.
"""
LOOKAHEAD, GAIN = 0.1, 300
"""Of servoj, s and its own unit: its defaults."""
PTP_PERCENT = 20
"""Of KUKA's largest joint speeds and accelerations, from stop to stop."""
LONGEST_NAME = 24
"""Of a KRL program."""


def program_of(output: Path | None, arm: Arm) -> Callable[[DynamicPlan, str], str]:
    """What makes the file `output` of a plan, and of the file's name without its suffix. Raises `InputError` for a
    suffix that is not known, and for an arm that the language does not move.
    """
    suffix = ".csv" if output is None or str(output) == STDOUT else output.suffix.lower()
    if suffix == ".csv":
        return lambda plan, _: motion_csv(plan)
    if suffix not in PROGRAMS:
        raise InputError(
            f"--output is {output}, expected a name that ends in .csv, .script (URScript) or .src (KUKA KRL)"
        )
    language, makers, write = PROGRAMS[suffix]
    of_other_maker = not arm.joint_names and not (suffix == ".script" and arm.name.startswith("ur"))
    if len(arm) != AXES or of_other_maker:
        raise InputError(
            f"--output is {output}, and {language} moves the {AXES} joints of {makers}, found {arm.name} with "
            f"{len(arm)}: name a .csv"
        )
    return write


def motion_csv(plan: DynamicPlan) -> str:
    """`t`, s, and `q1` to `qN`, rad, every `CSV_PERIOD`."""
    t = np.append(np.arange(0.0, plan.duration - 0.5 * CSV_PERIOD, CSV_PERIOD), plan.duration)
    names = ",".join(f"q{k + 1}" for k in range(len(plan.arm)))
    rows = np.column_stack([t, plan.at(t)[0] + 0.0]).tolist()
    form = ",".join(["%.4f", *["%.9f"] * len(plan.arm)]) + "\n"
    return f"t,{names}\n" + "".join(form % tuple(row) for row in rows)


def urscript(plan: DynamicPlan, name: str) -> str:
    """A program of Universal Robots: movej to the stops, then the series itself, evaluated for servoj."""
    motion, w = plan.motion, 2.0 * np.pi * plan.motion.frequency
    orders = range(1, HARMONICS + 1)
    lines = [
        *(f"# {line}" for line in _to_check(plan, "set the payload, and set_tcp(p[0, 0, 0, 0, 0, 0]) to record")),
        "# - servoj: the safety limits and the joint speeds above; no force or freedrive mode is on",
        f"def {_identifier(name)}():",
        "  slower = 10.0  # times; 1.0 for the recording",
        f"  movej([{_listed(motion.start)}], a=0.5, v=0.25)\n  sleep({STOP})",
        *(
            f"  movej([{_listed(row)}], t={seconds:.1f}*slower)\n  sleep({STOP})"
            for row, seconds in zip(plan.visited[1:], plan.moves, strict=True)
        ),
        f"  period = {SERVOJ_PERIOD}",
        "  t = 0.0",
        f"  while t < {motion.duration:.6f}:",
        *(f"    s{k} = sin({k * w:.9f}*t)\n    c{k} = cos({k * w:.9f}*t) - 1.0" for k in orders),
        *(
            f"    q{j + 1} = {motion.start[j]:.9f}"
            + "".join(f" + ({motion.sine[k - 1, j]:.9f})*s{k} + ({motion.cosine[k - 1, j]:.9f})*c{k}" for k in orders)
            for j in range(AXES)
        ),
        f"    servoj([{', '.join(f'q{j + 1}' for j in range(AXES))}], 0, 0, period, {LOOKAHEAD}, {GAIN})",
        "    t = t + period/slower",
        "  end",
        "  stopj(1.0)",
        f"  sleep({STOP})",
        "end",
    ]
    return "\n".join(lines) + "\n"


def krl(plan: DynamicPlan, name: str) -> str:
    """A program of a KUKA with KRC: PTP to the stops, then period by period a block of SPTP in its time."""
    motion = plan.motion
    points = round(1.0 / (motion.frequency * KRL_PERIOD))
    joints = motion.at(np.arange(1, points + 1) / (points * motion.frequency))[0]
    joints[-1] = motion.start
    lines = [
        f"DEF {_identifier(name)}( )",
        *(f"; {line}" for line in _to_check(plan, "set the load data, and record the flange's pose ($TOOL of zeros)")),
        "; - the angles are the URDF's: compare those of the first PTP with the controller's display, sign by sign",
        "; - first in T1; at a reduced override TIME_BLOCK takes longer, and 100 % is the recording's",
        "DECL INT I",
        "BAS(#INITMOV, 0)",
        "FOR I = 1 TO 6",
        f"  $VEL_AXIS[I] = {PTP_PERCENT}",
        f"  $ACC_AXIS[I] = {PTP_PERCENT}",
        "ENDFOR",
        *(f"PTP {_axes(row)}\nWAIT SEC {STOP}" for row in plan.visited),
        "FOR I = 1 TO 6",
        "  $VEL_AXIS[I] = 100",
        "  $ACC_AXIS[I] = 100",
        "ENDFOR",
        f"FOR I = 1 TO {motion.periods}",
        "  PTP_SPLINE",
        "    TIME_BLOCK START",
        *(f"    SPTP {_axes(row)}\n    TIME_BLOCK PART = 1" for row in joints),
        f"    TIME_BLOCK END = {1.0 / motion.frequency:.6f}",
        "  ENDSPLINE",
        "ENDFOR",
        f"WAIT SEC {STOP}",
        "END",
    ]
    return "\n".join(lines) + "\n"


AXES = 6
PROGRAMS: dict[str, tuple[str, str, Callable[[DynamicPlan, str], str]]] = {
    ".script": ("URScript", "a Universal Robots arm", urscript),
    ".src": ("KRL", "a KUKA with KRC, given as a URDF", krl),
}
"""By suffix: the language, whose arms it moves, and what writes it."""


def _to_check(plan: DynamicPlan, payload: str) -> Iterator[str]:
    """Comments for who runs it first."""
    most = plan.largest
    speeds = " ".join(f"{value:.0f}" for value in np.rad2deg(most.speed))
    yield f"{len(plan.stops)} stops and {plan.motion.duration:.3g} s of motion, {plan.arm.name}, model dynamic"
    yield "Check before the first run, which is slow and with a hand on the stop:"
    yield f"- speed: joints {speeds} deg/s, the flange {np.rad2deg(most.turn_speed):.0f} deg/s and"
    yield f"  {most.flange_speed:.2g} m/s at most, the way between the stops apart"
    yield f"- workspace: the flange, tool and cables not counted, is {most.lowest:.2g} m above the plane of the base or"
    yield f"  more, within {most.furthest:.2g} m of where it starts; collisions are not checked"
    yield f"- payload: {payload}; the tool is free"


def _identifier(name: str) -> str:
    word = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST_NAME]
    return word if word[:1].isalpha() else f"p{word}"[:LONGEST_NAME]


def _listed(joints: Array) -> str:
    return ", ".join(f"{q:.6f}" for q in (joints + 0.0).tolist())


def _axes(joints: Array) -> str:
    return "{" + ", ".join(f"A{k} {q:.5f}" for k, q in enumerate((np.rad2deg(joints) + 0.0).tolist(), start=1)) + "}"
