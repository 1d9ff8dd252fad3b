"""Rows that were handed on many at a time: spread evenly again, and nothing else is taken for such."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.assess.weigh import weigh
from contactwrench.errors import InputError
from contactwrench.samples.bursts import bursts_in, spread
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.synchronize import synchronize, synchronized
from tests.support.brands import stop_and_go
from tests.support.moving import smooth_rotations
from tests.support.recordings import MATRIX, WRENCH, Array, csv_text, run, written
from tests.support.rigs import example


def handed_on(t: Array, each: float, rng: np.random.Generator, late: float = 0.002, within: float = 5e-5) -> Array:
    """Stamps of rows taken at t (n,), s, out of a buffer that is emptied `each` s, up to `late` s too late."""
    burst = np.floor(t / each)
    first = np.searchsorted(burst, burst)
    delayed = rng.uniform(0.0, late, int(burst[-1]) + 1)[burst.astype(int)]
    return np.asarray((burst + 1.0) * each + delayed + (np.arange(len(t)) - first) * within)


@pytest.mark.parametrize("rate", [125.0, 1000.0, 7000.0])
@pytest.mark.parametrize("each", [0.0413, 0.5])
def test_they_are_as_they_were_taken(rate: float, each: float) -> None:
    rng = np.random.default_rng(3)
    t = np.arange(int(12.0 * rate)) / rate
    stamps = handed_on(t, each, rng, within=1e-5)
    bursts = bursts_in(stamps)
    assert bursts is not None
    assert bursts.rows == pytest.approx(each * rate, abs=1.0)
    late = spread(stamps, bursts) - t
    assert np.diff(spread(stamps, bursts)).min() > 0.0
    whole = (t > each) & (t < 12.0 // each * each)
    assert np.ptp(late[whole]) < 0.003 + 2.0 / rate  # how late each burst was, and a row that came with the next


ORDINARY: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "even": lambda t, rng: t,
    "jitter": lambda t, rng: t + rng.uniform(0.0, 0.4, len(t)) * np.diff(t)[0],
    "a clock of a ms": lambda t, rng: np.floor(1e3 * t / 4.0) / 1e3,
    "pairs": lambda t, rng: t[np.arange(len(t)) // 2 * 2] + 1e-5 * (np.arange(len(t)) % 2),
    "each message twice": lambda t, rng: np.repeat(t[::20], 2) + 2e-4 * (np.arange(2 * len(t[::20])) % 2),
    "a clock of 10 ms": lambda t, rng: np.floor(t / 0.01) * 0.01,
    "a clock of 15.6 ms": lambda t, rng: np.floor(t / 0.015625) * 0.015625,
    "a tenth is lost": lambda t, rng: t[rng.random(len(t)) > 0.1],
    "gaps": lambda t, rng: t[np.sin(7.0 * t) > -0.3],
    "stops recorded by themselves": lambda t, rng: t + 4.0 * np.floor(t),
    "readings of each pose at once": lambda t, rng: 3.0 * np.floor(1e3 * t / 20.0) + t,
    "irregular": lambda t, rng: np.sort(rng.uniform(0.0, t[-1], len(t))),
    "few": lambda t, rng: t[:12],
    "none": lambda t, rng: t[:0],
    "one time": lambda t, rng: 0.0 * t,
    "backwards": lambda t, rng: t[::-1],
    "no time": lambda t, rng: np.where(t > 1.0, np.nan, t),
}


@pytest.mark.parametrize("kind", ORDINARY)
def test_nothing_else_is_a_burst(kind: str) -> None:
    t = np.arange(8000) / 1000.0
    stamps = ORDINARY[kind](t, np.random.default_rng(5))
    assert bursts_in(stamps) is None
    assert spread(stamps, None) is stamps


@pytest.mark.parametrize("row", [0, 1500, 2700])
def test_what_cannot_be_put_in_order_is_refused_as_ever(row: int) -> None:
    rng = np.random.default_rng(6)
    t = np.arange(3000) / 100.0
    R = smooth_rotations(t, rng)
    stamps = handed_on(t, 0.2, rng)
    for bad in (np.nan, np.inf):
        wrong = np.r_[stamps[:row], bad, stamps[row + 1 :]]
        streams = Streams(WrenchStream(wrong, rng.normal(size=(3000, 6))), OrientationStream(t, R))
        with pytest.raises(InputError, match=f"row {row + 1} of the wrench is stamped {bad}, expected seconds"):
            synchronize(streams)
    back = np.r_[stamps[: row + 7], stamps[row + 7 :] - 0.4]
    streams = Streams(WrenchStream(back, rng.normal(size=(3000, 6))), OrientationStream(t, R))
    with pytest.raises(InputError, match=f"row {row // 20 * 20 + 21} of the wrench|row {row + 8} of the wrench"):
        synchronize(streams)


def test_rows_that_come_evenly_later_stay() -> None:
    """In one piece and in batches; memory is held for no more than a burst."""
    rng = np.random.default_rng(9)
    t = np.r_[np.arange(1000) / 100.0, 10.0 + np.arange(500) / 25.0]
    stamps = np.r_[handed_on(t[:1000], 0.2, rng), t[1000:] + 0.22]
    R = smooth_rotations(t, rng)
    whole = Streams(WrenchStream(stamps, rng.normal(size=(1500, 6))), OrientationStream(t, R))
    one = synchronize(whole)
    assert one.samples.t is not None
    late = one.samples.t - t[one.rows]
    assert late[one.rows >= 1000] == pytest.approx(0.22)
    assert np.ptp(late[(one.rows >= 20) & (one.rows < 980)]) < 0.003 + 0.01  # as above
    cuts = [slice(begin, begin + 70) for begin in range(0, 1500, 70)]
    many = list(synchronized(Streams(whole.wrench.select(cut), whole.orientation.select(cut)) for cut in cuts))
    times = np.concatenate([part.samples.t for part in many if part.samples.t is not None])
    assert times == pytest.approx(one.samples.t)
    assert max(len(part.rows) for part in many[14:]) < 150


@settings(max_examples=6)
@given(st.lists(st.integers(0, 900), max_size=6), st.booleans(), st.integers(0, 99))
def test_in_batches_as_in_one(cuts: list[int], of_poses: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t, at = np.arange(900) / 100.0, np.arange(900) / 100.0 - 0.3
    R = smooth_rotations(at, rng)
    stamps, poses = handed_on(t, 0.2, rng), handed_on(at + 0.3, 0.1, rng, 0.0) - 0.3 if of_poses else at
    whole = Streams(WrenchStream(stamps, rng.normal(size=(900, 6))), OrientationStream(poses, R))
    edges = np.r_[0, np.sort(np.array(cuts, dtype=int)), 900]
    parts = [
        Streams(whole.wrench.select(slice(a, b)), whole.orientation.select(slice(a, b))) for a, b in pairwise(edges)
    ]
    one, many = synchronize(whole), list(synchronized(parts))
    rows = np.concatenate([part.rows for part in many])
    assert (rows == one.rows).all()
    assert np.concatenate([part.samples.t for part in many if part.samples.t is not None]) == pytest.approx(
        one.samples.t
    )
    assert np.allclose(
        np.concatenate([part.samples.R_base_flange for part in many]), one.samples.R_base_flange, rtol=1e-6, atol=0.0
    )
    assert many[-1].notes[: 1 + of_poses] == one.notes[: 1 + of_poses]
    said = ["the wrench came in bursts of 20 rows each 200 ms", "the orientation came in bursts of 10 rows each 100 ms"]
    for note, begin in zip(one.notes, said[: 1 + of_poses], strict=False):
        assert note == f"{begin}: spread evenly between them"


@cache
def calibrated_as_it_came(folder: Path, each: float | None) -> cw.Calibration:
    """From two files, whose wrench came evenly, or in bursts `each` s."""
    rig, _, rng = example(7)
    went = stop_and_go(rig, rng, 250.0)
    poses = np.column_stack([went.t, went.R_base_flange.reshape(-1, 9)])[::2]
    pose_file = written(folder, csv_text(("t", *MATRIX), poses), "poses.csv")
    t = went.t if each is None else handed_on(went.t, each, rng)
    path = written(folder, csv_text(("t", *WRENCH), np.column_stack([t, went.wrench])), "wrench.csv")
    return cw.calibrate(cw.read(path, pose_file=pose_file), "mount")


def test_a_recording_is_calibrated_as_if_it_had_come_evenly(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Two files; the buffer adds the time in which it is emptied, and half of what it is late, to the delay."""
    each = 0.5
    even = calibrated_as_it_came(tmp_path_factory.getbasetemp(), None)
    bursts = calibrated_as_it_came(tmp_path_factory.getbasetemp(), each)
    assert bursts.verdict == even.verdict
    assert pytest.approx(even.B, abs=0.003) == bursts.B
    assert bursts.delay is not None
    assert even.delay is not None
    emptied = 5e-5 * (each * 250.0 - 1.0) + 0.001 + 0.002  # the last row of a burst was taken 4 ms before the next
    assert bursts.delay - even.delay == pytest.approx(emptied, abs=0.0025)


