"""`contactwrench diagnose`."""

from __future__ import annotations

from typing import Annotated

from . import options
from .recordings import Recordings, with_reading_options


@with_reading_options
def diagnose(
    *,
    model: Annotated[str, options.text("M", "Of `calibrate`: auto, yaw, mount or mount+base.")] = "auto",
    json: options.Json = False,
    recording: Recordings,
    gravity: options.Gravity = None,
) -> None:
    """Find the interpretation of FILE that a rigid tool explains, and the options that make it so.

    Tries every orientation convention, inverse and unit, both signs, wrenches in base axes, exchanged axes, shifted
    rows and torques in N mm. The options of reading say how the file is read as given.
    """
    from ..assess.diagnose import diagnose as rank
    from ..recording.interpretations import interpretations
    from ..report.diagnosis import diagnosis_json, diagnosis_text

    ranked = rank(interpretations(recording.path, recording.options, options.gravity_direction(gravity)), model)
    options.print_result(ranked, json, diagnosis_json, diagnosis_text)
