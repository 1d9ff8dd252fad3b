"""`contactwrench weigh`."""

from __future__ import annotations

from pathlib import Path

from . import options
from .recordings import Recordings, calibration_and_samples, with_reading_options


@with_reading_options
def weigh(
    *,
    calibration: Path = options.CALIBRATION,
    json: bool = options.JSON,
    recording: Recordings,
    gravity: str | None = options.GRAVITY,
    g: float | None = options.WEIGHING_G,
) -> int:
    """Mass and centre of mass of an object that the tool holds, from one or more poses.

    Exit status 1 where nothing that an arm holds explains the readings: the calibration is wrong.
    """
    from ..assess.weigh import weigh as weighed
    from ..report.text import held_object_json, held_object_text

    loaded, samples = calibration_and_samples(calibration, gravity, recording)
    held = weighed(loaded, samples, g=g)
    options.print_result(held, json, held_object_json, held_object_text)
    return int(held.refused)
