"""A calibration of poses, with what the same recording tells in motion: model `dynamic`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..calibration.dynamics import DYNAMIC_PARAMETERS, INERTIA, Dynamics, can_exist, inertial_matrix, nearest_possible
from ..calibration.findings import Kind, Severity
from ..errors import InputError, UnobservableError
from ..geometry.arrays import Array
from ..geometry.ranges import ON_FLANGE
from ..samples.accelerometer import Accelerometer, delay_behind, mounted_accelerometer, without_drift
from ..samples.delay import is_significant
from ..samples.flange_motion import AT_REST, SLOWEST, FlangeMotion, flange_motion
from ..samples.recorded_poses import is_stream
from ..samples.samples import OrientationStream, Samples, Streams, WrenchStream
from ..samples.synchronize import synchronize
from ..samples.timestamps import spread_evenly
from .dynamic import NO_ROWS, SHAKEN_STD, UNKNOWN_STD, Moved, moved
from .findings_of_motion import of_delay, of_motion, of_positions, of_rate, of_weight
from .motion_moments import FLAT, MotionMoments, motion_moments
from .priors import tool_of
from .rigidity import positions_read

ALIGNED, LEAST_LATE = 3, 2e-4
"""Times that readings are put where the motion tells that they belong; and s, which matter to nobody."""
LEAST_SECONDS = 4.0
"""Of motion."""
BY_WRONG_POSITIONS = (Kind.CONTACT_IN_MOTION, Kind.SLOW_SENSOR, Kind.NOT_RIGID, Kind.DELAY_OF_MOTION)
"""What follows from positions that are plainly wrong, and would lead a person elsewhere."""
KNOWN = 0.5
"""Of what was thinkable before: a std that is larger was not told by the motion."""
FAR_BEYOND, MEDIAN_OF_SQUARES, LEAST_EXPECTED, TRIMMED = 9.0, 0.79, 0.01, 5
"""Times the expected mean square of three axes, by chance once in 10^5 rows, and its median; of what was expected at
first; how often what is beyond is left out."""
ARM_IS_LARGER = 20.0
"""m/s^2: of the acceleration, RMS; no arm keeps that up, and a position in mm is a thousand times as large."""


def with_motion(calibration: Calibration, samples: Samples, sensor_offset: ArrayLike | None) -> Calibration:
    """The calibration with `dynamics` from the motion in `samples`.

    Args:
        calibration: of a rigid model, from their stops.
        samples: with times, and positions or an accelerometer's readings, free of contact for the most.
        sensor_offset: where the sensor's origin is (3,), m from the flange's or the accelerometer, flange axes; None:
            it is looked for.

    Raises:
        InputError: no times, no positions, or positions that are not in m or all 0; an accelerometer that does not
            follow gravity; moments of inertia below zero.
        UnobservableError: the arm does not move, or so little that nothing of the inertia shows.
    """
    for odd in calibration.findings:  # as torques in N mm make it, whose motion tells nothing
        if odd.kind is Kind.IMPLAUSIBLE_TOOL and odd.severity is Severity.WEAK:
            raise InputError(f"{samples.source}: {odd.said}")
    stated = None if sensor_offset is None else ON_FLANGE.require(sensor_offset, "sensor offset", (3,))
    told = samples.position is not None or samples.accelerometer is not None
    if samples.t is not None and told and not is_stream(samples):
        raise _at_rest(0.0)
    own = samples.delay, samples.delay_std  # as the motion was aligned, whatever an earlier calibration knew
    followed = _followed(calibration, as_stamped(samples), stated, _applied(samples))
    samples, motion, moments, found, accelerometer, late = followed
    tool, mass = tool_of(calibration), float(calibration.mass or 0.0)
    untold = _untold(found, DYNAMIC_PARAMETERS if stated is None else INERTIA)
    if found.is_negative:
        raise InputError(
            f"{samples.source}: found moments of inertia below zero, expected those of a body: are the torques' sign "
            "and unit those of the forces?"
        )
    if set(INERTIA) <= set(untold):
        raise UnobservableError(
            f"found no excitation of {', '.join(untold)}: the arm turns too slowly, expected angular "
            "accelerations that the sensor feels: move faster, or take model auto"
        )
    inertia, moved_by = found.inertia, 0.0
    if not can_exist(inertia):
        inertia, moved_by = nearest_possible(inertia, found.covariance[:6, :6], mass)
    dynamics = Dynamics(
        matrix=inertial_matrix(tool, mass, inertia, found.sensor_offset),
        inertia=inertia,
        sensor_offset=found.sensor_offset,
        covariance=found.covariance,
        with_parameters=found.with_parameters,
        bandwidth=motion.bandwidth,
        motion_noise=np.zeros((2, 2)),
        residual_rms=np.zeros(6),
        static_rms=np.zeros(6),
        seconds=moments.seconds,
        accelerometer=accelerometer,
    )
    delay, delay_std = own if late is None else (late, found.late.std)
    complete = replace(calibration, requested_model="dynamic", dynamics=dynamics, delay=delay, delay_std=delay_std)
    dynamics = _with_what_is_left(complete, dynamics, samples, motion)
    read = 1.0 if samples.accelerometer is None else float(np.isfinite(samples.accelerometer).all(axis=1).mean())
    said = [*of_motion(found, tool.weight, stated, untold, moved_by, dynamics, moments.most, read)]
    said += of_weight(found.weighs, tool.weight)
    if late is not None and accelerometer is None:
        said.append(of_delay(late))
    if accelerometer is None:
        where_it_moves = flange_motion(samples, max(moments.most / FLAT, SLOWEST))
        read_as = positions_read(complete, samples, where_it_moves)
        if read_as.otherwise and read_as.cause is not None:
            said = [each for each in said if each.kind not in BY_WRONG_POSITIONS]
        said += of_positions(read_as, np.asarray(samples.position))
    said += of_rate(samples, moments.usual)
    return replace(complete, dynamics=dynamics, findings=(*calibration.findings, *said))


def _followed(
    calibration: Calibration, samples: Samples, stated: Array | None, applied: float
) -> tuple[Samples, FlangeMotion, MotionMoments, Moved, Accelerometer | None, float | None]:
    """The motion in samples, to which a delay of so many s was `applied`; readings that it says are late are put where
    they belong, and it is followed again. So the samples, their motion, its moments, what these tell, how an
    accelerometer sits, and by how many s the wrench is late in all; None: nothing was put elsewhere. Raises as
    `with_motion`.
    """
    if samples.accelerometer is None:
        _require_places(samples)
    gravity = calibration.g * calibration.gravity_direction
    accelerometer, of_rows = _accelerometer(calibration, samples)
    tool, late = tool_of(calibration), applied
    if accelerometer is not None:
        samples = without_drift(samples, accelerometer)
    known = calibration.parameter_names, calibration.covariance, calibration.noise
    ahead_std = None if accelerometer is None else SHAKEN_STD if accelerometer.delay else UNKNOWN_STD
    for k in range(ALIGNED):
        motion = flange_motion(samples, accelerometer=accelerometer, gravity=gravity)
        shaken = float(np.sqrt(np.mean(np.sum(motion.acceleration**2, axis=1))))
        if shaken > ARM_IS_LARGER and accelerometer is None:
            raise InputError(
                f"{samples.source}: found the flange accelerating at {shaken:.3g} m/s^2 RMS, expected positions in m: "
                "are they in mm? name the columns x_mm, y_mm, z_mm, or state the unit"
            )
        moments = motion_moments(samples, motion)
        if moments.seconds < (LEAST_SECONDS if k == 0 else 0.5 * LEAST_SECONDS):  # a shift may cut a window
            raise _at_rest(moments.seconds)
        found = moved(tool, calibration.g, *known, moments, stated, ahead_std, of_rows)
        is_late, is_ahead = (
            abs(off.value) > LEAST_LATE and is_significant(off.value, off.std) for off in (found.late, found.ahead)
        )
        if k == ALIGNED - 1 or not (is_late or is_ahead):
            break
        if is_late:
            late += found.late.value
            samples = _shifted(samples, found.late.value)
        if accelerometer is not None:
            delay = accelerometer.delay - (found.ahead.value if is_ahead else 0.0)
            sits, of_rows = mounted_accelerometer(samples, gravity)
            accelerometer = replace(sits, delay=delay, drift=accelerometer.drift)
    return samples, motion, moments, found, accelerometer, late if late != applied else None


def _applied(samples: Samples) -> float:
    """By how many s the wrench is late as far as its samples know."""
    known = samples.delay and is_significant(samples.delay, samples.delay_std or 0.0)
    return float(samples.delay) if known and samples.delay else 0.0


def _require_places(samples: Samples) -> None:
    """Raise `InputError` where nobody filled in the positions."""
    if samples.position is not None and not np.nan_to_num(samples.position).any():
        raise InputError(
            f"{samples.source}: found positions that are all 0, expected the flange's x, y, z: name their columns, "
            "name an accelerometer with --imu, or take model auto"
        )


def _accelerometer(calibration: Calibration, samples: Samples) -> tuple[Accelerometer | None, Array]:
    """How the accelerometer of samples sits, and how late it is; None where there is none."""
    if samples.accelerometer is None or samples.t is None:
        return None, NO_ROWS
    gravity = calibration.g * calibration.gravity_direction
    found, covariance = mounted_accelerometer(samples, gravity)
    angular = flange_motion(samples, accelerometer=found, gravity=gravity).terms[:, :9]
    late = delay_behind(samples.wrench[:, :3], samples.accelerometer, angular, spread_evenly(samples.t))
    return replace(found, delay=late), covariance


def _at_rest(seconds: float) -> UnobservableError:
    return UnobservableError(
        f"found {seconds:.3g} s of motion, expected {LEAST_SECONDS:g} s or more with turns about "
        f"every axis, to tell {', '.join(DYNAMIC_PARAMETERS)}: move the arm, or take model auto"
    )


def with_earlier_inertia(calibration: Calibration, earlier: Calibration) -> Calibration:
    """The calibration of a new bias with the inertia of an `earlier` one of the same tool, where that knows it."""
    if earlier.dynamics is None or calibration.mass is None:
        return calibration
    known = earlier.dynamics
    matrix = inertial_matrix(tool_of(calibration), calibration.mass, known.inertia, known.sensor_offset)
    apart = np.zeros((len(DYNAMIC_PARAMETERS), len(calibration.parameters)))
    untold = (finding for finding in earlier.findings if finding.kind is Kind.UNTOLD_BY_MOTION)
    dynamics = replace(known, matrix=matrix, with_parameters=apart)
    return replace(calibration, dynamics=dynamics, findings=(*calibration.findings, *untold))


def as_stamped(samples: Samples, calibration: Calibration | None = None) -> Samples:
    """The samples with the orientation that belongs to each reading: where rows came with one and are late; and where
    they were paired, by what the calibration's delay is beyond theirs.

    Args:
        samples: with times.
        calibration: whose delay, s, is taken; None: that of the samples.

    Returns:
        The samples as stamped; the same where no delay is significant.
    """
    of = samples if calibration is None else calibration
    delay, std = of.delay, of.delay_std
    if samples.t is None or delay is None or std is None or not is_significant(delay, std):
        return samples
    applied = 0.0 if samples.pose_period is None else _applied(samples)
    return _shifted(samples, delay - applied, std) if delay != applied else samples


def _shifted(samples: Samples, delay: float, std: float | None = None) -> Samples:
    """The samples with the orientation of so many s earlier; an accelerometer's readings stay with the wrench."""
    wrench = WrenchStream(np.asarray(samples.t), samples.wrench, samples.source)
    poses = OrientationStream(np.asarray(samples.t), samples.R_base_flange, samples.position, samples.source)
    paired = synchronize(Streams(wrench, poses), delay, std)
    told = None if samples.accelerometer is None else samples.accelerometer[paired.rows]
    periods = {name: getattr(samples, name) for name in ("pose_period", "accelerometer_period")}
    return replace(paired.samples, accelerometer=told, **periods)


