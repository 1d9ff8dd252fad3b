"""The way without the sensor that the paper's introduction describes: contact force from the joints' torques.

Against it stands the sensor in the wrist, calibrated in the paper's six poses, on the same contacts in the same
configurations: all over the workspace, and on a line into a singularity.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from itertools import pairwise

import numpy as np

from ..report.joint_torques import error_near_singularities
from ..simulate.joint_torque import sensor_jacobians
from ..simulate.rig import build
from ..simulate.settings import JointTorque, Settings
from .joint_torque_routes import (
    COM_ERROR,
    CONFIGURATIONS,
    FORCE,
    MASS_ERROR,
    PUSH,
    ROUTES,
    SHORT_OF_STRETCHED,
    SOURCES,
    WRENCH,
    Robot,
    one_robot,
    smallest_singular_value,
    stretching,
)
from .part import Measured, Part, Picture, Table, mean, root_mean_square, share

ROBOTS = 24
"""At scale 1."""
STEADY = 0.1
"""Smallest singular value (m and rad) from which a configuration counts as away from singularities: about half do."""
EDGES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, np.inf)
OF_WRENCH = ROUTES.index(WRENCH)
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
    distance = np.concatenate([robot.distance for robot in robots])
    rows = []
    for low, high in pairwise(EDGES):
        cells = (
            share((distance >= low) & (distance < high)),
            *(_rms_within(robots, k, low, high) for k in range(len(ROUTES))),
        )
        rows.append((f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more", cells))
    return Table(
        "joint_torques_singularity",
        "RMS error of the contact force by the smallest singular value of the Jacobian, N",
        ("share of configurations", *ROUTES),
        tuple(rows),
        "The Jacobian is that of the hook, lengths in m and angles in rad; in a singularity its smallest singular "
        "value is 0. Standard errors from the scatter between robots.",
    )


def _rms_within(robots: list[Robot], route: int, low: float, high: float) -> Measured | None:
    """The RMS error of a route between two singular values; a robot that came there is a trial. None where none did."""
    squares = [
        float(robot.workspace[route, inside].mean())
        for robot in robots
        if (inside := (robot.distance >= low) & (robot.distance < high)).any()
    ]
    return root_mean_square(squares) if squares else None


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
        "The wrist moves out level with the shoulder, the flange looks down; the rows say how far it is from the end "
        "of its reach.",
    )


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
        "Offsets and gains anywhere within the 2 % of a joint's largest torque that KUKA states, half for each; link "
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
    errors = np.sqrt([robot.workspace for robot in robots])
    median = np.median(errors, axis=2).mean(axis=0)
    lost = 100.0 * np.mean(errors > PUSH, axis=(0, 2))
    in_order = ", ".join(f"{median[k]:.3g} N ({ROUTES[k]})" for k in np.argsort(median))
    yield (
        f"Half of the time the force is wrong by more than {in_order}. A wrench from joint torques has "
        f"{median[2] / median[0]:.3g} times the error of our wrist sensor and {median[2] / median[1]:.3g} times that "
        "of the paper's; knowing that the contact is a single force at one known point makes it "
        f"{median[3] / median[2]:.2g} times as large. In {lost[2]:.2g} % of the configurations the wrench's force is "
        f"off by more than the {PUSH:g} N that it should find (our wrist sensor: {lost[0]:.2g} %)."
    )
    close, far = (_rms_within(robots, OF_WRENCH, low, high) for low, high in (EDGES[:2], EDGES[-2:]))
    line = np.sqrt(np.mean([robot.line for robot in robots], axis=0))
    first, last = (f"{1e3 * short:g} mm" for short in (SHORT_OF_STRETCHED[0], SHORT_OF_STRETCHED[-1]))
    both = (
        f"the RMS error of the wrench is {far.value:.3g} N where the smallest singular value is over {EDGES[-2]:g} and "
        f"{close.value:.3g} N where it is under {EDGES[1]:g}. "
        if close and far
        else ""
    )
    yield (
        f"In a singularity the joints do not feel a force in some direction: {both}On a straight line into the "
        f"stretched arm it goes from {line[2, 0]:.3g} N, {first} before the end, to {line[2, -1]:.3g} N at {last}; "
        f"that of our wrist sensor, which does not depend on the arm, from {line[0, 0]:.3g} N to {line[0, -1]:.3g} N."
    )
    each = [_from_source(robots, place, 0).value for place in range(len(SOURCES) + 2)]
    *alone, by_chance, together = each
    worst = int(np.argmax(alone))
    yield (
        f"Away from singularities (smallest singular value over {STEADY:g}) the largest single source is "
        f"{SOURCES[worst]}: {alone[worst]:.3g} N of {together:.3g} N. Friction and noise leave {by_chance:.3g} N, so "
        "that a perfect correction of everything that is the same from touch to touch could take "
        f"{100.0 * (1.0 - by_chance / together):.0f} % away. From outside: Osburg et al. (2022, "
        "doi:10.3389/frobt.2022.892916) trained a network on 330,000 contacts of a real iiwa 7 R800 and took 57 % off "
        "the error of force of the maker's own estimate."
    )


def _picture(robots: list[Robot]) -> Picture:
    distance = np.concatenate([robot.distance for robot in robots])
    errors = np.sqrt(np.concatenate([robot.workspace for robot in robots], axis=1))
    line = np.array([robot.line for robot in robots])
    drawn = (2, 3, 1, 0)
    return Picture(
        "joint_torques",
        error_near_singularities(
            tuple(ROUTES[k] for k in drawn),
            PUSH,
            distance,
            errors[drawn, :],
            np.array(SHORT_OF_STRETCHED),
            line[:, drawn, :],
        ),
        f"Error of a contact force of {PUSH:g} N. Left: {len(distance):,} configurations against the smallest singular "
        "value of the Jacobian (0: singular); dots are some of them, lines the RMS between two values. Right: RMS "
        "on a straight line into the stretched arm. Bars: two standard errors.",
    )
