"""The poses of any recording: of a table of poses its rows, of a stream its still segments.

The times decide: a stream has rows, several a second, while the arm turns from one orientation to the next, so that
more of its turning lies between rows that follow one another on the way than in jumps. Without times it is a table.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.rotations import angles_between, rotation_log
from .bursts import bursts_in, spread
from .creep import MOST_STOPS, Creep, Stop, creep_of
from .poses import SAME_POSE_ANGLE, Pose, averaged, cells_of, label_orientations, mean_poses, nearly_equal, visits
from .samples import SLOWEST, Samples
from .slow_motion import poses_on_the_way
from .still_noise import StillNoise, still_noise_of
from .still_segments import StillSegment, StillSegments, still_segments
from .timestamps import counted_on

FASTEST_TURN = np.deg2rad(360.0)
HOLD = 0.05
"""rad/s, and s for which a stated orientation may be an old one: a faster turn from row to row is a jump."""

SCALES = (0.1, 0.3, 1.0)
"""s from one look at the orientation to the next: slow arms show on long ones."""

ONWARD = 0.5
"""Cosine of the angle between the axes of one turn and the next, where an arm goes on turning."""

CELL = 2.0 * SAME_POSE_ANGLE
MOST_CELLS = 50_000
"""Orientations of a table, counted in cells of that size of the matrices' elements."""

MOST_POSES, MOST_ON_THE_WAY = 12_000, 2_000
GAP = 0.25
"""Of a visit to an orientation: rows with such a gap are two stretches of it."""
CLOSE = np.deg2rad(3.0)
"""Poses of a table; fewer of those that lie this close to the one before: fitting them would take minutes."""

LONGEST_STEP = np.deg2rad(20.0)
ROW_SCALES = (1.0, 3.0, 10.0, 30.0)
"""Steps and looks at rows without times."""

MANY_IN_NO_TIME = 50
"""Orientations; fewer may be a table by hand, whose times say little."""

FEW_STOPS = 6
"""Orientations: with fewer, what the sensor reads on the way between them is used too."""

MOST_BACK = 0.1
"""Of the rows; where recordings stand one after the other, times go back at few."""

LEAST_ON_THE_WAY = 5.0 * SAME_POSE_ANGLE
FEWEST_ROWS = 10


def is_stream(samples: Samples) -> bool:
    """Whether samples were recorded through the moves of the arm, so that still segments must be found in them; else
    each row, or group of rows at one orientation, is a pose.
    """
    if samples.t is None or len(samples) < FEWEST_ROWS:
        return False
    t, R = spread(samples.t, bursts_in(samples.t)), samples.R_base_flange
    step = np.diff(t)
    jump = (step < 0.0) | (step > SLOWEST) | (angles_between(R[:-1], R[1:]) > FASTEST_TURN * np.maximum(step, HOLD))
    jumps = np.r_[0, np.cumsum(jump)]
    return not jump.all() and any(_turns_along(R, t, jumps, scale) for scale in SCALES)


def _turns_along(R: Array, t: Array, jumps: NDArray[np.intp], scale: float) -> bool:
    """Whether more turning lies on ways than in jumps, looked at once in `scale` s."""
    look = np.floor((t - t[0]) / scale)
    rows = np.flatnonzero(np.r_[True, look[1:] != look[:-1]])
    if len(rows) < 3:
        return False
    turns = rotation_log(R[rows[:-1]].transpose(0, 2, 1) @ R[rows[1:]])
    angle = np.linalg.norm(turns, axis=1)
    turned = angle > SAME_POSE_ANGLE
    on_the_way = turned & (jumps[rows[1:]] == jumps[rows[:-1]])
    along = np.einsum("ni,ni->n", turns[1:], turns[:-1]) > ONWARD * angle[1:] * angle[:-1]
    onward = on_the_way[1:] & on_the_way[:-1] & along
    going_on = np.r_[onward, False] | np.r_[False, onward]
    recorded = float(angle[going_on].sum())
    return recorded > max(0.5 * float(angle[turned].sum()), float(LEAST_ON_THE_WAY))


@dataclass(frozen=True, eq=False)
class RecordedPoses:
    """`poses`; `visits`, where an orientation that the arm comes back to counts each time, None where it comes back to
    none or too often; the segments of a stream that are no pose, `rejected`, as poses with the reason, in how many of
    them the reading `moved`, and how many `segments` made the poses (0: the rows of a table did); how many poses were
    taken `on_the_way` of an arm that turns slowly; the `still_noise` of the segments, and the `creep` that they show;
    of a table the `label` (n,) of each row's pose, negative of none, and rows that are `apart` from others at their
    orientation, and whether they were left out (agreement.py); what the `lag` (10, 6) of poses on the way makes of all
    (slow_motion.py).
    """

    poses: tuple[Pose, ...]
    visits: tuple[Pose, ...] | None
    rejected: tuple[Pose, ...]
    moved: int
    segments: int
    on_the_way: int = 0
    still_noise: StillNoise | None = None
    creep: Creep | None = None
    label: NDArray[np.intp] | None = None
    apart: tuple[tuple[NDArray[np.intp], NDArray[np.intp], bool], ...] = ()
    lag: Array | None = None


