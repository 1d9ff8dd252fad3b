"""What the readings and the orientations mean: by the parameters, and as a calibration's provenance remembers it."""

from __future__ import annotations

from typing import Any

import contactwrench as cw
from contactwrench.errors import InputError, refuse
from contactwrench.recording.as_calibrated import in_base_of_recording
from contactwrench.recording.options import Options, remembered
from contactwrench.samples.samples import ReadAs

ANOTHER_FRAME = (
    "{0} is {1}, expected {2} as for the calibration: set it so (where tf has no {2}, a static transform gives that "
    "name to the same place), or calibrate anew"
)


def options_of(settings: dict[str, Any], calibration: cw.Calibration | None) -> Options:
    """How readings and orientations are written: by the parameters, with the sign of a calibration's readings where
    they state none.

    Args:
        settings: the node's parameters by their names.
        calibration: that was loaded, None: there is none yet.

    Raises:
        InputError: a sign that is none, or a flange that is not the calibration's.
    """
    known = {} if calibration is None else remembered(calibration.provenance)
    source, frames = settings["pose_source"], (bare(settings["base_frame"]), bare(settings["flange_frame"]))
    of_pose: dict[str, dict[str, Any]] = {
        "tf": {"frames": frames},
        "pose": {"pose_topic": settings["pose_topic"]},
        "joints": {"pose_topic": settings["joint_topic"], "robot": settings["urdf"]},
    }
    sign = settings["sign"] or known.get("sign", "pull")
    options = Options(sign=sign, wrench_topic=settings["wrench_topic"], **of_pose[source])
    flange = bare(known["frames"][1]) if source == "tf" and "frames" in known else frames[1]
    refuse((flange != frames[1], ANOTHER_FRAME.format("flange_frame", frames[1], flange)))
    return options


def of_another_sign(options: Options, calibration: cw.Calibration) -> str | None:
    """That readings are taken with another sign than the calibration's were, which may be of another program."""
    own = remembered(calibration.provenance).get("sign", options.sign)
    return None if own == options.sign else f"sign is {options.sign}, and was {own} for the calibration"


def read_as(settings: dict[str, Any], options: Options) -> ReadAs:
    """What goes into the provenance of a calibration by the node: as `calibrate` has it of a bag."""
    return options.told({"base_frame": bare(settings["base_frame"])})


def in_base(calibration: cw.Calibration, base_frame: str) -> tuple[cw.Calibration, str | None]:
    """The calibration for orientations in the base of that name, and what there is to say of it.

    Raises:
        InputError: how that base stands to the calibration's is not known.
    """
    own, new = bare(str(calibration.provenance.get("base_frame") or "")), bare(base_frame)
    try:
        fitting, note = in_base_of_recording(calibration, new, "base_frame")
    except InputError:
        raise InputError(ANOTHER_FRAME.format("base_frame", new, own)) from None
    return fitting, note if own or note is None else f"the calibration does not name its base: taken to be {new}"


def bare(frame: str) -> str:
    """A frame's name without the slash that ROS 1 began it with."""
    return frame.removeprefix("/")
