"""What every format of parameters has in common: its name, what it needs beside the calibration, and what it loses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...calibration.calibration import Calibration
from ...geometry.arrays import Frozen, Vector


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


@dataclass(frozen=True)
class Target:
    """A format: its `name` on the command line, the `program` that reads it in words, the `suffix` of its files, and
    what writes it; `write` raises `InputError` for what is needed and not stated, and for what it cannot express.
    """

    name: str
    program: str
    suffix: str
    write: Callable[[Calibration, Setup], str]
