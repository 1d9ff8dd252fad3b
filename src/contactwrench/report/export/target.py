"""What every format of parameters has in common: what a file holds, what it needs beside the calibration and loses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...calibration.calibration import Calibration
from ...geometry.arrays import Frozen, Matrix, Vector


@dataclass(frozen=True, eq=False)
class Setup(Frozen):
    """What a calibration does not hold and some targets need; None: not stated.

    `tool_mass` kg, as weighed on scales, in place of the identified one; `sensor_mass` kg and `sensor_com` (3,) m from
    the flange's origin, flange axes; `sensor_offset` (3,) m, from the flange's origin to the sensor's, flange axes;
    names of the sensor, of its frame and of the base's in the program's configuration.
    """

    tool_mass: float | None = None
    sensor_mass: float | None = None
    sensor_com: Vector | None = None
    sensor_offset: Vector | None = None
    sensor_name: str = "ft_sensor"
    sensor_frame: str = "ft_frame"
    base_frame: str = "base_link"


@dataclass(frozen=True, eq=False)
class Parameters(Frozen):
    """What a program gets, and what it makes of it.

    `body` in the program's own format, without a comment; `remarks`, a sentence each: unit and frame of every number,
    and what is assumed; `B` (6, 4) and `gravity_direction` (3,): the program subtracts `B @ [r, 1]` from this sensor's
    readings, with `r = R_base_flange.T @ gravity_direction` (sensor axes, N and N m). Both are None for a program that
    subtracts nothing from them, as a robot's own controller that moves a payload.
    """

    body: str
    remarks: tuple[str, ...]
    B: Matrix | None = None
    gravity_direction: Vector | None = None


def commented(mark: str) -> Callable[[Sequence[str], str], str]:
    """How a header stands above a body in a format whose comments begin with `mark`."""

    def with_header(header: Sequence[str], body: str) -> str:
        return "".join(f"{mark} {line}".rstrip() + "\n" for line in header) + body

    return with_header


@dataclass(frozen=True)
class Target:
    """A format of parameters.

    `name` on the command line; `program` that reads it, in words; `suffix` of its files; `needs` beside the calibration
    and `loses` of it, in a few words, empty for nothing; `parameters` of a calibration, which raises `InputError` for
    what is needed and not stated and for a calibration without which the file would mean nothing; `with_header` sets
    the lines of the header over the body, or drops them where the format has no room.
    """

    name: str
    program: str
    suffix: str
    needs: str
    loses: str
    parameters: Callable[[Calibration, Setup], Parameters]
    with_header: Callable[[Sequence[str], str], str] = commented("#")
