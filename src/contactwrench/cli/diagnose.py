"""`contactwrench diagnose`."""

from __future__ import annotations

from . import options
from .recordings import Recordings, with_reading_options


@with_reading_options
def diagnose(
    *,
    model: str = options.text("M", "Of `calibrate`: auto, yaw, mount or mount+base.", default="auto"),
    json: bool = options.JSON,
    recording: Recordings,
    gravity: str | None = options.GRAVITY,
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
