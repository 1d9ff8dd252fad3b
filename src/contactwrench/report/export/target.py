"""What every format of parameters has in common: what a program gets, what it makes of it, what it needs and loses; the
tool as a rigid body on the sensor, and numbers that read back exactly.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.calibration import Calibration
from ...errors import InputError
from ...geometry.arrays import Array, Frozen, Matrix, Vector
from ...geometry.ranges import ON_FLANGE, SENSOR_MASS, TOOL_MASS
from ...geometry.rotations import procrustes, spread_rotations
from ...model import RigidTool

WithHeader: TypeAlias = Callable[[Sequence[str], str], str]
"""How the lines of a header and the body make a file."""
NAME = r"[\w./-]+"
"""What a name in a program's configuration is made of, that of a frame in ROS too."""


@dataclass(frozen=True, eq=False)
class Setup(Frozen):
    """What a calibration does not hold and some targets need; None: not stated.

    `tool_mass` kg, as weighed on scales, in place of the identified one; `sensor_mass` kg and `sensor_com` (3,) m from
    the flange's origin, flange axes; `sensor_offset` (3,) m, from the flange's origin to the sensor's, flange axes;
    names of the sensor, of its frame and of the base's in the program's configuration, that of the base None: the
    recording's. Raises `InputError` for a length or a mass that can only be in another unit.
    """

    tool_mass: float | None = None
    sensor_mass: float | None = None
    sensor_com: Vector | None = None
    sensor_offset: Vector | None = None
    sensor_name: str = "ft_sensor"
    sensor_frame: str = "ft_frame"
    base_frame: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for option, stated, within, shape in (
            ("--tool-mass", self.tool_mass, TOOL_MASS, ()),
            ("--sensor-mass", self.sensor_mass, SENSOR_MASS, ()),
            ("--sensor-offset", self.sensor_offset, ON_FLANGE, (3,)),
            ("--sensor-com", self.sensor_com, ON_FLANGE, (3,)),
        ):
            if stated is not None:
                within.require(stated, option, shape)


@dataclass(frozen=True, eq=False)
class Parameters(Frozen):
    """What a program gets, and what it makes of it.

    `body` in the program's own format, without a header; `remarks`, a sentence each: unit and frame of the numbers, and
    what is assumed; `B` (6, 4) and `gravity_direction` (3,): the program subtracts `B @ [r, 1]` from the readings, pull
    sign and sensor axes, N and N m, with `r = R_base_flange.T @ gravity_direction`. Both are None for a program that
    subtracts nothing from them, as a robot's controller that moves a payload. `takes_reaction`: the file is for the
    readings as they come from the sensor, also where they have the other sign. `cautions`: sentences without which the
    file does harm, for the person who asked for it too.
    """

    body: str
    remarks: tuple[str, ...]
    B: Matrix | None = None
    gravity_direction: Vector | None = None
    takes_reaction: bool = False
    cautions: tuple[str, ...] = ()


def commented(mark: str) -> WithHeader:
    """A header above the body, each line a comment that begins with `mark`."""

    def above(header: Sequence[str], body: str) -> str:
        return "".join(f"{mark} {line}\n" for line in header) + body

    return above


HASH = commented("#")


def below(header: Sequence[str], body: str) -> str:
    """A header behind the numbers, for programs that read so many and then no further."""
    return body + HASH(header, "")


def in_xml(header: Sequence[str], body: str) -> str:
    """A header above the body as comments of XML, in which no two hyphens may stand side by side."""
    return "".join(f"<!-- {line.replace('--', '- -')} -->\n" for line in header) + body


def in_json(header: Sequence[str], body: str) -> str:
    """A header as a list under the key `comment`, before the keys of an object, which stand one a line."""
    lines = ",\n".join(f"    {json.dumps(line)}" for line in header)
    return body.replace("{\n", f'{{\n  "comment": [\n{lines}\n  ],\n', 1)


@dataclass(frozen=True)
class Target:
    """A format of parameters.

    `name` on the command line; `program` that reads it, in words; `needs` beside the calibration
    and `loses` of it, in a few words, empty for nothing; `parameters` of a calibration, which raises `InputError` for
    what is needed and not stated, and for a calibration of which the program could make nothing; `with_header`, None
    where a comment has no room in the file; `uses` of `Setup`, beside the tool's mass.
    """

    name: str
    program: str
    needs: str
    loses: str
    parameters: Callable[[Calibration, Setup], Parameters]
    with_header: WithHeader | None = HASH
    uses: tuple[str, ...] = ()


