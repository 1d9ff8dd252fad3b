"""`contactwrench diagnose`."""

from __future__ import annotations

from ..errors import InputError
from . import options
from .recordings import Recordings, with_reading_options


@with_reading_options
def diagnose(*, json: options.Json = False, recording: Recordings, gravity: options.Gravity = None) -> None:
    """Find the interpretation of FILE that a rigid tool explains, and the options that make it so.

    Tries every orientation convention, inverse and unit, both signs, wrenches in base axes, exchanged axes, shifted
    rows and torques in N mm. The options of reading say how the file is read as given.
    """
    from ..assess.diagnose import diagnose as rank
    from ..recording.interpretations import interpretations
    from ..report.diagnosis import diagnosis_json, diagnosis_text

    if recording.options.pose_file is not None:
        # The rows of two do not belong together as written; which do is not known before the orientation is.
        raise InputError(
            f"{recording.path}: found the wrenches of two files, expected one with wrench and orientation in a row: "
            "diagnose a recording of still poses in one table"
        )
    ranked = rank(interpretations(recording.path, recording.options, options.gravity_direction(gravity)))
    options.print_result(ranked, json, diagnosis_json, diagnosis_text)
