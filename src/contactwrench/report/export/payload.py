"""What hangs on a robot's flange, tool and sensor together, as the robot's own controller wants it described."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ...calibration.calibration import Calibration
from ...errors import InputError
from ...geometry.arrays import Array, Frozen, Matrix, Vector
from ...geometry.wrench import cross_matrix
from ...statistics import three_digits, two_digits
from .target import DOWN, ROUNDING, Parameters, Setup, largest_error, rigid_tool

OFFSET = "--sensor-offset X,Y,Z (its origin: drawing)"
MASS = "--sensor-mass KG (with adapter; 0 inside the robot)"
COM = "--sensor-com X,Y,Z (of that mass)"
"""What a payload needs beside the calibration, and where to find it."""

COUNTED = ", in m from the flange's origin, flange axes"


@dataclass(frozen=True, eq=False)
class Payload(Frozen):
    """All that hangs on the flange: `mass` kg; `com` (3,) m, flange axes, from the flange's origin; `tool_mass` kg of
    it on the tool's side of the sensor, with its centre of mass `tool_com` (3,) m, sensor axes, from the sensor's
    origin. `inertia` (3, 3) kg m^2, flange axes, about `com`, of the tool as found and the sensor as a point, None
    where the calibration does not know it; `inertia_std`, the largest of the tool's. `of_lean`: how far off, at most, a
    controller that assumes gravity along -z of its base is of the identified weight, N, and of its torque about the
    sensor's origin, N m, None where the calibration's own std is larger.
    """

    mass: float
    com: Vector
    tool_mass: float
    tool_com: Vector
    inertia: Matrix | None
    inertia_std: float
    of_lean: tuple[float, float] | None

    def parameters(self, body: str, unit: str, upright: str, inertia: str, *remarks: str) -> Parameters:
        """What a controller gets: its `body`, lengths in `unit`, `upright`, which tells it how the base leans, and what
        is said of the moments of inertia.
        """
        lines = [
            f"mass in kg, centre of mass in {unit}, flange axes, from the flange's origin: the tool "
            f"({fixed(self.tool_mass, 6)} kg) with the sensor as stated ({fixed(self.mass - self.tool_mass, 6)} kg); "
            "the plate on the sensor's tool side is weighed with the tool, take it off --sensor-mass",
            "flange axes, here and in the options, are those whose orientation was recorded: with a turned TCP set "
            "then, the TCP's; where the robot reports torques about a TCP, --sensor-offset is how far off the flange "
            "that is",
            inertia,
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

    def inertia_written(self, axes: str) -> str:
        """What is said of the inertia in a file that has it, in which `axes`."""
        if self.inertia is None:
            return (
                "moments of inertia are written as 0, a point mass: they are not known without model dynamic "
                "(--model dynamic)"
            )
        return (
            f"moments of inertia in kg m^2 about the centre of mass, {axes}: the tool's as found (std up to "
            f"{two_digits(self.inertia_std)} kg m^2), the sensor as a point; mind the sensor's own, if it is large"
        )


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Of an inertia (3, 3) its principal moments (3,), and the rotation (3, 3) from its principal axes to those that it
    is stated in: of all that there are the one nearest to no rotation.
    """
    moments, axes = np.linalg.eigh(inertia)
    order = max(permutations(range(3)), key=lambda order: float(np.abs(np.diag(axes[:, order])).sum()))
    moments, axes = moments[list(order)], axes[:, order]
    axes = axes * np.where(np.diag(axes) < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, np.argmin(np.diag(axes))] *= -1.0
    return moments, axes


def payload_on_flange(calibration: Calibration, setup: Setup, target: str) -> Payload:
    """The payload that a calibrated tool and its sensor make on the robot's flange. Raises `InputError`, naming the
    `target` that asks, without a stated `sensor_offset`, `sensor_mass` and, above 0 kg, `sensor_com`, and for a model
    that has no mass.
    """
    offset, sensor_mass = setup.sensor_offset, setup.sensor_mass
    sensor_com = np.zeros(3) if sensor_mass == 0.0 else setup.sensor_com
    if offset is None or sensor_mass is None or sensor_com is None:
        stated = ((OFFSET, offset), (MASS, sensor_mass), (COM, sensor_com))
        missing = " and ".join(option for option, value in stated if value is None)
        where = "" if missing == MASS else COUNTED
        raise InputError(f"{target} counts with the sensor's own mass, expected {missing}: give it{where}")
    tool = rigid_tool(calibration, setup, target)
    tool_mass = tool.weight / calibration.g
    mass = tool_mass + sensor_mass
    tool_com = offset + tool.R_flange_sensor @ tool.com
    moment = tool_mass * tool_com + sensor_mass * sensor_com
    std = calibration.std["inertia"]
    if (inertia := calibration.inertia) is not None:
        inertia = tool.R_flange_sensor @ inertia @ tool.R_flange_sensor.T
        for part, at in ((tool_mass, tool_com), (sensor_mass, sensor_com)):
            arm = cross_matrix(at - moment / mass)
            inertia = inertia - part * arm @ arm
    of_lean = largest_error(calibration, calibration.B, DOWN)
    own = np.maximum(calibration.largest_std, ROUNDING)
    matters = np.greater(of_lean, own).any()
    most = 0.0 if std is None else float(np.max(std))
    return Payload(mass, moment / mass, tool_mass, tool.com, inertia, most, of_lean if matters else None)


def fixed(value: float, digits: int) -> str:
    """A number never in powers of ten, with as many digits as it needs up to `digits`."""
    whole, _, fraction = f"{round(value, digits) + 0.0:.{digits}f}".partition(".")
    return f"{whole}.{fraction.rstrip('0') or '0'}"