def recorded_poses(samples: Samples, most_visits: int, stream: bool | None = None) -> RecordedPoses:
    """The poses of a table or of a `stream`, which the samples tell where it is None; visits count each time where
    there are `most_visits` at the most. Raises `InputError` for a stream in which the arm never stands still, and for a
    table of more poses than anybody stops at.
    """
    if not (is_stream(samples) if stream is None else stream and len(samples)):
        _require_order(samples)
        some, of_row = nearly_equal(samples.R_base_flange)
        _require_few(samples, some)
        label = label_orientations(some)[of_row]
        first = np.unique(label, return_index=True)[1]
        of_each = samples.R_base_flange[first]
        close = len(first) > MOST_ON_THE_WAY and np.median(angles_between(of_each[:-1], of_each[1:])) < CLOSE
        if len(first) > MOST_POSES or close:  # as none do that anybody chose
            raise _too_many(samples, len(first))
        _require_seconds(samples, len(first))
        poses, visit = averaged(samples, label), visits(label, most_visits)
        again = None if visit is None else averaged(samples, visit)
        noise, creep = told_by_times(samples, label)
        return RecordedPoses(poses, again, (), 0, 0, still_noise=noise, creep=creep, label=label)
    samples = counted_on(samples)[0]
    still = still_segments(samples)
    stood = still.accepted + still.rejected
    label = label_orientations(np.array([segment.R_base_flange for segment in still.accepted]).reshape(-1, 3, 3))
    count = len(set(label.tolist()))
    few = count < FEW_STOPS
    moving, lag = poses_on_the_way(samples, [segment.rows for segment in stood]) if few else ((), None)
    if not still.accepted and not moving:
        raise InputError(_never_still(samples, still))
    visit = visits(label, most_visits)
    return RecordedPoses(
        _joined(samples, still.accepted, label) + moving,
        None if visit is None else _joined(samples, still.accepted, visit) + moving,
        tuple(segment.as_pose() for segment in still.rejected),
        sum(segment.moves for segment in still.rejected),
        len(still.accepted),
        len(moving),
        still.noise,
        _creep_of(samples, still),
        lag=lag,
    )


def told_by_times(samples: Samples, label: NDArray[np.intp]) -> tuple[StillNoise | None, Creep | None]:
    """The noise, and the creep, that rows of a table show whose orientations have these labels."""
    if samples.t is None:
        return None, None
    rows, period = _even_rows(samples.t, label)
    return still_noise_of([samples.wrench[k] for k in rows], period), _creep_of_rows(samples, samples.t, label)


def _even_rows(t: Array, label: NDArray[np.intp]) -> tuple[list[slice], float]:
    """The rows of a table that follow each other at one orientation, where they come evenly, and their period, s."""
    step = np.diff(t)
    usual = float(np.median(step[label[1:] == label[:-1]])) if (label[1:] == label[:-1]).any() else 0.0
    ends = np.flatnonzero((label[1:] != label[:-1]) | (np.abs(step - usual) > 0.5 * usual)) + 1
    return [slice(a, b) for a, b in pairwise([0, *ends.tolist(), len(t)])], usual


def resting_poses(samples: Samples, stream: bool | None = None) -> tuple[Pose, ...]:
    """The poses of a table or of a `stream`, each orientation once. Raises `InputError` as `recorded_poses` does."""
    return recorded_poses(samples, 0, stream).poses


def _require_few(samples: Samples, some: Array) -> None:
    """Raise `InputError` for more orientations than anybody stops at, before any is averaged; `some` are distinct."""
    count = len(np.unique(cells_of(some, CELL)))
    if count > MOST_CELLS or (count > MOST_ON_THE_WAY and _follows_the_arm(samples.R_base_flange)):
        raise _too_many(samples, count)


def _require_order(samples: Samples) -> None:
    """Raise `InputError` for the rows of a stream that do not follow each other in time: as poses, those on the way
    would count like those at rest.
    """
    if samples.t is None or (back := int((np.diff(samples.t) < 0.0).sum())) <= MOST_BACK * len(samples):
        return
    if is_stream(samples.select(np.argsort(samples.t, kind="stable"))):
        raise InputError(
            f"{samples.source}: found times that go back at {back} of {len(samples)} rows, expected rows in the order "
            "of their times: sort them, or name another column of times, of poses none, with --time-column"
        )


def _too_many(samples: Samples, count: int) -> InputError:
    """The error for them. Raises that of `_require_seconds` where the times are what is wrong."""
    _require_seconds(samples, count)
    still = "stop for a second or two at each orientation"
    if samples.t is None:
        still = "give the times in a column t, or state --rate HZ, so that the still stretches are found"
    return InputError(
        f"{samples.source}: found about {count} orientations in {len(samples)} rows, expected poses at rest: {still}, "
        "or give only rows at rest"
    )