def _untold(found: Moved, sought: tuple[str, ...]) -> list[str]:
    """The parameters of which the motion says next to nothing, of the first that it was to tell."""
    least = KNOWN * found.before
    least[: len(INERTIA)] = np.minimum(least[: len(INERTIA)], np.linalg.eigvalsh(found.inertia)[-1])
    untold = np.sqrt(np.diag(found.covariance)) > least
    return [name for name, is_untold in zip(sought, untold[: len(sought)], strict=True) if is_untold]


def _with_what_is_left(c: Calibration, dynamics: Dynamics, samples: Samples, motion: FlangeMotion) -> Dynamics:
    """What is left of the readings in motion, with the inertia and without; and how it grows with speed and
    acceleration, beyond what is left of slow motion.
    """
    known = motion.inside
    still = c.compensate(samples.wrench, samples.R_base_flange)[known]
    left = c.compensate(samples.wrench, samples.R_base_flange, motion=motion)[known]
    of_speed = np.sum(motion.angular_velocity[known] ** 2, axis=1)
    of_acceleration = np.sum(motion.acceleration[known] ** 2, axis=1)
    level = np.column_stack([np.ones(len(left)), motion.stirred[known]])
    about_com = left[:, 3:] - np.cross(tool_of(c).com, left[:, :3])
    noise = [_growth(level, each) for each in (left[:, :3], about_com)]
    moving = of_speed + of_acceleration > 0.1 * np.mean(of_speed + of_acceleration)
    rms = (np.sqrt(np.mean(each[moving] ** 2, axis=0)) for each in (left, still))
    residual, static = rms
    return replace(dynamics, motion_noise=np.array(noise), residual_rms=residual, static_rms=static)


def _growth(level: Array, left: Array) -> Array:
    """The std (2,) for each m/s^2 and rad/s of what is left (n, 3), in the direction in which most is: mean squares by
    least squares of none below zero, without what is far beyond them, a push.
    """
    from scipy.optimize import nnls

    squares, unit = np.mean(left**2, axis=1), np.mean(level**2, axis=0) ** 0.5
    level, unit = np.where(unit > AT_REST**2, level, 0.0), np.maximum(unit, AT_REST**2)
    expected = np.sum(level / unit, axis=1)
    expected *= np.median(squares / expected) / MEDIAN_OF_SQUARES
    least, found = LEAST_EXPECTED * expected, np.zeros(3)
    for _ in range(TRIMMED):
        kept = squares <= FAR_BEYOND * expected
        found = nnls(level[kept] / unit, squares[kept])[0]
        expected = np.maximum(level / unit @ found, least)
    principal = np.linalg.eigvalsh(left[kept].T @ left[kept])
    most = principal[-1] / max(float(principal.mean()), 1e-300)
    return np.asarray(np.sqrt(most * found / unit)[1:])
