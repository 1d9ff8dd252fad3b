"""What the recording itself says of a result: stretches left out, poses on the way, and creep of the sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind
from ..samples.creep import Creep
from ..samples.recorded_poses import RecordedPoses
from .findings import DOUBTFUL, REFUSED, WARNING, WEAK, those_that_hold

MOST_SEGMENTS_NAMED = 3
MOST_MOVED = 1.0 / 3.0
"""Of the segments in which the arm stood: where the reading moves in more of them, the recording is in doubt."""
ALLOWED, NEGLIGIBLE = 3.0, 0.002
"""Standard deviations of the weight, and part of it: creep that makes it wrong by less than either is not said. No data
sheet promises a better gain.
"""


def of_recording(recorded: RecordedPoses, since: float) -> list[Finding]:
    """Still segments of a stream that are no pose, the longest with their reasons, times counted from `since` (s); and
    that the arm stopped at too few orientations.
    """
    rejected, stood = recorded.rejected, len(recorded.rejected) + recorded.segments
    longest = sorted(rejected, key=lambda pose: -pose.n)[:MOST_SEGMENTS_NAMED]
    starts = sorted((pose.t_start or 0.0, str(pose.rejected)) for pose in longest)
    named = "; ".join(f"t = {start - since:.6g} s, {reason}" for start, reason in starts)
    more = f"; {len(rejected) - len(longest)} more" if len(rejected) > len(longest) else ""
    left_out = f"{len(rejected)} of {stood} stretches in which the arm stood were left out: {named}{more}"
    doubt = "do wrench and pose belong together in time, and was the tool let alone?"
    slow = (
        f"{recorded.on_the_way} of {len(recorded.poses)} poses are parts of a slow motion, "
        f"{recorded.segments} still stretches were found: a stop of two seconds at each orientation tells more"
    )
    most_moved = recorded.moved > MOST_MOVED * stood
    return those_that_hold(
        (
            (bool(rejected) and most_moved, WEAK, Kind.STILL_SEGMENTS_LEFT_OUT, f"{left_out}; {doubt}"),
            (bool(rejected) and not most_moved, REFUSED, Kind.STILL_SEGMENTS_LEFT_OUT, left_out),
            (recorded.on_the_way > 0, WARNING, Kind.POSES_ON_THE_WAY, slow),
        )
    )


def with_creep(calibration: Calibration, creep: Creep | None) -> Calibration:
    """The calibration with a weight as uncertain as creep leaves it; doubtful where that is sure, and more than its own
    error. Gravity's force and torque creep alike, so the centre of mass stays.
    """
    if creep is None:
        return calibration
    of_load = np.column_stack([calibration.B[:, :3], np.zeros(6)]).ravel()
    names, weight = calibration.parameter_names, calibration.weight
    direction = of_load if weight is None else weight * (np.array(names) == "weight")
    variance = creep.not_excluded**2
    honest = replace(
        calibration,
        covariance=calibration.covariance + variance * np.outer(direction, direction),
        B_covariance=calibration.B_covariance + variance * np.outer(of_load, of_load),
    )
    share, force = abs(creep.share), abs(creep.share) * creep.change
    beyond_weight = False
    if weight is not None:
        beyond_weight = share * weight >= max(ALLOWED * calibration.std["weight"], NEGLIGIBLE * weight)
    if not creep.sure or (force < calibration.expected_error[0] and not beyond_weight):
        return honest
    text = (
        f"the sensor creeps after each change of its load: {100.0 * share:.2g} % of it or more was perhaps still to "
        f"come when the poses were taken, {force:.2g} N: stops that last longer would weigh the tool otherwise"
    )
    return replace(honest, findings=(*calibration.findings, DOUBTFUL(Kind.CREEP, text)))