DOWN = np.array([0.0, 0.0, -1.0])
"""Gravity of programs that take the base for upright, base axes."""
ROUNDING = 1e-6
"""N and N m: a smaller error is that of rounded numbers, and not worth a remark."""
STARTS, MOST_STEPS = 24, 2000
LEAST_GAIN = 1e-10
"""Relative, a step: where the climb ends, which is then within 1e-6 of the top."""


def rigid_tool(calibration: Calibration, setup: Setup, target: str) -> RigidTool:
    """The identified tool, with the weight of the `tool_mass` that was stated; its centre of mass stays. Raises
    `InputError`, naming the `target` that asks, for a model that has no mass.
    """
    if (tool := calibration.rigid_tool) is None:
        without = "" if setup.tool_mass is None else ", without --tool-mass"
        raise InputError(
            f"{target} takes a mass and a centre of mass, found model {calibration.model}, which has none: calibrate "
            f"with --model auto, or export B itself with --to c, python or matlab{without}"
        )
    return tool if setup.tool_mass is None else replace(tool, weight=setup.tool_mass * calibration.g)


def roll_pitch_yaw(R: Array) -> Array:
    """The angles (3,), rad, of `Rz(yaw) Ry(pitch) Rx(roll)`, as in URDF's `rpy`; exact also at a pitch of 90 deg."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def number(value: float) -> str:
    """A number in the shortest form that reads back exactly, a float for every reader of YAML: with a point."""
    digits, power, exponent = repr(float(value) + 0.0).partition("e")
    return f"{digits if '.' in digits else f'{digits}.0'}{power}{exponent}"


def numbers(values: ArrayLike, between: str = ", ") -> str:
    """Numbers in a row, as `number` writes them."""
    return between.join(number(value) for value in np.ravel(values))


def mounting_remark(tool: RigidTool, frame: str) -> str:
    """How the sensor's frame has to stand in the robot's description."""
    rpy = numbers(roll_pitch_yaw(tool.R_flange_sensor), " ")
    return f'the robot\'s description must turn {frame} against the flange of the recording by rpy="{rpy}" (rad, URDF)'


def largest_error(calibration: Calibration, B: Array, gravity_direction: Array) -> tuple[float, float]:
    """How far off contact force, N, and torque, N m, are at most, each a norm, over all orientations and to a relative
    1e-6, where a program subtracts `B @ [r, 1]` in place of the calibration's free wrench: B (6, 4) in sensor axes, and
    `r = R_base_flange.T @ gravity_direction`, a unit vector (3,) in base axes.
    """
    wrong = np.einsum("ij,k->ijk", B[:, :3], gravity_direction)
    right = np.einsum("ij,k->ijk", calibration.B[:, :3], calibration.gravity_direction)
    slope, constant = wrong - right, B[:, 3] - calibration.bias
    return _largest(slope[:3], constant[:3]), _largest(slope[3:], constant[3:])


def _largest(slope: Array, constant: Array) -> float:
    """The largest norm of `slope[i, j, k] R[k, j] + constant[i]` over all rotations R.

    Its square is convex in R. So the rotation that has most in common with the gradient is never worse than the one
    before: from the best of a dense set of rotations these steps climb to the largest.
    """
    R = spread_rotations(288, 24)
    error = _error(slope, constant, R)
    R = R[np.argsort(np.linalg.norm(error, axis=1))[-STARTS:]]
    largest = 0.0
    for _ in range(MOST_STEPS):
        error = _error(slope, constant, R)
        before, largest = largest, float(np.linalg.norm(error, axis=1).max())
        if largest <= before * (1.0 + LEAST_GAIN):
            break
        R = procrustes(np.einsum("ijk,ni->nkj", slope, error))
    return largest


def _error(slope: Array, constant: Array, R: Array) -> Array:
    """The error (n, 3) at rotations (n, 3, 3)."""
    return np.asarray(np.einsum("ijk,nkj->ni", slope, R) + constant)
