"""A plan as text for the terminal and as JSON: of poses, also as the CSV to be filled in, or of a whole recording."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..assess.fourier_motion import HARMONICS
from ..assess.plan import READINGS, Accuracy, Expected, Plan
from ..assess.plan_motion import STOP, DynamicPlan
from ..calibration.dynamics import DYNAMIC_PARAMETERS, SPOKEN_UNIT_OF
from ..geometry.arrays import Array
from ..geometry.orientation import to_quat_xyzw
from ..model import gravity_in_flange
from ..statistics import counted
from .text import json_text, named

MUCH_WORSE = 1.05
"""Of the std that a plan without a robot reaches: more than this, and the arm's limits are said to cost it."""


def plan_text(plan: Plan) -> str:
    """The poses in order, what they are planned for, and what they are worth."""
    lines = [
        f"Plan of {counted(len(plan), 'pose')} after {plan.recorded}, model {plan.model}",
        *_expected_text(plan.expected),
    ]
    if plan.around is not None and plan.joints is not None:
        around = " ".join(f"{q:.4g}" for q in plan.around)
        still = np.flatnonzero((plan.joints == plan.around).all(axis=0))
        stay = "none" if not len(still) else " ".join(f"q{k + 1}" for k in still)
        lines += [f"  by the wrist of {plan.arm} around {around} rad; joints that stay: {stay}"]
    return "\n".join([*lines, "", *_poses(plan), "", *_accuracies(plan)])


def _expected_text(expected: Expected) -> list[str]:
    """What is planned for, and why no recording tells it."""
    origin = "assumed" if expected.fitted_to is None else f"fitted to {expected.fitted_to}"
    return [
        *([] if expected.refusal is None else [f"  {expected.refusal}"]),
        f"  {origin}: a tool of {expected.tool.weight:.3g} N, a noise of {_noise_text(expected.noise)} in a pose's "
        "reading",
    ]


def _noise_text(noise: Array) -> str:
    """The root mean square of the forces' std, and of the torques'."""
    force, torque = (np.sqrt(np.mean(part**2)) for part in (noise[:3], noise[3:]))
    return f"{force:.2g} N and {1e3 * torque:.2g} mN m"


def _poses(plan: Plan) -> list[str]:
    """One line a pose: what the flange sees of gravity, how far it is from the pose before, and how to go there; joint
    angles in a table of their own, as there are up to seven.
    """
    down = gravity_in_flange(plan.R_base_flange, plan.expected.tool.gravity_direction)
    tilt = np.rad2deg(np.arccos(np.clip(down[:, 2], -1.0, 1.0)))
    lines = [
        f"  {'':4}  {'down, in flange axes':^20}  {'flange z':>9}  {'turn':>7}",
        f"  {'pose':4}  {'x':>6} {'y':>6} {'z':>6}  {'from down':>9}  {'':>7}",
    ]
    for k in range(len(plan)):
        turn = "" if np.isnan(plan.turn[k]) else f"{np.rad2deg(plan.turn[k]):.0f} deg"
        seen = " ".join(f"{value:+6.2f}" for value in down[k])
        lines.append(f"  {k + 1:4d}  {seen}  {tilt[k]:5.0f} deg  {turn:>7}")
    if plan.joints is None:
        go_to = [
            _cells(_columns(plan), ">8"),
            *(_cells(row, "8.4f") for row in to_quat_xyzw(plan.R_base_flange, canonical=True)),
        ]
        return [lines[0], *(line + cells for line, cells in zip(lines[1:], go_to, strict=True))]
    names = f"  pose{_cells(_columns(plan)[4:], '>9')}  rad"
    return [
        *(line.rstrip() for line in lines),
        "",
        names,
        *(f"  {k:4d}{_cells(joints, '9.4f')}" for k, joints in enumerate(plan.joints, start=1)),
    ]


def _cells(values: Iterable[object], form: str) -> str:
    return "".join(f"{value:{form}}" for value in values)


def _accuracies(plan: Plan) -> list[str]:
    lines = [
        "  std of the contact wrench because of the calibration, over all orientations",
        f"  {'':8}   {'root mean square':^20}   {'largest':^20}".rstrip(),
        *([f"  {'before':8}   {_accuracy(plan.before)}"] if plan.recorded else []),
        f"  {'after':8}   {_accuracy(plan.after)}",
    ]
    if plan.anywhere is not None and plan.after is not None and plan.after.force > MUCH_WORSE * plan.anywhere.force:
        lines += [
            f"  {'anywhere':8}   {_accuracy(plan.anywhere)}",
            "  The wrist cannot reach the best orientations from here: try another place (--around)",
        ]
    if plan.after is None:
        lines += ["  These poses are too few to calibrate with: plan more"]
    if plan.arm is not None:
        lines += ["  Collisions and cables are not checked: run the poses slowly once"]
    return lines


def _accuracy(accuracy: Accuracy | None) -> str:
    if accuracy is None:
        return "  cannot be calibrated"
    rms = f"{accuracy.force:6.2g} N {1e3 * accuracy.torque:6.2g} mN m"
    return f"{rms}   {accuracy.largest_force:6.2g} N {1e3 * accuracy.largest_torque:6.2g} mN m"


