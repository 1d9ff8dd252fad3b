"""What the tasks' figures say, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from . import guarded_move
from .closed_loop import PERIOD
from .part import Measured, wilson
from .scenes import PLATE_STIFFNESS
from .task_trials import (
    SETTINGS,
    Inserted,
    Pushed,
)

FAILED = ("time", "lost", "stop")
"""How a try of the peg ends that fails."""


def against_ours(face: str, tries: dict[str, list[Inserted]], name: str) -> str:
    """How a method compares with ours: in success only where the two intervals lie apart."""
    counts = {one: sum(found.inserted for found in tries[one]) for one in (name, "ours")}
    n = len(tries[name])
    (low, high), (our_low, our_high) = (wilson(counts[one] / n, n) for one in (name, "ours"))
    verdict = "fewer" if high < our_low else "more" if low > our_high else "which these trials cannot tell apart"
    force, our_force = (float(np.mean([one.largest_force for one in tries[which]])) for which in (name, "ours"))
    words = (
        f"{sentence(where(face))}, {name} brought {counts[name]} of {n} pegs in and ours {counts['ours']}: "
        f"{verdict}. Its largest force was {force:.1f} N in the mean, ours {our_force:.1f} N"
    )
    times = [[one.seconds for one in tries[which] if one.inserted] for which in (name, "ours")]
    if all(times):
        words += f"; where the peg went in it took {np.mean(times[0]):.1f} s, ours {np.mean(times[1]):.1f} s"
    return f"{words}."


def failed(found: Sequence[Inserted]) -> str:
    """How many tries ended in each of the ways to fail."""
    return ", ".join(str(sum(one.ended == end for one in found)) for end in FAILED)


def where(face: str) -> str:
    """Where the hole of that face lies."""
    return "in the upright face" if face == "upright" else "straight below"


def about_the_tool() -> str:
    """What the arm holds, and what the controller knows of it."""
    tool, bias = SETTINGS.tool, SETTINGS.sensor.bias
    weight = tool.mass * SETTINGS.gravity
    com = ", ".join(f"{1e3 * value:g}" for value in tool.com)
    return (
        f"The tool weighs {weight:.1f} N ({tool.mass:g} kg, centre of mass at {com} mm), the sensor's zero is "
        f"{bias[2]:g} N along its z; calibrations come from the paper's six postures with this tool. The controller "
        "knows the sensor's mounting exactly, for every method; only what is subtracted differs."
    )


def about_the_stop() -> str:
    """By how much the force goes past the threshold until the stop is commanded, and why."""
    sensor, growth = SETTINGS.sensor, guarded_move.SPEED * PLATE_STIFFNESS
    lag = 1.0 / (2.0 * np.pi * sensor.low_pass)
    late = lag + sensor.delay + PERIOD
    return (
        f"Square to a rigid arm the force would grow by {growth:g} N/s, and until the stop the sensor's lag "
        f"({1e3 * lag:.1f} ms), its delay ({1e3 * sensor.delay:g} ms) and up to one period of the controller "
        f"({1e3 * PERIOD:g} ms) pass: with a perfect calibration it would then be over {guarded_move.THRESHOLD:g} N by "
        f"about {growth * (late - 0.5 * PERIOD):.1f} N in the mean and {growth * late:.1f} N at the most. The arm "
        "gives a little too, and plates lean, which makes it less."
    )


def about_saturation(found: dict[str, dict[str, list[Pushed]]] | dict[str, dict[str, list[Inserted]]]) -> str:
    """In how many readings the sensor was at its limit, and why."""
    shares = {
        name: float(np.mean([one.saturated for face in found for one in found[face][name]])) for name in found["level"]
    }
    sensor = SETTINGS.sensor
    room = sensor.overload * np.array(sensor.ranges[3:]) - np.abs(sensor.bias[3:])
    figures = ", ".join(f"{100.0 * value:.1f} % ({name})" for name, value in shares.items())
    return (
        f"A channel of the sensor stood at its limit, and showed less than there was, in {figures} of the readings: "
        f"its zero leaves {room.min():.2f} N m of one torque axis, and no calibration gives that back."
    )


def share_of(successes: int, trials: int) -> Measured:
    """Without a standard error: the interval beside it is what counts, and it is right at 0 and 1 too."""
    return Measured(successes / trials, None, trials)


def calibrations(n: int) -> str:
    """How many calibrations n trials had."""
    return f"{n} calibrations: every trial has one of its own"


def interval(successes: int, trials: int) -> str:
    """The 95 % interval of a share."""
    low, high = wilson(successes / trials, trials)
    return f"{100.0 * low:.0f} to {100.0 * high:.0f} %"


def ended_early(found: Sequence[Pushed]) -> str:
    """How many of the runs ended early."""
    return f"{sum(run.ended_early for run in found)} of {len(found)}"


def sentence(name: str) -> str:
    """With a capital first letter."""
    return name[:1].upper() + name[1:]
