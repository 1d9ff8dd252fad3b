"""Time stamps as recorders write them: what is refused, what is put right, and the words for both."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.ranges import RATE, TIME
from ..statistics import counted
from .samples import Samples

SORTED_WITHIN = 0.1
"""s: messages are delivered late by less, and are sorted. Clocks are set back by more: those that follow a server step
only where they are further off (ntpd: 0.128 s), and are slowed down until then.
"""
FINEST = 1e-9
"""s from row to row: no recorder counts less."""
LEAST_GAP, GAP_IN_ROWS = 0.05, 5.0
"""s, and median steps of a stream: what takes longer is a gap, where nobody states one (`default_gap`) than both."""
PACED, FEWEST_AT_A_PACE = 1.0, 8
"""s, over which a pace is even, and stamps that tell one."""
APART = 1.0
"""s by which what follows is put behind what came before: a gap, of nobody knows which length."""

FEWEST_AGAIN = 50
"""Rows in a row, stamp and reading alike to the last digit, as no two recordings have them: one written twice."""


@dataclass(frozen=True)
class Stamps:
    """The stamps of a stream up to some row: how many `rows`, the `first` and the `latest` stamp and the latest one's
    row, the stamp of the `last` row; how many rows were stamped earlier than a row before them and by how much at the
    most, and how many repeat the stamp before.
    """

    stream: str
    source: str
    rows: int = 0
    first: float = np.inf
    latest: float = -np.inf
    latest_row: int = 0
    last: float = np.nan
    out_of_order: int = 0
    furthest_back: float = 0.0
    repeated: int = 0


def stamps_after(before: Stamps, t: Array, origin: float) -> Stamps:
    """The stamps after rows at `t` (n,), s. `origin`: the recording's first stamp, from which people count.

    Raises `InputError` for a stamp that is no finite number, and for one that lies `SORTED_WITHIN` or more before an
    earlier row's: a clock that was set back, or two recordings in one.
    """
    if not len(t):
        return before
    if len(TIME.outside(t)):
        bad = int(np.argmin(TIME.holds(t)))
        raise InputError(
            f"{before.source}: row {before.rows + bad + 1} of the {before.stream} is stamped {t[bad]}, expected "
            "seconds: leave such rows out",
            before.rows + bad,
        )
    latest = np.maximum.accumulate(np.r_[before.latest, t])
    back = latest[:-1] - t
    if back.max() >= SORTED_WITHIN:
        _refuse_jump(before, t, int(np.argmax(back >= SORTED_WITHIN)), origin)
    late = back > 0.0
    return replace(
        before,
        rows=before.rows + len(t),
        first=min(before.first, float(t.min())),
        latest=float(latest[-1]),
        latest_row=before.rows + int(t.argmax()) if latest[-1] > before.latest else before.latest_row,
        last=float(t[-1]),
        out_of_order=before.out_of_order + int(late.sum()),
        furthest_back=max(before.furthest_back, float(back[late].max(initial=0.0))),
        repeated=before.repeated + int(np.sum(np.diff(np.r_[before.last, t]) == 0.0)),
    )


def _refuse_jump(before: Stamps, t: Array, row: int, origin: float) -> None:
    earlier = t[:row]
    ahead = len(earlier) > 0 and earlier.max() > before.latest
    latest = float(earlier.max()) if ahead else before.latest
    latest_row = before.rows + int(earlier.argmax()) if ahead else before.latest_row
    raise InputError(
        f"{before.source}: row {before.rows + row + 1} of the {before.stream} is stamped {latest - t[row]:.3g} s "
        f"before row {latest_row + 1}, which is at {latest - origin:.3f} s of the recording; expected stamps in order "
        f"within {SORTED_WITHIN:g} s: cut the recording there, the clock was set back or it was started again",
        before.rows + row,
    )


def require_times(stamps: Stamps) -> None:
    """Raise `InputError` where a stream has no rows, or one stamp for all of them."""
    expected = {"wrench": "readings", "orientation": "orientations"}[stamps.stream]
    if stamps.rows == 0:
        raise InputError(f"{stamps.source}: found no {expected}, expected a stream of them: add it")
    if stamps.rows > 1 and stamps.latest == stamps.first:
        raise InputError(
            f"{stamps.source}: all {stamps.rows} rows of the {stamps.stream} are stamped {stamps.first:g} s, expected "
            "the time of each: take the times at which they were recorded"
        )


def notes_of(stamps: Stamps) -> tuple[str, ...]:
    """What was put right, in words."""
    notes = []
    if stamps.out_of_order:
        notes.append(
            f"{counted(stamps.out_of_order, 'row')} of the {stamps.stream} came out of order, by up to "
            f"{1e3 * stamps.furthest_back:.3g} ms: sorted by their stamps"
        )
    if stamps.repeated:
        which = "the last of each stamp counts" if stamps.stream == "orientation" else "all of them count"
        repeat = "repeats" if stamps.repeated == 1 else "repeat"
        notes.append(f"{counted(stamps.repeated, 'row')} of the {stamps.stream} {repeat} the stamp before: {which}")
    return tuple(notes)


def require_common_span(wrench: Stamps, orientation: Stamps, delay: float) -> None:
    """Raise `InputError` unless the streams have some time in common: two clocks, or two units, as a rule."""
    start = max(wrench.first - delay, orientation.first)
    end = min(wrench.latest - delay, orientation.latest)
    shorter = min(wrench.latest - wrench.first, orientation.latest - orientation.first)
    begun_together = abs(wrench.first - orientation.first) <= shorter
    another = _another_unit(wrench, orientation)
    if end - start >= LEAST_COMMON * shorter and end >= start and not (begun_together and another):
        return
    common = "nothing" if end < start else f"only {end - start:.3g} s"
    behind = f", with a delay of {1e3 * delay:.3g} ms," if delay else ""
    remedy = "record both with one clock, or correct the stamps of one"
    if (wrench.first > UNIX) != (orientation.first > UNIX):
        remedy = "one clock counts from 1970 and one from the start, record both with one"
    raise InputError(
        f"{wrench.source}: the wrench goes from {_moment(wrench.first)} to {_moment(wrench.latest)}, the orientation "
        f"from {_moment(orientation.first)} to {_moment(orientation.latest)}{behind} and they have {common} in common: "
        f"{another or remedy}"
    )


LEAST_COMMON = 0.1
"""Of the shorter stream's time: with less the two do not belong together as they are stamped."""

