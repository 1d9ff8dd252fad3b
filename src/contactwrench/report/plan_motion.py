"""A planned recording for model `dynamic` as text for the terminal and as JSON."""

from __future__ import annotations

import numpy as np

from ..assess.fourier_motion import HARMONICS
from ..assess.plan import READINGS
from ..assess.plan_motion import STOP, DynamicPlan
from ..calibration.dynamics import DYNAMIC_PARAMETERS, INERTIA
from .plan import expected_json, expected_text, noise_text
from .text import json_text

IN_KG_CM2, IN_MM = 1e4, 1e3


def dynamic_plan_text(plan: DynamicPlan) -> str:
    """What is planned, how fast it is at most, and how well it tells inertia and offset."""
    motion, most = plan.motion, plan.largest
    lines = [
        f"Plan of {len(plan.stops)} stops and {motion.duration:.3g} s of motion, {plan.duration:.0f} s in all, model "
        "dynamic",
        *expected_text(plan.stops.expected),
        f"  in motion {noise_text(plan.stops.expected.in_motion)} in each of {READINGS:g} readings a second",
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
        scale, unit = (IN_KG_CM2, "kg cm^2") if name in INERTIA else (IN_MM, "mm")
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
            "expected": expected_json(plan.stops.expected),
            "robot": {"arm": plan.arm.name, "around": motion.start},
            "duration": plan.duration,
            "stops": {"joints": plan.stops.joints, "seconds": STOP, "moves": plan.moves, "after": plan.stops.after},
            "motion": {
                "frequency": motion.frequency,
                "periods": motion.periods,
                "duration": motion.duration,
                "sine": motion.sine,
                "cosine": motion.cosine,
            },
            "largest": plan.largest,
            "reading": {"noise": plan.stops.expected.in_motion, "per_second": READINGS},
            "std": dict(zip(DYNAMIC_PARAMETERS, plan.std.tolist(), strict=True)),
            "std_after_stops": dict(zip(DYNAMIC_PARAMETERS, plan.std_after_stops.tolist(), strict=True)),
        }
    )