def _require_seconds(samples: Samples, count: int) -> None:
    """Raise `InputError` where rows follow an arm that by their times turns faster than any does. An orientation that
    comes more rarely than the readings has turned since it came.
    """
    if samples.t is None or count <= MANY_IN_NO_TIME or not _follows_the_arm(samples.R_base_flange):
        return
    came = np.r_[True, (np.diff(samples.R_base_flange, axis=0) != 0.0).any(axis=(1, 2))]
    R, t = samples.R_base_flange[came], samples.t[came]
    turn, step = angles_between(R[:-1], R[1:]), np.abs(np.diff(t))
    too_fast = turn > FASTEST_TURN * step
    if (turned := float(turn[too_fast].sum())) > 0.5 * float(turn.sum()):
        took = float(step[too_fast].sum())
        raise InputError(
            f"{samples.source}: found an arm that turns by {np.rad2deg(turned):.0f} deg in {took:.3g} s, expected "
            "times in s, with their decimals: write them so, or name another column, of poses none, with --time-column"
        )


def _follows_the_arm(R: Array) -> bool:
    """Whether rows without times follow the arm on its way."""
    rows = np.arange(len(R), dtype=np.float64)
    jump = np.r_[0, np.cumsum(angles_between(R[:-1], R[1:]) > LONGEST_STEP)]
    return any(_turns_along(R, rows, jump, scale) for scale in ROW_SCALES)


def _joined(samples: Samples, segments: tuple[StillSegment, ...], label: NDArray[np.intp]) -> tuple[Pose, ...]:
    """The mean of the rows of the segments of each label, in the order of their first ones."""
    row = np.arange(len(samples))
    of_pose = [np.flatnonzero(label == pose) for pose in range(int(label.max(initial=-1)) + 1)]
    return mean_poses(samples, [np.concatenate([row[segments[k].rows] for k in of]) for of in of_pose])


def _creep_of(samples: Samples, still: StillSegments) -> Creep | None:
    """What segments show of it. Among all in which the arm stood are those that creep too much to be poses, but also
    those that somebody touched, which hide it.
    """
    of_all = creep_of(_stops(samples, still.accepted + still.rejected))
    return of_all if of_all is not None and of_all.sure else creep_of(_stops(samples, still.accepted))


def _stops(samples: Samples, segments: tuple[StillSegment, ...]) -> list[Stop]:
    t = np.arange(len(samples), dtype=np.float64) if samples.t is None else samples.t
    stops, before = [], 0
    for segment in sorted(segments, key=lambda each: each.first):
        on_the_way = samples.R_base_flange[before : segment.first] - segment.R_base_flange
        far = np.flatnonzero(np.sum(on_the_way**2, axis=(1, 2)) > 2.0 * SAME_POSE_ANGLE**2)
        came = before + int(far[-1]) + 1 if len(far) else segment.first
        before = segment.last + 1
        stops.append(_stop(samples, t, segment.first, before, float(t[came])))
    return stops


def _creep_of_rows(samples: Samples, t: Array, label: NDArray[np.intp]) -> Creep | None:
    """What rows of a table show of it, those that follow each other at one orientation, to which the arm came when the
    samples say so, or with the first of them.
    """
    came, stops = (t if samples.came is None else samples.came), []
    edges = np.r_[0, np.flatnonzero(label[1:] != label[:-1]) + 1, len(t)]
    of_use = np.flatnonzero(np.diff(edges) >= FEWEST_ROWS)[:MOST_STOPS]
    for first, end in zip(edges[of_use].tolist(), edges[of_use + 1].tolist(), strict=True):
        visit = t[first:end]
        gaps = first + 1 + np.flatnonzero(np.diff(visit) > GAP * (visit[-1] - visit[0]))
        parts = pairwise([first, *gaps.tolist(), end])
        stops += [_stop(samples, t, a, b, float(came[first])) for a, b in parts if b - a > 1]
    return creep_of(stops)


def _stop(samples: Samples, t: Array, first: int, end: int, came: float) -> Stop:
    """Rows at one orientation, to which the arm `came` then."""
    half = (first + end + 1) // 2
    earlier, later = (samples.R_base_flange[rows].mean(axis=0) for rows in (slice(first, half), slice(half, end)))
    turn = float(np.linalg.norm(later - earlier) / np.sqrt(2.0))
    return Stop(samples.wrench[first:end, :3], came, float(t[first]), float(t[end - 1]), turn)


def _never_still(samples: Samples, still: StillSegments) -> str:
    t = samples.t if samples.t is not None else np.zeros(1)
    seen = f"found no stretch in {t[-1] - t[0]:.3g} s in which arm and reading are still"
    if still.rejected:
        longest = max(still.rejected, key=lambda segment: segment.n)
        at = f"the longest of {len(still.rejected)} looked at, t = {longest.t_start - t[0]:.4g} s"
        seen += f" ({at}: {longest.rejected})"
    return f"{samples.source}: {seen}: stop for a second or two at each orientation; calibrate --prior needs one"