UNIX = 1e9
"""s: a clock that shows more counts from 1970 (this is 2001)."""
UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}


def default_gap(t: Array) -> float:
    """The longest time between two rows at `t` (n,), s, that is no gap, where nobody states it."""
    steps = np.diff(t)
    return max(LEAST_GAP, GAP_IN_ROWS * float(np.median(steps))) if len(steps) else LEAST_GAP


def rate_of(t: Array) -> float | None:
    """Of rows at `t` (n,), s, in order, gaps apart, Hz; None where they tell none that can be."""
    steps = np.diff(t)
    steps = steps[steps <= default_gap(t)]
    passed = float(np.sum(steps))
    return len(steps) / passed if passed > 0.0 and RATE.least <= len(steps) / passed <= RATE.most else None


def spread_evenly(t: Array) -> Array:
    """Stamps (n,) of which several in a row are the same, as a clock of ms gives them at 4 kHz, spread evenly up to the
    next one.
    """
    new = np.flatnonzero(np.r_[True, np.diff(t) > 0.0][: len(t)])
    if len(new) in (len(t), 0, 1):
        return t
    count = np.diff(np.r_[new, len(t)])
    width = np.diff(t[new])
    width = np.minimum(np.r_[width, width[-1]], 2.0 * float(np.median(width)))
    within = np.arange(len(t)) - np.repeat(new, count)
    return np.asarray(t + within * np.repeat(width / count, count))


def at_pace(t: Array, values: Array) -> Array:
    """The stamps (n,), or those of messages that were sent at an even pace, some of them lost, and stamped as they
    came: where what they are then off scatters from one to the next, and the values (n, m) change more smoothly. An arm
    at 1 m/s whose stamps are 1 ms off seems to accelerate at 10 m/s^2.
    """
    steps = np.diff(t)
    period = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP_IN_ROWS * period) + 1
    parts = zip(np.split(t, gaps), np.split(values, gaps), strict=True)
    return np.concatenate([_at_pace(part, of_part, period) for part, of_part in parts])


