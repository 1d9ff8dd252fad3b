"""The node's parameters: defaults, descriptions, ranges; which can be set while it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from contactwrench.errors import InputError, refuse

POSE_SOURCES = ("tf", "pose", "joints")


@dataclass(frozen=True)
class Parameter:
    """A parameter: its default, what it is for, and the range (least, most) of a number. Those that are `live` can be
    set while the node runs.
    """

    default: str | float
    description: str
    live: bool = False
    within: tuple[float, float] | None = None


ANEW = "set while running, the compensation starts anew"

PARAMETERS = {
    "calibration": Parameter("", "file of a calibration; empty: none yet, only calibrating is possible"),
    "save_to": Parameter("", "file that ~/finish_calibration writes; empty: the calibration is not kept", live=True),
    "wrench_topic": Parameter("/wrench", "WrenchStamped with the raw reading, in sensor axes"),
    "sign": Parameter(
        "",
        "of the readings: pull, a free tool reads its weight downwards, or reaction; empty: as calibrated, else pull",
    ),
    "pose_source": Parameter("tf", "where the pose of the flange is from: tf, pose or joints"),
    "pose_topic": Parameter("/pose", "PoseStamped of the flange in the base, for pose_source pose"),
    "joint_topic": Parameter("/joint_states", "JointState, for pose_source joints"),
    "urdf": Parameter("", "for pose_source joints: the arm, FILE.urdf[:LINK], or a name such as ur5e"),
    "base_frame": Parameter("base_link", "frame that does not move with the arm; the calibration remembers it"),
    "flange_frame": Parameter("tool0", "frame that the sensor is mounted on"),
    "output_frame": Parameter(
        "sensor", "axes of the contact wrench, about the sensor's origin: sensor, flange or base", live=True
    ),
    "lowpass": Parameter(0.0, f"Hz, of the contact wrench, order 2; 0: none; {ANEW}", live=True, within=(0.0, 1e4)),
    "drift": Parameter(
        0.0,
        f"N in an hour, by which the bias walks and is followed; 0: it is not; {ANEW}",
        live=True,
        within=(0.0, 10.0),
    ),
    "noise": Parameter(
        0.0, f"N, std of one reading; 0: the calibration's, or learned; {ANEW}", live=True, within=(0.0, 100.0)
    ),
    "stale_after": Parameter(
        0.1, "s without a new orientation, after which no wrench is published", live=True, within=(0.001, 10.0)
    ),
}
TOPICS = {"pose": "pose_topic", "joints": "joint_topic"}
"""Of the sources of poses, beside tf."""


def defaults() -> dict[str, Any]:
    """Every parameter's default by its name."""
    return {name: parameter.default for name, parameter in PARAMETERS.items()}


def meant(name: str, value: Any) -> str | float:
    """A parameter's value as it is meant: a whole number is a number too.

    Raises:
        InputError: another type, a number out of its range, an empty text where there is no telling without one.
    """
    parameter = PARAMETERS[name]
    if isinstance(parameter.default, str):
        refuse(
            (not isinstance(value, str), f"{name} is {value!r}, expected a text: write it in quotes"),
            (
                parameter.default and not value and name not in TOPICS.values(),
                f"{name} is empty, expected a text such as {parameter.default}",
            ),
        )
        return str(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{name} is {value!r}, expected a number: write it as {parameter.default}, without quotes")
    if parameter.within is not None:
        least, most = parameter.within
        refuse((not least <= value <= most, f"{name} is {value:g}, expected {least:g} to {most:g}"))
    return float(value)
