"""Two streams onto one clock."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from contactwrench.errors import InputError
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.synchronize import Synchronized, synchronize, synchronized
from tests.support.moving import smooth_rotations
from tests.support.recordings import Array, generic_rotations

GAP = "in a gap of the orientation"


def _reasons(found: Synchronized) -> dict[int, str]:
    """Why a row of the wrench stream has no sample."""
    return {int(row): part.reason for part in found.left_out for row in part.rows}


def _streams(
    t: Array, at: Array, seed: int = 0, R: Array | None = None, wrench: Array | None = None, position: bool = False
) -> Streams:
    """Any readings at t (n,), and a slow motion at `at` (m,)."""
    rng = np.random.default_rng(seed)
    R = smooth_rotations(at, rng) if R is None else R
    readings = rng.normal(size=(len(t), 6)) if wrench is None else wrench
    where = np.stack([np.sin(at), np.cos(2.0 * at), at], axis=1) if position else None
    return Streams(WrenchStream(t, readings, "run.bag"), OrientationStream(at, R, where, "run.bag"))


def _regular(duration: float = 4.0) -> tuple[Array, Array]:
    return np.arange(0.0, duration, 0.002) + 0.3, np.arange(0.0, duration + 1.0, 0.01)


@pytest.mark.parametrize("delay", [0.0, 0.0123, -0.21])
def test_orientations_between_stamps_are_scipys(delay: float) -> None:
    t, at = _regular()
    streams = _streams(t, at, position=True)
    found = synchronize(streams, delay, delay_std=0.001)
    expected = Slerp(at, Rotation.from_matrix(streams.orientation.R_base_flange))(found.samples.t - delay)  # type: ignore[operator]
    assert np.allclose(found.samples.R_base_flange, expected.as_matrix(), rtol=0.0, atol=1e-14)
    for k in range(3):
        line = np.interp(t - delay, at, streams.orientation.position[:, k])  # type: ignore[index]
        assert np.allclose(found.samples.position[:, k], line, rtol=0.0, atol=1e-14)  # type: ignore[index]
    assert np.array_equal(found.samples.wrench, streams.wrench.wrench)
    assert (found.rows == np.arange(len(t))).all()
    assert (found.samples.delay, found.samples.delay_std) == (delay, 0.001)
    assert found.notes == ()
    assert found.left_out == ()


def test_nothing_is_extrapolated() -> None:
    t, at = np.arange(0.0, 3.0, 0.01) + 0.005, np.arange(1.0, 2.001, 0.01)
    found = synchronize(_streams(t, at))
    assert found.samples.t is not None
    assert found.samples.t.min() > 1.0
    assert found.samples.t.max() < 2.0
    assert found.notes == (
        "100 readings before the first orientation left out",
        "100 readings after the last orientation left out",
    )
    assert _reasons(found)[0] == "before the first orientation"
    assert _reasons(found)[299] == "after the last orientation"
    assert sorted([*found.rows, *_reasons(found)]) == list(range(300))


def test_a_reading_at_a_stamp_has_that_orientation_even_beside_a_gap() -> None:
    at = np.r_[np.arange(0.0, 1.0, 0.01), np.arange(1.5, 3.0, 0.01)]
    streams = _streams(at, at)
    found = synchronize(streams)
    assert len(found.rows) == len(at)
    assert np.allclose(found.samples.R_base_flange, streams.orientation.R_base_flange, rtol=0.0, atol=1e-15)


def test_gaps_of_the_orientation_are_named() -> None:
    t, at = _regular()
    at = at[(at < 1.2) | (at > 1.5)]
    found = synchronize(_streams(t, at))
    assert [part.reason for part in found.left_out] == [GAP]
    assert found.notes == ("no orientation from 1.190 s to 1.510 s: 159 readings left out",)
    assert synchronize(_streams(t, at), longest_gap=0.4).notes == ()


def test_the_limit_follows_the_spacing() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    at = np.arange(0.0, 20.0, 0.1)
    at = at[(at < 5.0) | (at > 5.45)]
    assert synchronize(_streams(t, at)).left_out[0].reason == "after the last orientation"
    at = at[(at < 5.0) | (at > 5.55)]
    assert synchronize(_streams(t, at)).left_out[-1].reason == GAP


def test_of_many_gaps_the_first_are_named() -> None:
    t, at = _regular(9.0)
    t, at = t + 0.001, at[np.arange(len(at)) % 100 < 85]
    notes = synchronize(_streams(t, at)).notes
    assert len(notes) == 6
    assert notes[0] == "no orientation from 0.840 s to 1.000 s: 80 readings left out"
    assert notes[-1] == "and 4 more of these, 320 readings left out"


def test_readings_that_are_not_numbers_are_left_out() -> None:
    t, at = _regular()
    wrench = np.ones((len(t), 6))
    wrench[[7, 9], [0, 5]] = np.nan, np.inf
    found = synchronize(_streams(t, at, wrench=wrench))
    assert _reasons(found) == {7: "the reading is not a number", 9: "the reading is not a number"}
    assert found.notes == ("2 readings that are not numbers left out",)


def test_a_turn_of_which_the_way_round_is_not_known_is_left_out() -> None:
    at = np.arange(0.0, 2.0, 0.05)
    angle = np.where(at < 1.0, 0.0, 2.0) + 0.1 * at
    R = Rotation.from_rotvec(angle[:, None] * [0.0, 0.6, 0.8]).as_matrix()
    found = synchronize(_streams(np.arange(0.0, 1.9, 0.01) + 0.001, at, R=R))
    assert [part.reason for part in found.left_out] == ["between two orientations more than 90 deg apart"]
    assert found.notes == (
        "the orientation turns by more than 90 deg from 0.950 s to 1.000 s, which way round is not known: 5 readings "
        "left out",
    )


def test_missing_readings_are_named() -> None:
    t, at = _regular()
    t = t[(t < 2.0) | (t > 2.4)]
    assert synchronize(_streams(t, at)).notes == ("no readings from 1.998 s to 2.402 s",)


def _complaint(streams: Streams, delay: float = 0.0) -> str:
    with pytest.raises(InputError) as caught:
        synchronize(streams, delay)
    return str(caught.value)


def test_late_messages_are_sorted() -> None:
    t, at = _regular()
    late = np.arange(len(t))
    late[100:110], late[110] = np.arange(101, 111), 100
    found = synchronize(_streams(t[late], at))
    assert found.notes == ("1 row of the wrench came out of order, by up to 20 ms: sorted by their stamps",)
    assert found.samples.t == pytest.approx(t, abs=0.0)
    assert (found.rows[100], found.rows[101]) == (110, 100)
    poses = np.arange(len(at))
    poses[[50, 51]] = 51, 50
    streams = _streams(t, at)
    swapped = OrientationStream(at[poses], streams.orientation.R_base_flange[poses])
    again = synchronize(Streams(streams.wrench, swapped))
    assert again.notes == ("1 row of the orientation came out of order, by up to 10 ms: sorted by their stamps",)
    assert np.array_equal(again.samples.R_base_flange, synchronize(streams).samples.R_base_flange)


def test_repeated_stamps_count() -> None:
    t, at = _regular()
    t = np.floor(t * 250.0) / 250.0
    streams = _streams(t, at)
    found = synchronize(streams)
    assert found.notes == ("1000 rows of the wrench repeat the stamp before: all of them count",)
    assert len(found.rows) == len(t)
    R = streams.orientation.R_base_flange
    twice = OrientationStream(np.repeat(at, 2), np.stack([np.roll(R, 7, axis=0), R], axis=1).reshape(-1, 3, 3))
    again = synchronize(Streams(streams.wrench, twice))
    assert np.array_equal(again.samples.R_base_flange, found.samples.R_base_flange)
    assert again.notes[1] == "500 rows of the orientation repeat the stamp before: the last of each stamp counts"


def test_a_clock_that_was_set_back_is_named() -> None:
    t, at = _regular()
    back = t.copy()
    back[1203:] -= 0.212
    assert _complaint(_streams(back, at)) == (
        "run.bag: row 1204 of the wrench is stamped 0.21 s before row 1203, which is at 2.704 s of the recording; "
        "expected stamps in order within 0.1 s: cut the recording there, the clock was set back or it was started again"
    )
    ahead = at.copy()
    ahead[40] += 3600.0
    assert _complaint(_streams(t, ahead)).startswith(
        "run.bag: row 42 of the orientation is stamped 3.6e+03 s before row 41, which is at 3600.400 s of the recording"
    )


def test_a_stamp_that_is_no_number_is_named() -> None:
    t, at = _regular()
    t[5] = np.nan
    with pytest.raises(InputError) as caught:
        synchronize(_streams(t, at))
    assert str(caught.value) == ("run.bag: row 6 of the wrench is stamped nan, expected seconds: leave such rows out")
    assert caught.value.row == 5


def test_streams_that_do_not_belong_together_are_refused() -> None:
    t, at = _regular()
    end = "the orientation from 0 s to 4.99 s and they have nothing in common"
    assert _complaint(_streams(t + 1.7e9, at)) == (
        "run.bag: the wrench goes from 1700000000 s (Unix time, 2023-11-14) to 1700000004 s (Unix time, 2023-11-14), "
        f"{end}: one clock counts from 1970 and one from the start, record both with one"
    )
    assert _complaint(_streams(t * 1e3 + 300.0, at)) == (
        f"run.bag: the wrench goes from 600 s to 4598 s, {end}: the wrench's stamps look like ms, 1000 times as long, "
        "give them in s, or name their column t_ms"
    )
    assert _complaint(_streams(t + 20.0, at)).endswith(
        f"{end}: record both with one clock, or correct the stamps of one"
    )
    assert "and they have only 0.19 s in common" in _complaint(_streams(t + 4.5, at))
    assert ", with a delay of 9e+03 ms, and they have nothing in common" in _complaint(_streams(t, at), 9.0)


def test_streams_without_times_are_refused() -> None:
    t, at = _regular()
    assert _complaint(_streams(0.0 * t, at)) == (
        "run.bag: all 2000 rows of the wrench are stamped 0 s, expected the time of each: take the times at which they "
        "were recorded"
    )
    assert _complaint(_streams(t[:0], at)) == "run.bag: found no readings, expected a stream of them: add it"
    assert _complaint(_streams(t, at[:0], R=np.empty((0, 3, 3)))) == (
        "run.bag: found no orientations, expected a stream of them: add it"
    )
    assert _complaint(_streams(t, at[:1])) == (
        "run.bag: found 1 orientation, expected 2 or more to interpolate between"
    )


def test_where_gaps_take_most_it_is_refused() -> None:
    t, at = _regular()
    at = at[(at < 0.5) | (at > 4.0)]
    assert _complaint(_streams(t, at)) == (
        "run.bag: 1759 of 2000 readings lie in gaps of the orientation longer than 0.05 s (the first from 0.490 s to "
        "4.010 s), expected at most half: record the orientation more often, or state a longer gap"
    )
    R = generic_rotations(500)
    assert "lie between orientations more than 90 deg apart, where the way round is not known" in _complaint(
        _streams(*_regular(), R=R)
    )


def test_where_no_reading_is_a_number_it_is_refused() -> None:
    t, at = _regular()
    assert _complaint(_streams(t, at, wrench=np.full((2000, 6), np.nan))) == (
        "run.bag: none of 2000 readings has an orientation (2000 the reading is not a number), expected both at the "
        "same time: record them together"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"delay": np.nan}, "delay is nan, expected s"),
        ({"longest_gap": 0.0}, "longest_gap is 0.0, expected s above 0"),
    ],
)
def test_arguments_that_mean_nothing_are_refused(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        synchronize(_streams(*_regular()), **arguments)
    assert str(caught.value) == words


def test_orientations_are_put_at_their_pace() -> None:
    """Sent at 125 Hz, some of them lost, and stamped as they came: by the mean of a second the stamps are even."""
    rng = np.random.default_rng(6)
    sent = np.arange(0.0, 8.0, 0.008)
    R, got = smooth_rotations(sent, rng), rng.random(len(sent)) > 0.02
    came = sent + 0.003 + 5e-4 * rng.normal(size=len(sent))
    t = np.arange(1.0, 7.0, 0.002)
    true = Slerp(sent + 0.003, Rotation.from_matrix(R))(t)
    streams = _streams(t, came[got], R=R[got])

    def off(found: Synchronized) -> float:
        turn = true[found.rows].inv() * Rotation.from_matrix(found.samples.R_base_flange)
        return float(np.sqrt(np.mean(turn.magnitude() ** 2)))

    whole = synchronize(streams, at_their_pace=True)
    assert off(whole) < 0.25 * off(synchronize(streams))
    parts = [
        Streams(streams.wrench.select(streams.wrench.t // 2.0 == k), streams.orientation.select(came[got] // 2.0 == k))
        for k in range(4)
    ]
    rows = np.concatenate([part.samples.R_base_flange for part in synchronized(parts, at_their_pace=True)])
    assert np.array_equal(rows, whole.samples.R_base_flange)


# Poses that were held


@settings(max_examples=20, deadline=None)
@given(hold=st.floats(0.008, 0.1), seed=st.integers(0, 1000))
def test_a_pose_that_was_held_counts_where_it_came_first(hold: float, seed: int) -> None:
    t = np.arange(0.0, 6.0, 0.001)
    updates = np.arange(0.0, 7.0, hold)
    R = smooth_rotations(updates, np.random.default_rng(seed), angle=0.3)
    shown = np.searchsorted(updates, t + 1e-9, "right") - 1
    as_updated = synchronize(_streams(t[:5000], updates, R=R), longest_gap=0.2)
    held = synchronize(_streams(t[:5000], t, R=R[shown]), longest_gap=0.2)
    angle = Rotation.from_matrix(np.swapaxes(as_updated.samples.R_base_flange, 1, 2) @ held.samples.R_base_flange)
    late = np.linalg.norm(np.diff(R, axis=0), axis=(1, 2)).max() / np.sqrt(2.0) / hold * 0.0011
    assert angle.magnitude().max() < late  # shown at the next ms; half a hold would be much more


def test_an_arm_at_rest_is_no_pose_that_was_held() -> None:
    at = np.arange(0.0, 5.0, 0.01)
    angle = np.where(at < 2.0, 0.0, at - 2.0)
    R = Rotation.from_rotvec(angle[:, None] * [0.0, 0.6, 0.8]).as_matrix()
    t = np.arange(0.0, 4.5, 0.002)
    found = Rotation.from_matrix(synchronize(_streams(t, at, R=R)).samples.R_base_flange).magnitude()
    assert found == pytest.approx(np.maximum(t - 2.0, 0.0), abs=1e-9)


# Batches


def _joined(parts: list[Synchronized]) -> tuple[Array, Array, Array, dict[int, str], tuple[str, ...]]:
    return (
        np.concatenate([part.samples.wrench for part in parts]),
        np.concatenate([part.samples.R_base_flange for part in parts]),
        np.concatenate([part.rows for part in parts]),
        {row: reason for part in parts for row, reason in _reasons(part).items()},
        parts[-1].notes,
    )


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    cuts=st.lists(st.floats(0.0, 1.0), max_size=7),
    out_of_step=st.floats(-0.2, 0.2),
    delay=st.floats(-0.3, 0.3),
    held=st.booleans(),
)
def test_batches_give_what_the_whole_gives(
    seed: int, cuts: list[float], out_of_step: float, delay: float, held: bool
) -> None:
    rng = np.random.default_rng(seed)
    t, at = np.arange(0.0, 3.0, 0.005), np.arange(-0.2, 2.9, 0.01)
    R = smooth_rotations(at, rng)
    if held:
        R = np.repeat(R[::4], 4, axis=0)[: len(at)]
    R[100:150] = R[100]
    at, R = (values[(at < 2.0) | (at > 2.2)] for values in (at, R))
    t = t + np.where(rng.random(len(t)) < 0.05, rng.uniform(-0.09, 0.0, len(t)), 0.0)
    at = at + np.where(rng.random(len(at)) < 0.05, rng.uniform(-0.09, 0.0, len(at)), 0.0)
    t[40] = t[41]
    wrench = rng.normal(size=(len(t), 6))
    wrench[rng.random(len(t)) < 0.02, 3] = np.nan
    where = rng.normal(size=(len(at), 3))
    whole = Streams(WrenchStream(t, wrench), OrientationStream(at, R, where if seed % 2 else None))
    shares = np.array([0.0, *sorted(cuts), 1.0])
    first = np.rint(shares * len(t)).astype(int)
    second = np.rint(np.clip(shares + out_of_step * (shares % 1.0 > 0.0), 0.0, 1.0) * len(at)).astype(int)
    second = np.maximum.accumulate(second)
    batches = [
        Streams(
            WrenchStream(t[a:b], wrench[a:b]),
            OrientationStream(at[c:d], R[c:d], where[c:d] if seed % 2 else None),
        )
        for (a, b), (c, d) in zip(pairwise(first), pairwise(second), strict=True)
    ]
    expected = _joined([synchronize(whole, delay, longest_gap=0.05)])
    parts = list(synchronized(batches, delay, longest_gap=0.05))
    assert len(parts) == len(batches)
    found = _joined(parts)
    for one, other in zip(found[:3], expected[:3], strict=True):
        assert one.shape == other.shape
        assert (one == other).all()
    assert found[3:] == expected[3:]


def test_a_first_batch_in_which_a_pose_is_held_waits_for_the_next() -> None:
    t, at = np.arange(0.0, 1.0, 0.01), np.arange(0.0, 1.0, 0.02)
    R = np.repeat(smooth_rotations(at, np.random.default_rng(0))[::6], 6, axis=0)[: len(at)]
    wrench = np.random.default_rng(1).normal(size=(len(t), 6))
    whole = synchronize(Streams(WrenchStream(t, wrench), OrientationStream(at, R)), longest_gap=0.3)
    for cut in (0.15, 0.18, 0.21):
        parts = [
            Streams(WrenchStream(t[some], wrench[some]), OrientationStream(at[poses], R[poses]))
            for some, poses in ((t < cut, at < cut), (t >= cut, at >= cut))
        ]
        found = _joined(list(synchronized(parts, longest_gap=0.3)))
        assert (found[0] == _joined([whole])[0]).all()


def test_batches_hold_back_little() -> None:
    t, at = np.arange(0.0, 20.0, 0.002), np.arange(0.0, 20.0, 0.01)
    whole = _streams(t, at)
    batches = (
        Streams(
            WrenchStream(t[k : k + 500], whole.wrench.wrench[k : k + 500]),
            OrientationStream(at[k // 5 : k // 5 + 100], whole.orientation.R_base_flange[k // 5 : k // 5 + 100]),
        )
        for k in range(0, len(t), 500)
    )
    held_back = 0
    for k, part in enumerate(synchronized(batches)):
        held_back += 500 - len(part.rows)
        assert held_back < 0.15 / 0.002 or k == 19