def _at_pace(t: Array, values: Array, period: float) -> Array:
    """Of a stream without a gap."""
    from scipy.ndimage import uniform_filter1d

    if len(t) < FEWEST_AT_A_PACE:
        return t
    steps, near = np.diff(t), 2 * round(0.25 * PACED / period) + 1
    paced = []
    for shortest_loss in (GAP_IN_ROWS, 1.5):
        count = np.r_[0.0, np.cumsum(np.where(steps < shortest_loss * period, 1.0, np.round(steps / period)))]
        even = t[0] + np.polyval(np.polyfit(count, t - t[0], 1), count)
        late = t - even
        for _ in range(2):
            late = uniform_filter1d(late, near, mode="reflect")
        paced.append(even + late)

    def unsteady(t: Array) -> float:
        velocity = np.diff(values, axis=0) / np.diff(t)[:, None]
        return float((np.diff(velocity, axis=0) ** 2).sum())

    closest = min(paced, key=lambda stamps: float(((stamps - t) ** 2).sum()))
    off = t - closest
    scatters = np.sum(np.diff(off) ** 2) >= np.sum(off**2) and np.abs(uniform_filter1d(off, near)).max() <= off.std()
    return closest if scatters and np.diff(closest).min() > 0.0 and unsteady(closest) < unsteady(t) else t


def _moment(t: float) -> str:
    if t < UNIX:
        return f"{t:.10g} s"
    days = t / 86400.0
    return f"{t:.10g} s (Unix time, {np.datetime64(int(days), 'D')})" if days < 1e6 else f"{t:.10g} s"


def _another_unit(wrench: Stamps, orientation: Stamps) -> str:
    """Which stream lasts longer by the factor of a unit, and what to do; empty where none does."""
    spans = {stamps.stream: stamps.latest - stamps.first for stamps in (wrench, orientation)}
    longer, shorter = sorted(spans, key=lambda stream: -spans[stream])
    if spans[shorter] > 0.0:
        for factor, unit in UNITS.items():
            if 0.8 < spans[longer] / (factor * spans[shorter]) < 1.25:
                return (
                    f"the {longer}'s stamps look like {unit}, {factor:.0f} times as long, give them in s, or name "
                    f"their column t_{unit}"
                )
    return ""


def begins_anew(samples: Samples) -> bool:
    """Whether the times jump back anywhere, by more than late rows do."""
    return samples.t is not None and bool((np.diff(samples.t) < -SORTED_WITHIN).any())


def counted_on(samples: Samples) -> tuple[Samples, tuple[str, ...]]:
    """A stream in the order of its rows where its times begin anew, as of recordings in one file or a clock that was
    set back: they go on there, and rows that only repeat earlier ones are left out; notes say both.
    """
    t = samples.t
    if t is None or not begins_anew(samples):
        return samples, ()
    back = np.flatnonzero(np.diff(t) < -SORTED_WITHIN) + 1
    seen = _seen_before(np.column_stack([t, samples.wrench]))
    keep = np.ones(len(t), dtype=bool)
    for begin, end in zip(back, [*back[1:], len(t)], strict=True):
        news = np.flatnonzero(seen[begin:end] == 0)
        again = int(news[0]) if len(news) else end - begin
        keep[begin : begin + again] = again < FEWEST_AGAIN
    on, latest = t.copy(), -np.inf
    for part in np.split(np.arange(len(t)), back):
        if len(rows := part[keep[part]]):
            on[rows] += max(latest + APART - float(t[rows[0]]), 0.0) if np.isfinite(latest) else 0.0
            latest = float(on[rows].max())
    more = f", and {counted(len(back) - 1, 'more time')}" if len(back) > 1 else ""
    notes = [
        f"the times jump back at row {back[0] + 1}, by {t[back[0] - 1] - t[back[0]]:.3g} s{more}, as where recordings "
        "stand one after the other: counted on from there; of two tools cut the file there"
    ]
    if not keep.all():
        notes.append(f"{counted(int(np.sum(keep == 0)), 'row')} that repeat earlier ones to the last digit left out")
    return replace(samples, t=on).select(keep), tuple(notes)


def _seen_before(rows: Array) -> Array:
    """Whether each of (n, k) rows stands further above as well: (n,)."""
    first = np.unique(rows, axis=0, return_index=True)[1]
    seen = np.ones(len(rows), dtype=bool)
    seen[first] = False
    return seen
