"""What every format of parameters has in common: what a program gets, what it makes of it, what it needs and loses."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from ...calibration.calibration import Calibration
from ...geometry.arrays import Frozen, Matrix, Vector
from ...geometry.ranges import ON_FLANGE, SENSOR_MASS, TOOL_MASS

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
