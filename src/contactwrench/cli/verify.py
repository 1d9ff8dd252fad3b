"""`contactwrench verify`."""

from __future__ import annotations

from pathlib import Path

from ..geometry.ranges import LEFT_FORCE, LEFT_TORQUE
from . import options
from .recordings import Recordings, calibration_and_samples, with_reading_options


@with_reading_options
def verify(
    *,
    calibration: Path = options.CALIBRATION,
    limit_force: float | None = options.number(LEFT_FORCE, "N", "Largest contact force that may be left in a pose."),
    limit_torque: float | None = options.number(
        LEFT_TORQUE, "NM", "Largest contact torque that may be left in a pose."
    ),
    json: bool = options.JSON,
    recording: Recordings,
    gravity: str | None = options.GRAVITY,
    g: float | None = options.WEIGHING_G,
) -> int:
    """Hold a second, contact-free recording against a calibration; weigh the loads in its column load_g.

    Exit status 1 if the recording contradicts the calibration.
    """
    from ..assess.verify import verify as check
    from ..report.text import verification_json, verification_text

    loaded, samples = calibration_and_samples(calibration, gravity, recording)
    result = check(loaded, samples, limit_force=limit_force, limit_torque=limit_torque, g=g)
    options.print_result(result, json, verification_json, verification_text)
    if loaded.dynamics is not None:
        options.note(
            "only the stops were verified: for inertia and offset compensate free motion, and see what is left"
        )
    return 0 if result.passed else 1
