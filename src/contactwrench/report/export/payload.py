"""What hangs on a robot's flange, tool and sensor together, as the robot's own controller wants it described."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...calibration.calibration import Calibration
from ...errors import InputError
from ...geometry.arrays import Frozen, Vector
from ...statistics import three_digits
from .losses import ROUNDING, largest_error
from .target import Parameters, Setup
from .tool import DOWN, rigid_tool

OFFSET = "--sensor-offset X,Y,Z (m, flange axes, from the flange's origin to the sensor's: on its drawing)"
MASS = "--sensor-mass KG (sensor and adapter: data sheet or scales; 0 for a sensor inside the robot)"
COM = "--sensor-com X,Y,Z (m, flange axes, from the flange's origin to their centre of mass)"
"""What a payload needs beside the calibration, and where to find it."""


@dataclass(frozen=True, eq=False)
class Payload(Frozen):
    """All that hangs on the flange: `mass` kg; `com` (3,) m, flange axes, from the flange's origin; `tool_mass` kg of
    it on the tool's side of the sensor, with its centre of mass `tool_com` (3,) m, sensor axes, from the sensor's
    origin. `of_lean`: how far off, at most, a controller that assumes gravity along -z of its base is of the identified
    weight, N, and of its torque about the sensor's origin, N m, None where the calibration's own std is larger.
    """

    mass: float
    com: Vector
    tool_mass: float
    tool_com: Vector
    of_lean: tuple[float, float] | None

    def parameters(self, body: str, unit: str, upright: str, *remarks: str) -> Parameters:
        """What a controller gets: its `body`, lengths in `unit`, and `upright`, which tells it how the base leans."""
        lines = [
            f"mass in kg, centre of mass in {unit}, flange axes, from the flange's origin: the tool "
            f"({fixed(self.tool_mass, 6)} kg) with the sensor as stated ({fixed(self.mass - self.tool_mass, 6)} kg); "
            "the plate on the sensor's tool side is weighed with the tool, take it off --sensor-mass",
            "flange axes, here and in the flags, are those whose orientation was recorded: with a turned TCP set then, "
            "the TCP's",
            "moments of inertia, found or not, are written as 0, a point mass",
            "for the robot's own motion, hand guiding and collision detection, and for a sensor inside it; from the "
            "readings of a sensor outside nothing is subtracted, and its bias is not in here",
        ]
        cautions = []
        if self.of_lean is not None:
            force, torque = map(three_digits, self.of_lean)
            cautions.append(
                f"a controller that takes gravity to be along -z of its base is off by up to {force} N in the "
                f"identified weight and {torque} N m in its torque about the sensor; {upright} tells it how the base "
                "leans"
            )
        return Parameters(body, (*lines, *remarks), cautions=tuple(cautions))


def payload_on_flange(calibration: Calibration, setup: Setup, target: str) -> Payload:
    """The payload that a calibrated tool and its sensor make on the robot's flange.

    Args:
        calibration: of any model but `affine`.
        setup: with `sensor_offset`, `sensor_mass` and, above 0 kg, `sensor_com`.
        target: which asks, for the message.

    Returns:
        Mass and centre of mass, and what a controller that does not know how the base leans then gets wrong.

    Raises:
        InputError: what is needed was not stated, or the model has no mass.
    """
    offset, sensor_mass = setup.sensor_offset, setup.sensor_mass
    sensor_com = np.zeros(3) if sensor_mass == 0.0 else setup.sensor_com
    if offset is None or sensor_mass is None or sensor_com is None:
        stated = ((OFFSET, offset), (MASS, sensor_mass), (COM, sensor_com))
        missing = " and ".join(flag for flag, value in stated if value is None)
        raise InputError(f"{target} counts from the flange, with the sensor's own mass: give {missing}")
    tool = rigid_tool(calibration, setup, target)
    tool_mass = tool.weight / calibration.g
    mass = tool_mass + sensor_mass
    moment = tool_mass * (offset + tool.R_flange_sensor @ tool.com) + sensor_mass * sensor_com
    of_lean = largest_error(calibration, calibration.B, DOWN)
    own = np.maximum(calibration.largest_std, ROUNDING)
    return Payload(mass, moment / mass, tool_mass, tool.com, of_lean if np.greater(of_lean, own).any() else None)


def fixed(value: float, digits: int) -> str:
    """A number never in powers of ten, with as many digits as it needs up to `digits`."""
    whole, _, fraction = f"{round(value, digits) + 0.0:.{digits}f}".partition(".")
    return f"{whole}.{fraction.rstrip('0') or '0'}"
