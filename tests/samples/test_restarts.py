"""Streams whose times begin anew, or are no seconds: in the order of their rows, and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import contactwrench as cw
from contactwrench.recording.options import AS_USUAL
from contactwrench.recording.read import read_samples
from contactwrench.samples.timestamps import counted_on
from tests.support.world import Array

NAMES = "t,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw"
ZERO = np.array([1.0, -2.0, 3.0, 0.1, 0.2, 0.3])


def rows(seed: int, weight: float, rate: float = 50.0) -> Array:
    """An arm that stops for 2 s at each of ten orientations, 2 s apart: t, wrench, quaternion."""
    rng = np.random.default_rng(seed)
    stops = Rotation.random(10, random_state=rng)
    t = np.arange(0.0, 38.0, 1.0 / rate)
    way = np.clip((t % 4.0 - 2.0) / 2.0, 0.0, 1.0)
    turned = Slerp(np.arange(10), stops)(np.minimum(t // 4.0 + way**2 * (3.0 - 2.0 * way), 9.0))
    force = turned.inv().apply([0.0, 0.0, -weight])
    wrench = np.hstack([force, np.cross([0.01, 0.0, 0.05], force)])
    noise = rng.normal(size=(len(t), 6)) * [0.05, 0.05, 0.05, 2e-3, 2e-3, 2e-3]
    return np.column_stack([t, wrench + ZERO + noise, turned.as_quat()])


def read(path: Path, table: Array) -> tuple[cw.Samples, list[str]]:
    notes: list[str] = []
    np.savetxt(path, table, delimiter=",", header=NAMES, comments="", fmt="%.12g")
    return read_samples(path, AS_USUAL, tell=notes.append), notes


def test_two_tools_in_one_file_whose_times_begin_anew_are_told_apart(tmp_path: Path) -> None:
    samples, notes = read(tmp_path / "both.csv", np.vstack([rows(1, 10.0), rows(2, 9.7)]))
    assert len(notes) == 1
    assert notes[0].startswith("the times jump back at row 1901, by 38 s")
    assert samples.t is not None
    assert (np.diff(samples.t) > 0.0).all()
    calibration = cw.calibrate(samples)
    assert calibration.verdict == "weak"
    assert any("after the first 10 poses that count" in text for text in calibration.warnings)
    arrays = cw.Samples(samples.wrench, samples.R_base_flange, np.tile(rows(1, 1.0)[:, 0], 2))
    assert cw.calibrate(arrays).verdict == "weak"


def test_one_recording_written_twice_counts_once(tmp_path: Path) -> None:
    once = rows(1, 10.0)
    samples, notes = read(tmp_path / "twice.csv", np.vstack([once, once]))
    assert len(samples) == len(once)
    assert notes[-1] == "1900 rows that repeat earlier ones to the last digit left out"
    assert cw.calibrate(samples).std["weight"] == pytest.approx(cw.calibrate(counted_on(samples)[0]).std["weight"])


def test_a_clean_recording_and_late_rows_are_left_as_they_are(tmp_path: Path) -> None:
    table = rows(1, 10.0)
    table[100, 0] -= 0.03
    samples, notes = read(tmp_path / "late.csv", table)
    assert notes == []
    assert counted_on(samples)[0] is samples


@pytest.mark.parametrize(("unit", "digits"), [(3600.0, 12), (86400.0, 12), (np.inf, 0), (30.0, 0)])
def test_a_moving_arm_whose_times_are_no_seconds_is_refused(tmp_path: Path, unit: float, digits: int) -> None:
    table = rows(1, 10.0, rate=10.0)
    table[:, 0] = np.round(table[:, 0] / unit, digits) * (30.0 if unit == 30.0 else 1.0)  # as of single precision
    with pytest.raises(cw.ContactWrenchError, match=r"found an arm that turns by \d+ deg in .* s, expected times in s"):
        cw.calibrate(read(tmp_path / "hours.csv", table)[0])
    table[:, 0] = 0.0  # a table of few poses may have no times to speak of
    assert cw.calibrate(read(tmp_path / "poses.csv", table[5::40])[0]).weight == pytest.approx(10.0, abs=0.5)


def test_an_orientation_that_comes_more_rarely_than_readings_turned_since_it_came(tmp_path: Path) -> None:
    """At 4 Hz beside readings at 125 Hz, of an arm that turns by 19 deg in between: no row of 8 ms has such a turn."""
    t = np.arange(0.0, 20.0, 0.008)
    turned = Rotation.from_euler("x", 76.0 * (t - t % 0.248)[:, None], degrees=True) * Rotation.from_euler("y", 0.7)
    wrench = np.hstack([turned.inv().apply([0.0, 0.0, -10.0]), np.zeros((len(t), 3))])
    wrench += ZERO + np.random.default_rng(1).normal(size=(len(t), 6)) * 0.05
    table = np.column_stack([t, wrench, turned.as_quat()])
    assert cw.calibrate(read(tmp_path / "rare.csv", table)[0], "mount").weight == pytest.approx(10.0, abs=0.1)


def test_a_header_in_the_middle_is_named(tmp_path: Path) -> None:
    path = tmp_path / "appended.csv"
    read(path, rows(1, 10.0))
    path.write_text(path.read_text() * 2)
    with pytest.raises(cw.ContactWrenchError, match="row 1902, column t: found the header again"):
        cw.read(path)