def plan_csv(plan: Plan) -> str:
    """A header and a row a pose: qx qy qz qw of R_base_flange, and with a robot q1..qN, rad."""
    joints = [[]] * len(plan) if plan.joints is None else plan.joints.tolist()
    turned = zip(to_quat_xyzw(plan.R_base_flange, canonical=True).tolist(), joints, strict=True)
    rows = ([*(f"{part:.9f}" for part in quaternion), *(f"{q:.4f}" for q in angles)] for quaternion, angles in turned)
    return "".join(",".join(cells) + "\n" for cells in [_columns(plan), *rows])


def plan_json(plan: Plan) -> str:
    """What the plan is for, its poses, and what they are worth: SI and radians."""
    down = gravity_in_flange(plan.R_base_flange, plan.expected.tool.gravity_direction)
    return json_text(
        {
            "model": plan.model,
            "expected": _expected_json(plan.expected),
            "recorded": plan.recorded,
            "robot": None if plan.around is None else {"arm": plan.arm, "around": plan.around},
            "poses": [
                {
                    "quat_xyzw": quat_xyzw,
                    "joints": None if plan.joints is None else plan.joints[k],
                    "down_in_flange": down[k],
                    "turn": float(plan.turn[k]),
                }
                for k, quat_xyzw in enumerate(to_quat_xyzw(plan.R_base_flange, canonical=True))
            ],
            **named(plan, "before after anywhere"),
        }
    )


def _expected_json(expected: Expected) -> dict[str, object]:
    """Tool and noise that are planned for, and where they are from."""
    return {**named(expected.tool, "weight com"), **named(expected, "noise fitted_to refusal")}


def dynamic_plan_text(plan: DynamicPlan) -> str:
    """What is planned, how fast it is at most, and how well it tells inertia and offset."""
    motion, most = plan.motion, plan.largest
    lines = [
        f"Plan of {len(plan.stops)} stops and {motion.duration:.3g} s of motion, {plan.duration:.0f} s in all, model "
        "dynamic",
        *_expected_text(plan.stops.expected),
        f"  in motion {_noise_text(plan.stops.expected.in_motion)} in each of {READINGS:g} readings a second",
        f"  with {plan.arm.name} from {' '.join(f'{q:.4g}' for q in motion.start)} rad and back, {STOP} s at each stop",
        f"  then {motion.periods} periods of {HARMONICS} harmonics of {motion.frequency:.3g} Hz in every joint",
        "",
        f"  {'at most':14}" + "".join(f"{f'q{k + 1}':>6}" for k in range(len(plan.arm))),
        *(
            f"  {name:14}" + "".join(f"{value:6.0f}" for value in np.rad2deg(values)) + f"  {unit}"
            for name, values, unit in (
                ("from the start", most.from_start, "deg"),
                ("speed", most.speed, "deg/s"),
                ("acceleration", most.acceleration, "deg/s^2"),
            )
        ),
        f"  The flange turns at up to {np.rad2deg(most.turn_speed):.0f} deg/s and "
        f"{np.rad2deg(most.turn_acceleration):.0f} deg/s^2, and moves at up to {most.flange_speed:.2g} m/s",
        f"  It is {most.lowest:.2g} m above the plane of the base or more, within {most.furthest:.2g} m of "
        f"where it starts, in motion {plan.limits.within:.2g} m",
        "",
        "  std that the motion leaves, at best",
        f"  {'':12}{'tool known':>12}{'after the stops':>17}",
    ]
    for name, known, after in zip(DYNAMIC_PARAMETERS, plan.std, plan.std_after_stops, strict=True):
        scale, unit = SPOKEN_UNIT_OF[name]
        lines.append(f"  {name:12}{scale * known:12.2g}{scale * after:17.2g}  {unit}")
    if plan.stops.after is None:
        lines.append("  The stops are too few to calibrate with: plan more (-n)")
    return "\n".join([*lines, "  Collisions and cables are not checked: run the motion slowly once"])


def dynamic_plan_json(plan: DynamicPlan) -> str:
    """All of it: SI and radians."""
    motion = plan.motion
    return json_text(
        {
            "model": "dynamic",
            "expected": _expected_json(plan.stops.expected),
            "robot": {"arm": plan.arm.name, "around": motion.start},
            "duration": plan.duration,
            "stops": {"joints": plan.stops.joints, "seconds": STOP, "moves": plan.moves, "after": plan.stops.after},
            "motion": named(motion, "frequency periods duration sine cosine"),
            "largest": plan.largest,
            "reading": {"noise": plan.stops.expected.in_motion, "per_second": READINGS},
            "std": dict(zip(DYNAMIC_PARAMETERS, plan.std.tolist(), strict=True)),
            "std_after_stops": dict(zip(DYNAMIC_PARAMETERS, plan.std_after_stops.tolist(), strict=True)),
        }
    )


def _columns(plan: Plan) -> list[str]:
    joints = 0 if plan.joints is None else plan.joints.shape[1]
    return ["qx", "qy", "qz", "qw", *(f"q{k + 1}" for k in range(joints))]
