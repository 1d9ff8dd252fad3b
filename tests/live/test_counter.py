"""Counters that wrap, skip, repeat, run backwards and begin anew."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactwrench.live.counter import Counter
from contactwrench.live.source import Batch, NoteKind

PERIOD = 1e-3


def taken(
    counts: list[int], modulus: int | None = 1 << 16, step: int = 1, gaps: dict[int, float] | None = None
) -> tuple[list[float | None], list[tuple[int, NoteKind, int]]]:
    """Device times of counts that come a period apart, or `gaps[k]` s before count k; notes with where they came."""
    counter = Counter(PERIOD, modulus, step)
    arrival, times, notes = 100.0, [], []
    for k, count in enumerate(counts):
        arrival += (gaps or {}).get(k, PERIOD * step)
        batch = Batch()
        times.append(counter.take(count, arrival, batch))
        notes += [(k, note.kind, note.number) for note in batch.notes]
    return times, notes


@given(st.integers(0, (1 << 16) - 1), st.integers(2, 300))
def test_a_wrap_is_no_event(start: int, number: int) -> None:
    times, notes = taken([(start + k) % (1 << 16) for k in range(number)])
    assert notes == []
    assert times == pytest.approx([PERIOD * k for k in range(number)])


@given(st.integers(0, (1 << 16) - 1), st.integers(1, 200_000))
def test_a_loss_is_counted_also_over_wraps(start: int, missing: int) -> None:
    after = (start + 1 + missing + 1) % (1 << 16)
    counts = [start, (start + 1) % (1 << 16), after]
    times, notes = taken(counts, gaps={2: PERIOD * (missing + 1)})
    assert notes == [(2, NoteKind.LOST, missing)]
    assert times[2] == pytest.approx(PERIOD * (missing + 2))


def test_a_loss_behind_a_stall_is_a_loss() -> None:
    """5 s of silence, then what waited, then a gap that fell into the silence."""
    counts = [*range(100), *range(100, 600), *range(4_900, 5_000)]
    _, notes = taken(counts, gaps={100: 5.0, **dict.fromkeys(range(101, 601), 0.0)})
    assert notes == [(600, NoteKind.LOST, 4_300)]


def test_a_repeated_count_is_no_sample() -> None:
    times, notes = taken([7, 8, 8, 9])
    assert times == [0.0, PERIOD, None, 2 * PERIOD]
    assert notes == [(2, NoteKind.REPEATED, 1)]


@pytest.mark.parametrize("late", [[3], [3, 4], [0]])
def test_late_packets_are_out_of_order(late: list[int]) -> None:
    counts = [k for k in range(10) if k not in late]
    place = counts.index(6) + 1
    times, notes = taken([*counts[:place], *late, *counts[place:]])
    assert [note for note in notes if note[1] == NoteKind.DISORDERED] == [
        (place + k, NoteKind.DISORDERED, 1) for k in range(len(late))
    ]
    assert NoteKind.RESTARTED not in [kind for _, kind, _ in notes]
    fresh = [time for time in times if time is not None]
    assert fresh == sorted(fresh)
    assert fresh[-1] == pytest.approx(PERIOD * (9 - counts[0]))


@given(
    st.sampled_from([None, 1 << 16, 1 << 32]),
    st.integers(2, 60_000),
    st.integers(0, 20),
    st.sampled_from([PERIOD, 0.3, 3.0]),
)
def test_a_restart_is_seen_within_three_samples(modulus: int | None, last: int, first: int, silence: float) -> None:
    """Wherever it was, and though it does not count from 0; within three of where it was nobody can tell."""
    if last - first < 3:
        return
    before = [last - 1, last]
    times, notes = taken([*before, *range(first, first + 50)], modulus, gaps={2: silence})
    kinds = [kind for _, kind, _ in notes]
    if modulus == 1 << 16 and (first - last) % modulus * PERIOD <= 1.5 * silence + 0.5:
        return  # as far ahead as one that lost samples over a wrap
    assert kinds.count(NoteKind.RESTARTED) == 1
    assert sum(time is None for time in times) <= 2 + kinds.count(NoteKind.REPEATED)
    assert set(kinds) <= {NoteKind.RESTARTED, NoteKind.DISORDERED, NoteKind.REPEATED}
    fresh = [time for time in times if time is not None]
    assert all(a < b for a, b in pairwise(fresh))


def test_a_jump_ahead_of_time_is_another_start() -> None:
    _, notes = taken([5, 6, 30_000, 30_001])
    assert notes == [(2, NoteKind.RESTARTED, 1)]


@given(st.lists(st.integers(0, (1 << 16) - 1), min_size=1, max_size=60), st.sampled_from([None, 1 << 16]))
def test_time_never_runs_backwards(counts: list[int], modulus: int | None) -> None:
    fresh = [time for time in taken(counts, modulus)[0] if time is not None]
    assert all(a < b for a, b in pairwise(fresh))


@given(st.lists(st.integers(-400, 400), min_size=2, max_size=60))
def test_steps_that_jitter_lose_nothing(jitter: list[int]) -> None:
    """A robot's stamps in microseconds, 2 ms apart give or take 0.4 ms."""
    counts = [2_000 * k + each for k, each in enumerate(jitter)]
    counter, batch = Counter(1e-6, step=2_000), Batch()
    times = [counter.take(count, 2e-3 * k, batch) for k, count in enumerate(counts)]
    assert batch.notes == []
    assert times == pytest.approx([1e-6 * (count - counts[0]) for count in counts])


def test_a_slower_device_than_it_says_loses_nothing() -> None:
    _, notes = taken([k % (1 << 16) for k in range(70_000)], gaps=dict.fromkeys(range(70_000), 4 * PERIOD))
    assert notes == []
