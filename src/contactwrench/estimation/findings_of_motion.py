"""What a motion says of itself beside the numbers: contact, slow sensors, an accelerometer, what it leaves untold, and
positions or a tool that are not what they were taken for.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil

import numpy as np

from ..calibration.dynamics import Dynamics
from ..calibration.findings import Finding, Kind, Severity
from ..geometry.arrays import Array
from ..samples.accelerometer import Accelerometer
from ..samples.samples import Samples
from ..samples.timestamps import spread_evenly
from ..statistics import meaningful_digits
from .dynamic import STATED_OFFSET_STD, Moved, Told
from .motion_moments import FLAT
from .rigidity import PositionsRead

LITTLE_WEIGHT = 0.25
"""Of a window: it is noisier than most, a push or a shake."""
MANY = 0.1
"""Of the windows; and of the weight, what is left of the force in motion."""
OTHER_FORCES = "contact, cables, shaking, or another tool than at the stops"
CONTRADICTS = 3.0
"""Standard deviations of a stated offset, or of the weight at the stops."""
MOST_OF_IT = 0.9
"""Of the recording, in which an accelerometer is to have read."""
IMPOSSIBLE = 2.0
"""Standard deviations from the inertia of any body."""
NOT_RIGID = 2e-3
"""Of what the motion makes felt, as a share: less, though it shows in a long recording, matters to nobody."""
STANDS = 1e-6
"""m: a column that changes less is no position of a moving flange."""
ENOUGH_POSES = 8.0
"""For each period of the fastest motion used: with 5 of them std were up to ten times too small, with 12 they hold."""
SLOW_SENSOR, SURELY = 5e-5, 5.0
"""s^2, of the blur that a filter of first order at 16 Hz has, and standard deviations: it is said."""
OF_SENSOR = "set the sensor's filter faster, or state it where contact is judged (--sensor-filter)"
OF_IMU = "the inertia is told in spite of it, contact in motion is not: set its filter faster"
"""What to do."""
DRIFTED = 0.03
"""m/s^2, of an accelerometer from begin to end: as much of a kilogram's force is of the size of a sensor's noise."""


def of_motion(
    found: Moved,
    weight: float,
    stated: Array | None,
    untold: list[str],
    moved_by: float,
    dynamics: Dynamics,
    most: float,
    read: float,
) -> Iterator[Finding]:
    """What there is to say.

    Args:
        found: by the motion.
        weight: N.
        stated: sensor offset (3,), m, or None.
        untold: parameters of which the motion tells next to nothing.
        moved_by: standard deviations from what was found to the nearest inertia of a body.
        dynamics: that come of it.
        most: Hz, up to which the motion was used.
        read: share of the recording in which an accelerometer read.
    """
    off = np.zeros(3) if stated is None else np.abs(found.sensor_offset - stated)
    if off.max() > CONTRADICTS * STATED_OFFSET_STD:
        origin = "the flange's origin" if dynamics.accelerometer is None else "the accelerometer"
        text = (
            f"the stated sensor offset is {1e3 * off.max():.2g} mm or more off what the motion tells: it counts from "
            f"{origin} to the sensor's, in flange axes; measure it again, or leave it out"
        )
        yield Finding.doubtful(Kind.CONTRADICTS_PRIOR, text)
    if untold:
        text = f"the motion tells nothing of {', '.join(untold)}: what stands there was assumed; turn about every axis"
        yield Finding.weak(Kind.UNTOLD_BY_MOTION, text)
    nearest = "no body has the inertia that the readings alone give, the nearest that one can have was taken"
    if moved_by > IMPOSSIBLE:
        text = f"{nearest}, {moved_by:.2g} standard deviations off: something shakes the sensor, or moves on the tool"
        yield Finding.doubtful(Kind.IMPLAUSIBLE_TOOL, text)
    elif moved_by > 0.0:
        yield Finding(Kind.IMPLAUSIBLE_TOOL, Severity.NOTE, f"{nearest}, within its standard deviations")
    noisy, left = float(np.mean(found.weight.min(axis=1) < LITTLE_WEIGHT)), float(np.linalg.norm(found.left[:3]))
    if left > MANY * weight:
        text = (
            f"{left:.2g} N RMS of the force below {most:.2g} Hz is left in motion, {left / weight:.0%} of the weight: "
            f"{OTHER_FORCES}; what is known of the inertia counts with it"
        )
        yield Finding(Kind.CONTACT_IN_MOTION, Severity.WARNING, text)
    elif noisy > MANY:
        text = f"{noisy:.0%} of the motion is far noisier than the rest and counts little: {OTHER_FORCES}"
        yield Finding(Kind.CONTACT_IN_MOTION, Severity.WARNING, text)
    for kind, slow, what, remedy in (
        (Kind.SLOW_SENSOR, found.blur, "the readings follow the motion", OF_SENSOR),
        (Kind.ACCELEROMETER, found.slow, "the accelerometer follows what the sensor feels", OF_IMU),
    ):
        if slow.value > max(SLOW_SENSOR, SURELY * slow.std):
            corner = 1.0 / (2.0 * np.pi * np.sqrt(2.0 * slow.value))
            text = f"{what} as behind a low-pass of first order at {corner:.2g} Hz: {remedy}"
            yield Finding(kind, Severity.WARNING, text)
    if found.beyond.shows and found.beyond.share > NOT_RIGID:
        text = (
            f"{found.beyond.share:.2%} of what the motion makes felt follows it as no rigid tool does: something "
            "swings on the tool, the motion is told too slowly or late, or an accelerometer's zero wanders; it is in "
            "the std of the inertia"
        )
        yield Finding.doubtful(Kind.NOT_RIGID, text)
    if dynamics.accelerometer is not None:
        yield from _of_accelerometer(dynamics.accelerometer, read)
    told = FLAT * dynamics.bandwidth
    seconds = f"{dynamics.seconds:.3g} s of motion used, up to {most:.2g} Hz, "
    if most < told or dynamics.accelerometer is not None:
        yield Finding(Kind.MOTION_USED, Severity.NOTE, f"{seconds}where nearly all of its acceleration is")
    else:
        text = "beyond which the poses tell no acceleration: record them more often, or with more digits"
        yield Finding(Kind.MOTION_USED, Severity.WARNING, seconds + text)


def of_weight(weighs: Told, weight: float) -> Iterator[Finding]:
    """That what the tool `weighs` in motion is not the `weight` N of the stops, beside the std of that."""
    if abs(weighs.value - weight) > CONTRADICTS * weighs.std:
        at_stops, std = meaningful_digits(weight, weighs.std)
        text = (
            f"in motion the tool weighs {meaningful_digits(weighs.value, weighs.std)[0]} N, at the stops {at_stops} +- "
            f"{std} N: another tool, or something gripped or lost in between: record stops and motion of one tool"
        )
        yield Finding.doubtful(Kind.CONTRADICTS_PRIOR, text)


def of_positions(read: PositionsRead, position: Array) -> Iterator[Finding]:
    """What positions (n, 3) m of a motion are not: by themselves, and as the forces say that they are read."""
    spans = np.nanmax(position, axis=0) - np.nanmin(position, axis=0)
    still = [axis for axis, span in zip("xyz", spans, strict=True) if span < STANDS]
    if still:
        axes, change = " and ".join(still), "changes" if len(still) == 1 else "change"
        text = f"the position's {axes} never {change}: if the arm moves along it, that is not its column"
        yield Finding(Kind.POSITIONS_IN_DOUBT, Severity.WARNING, text)
    elif read.otherwise:
        text = (
            f"the forces in motion go with positions that are {read.cause or 'not those given'}: check the columns x, "
            "y, z, their unit, that they are of the same flange, base and time as the orientations, and the tool that "
            "of the stops"
        )
        yield Finding.doubtful(Kind.POSITIONS_IN_DOUBT, text)


def of_delay(late: float) -> Finding:
    """By how many s the motion says that the wrench is stamped later than the orientation."""
    by = f"{1e3 * abs(late):.3g} ms {'later' if late > 0.0 else 'earlier'}"
    text = f"by the motion the wrench is stamped {by} than the orientation: applied"
    return Finding(Kind.DELAY_OF_MOTION, Severity.NOTE, text)


def of_rate(samples: Samples, usual: float) -> Iterator[Finding]:
    """Whether poses, or an accelerometer's readings, come often enough for a motion that is nearly all below `usual`
    Hz; of rows that hold a pose those count that have a new one.
    """
    t = spread_evenly(np.asarray(samples.t))
    what, period = "the accelerometer's readings", samples.accelerometer_period
    if samples.accelerometer is None:
        what, period = "poses", samples.pose_period
        turned = np.flatnonzero(np.any(samples.R_base_flange[1:] != samples.R_base_flange[:-1], axis=(1, 2)))
        t = t[turned] if len(turned) > 1 else t
    rate = 1.0 / (period or float(np.median(np.diff(t))))
    if rate < ENOUGH_POSES * usual:
        text = (
            f"{what} came at {rate:.3g} Hz, and the arm moved at up to {usual:.2g} Hz: what lies between is guessed, "
            f"online a start is in no std: record them at {ceil(ENOUGH_POSES * usual)} Hz or faster, or move more "
            "slowly"
        )
        yield Finding.doubtful(Kind.SLOW_POSES, text)


def _of_accelerometer(accelerometer: Accelerometer, read: float) -> Iterator[Finding]:
    if read < MOST_OF_IT:
        text = (
            f"the accelerometer read in {read:.0%} of the recording, so that fewer stops tell how it sits than the std "
            "says: record it from begin to end"
        )
        yield Finding.doubtful(Kind.ACCELEROMETER, text)
    if accelerometer.unit is None:
        text = (
            f"the accelerometer reads {accelerometer.scale:.3g} for each m/s^2, expected 1, or 0.102 of one in g: "
            "taken as gravity turns in it"
        )
        yield Finding.doubtful(Kind.ACCELEROMETER, text)
    if (drift := float(np.linalg.norm(accelerometer.drift))) > DRIFTED:
        text = (
            f"the accelerometer's zero drifted by {drift:.2g} m/s^2: taken off here, not where contact is read: "
            "let it warm up, and calibrate again"
        )
        yield Finding(Kind.ACCELEROMETER, Severity.WARNING, text)
    if accelerometer.mirrors:
        text = "the accelerometer mirrors: two axes are exchanged, or one or all reversed; taken as gravity turns in it"
        yield Finding(Kind.ACCELEROMETER, Severity.WARNING, text)
    late, side = 1e3 * accelerometer.delay, "after" if accelerometer.delay > 0.0 else "before"
    when = f"{abs(late):.2g} ms {side} the wrench" if late else "with the wrench"
    text = (
        f"accelerations of an accelerometer in {accelerometer.unit or 'its own unit'}, {when}, off by "
        f"{accelerometer.noise:.2g} m/s^2 at rest; the sensor's offset counts from it"
    )
    yield Finding(Kind.ACCELEROMETER, Severity.NOTE, text)
