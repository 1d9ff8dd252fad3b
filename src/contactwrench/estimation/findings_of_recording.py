"""What the recording itself says of a result: stretches left out, poses on the way, creep, a weight that changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity
from ..geometry.arrays import Array
from ..geometry.ranges import likely_unit
from ..model import LINEAR_PARAMETERS, gravity_in_flange
from ..samples.bursts import even_rows
from ..samples.creep import Creep
from ..samples.delay import TWO_CLOCKS, is_significant
from ..samples.poses import SAME_POSE_ANGLE, Pose
from ..samples.recorded_poses import RecordedPoses
from ..samples.samples import Samples
from ..samples.spikes import spikes
from ..statistics import counted, force_and_torque, two_digits
from .estimate import Estimate, RigidEstimate
from .findings import DOUBTFUL, REFUSED, SIGNIFICANCE, WARNING, WEAK, those_that_hold
from .noise import PoseReadings, in_time, readings_of
from .priors import Question

MOST_NAMED = 3
MOST_MOVED = 1.0 / 3.0
"""Of the segments in which the arm stood: where the reading moves in more of them, the recording is in doubt."""
LEAST_OF_PART, CHANGED = 3, 0.01
"""Poses before and after a change of the weight, at least, and of the weight."""
MOST_FLIPS, UNEQUAL = 200, 4.0
"""Visits that change sides in search of two weights; and by what factor these are to leave less than by chance, as all
axes count alike, and one may have twice the noise of another.
"""
WEIGHT_AND_BIAS = (LINEAR_PARAMETERS[0], *LINEAR_PARAMETERS[4:])
ALLOWED, NEGLIGIBLE = 3.0, 0.002
"""Standard deviations of the weight, and part of it: creep that makes it wrong by less than either is not said. No data
sheet promises a better gain.
"""
LATE, TURNING = 0.01, float(np.deg2rad(60.0))
"""s that do not matter, and rad/s of an arm at work."""
MOST_CREEP = 0.5
"""Share of a change of load: of sensors 0.2 is much; lost rows and clocks that stepped read as 0.6 to 1.8."""


def of_recording(recorded: RecordedPoses, since: float) -> list[Finding]:
    """Still segments of a stream that are no pose, the longest with their reasons, times counted from `since` (s); and
    that the arm stopped at too few orientations.
    """
    rejected, stood = recorded.rejected, len(recorded.rejected) + recorded.segments
    longest = sorted(rejected, key=lambda pose: -pose.n)[:MOST_NAMED]
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


def rows_apart(recorded: RecordedPoses, wrench: Array) -> list[Finding]:
    """Rows of a table, with these readings (n, 6), that contradict others at their orientation; they count from 1,
    without those left out before.
    """
    found, left, in_order = [], len(recorded.apart) - MOST_NAMED, in_time(recorded.poses)
    for these, others, left_out in recorded.apart[:MOST_NAMED]:
        off = force_and_torque(wrench[these].mean(axis=0) - wrench[others].mean(axis=0))
        one, two = sorted((these, others), key=lambda rows: int(rows[0]))
        so = f"{_named(these)} left out as in contact, bumped, or lost on the way"
        if not left_out and recorded.label is not None:
            poses = [in_order.index(recorded.poses[recorded.label[rows[0]]]) + 1 for rows in (one, two)]
            so = f"they are poses {poses[0]} and {poses[1]}, one in contact, misread, or of another orientation"
        text = f"{_named(one)} and {_named(two)} have one orientation and are {off} apart: {so}"
        found.append((REFUSED if left_out else WARNING)(Kind.ROWS_APART, text))
    more = WARNING(Kind.ROWS_APART, f"rows at one orientation are apart {left} times more")
    return [*found, more] if left > 0 else found


def _named(rows: NDArray[np.intp]) -> str:
    first, last = int(rows[0]) + 1, int(rows[-1]) + 1
    some = "" if last - first < len(rows) else f" ({len(rows)} of them)"
    return f"row {first}" if first == last else f"rows {first} to {last}{some}"


def of_estimate(
    estimate: Estimate, samples: Samples, readings: PoseReadings, question: Question, visits: tuple[Pose, ...] | None
) -> list[Finding]:
    """What of a recording, its poses' `readings` and the `visits` to them, the estimate leaves in doubt: its delay, and
    whether the load was one.
    """
    if not isinstance(estimate, RigidEstimate):
        return of_delay(samples, estimate)
    R, force, number = readings.R_base_flange, (readings.wrench - estimate.change)[:, :3], np.flatnonzero(estimate.kept)
    if visits is not None and not estimate.bias_moved:
        visited = readings_of(in_time(visits), True)
        nearest = np.einsum("vij,pij->vp", visited.R_base_flange, R[number]).max(axis=1)
        number = np.flatnonzero(nearest > 1.0 + 2.0 * np.cos(SAME_POSE_ANGLE))
        R, force = visited.R_base_flange, visited.wrench[:, :3]
    R, force = R[number], force[number]
    changed = [] if question.earlier is not None else weight_changed(estimate, R, force)
    changed = changed or step_or_load(estimate, readings) or two_weights(estimate, R, force, number)
    return of_delay(samples, estimate) + changed


def of_delay(samples: Samples, estimate: Estimate) -> list[Finding]:
    """That the delay between wrench and orientation is not known from zero, where that matters while the arm turns; or
    that it is no sensor's.
    """
    delay, std = samples.delay, samples.delay_std
    if delay is None or not std or not np.isfinite(std):
        return []
    if is_significant(delay, std):
        text = (
            f"the wrench is stamped {two_digits(abs(delay))} s {'later' if delay > 0.0 else 'earlier'} than the "
            "orientation, as by two clocks: that holds for this recording; set them by one clock, or give what is "
            "compensated its own --delay"
        )
        return [Finding.doubtful(Kind.CLOCKS_APART, text)] if abs(delay) > TWO_CLOCKS else []
    late = float(np.hypot(delay, std))
    off = min(late * TURNING, 2.0) * estimate.weight_scale
    text = (
        f"the delay between wrench and orientation is known within {two_digits(1e3 * late)} ms only, and not made up "
        f"for: while the arm turns at 60 deg/s contact forces may be {two_digits(off)} N off; turn faster between the "
        f"stops{', record positions too' * (samples.position is None)}, or give compensate its --delay"
    )
    matters = late > LATE and off > ALLOWED * float(np.linalg.norm(estimate.noise[:3]))
    return those_that_hold([(matters, WARNING, Kind.DELAY_IN_DOUBT, text)])


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
    if share > MOST_CREEP:
        text = (
            f"within stops the reading changes by {100.0 * share:.2g} % of what it does from stop to stop, "
            f"{force:.2g} N, as no sensor creeps: the clocks of sensor and robot part (rows lost, a clock stepped), "
            "the sensor was zeroed at a stop, or a filter is slower than the stops"
        )
    others = (each for each in calibration.findings if each.kind is not Kind.CREEP)  # from stop to stop it is the same
    return replace(honest, findings=(*others, DOUBTFUL(Kind.CREEP, text)))


def usable(samples: Samples) -> tuple[Samples, tuple[Finding, ...]]:
    """The rows without saturation and spikes, in even times where they came in bursts, and what was left out."""
    samples, notes = even_rows(samples)[0].unsaturated()
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
    if not samples.read_as and (likely := likely_unit(samples.t)):  # who read a file has said so
        apart = f"{len(samples)} samples would come {likely[1]:g} s apart; if they do not, give it in s"
        doubt.append(WARNING(Kind.TIMES_IN_DOUBT, f"t is likely in {likely[0]}, expected s: {apart}"))
    samples, left_out = usable(samples)
    findings = (*damage, *doubt, *left_out)
    if samples.load_mass is None or not (samples.load_mass > 0.0).any():
        return samples, findings
    free = samples.load_mass == 0.0
    text = f"{int(np.sum(~free))} rows with a load hung on the tool were left out"
    return samples.select(free), (*findings, Finding(Kind.LOADED_ROWS, Severity.REFUSED, text))


def weight_changed(fit: RigidEstimate, R_base_flange: Array, force: Array) -> list[Finding]:
    """That from some visit to a pose on the `force` (n, 3) has another share of the weight, beyond what a force matrix
    explains (t test).
    """
    from scipy.special import stdtr

    n, r = len(force), gravity_in_flange(R_base_flange, fit.gravity_direction)
    basis = np.linalg.qr(np.column_stack([r, np.ones(n)])).Q
    pull, left = r @ fit.B[:3, :3].T, force - basis @ (basis.T @ force)
    square, dof = float(np.sum(left**2)), max(3.0 * n - 13.0, 1.0)
    of_basis, size, match = (
        np.cumsum(each[::-1], axis=0)[::-1]  # of the poses from each one on
        for each in (basis[:, :, None] * pull[:, None], np.sum(pull**2, axis=1), np.sum(pull * left, axis=1))
    )
    size = np.maximum(size - np.sum(of_basis**2, axis=(1, 2)), 1e-9 * size[0] + 1e-300)
    explained = match**2 / size
    t = np.sqrt(explained * dof / np.maximum(square - explained, 1e-300))
    t[:LEAST_OF_PART] = t[n - LEAST_OF_PART + 1 :] = 0.0
    first = int(np.argmax(t))
    share, by_chance = float(match[first] / size[first]), 2.0 * n * float(stdtr(dof, -t[first]))
    text = (
        f"the tool weighs {abs(share) * fit.weight_scale:.2g} N {'more' if share > 0.0 else 'less'} after the first "
        f"{first} poses that count: something was dropped, picked up, or fills; calibrate each part alone"
    )
    return those_that_hold([(by_chance < SIGNIFICANCE and abs(share) > CHANGED, WEAK, Kind.WEIGHT_CHANGED, text)])


def step_or_load(fit: RigidEstimate, readings: PoseReadings) -> list[Finding]:
    """That the bias stepped, where another load from that pose on would leave as little of the forces of all `readings`
    that are kept: in a cone gravity pulls in one direction, and both are a change in that.
    """
    from scipy.special import chdtri

    drift = None if fit.beliefs is None else fit.beliefs.drift
    if drift is None or drift.first_after is None or not fit.bias_moved:
        return []
    kept = readings.select(fit.kept)
    n, after = len(kept), np.flatnonzero(fit.kept) >= drift.first_after
    r = gravity_in_flange(kept.R_base_flange, fit.gravity_direction)
    basis = np.linalg.qr(np.column_stack([r, np.ones(n)])).Q
    load = after[:, None] * (r @ fit.B[:3, :3].T)
    load, left = (each - basis @ (basis.T @ each) for each in (load, kept.wrench[:, :3]))
    share = float(np.sum(load * left) / max(np.sum(load**2), 1e-300))
    misfit = float(np.sum(((left - share * load) / fit.noise[:3]) ** 2))
    text = (
        f"what is told as a step of the bias may be a load that weighs {two_digits(abs(share) * fit.weight_scale)} N "
        f"{'more' if share > 0.0 else 'less'} from there on: was another tool mounted? calibrate each part alone, or "
        "tilt it further"
    )
    alike = misfit < float(chdtri(max(3.0 * n - 13.0, 1.0), SIGNIFICANCE))
    return those_that_hold([(alike and abs(share) > CHANGED, DOUBTFUL, Kind.WEIGHT_CHANGED, text)])


def two_weights(fit: RigidEstimate, R_base_flange: Array, force: Array, number: NDArray[np.intp]) -> list[Finding]:
    """That the `force` (n, 3) on visits, of this `number`, shows two weights, in any order, better than by chance and
    than a bias in two levels. With half of the poses on each, none is an outlier, and the weight found is nobody's.
    """
    n, r = len(force), gravity_in_flange(R_base_flange, fit.gravity_direction)
    if n < 2 * LEAST_OF_PART:
        return []
    basis, pull = np.linalg.qr(np.column_stack([r, np.ones(n)])).Q, r @ fit.B[:3, :3].T
    left = force - basis @ (basis.T @ force)
    size, match, of_basis = np.sum(pull**2, axis=1), np.sum(pull * left, axis=1), basis[:, :, None] * pull[:, None]
    heavier, least = match > 0.0, 1e-6 * size.mean() + 1e-300
    for _ in range(MOST_FLIPS):
        other_side = 1.0 - 2.0 * heavier  # what a visit that changes sides adds or takes
        along, in_basis, own = heavier @ match, np.tensordot(heavier, of_basis, 1), heavier @ size
        now = max(own - float(np.sum(in_basis**2)), least)
        changed_in_basis = in_basis + other_side[:, None, None] * of_basis
        changed = np.maximum(own + other_side * size - np.sum(changed_in_basis**2, axis=(1, 2)), least)
        explained = (along + other_side * match) ** 2 / changed
        if explained.max() <= (by_weights := float(along**2 / now)):
            break
        heavier[np.argmax(explained)] ^= True
    else:
        return []
    share, level = float(along / now), heavier - basis @ (basis.T @ heavier)
    by_levels = float(np.sum((level @ left) ** 2) / max(level @ level, 1e-300))
    ratio = 1.0 / max(1.0 - by_weights / max(float(np.sum(left**2)), 1e-300), 1e-12)
    by_chance = (n - 1.0) * np.log(2.0) - 0.5 * (3.0 * n - 13.0) * np.log(ratio / UNEQUAL)
    part = heavier if 2 * heavier.sum() <= n else ~heavier
    sure = by_chance < np.log(SIGNIFICANCE) and by_weights > by_levels and part.sum() >= LEAST_OF_PART
    if not sure or abs(share) <= CHANGED:
        return []
    numbers, what = [str(1 + k) for k in number[part]], "pose" if n == fit.kept.sum() else "visit"
    more = f" and {counted(len(numbers) - MOST_NAMED, 'more ' + what)}" if len(numbers) > MOST_NAMED else ""
    by = f"{two_digits(abs(share) * fit.weight_scale)} N {'more' if (share > 0.0) == (part is heavier) else 'less'}"
    text = f"the tool weighs {by} in {what} {', '.join(numbers[:MOST_NAMED])}{more} than in the others: "
    return [WEAK(Kind.WEIGHT_CHANGED, f"{text}something was held or touched; calibrate the poses without it alone")]
