"""The way without the sensor that the paper's introduction describes: contact force from the joints' torques.

Against it stands the sensor in the wrist, calibrated in the paper's six poses, on the same contacts in the same
configurations: all over the workspace, and on a line into a singularity. Both sensors have errors of their own that a
recording in free air does not show, and both may have that recording.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.kinematics import flange_pose, paper_joints
from contactwrench.simulate.rig import Rig, build
from contactwrench.simulate.settings import JointTorque, Settings

from .joint_torque_figure import error_near_singularities
from .joint_torque_routes import (
    COM_ERROR,
    CONFIGURATIONS,
    CROSSTALK,
    FORCE,
    GAIN_ERROR,
    MASS_ERROR,
    PUSH,
    ROUTES,
    SENSOR_OURS,
    SENSOR_PAPER,
    SHORT_OF_STRETCHED,
    SOURCES,
    WRENCH,
    ZEROED_FORCE,
    ZEROED_WRENCH,
    Robot,
    one_robot,
    smallest_singular_value,
    stretching,
)
from .joint_torque_sensors import SHARE_OF_GAIN, SHARE_OF_OFFSET, sensor_jacobians
from .part import Measured, Part, Picture, Table, mean, root_mean_square, share
from .weighing import GAIN as GAIN_OF_THE_PAPER

ROBOTS = 24
"""At scale 1."""
STEADY = 0.1
"""Smallest singular value (m and rad) from which a configuration counts as away from singularities: about half do."""
EDGES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, np.inf)
DRAWS = 100
"""Of the bootstrap over robots, for standard errors of medians."""
DRAWN = (WRENCH, ZEROED_WRENCH, FORCE, ZEROED_FORCE, SENSOR_PAPER, SENSOR_OURS)
MAKERS = f"the {100.0 * (SHARE_OF_OFFSET + SHARE_OF_GAIN):g} % of a joint's largest torque"
CHANCE, ALL = "friction and noise", "all of them"


def part(pool: Executor, scale: float, seed: int) -> Part:
    """Section 5: joint torques against the sensor."""
    count = max(4, round(ROBOTS * scale))
    seeds = np.random.SeedSequence(seed).spawn(count)
    robots = list(pool.map(one_robot, seeds, chunksize=max(1, count // 16)))
    return Part(
        "joint_torques",
        "The way without the sensor: contact force from joint torques",
        tuple(_words(robots)),
        (_workspace(robots), _by_distance(robots), _line(robots), _sources(robots)),
        (_picture(robots),),
    )


def _workspace(robots: list[Robot]) -> Table:
    """How far each route is off, over all configurations."""
    errors = np.sqrt([robot.workspace for robot in robots])
    rows = tuple(
        (
            route,
            (
                mean(np.median(errors[:, k], axis=1)),
                mean(np.quantile(errors[:, k], 0.95, axis=1)),
                root_mean_square(np.mean(errors[:, k] ** 2, axis=1)),
            ),
        )
        for k, route in enumerate(ROUTES)
    )
    return Table(
        "joint_torques_workspace",
        f"Error of a contact force of {PUSH:g} N all over the workspace, N",
        ("median", "95 % are below", "RMS"),
        rows,
        f"{len(robots)} robots, {CONFIGURATIONS} configurations each; median and 95 % are those of one robot, then the "
        "mean over the robots with its standard error. An RMS over singularities hangs on the few configurations that "
        "come closest to one: read the median.",
    )


def _by_distance(robots: list[Robot]) -> Table:
    """How far each route is off, by the distance to a singularity."""
    distance = np.array([robot.distance for robot in robots])
    errors = np.sqrt([robot.workspace for robot in robots])
    rows = []
    for low, high in pairwise(EDGES):
        inside = (distance >= low) & (distance < high)
        cells = (share(inside.ravel()), *(_median(errors[:, k], inside) for k in range(len(ROUTES))))
        rows.append((f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more", cells))
    return Table(
        "joint_torques_singularity",
        "Median error of the contact force by the smallest singular value of the Jacobian, N",
        ("share of configurations", *ROUTES),
        tuple(rows),
        "The Jacobian is that of the hook, lengths in m and angles in rad; in a singularity its smallest singular "
        "value is 0. Every configuration of every robot counts alike; standard errors by bootstrap over the robots.",
    )


def _median(errors: Array, inside: NDArray[np.bool_]) -> Measured | None:
    """The median of the errors (robots, n) at the configurations `inside` (robots, n). None where there are none."""
    if not inside.any():
        return None
    drawn = np.random.default_rng(1).integers(len(errors), size=(DRAWS, len(errors)))
    again = [np.median(some) for draw in drawn if len(some := errors[draw][inside[draw]])]
    return Measured(float(np.median(errors[inside])), float(np.std(again, ddof=1)), int(inside.any(axis=1).sum()))


def _line(robots: list[Robot]) -> Table:
    """How far each route is off on the way into the stretched arm."""
    rig = build(Settings())
    distance = smallest_singular_value(sensor_jacobians(rig, stretching(rig)), rig.settings.tool.hook)
    squared = np.array([robot.line for robot in robots])
    rows = tuple(
        (
            f"{1e3 * short:g} mm",
            (
                Measured(float(distance[place]), None, 1),
                *(root_mean_square(squared[:, k, place]) for k in range(len(ROUTES))),
            ),
        )
        for place, short in enumerate(SHORT_OF_STRETCHED)
    )
    return Table(
        "joint_torques_stretched",
        "RMS error of the contact force on a straight line into the stretched arm, N",
        ("smallest singular value", *ROUTES),
        rows,
        "The wrist moves out level with the shoulder; the rows say how far it is from the end of its reach. The flange "
        f"looks down to {_tilt(rig, stretching(rig)).max():.1f} deg, the poses in which the wrist sensor was "
        f"calibrated tilt it by {_tilt(rig, paper_joints(rig)).max():.0f} deg at most.",
    )


def _tilt(rig: Rig, joints: Array) -> Array:
    """How far from down the flange looks (n,), degrees."""
    R_base_flange, _ = flange_pose(rig, joints)
    return np.asarray(np.rad2deg(np.arccos(np.clip(-R_base_flange[:, 2, 2], -1.0, 1.0))), dtype=np.float64)


def _sources(robots: list[Robot]) -> Table:
    """What each source of error does alone."""
    rows = tuple(
        (source, tuple(_from_source(robots, place, route) for route in range(2)))
        for place, source in enumerate((*SOURCES, CHANCE, ALL))
    )
    sensors = JointTorque()
    return Table(
        "joint_torques_sources",
        f"RMS error of the contact force by one source at a time, smallest singular value over {STEADY:g}, N",
        (WRENCH, FORCE),
        rows,
        f"Not zeroed. Offsets and gains anywhere within {MAKERS} that KUKA states, half for each; link "
        f"masses off by {100.0 * MASS_ERROR:g} %, their centres of mass by {1e3 * COM_ERROR:g} mm an axis (standard "
        f"deviations, assumed); friction on the link's side up to {sensors.friction:g} N m and noise of "
        f"{sensors.noise:g} N m (assumed).",
    )


def _from_source(robots: list[Robot], place: int, route: int) -> Measured:
    steady = [robot.sources[place, route, robot.distance >= STEADY] for robot in robots]
    return root_mean_square([float(squares.mean()) for squares in steady if len(squares)])


def _words(robots: list[Robot]) -> Iterator[str]:
    """What the figures say."""
    yield (
        f"{len(robots)} robots, each with joint torque sensors, a model of its own arm and a calibrated wrist sensor, "
        f"are pushed with {PUSH:g} N at the tool, each in {CONFIGURATIONS} configurations anywhere in the workspace. "
        "From joint torques, the contact is what the drives exert less than the gravity of arm and tool asks for, "
        "brought to the tool by the pseudo-inverse of the transposed Jacobian."
    )
    yield (
        "What each is granted. The wrist sensor: one reading in free air in each of the paper's six poses, on that "
        f"robot; its gains are off by {100.0 * GAIN_ERROR:g} % and its cross-talk is {100.0 * CROSSTALK:g} % of range "
        "(standard deviations, assumed; the paper's Table IX shows a gain that is off by "
        f"{100.0 * abs(GAIN_OF_THE_PAPER - 1.0):.2g} %), which free air does not show. The joint sensors: the maker's "
        "accuracy, a model of the arm that errs, and the tool as our calibration of the wrist sensor finds it. Zeroed: "
        "the same six poses too, where the mean of what they read over what the model says is taken off, joint by "
        "joint. A force at the hook: that place, and that no torque acts there. Nothing drifts in between."
    )
    errors = np.sqrt([robot.workspace for robot in robots])
    median = dict(zip(ROUTES, np.median(errors, axis=2).mean(axis=0), strict=True))
    lost = dict(zip(ROUTES, 100.0 * np.mean(errors > PUSH, axis=(0, 2)), strict=True))
    in_order = ", ".join(f"{median[route]:.3g} N ({route})" for route in sorted(ROUTES, key=lambda one: median[one]))
    yield (
        f"Half of the time the force is wrong by more than {in_order}. A wrench from joint torques has "
        f"{median[WRENCH] / median[SENSOR_OURS]:.3g} times the error of our wrist sensor and "
        f"{median[WRENCH] / median[SENSOR_PAPER]:.3g} times that of the paper's, zeroed "
        f"{median[ZEROED_WRENCH] / median[SENSOR_OURS]:.3g} and {median[ZEROED_WRENCH] / median[SENSOR_PAPER]:.3g} "
        "times; knowing that the contact is a single force at one known point makes it "
        f"{median[FORCE] / median[WRENCH]:.2g} times as large, zeroed "
        f"{median[ZEROED_FORCE] / median[ZEROED_WRENCH]:.2g} times. "
        f"In {lost[WRENCH]:.2g} % of the configurations the wrench's force is off by more than the {PUSH:g} N "
        f"that it should find, zeroed in {lost[ZEROED_WRENCH]:.2g} % (our wrist sensor: {lost[SENSOR_OURS]:.2g} %)."
    )
    yield _near_singularities(robots, errors)
    yield _along_the_line(robots, median[SENSOR_PAPER] / median[SENSOR_OURS])
    each = [_from_source(robots, place, 0).value for place in range(len(SOURCES) + 2)]
    *alone, by_chance, together = each
    worst = int(np.argmax(alone))
    before, after = (_steady_rms(robots, route) for route in (WRENCH, ZEROED_WRENCH))
    yield (
        f"Away from singularities (smallest singular value over {STEADY:g}) the largest single source is "
        f"{SOURCES[worst]}: {alone[worst]:.3g} N of {together:.3g} N. Zeroing brings the route from {before:.3g} N "
        f"to {after:.3g} N. Friction and noise leave {by_chance:.3g} N, so "
        "that a perfect correction of everything that is the same from touch to touch could take "
        f"{100.0 * (1.0 - by_chance / together):.0f} % away. From outside: Osburg et al. (2022, "
        "doi:10.3389/frobt.2022.892916) trained a network on 330,000 contacts of a real iiwa 7 R800 and took 57 % off "
        "the error of force of the maker's own estimate."
    )


def _steady_rms(robots: list[Robot], route: str) -> float:
    """The RMS error of a route away from singularities."""
    steady = [robot.workspace[ROUTES.index(route), robot.distance >= STEADY] for robot in robots]
    return float(np.sqrt(np.concatenate(steady).mean()))


def _near_singularities(robots: list[Robot], errors: Array) -> str:
    """What becomes of a wrench from joint torques there, from the errors (robots, routes, n)."""
    distance, of_wrench = np.array([robot.distance for robot in robots]), errors[:, ROUTES.index(WRENCH)]
    close, far = (_median(of_wrench, (distance >= low) & (distance < high)) for low, high in (EDGES[:2], EDGES[-2:]))
    law = "In a singularity there is a wrench that no joint feels"
    if close is None or far is None:
        return f"{law}."
    return (
        f"{law}: half of the time the force of a wrench from joint torques is wrong by more than {far.value:.3g} N "
        f"where the smallest singular value is over {EDGES[-2]:g}, and by more than {close.value:.3g} N where it is "
        f"under {EDGES[1]:g}."
    )


def _along_the_line(robots: list[Robot], everywhere: float) -> str:
    """What becomes of it on the line; `everywhere`: the paper's median error over ours, all over the workspace."""
    rms = np.sqrt(np.mean([robot.line for robot in robots], axis=0))
    wrench, ours, paper = (rms[ROUTES.index(route)] for route in (WRENCH, SENSOR_OURS, SENSOR_PAPER))
    first, last = (f"{1e3 * short:g} mm" for short in (SHORT_OF_STRETCHED[0], SHORT_OF_STRETCHED[-1]))
    rig = build(Settings())
    calibrated, tilt = (_tilt(rig, joints).max() for joints in (paper_joints(rig), stretching(rig)))
    within = "within" if tilt <= calibrated else "outside"
    return (
        f"On a straight line into the stretched arm the RMS error of the wrench's force goes from {wrench[0]:.3g} N, "
        f"{first} before the end, to {wrench[-1]:.3g} N at {last}; that of our wrist sensor, which does not depend on "
        f"the arm, from {ours[0]:.3g} N to {ours[-1]:.3g} N. The flange looks down there, {within} the tilts of up to "
        f"{calibrated:.0f} deg in which the wrist sensor was calibrated: the paper's calibration errs "
        f"{np.sqrt(np.mean(paper**2) / np.mean(ours**2)):.2f} times as much as ours on the line (RMS), and "
        f"{everywhere:.2f} times all over the workspace (median)."
    )


def _picture(robots: list[Robot]) -> Picture:
    distance = np.concatenate([robot.distance for robot in robots])
    errors = np.sqrt(np.concatenate([robot.workspace for robot in robots], axis=1))
    line = np.array([robot.line for robot in robots])
    drawn = [ROUTES.index(route) for route in DRAWN]
    return Picture(
        "joint_torques",
        error_near_singularities(
            DRAWN,
            PUSH,
            distance,
            errors[drawn, :],
            np.array(SHORT_OF_STRETCHED),
            line[:, drawn, :],
        ),
        f"Error of a contact force of {PUSH:g} N. Left: {len(distance):,} configurations against the smallest singular "
        "value of the Jacobian (0: singular); dots are some of them, lines the RMS between two values. Right: RMS "
        "on a straight line into the stretched arm. Dashed and hollow: zeroed, without dots. Bars: two standard "
        "errors.",
    )