@pytest.mark.parametrize("each", [0.2, 0.5])
def test_arrays_are_verified_weighed_and_given_a_new_zero_as_even_ones_are(each: float) -> None:
    rig, _, rng = example(8)
    went = stop_and_go(rig, rng, 100.0)
    even = cw.Samples(went.wrench, went.R_base_flange, went.t)
    bursts = replace(even, t=handed_on(went.t, each, rng))
    known = cw.calibrate(even, "mount")
    assert verify(known, bursts).passed
    assert len(verify(known, bursts).residuals) == len(verify(known, even).residuals)
    assert weigh(known, bursts).mass == pytest.approx(weigh(known, even).mass, abs=weigh(known, even).mass_std)
    anew = [cw.calibrate(samples, prior=known).bias for samples in (even, bursts)]
    assert anew[1] == pytest.approx(anew[0], abs=1e-2)


def test_a_table_of_rows_that_have_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Calibrated as if it had come evenly; compensated, the stamps stay as they were written."""
    rig, _, rng = example(8)
    went = stop_and_go(rig, rng, 100.0)
    stamps = handed_on(went.t, 0.2, rng)
    rows = np.column_stack([stamps, went.wrench, went.R_base_flange.reshape(-1, 9)])
    path, tool = written(tmp_path, csv_text(("t", *WRENCH, *MATRIX), rows), "run.csv"), tmp_path / "tool.json"
    done = run(capsys, "calibrate", path, "--model", "mount", "-o", tool)
    assert done.status == 0
    assert "Note: the recording came in bursts of 20 rows each 200 ms: spread evenly between them" in done.err
    known = cw.Calibration.load(tool)
    as_arrays = cw.calibrate(replace(cw.read(path), t=stamps), "mount")
    assert pytest.approx(known.B, abs=1e-9) == as_arrays.B
    even = cw.calibrate(replace(cw.read(path), t=went.t), "mount")
    assert pytest.approx(known.B, abs=0.01) == even.B
    left = []
    for times, more in ((stamps, "--contact"), (stamps, "--lowpass=5"), (went.t, "--lowpass=5")):
        rows[:, 0], out = times, tmp_path / "contact.csv"
        path = written(tmp_path, csv_text(("t", *WRENCH, *MATRIX), rows), "run.csv")
        assert run(capsys, "compensate", path, "-c", tool, more, "--force", "-o", out).status == 0
        read = np.loadtxt(out, delimiter=",", skiprows=1, usecols=range(4))
        assert read[:, 0] == pytest.approx(times, abs=1e-6)
        left.append(np.sqrt(np.nanmean(read[:, 1:4] ** 2)))
    assert left[1] == pytest.approx(left[2], rel=0.1)
