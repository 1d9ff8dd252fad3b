"""What the recording itself says of a result: stretches left out, poses on the way, and creep of the sensor."""

from __future__ import annotations

from dataclasses import replace

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
    """The calibration, doubtful where its readings had still more to show than its own error."""
    others = tuple(finding for finding in calibration.findings if finding.kind is not Kind.CREEP)
    unaffected = replace(calibration, findings=others)
    if creep is None:
        return unaffected
    wrong_weight = False
    if calibration.weight is not None:
        allowed = max(ALLOWED * calibration.std["weight"], NEGLIGIBLE * calibration.weight)
        wrong_weight = abs(creep.share) * calibration.weight >= allowed
    if creep.force < calibration.expected_error[0] and not wrong_weight:
        return unaffected
    text = (
        f"the sensor creeps after each change of its load: {100.0 * abs(creep.share):.2g} % of it or more was perhaps "
        f"still to come when the poses were taken, {creep.force:.2g} N: stops that last longer would weigh the tool "
        "otherwise"
    )
    return replace(calibration, findings=(*others, DOUBTFUL(Kind.CREEP, text)))
