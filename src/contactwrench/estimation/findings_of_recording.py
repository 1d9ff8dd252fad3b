"""What the recording itself says of a result: stretches left out, poses on the way, and creep of the sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity
from ..geometry.arrays import Array
from ..model import LINEAR_PARAMETERS, gravity_in_flange
from ..samples.creep import Creep
from ..samples.recorded_poses import RecordedPoses
from ..samples.samples import Samples, spikes
from .findings import DOUBTFUL, REFUSED, WARNING, WEAK, those_that_hold

MOST_SEGMENTS_NAMED = 3
MOST_MOVED = 1.0 / 3.0
"""Of the segments in which the arm stood: where the reading moves in more of them, the recording is in doubt."""
WEIGHT_AND_BIAS = (LINEAR_PARAMETERS[0], *LINEAR_PARAMETERS[4:])
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


def with_creep(calibration: Calibration, creep: Creep | None, R_base_flange: Array) -> Calibration:
    """The calibration of poses (n, 3, 3) with tool and bias as uncertain as creep leaves them; doubtful where that is
    sure, and more than the error without it. A sensor that creeps shows less of how each load differs from the mean of
    them: force and torque alike, so the centre of mass stays.
    """
    if creep is None:
        return calibration
    load = calibration.B[:, :3]
    mean_load = load @ gravity_in_flange(R_base_flange, calibration.gravity_direction).mean(axis=0)
    of_B = np.column_stack([load, -mean_load]).ravel()
    names, weight = calibration.parameter_names, calibration.weight
    direction = of_B
    if weight is not None:
        direction = np.zeros(len(names))
        direction[[names.index(name) for name in WEIGHT_AND_BIAS]] = np.r_[weight, -mean_load]
    variance = creep.not_excluded**2
    honest = replace(
        calibration,
        covariance=calibration.covariance + variance * np.outer(direction, direction),
        B_covariance=calibration.B_covariance + variance * np.outer(of_B, of_B),
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


def usable(samples: Samples) -> tuple[Samples, tuple[Finding, ...]]:
    """The rows without saturation and spikes, and what was left out."""
    samples, notes = samples.unsaturated()
    findings = tuple(Finding(Kind.SATURATED_ROWS, Severity.REFUSED, note) for note in notes)
    if (spiked := spikes(samples)).any():
        text = (
            f"{np.sum(spiked)} of {len(samples)} readings that jump and are back in the next row were left out: look "
            "at the sensor's cable, shield and driver"
        )
        samples, findings = samples.select(~spiked), (*findings, Finding(Kind.SPIKES, Severity.REFUSED, text))
    return samples, findings


def contact_free(samples: Samples) -> tuple[Samples, tuple[Finding, ...]]:
    """The usable rows without load, and what there is to say of the samples."""
    damage = [Finding(Kind.DAMAGED_RECORDING, Severity.WARNING, samples.damage)] if samples.damage else []
    doubt = [Finding.doubtful(Kind.ANGLES_IN_DOUBT, samples.doubt)] if samples.doubt else []
    samples, left_out = usable(samples)
    findings = (*damage, *doubt, *left_out)
    if samples.load_mass is None or not (samples.load_mass > 0.0).any():
        return samples, findings
    free = samples.load_mass == 0.0
    text = f"{int(np.sum(~free))} rows with a load hung on the tool were left out"
    return samples.select(free), (*findings, Finding(Kind.LOADED_ROWS, Severity.REFUSED, text))
