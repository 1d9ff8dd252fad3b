"""The benchmarks run, judge what they say they judge, and keep their figures. Their targets are for `make bench`."""

from __future__ import annotations

import csv
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Executor, Future
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from benchmarks import auto, dirty, live
from benchmarks.accuracy import NOISE, TABLE_V, UNSEEN
from benchmarks.measured import ranks
from benchmarks.record import HEADER, append
from benchmarks.table import Row
from contactwrench.compensate.contact_wrenches import Contact
from tests.support.measured_sets import measured_sets
from tests.support.poses import POSE_SETS
from tests.support.world import bound_on_prediction, readings


class Here(Executor):
    """Runs what is submitted at once, in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


def test_a_truth_is_tilted_as_it_says() -> None:
    rng = np.random.default_rng(1)
    both = auto.Cell(10.0, "6 spread", auto.TRUTHS[3], noise_given=False).rig(rng)
    assert both.weight == 10.0
    assert np.rad2deg(np.arccos(both.R_flange_sensor[2, 2])) == pytest.approx(2.0)
    assert np.rad2deg(np.arccos(-both.down[2])) == pytest.approx(1.0)
    assumed = auto.Cell(2.0, "6 spread", auto.TRUTHS[0], noise_given=False).rig(rng)
    assert np.array_equal(assumed.R_flange_sensor, TABLE_V.R_flange_sensor)


def test_tilts_drawn_from_the_priors_have_their_std() -> None:
    rng = np.random.default_rng(2)
    rigs = [auto.Cell(10.0, "6 spread", None, noise_given=False).rig(rng) for _ in range(2000)]
    mount = np.rad2deg(np.std([rig.R_flange_sensor[:2, 2] for rig in rigs], axis=0))
    base = np.rad2deg(np.std([rig.down[:2] for rig in rigs], axis=0))
    assert mount == pytest.approx([1.41, 1.41], rel=0.06)
    assert base == pytest.approx([0.71, 0.71], rel=0.06)


def test_every_rung_is_compared_on_the_same_readings() -> None:
    """Each column is what a call for that model alone gives."""
    cell = auto.Cell(10.0, "6 spread", auto.TRUTHS[0], noise_given=True)
    squared = auto.errors(cell, (3,), 1)[0]
    rng = np.random.default_rng((3,))
    rig = cell.rig(rng)
    R = POSE_SETS["6 spread"]
    wrench = readings(rig, R) + NOISE * rng.normal(size=(6, 6))
    for model, error in zip(("auto", *auto.RUNGS), squared, strict=True):
        predicted = cw.calibrate(cw.Samples(wrench, R), model, noise=NOISE).predict(UNSEEN)[:, :3]
        off = np.linalg.norm(predicted - readings(rig, UNSEEN)[:, :3], axis=1)
        assert error == pytest.approx(np.mean(off**2), rel=0.01 if model == "auto" else 0.05)


def test_a_refused_rung_is_not_counted_as_right() -> None:
    assert auto.rms(np.array([4.0, np.nan, 4.0])) == 2.0
    assert np.isnan(auto.rms(np.array([np.nan])))


def test_the_bound_of_a_cell_is_that_of_its_truth() -> None:
    cell = auto.Cell(TABLE_V.weight, "6 spread", auto.TRUTHS[0], noise_given=False)
    expected, _ = bound_on_prediction(TABLE_V, "yaw", POSE_SETS["6 spread"], NOISE, UNSEEN)
    assert auto.bound(cell, "yaw") == pytest.approx(expected)


@pytest.mark.slow
def test_mountings_are_recovered_and_a_wrong_one_would_be_seen() -> None:
    (row,) = auto.recovery(Here(), 2)
    assert row.met
    rig = auto.Cell(10.0, "24 random", auto.TRUTHS[0], noise_given=True).rig(np.random.default_rng(4))
    R = POSE_SETS["24 random"]
    calibration = cw.calibrate(cw.Samples(readings(rig, R) + 1e-3 * np.sin(np.arange(144.0)).reshape(24, 6), R))
    assert auto.judged(calibration, rig) == auto.RECOVERED
    elsewhere = auto.Cell(11.0, "24 random", auto.TRUTHS[1], noise_given=True).rig(np.random.default_rng(4))
    assert auto.judged(calibration, elsewhere) == "wrong weight and mounting"


def test_far_contacts_are_not_felt() -> None:
    (found,) = dirty.with_contacts(dirty.Contacts(100.0, one_direction=False), (5,), 1)
    assert found[2:].tolist() == [dirty.BAD, 0.0]
    assert found[0] == pytest.approx(found[1], rel=0.2)


@pytest.mark.slow
def test_a_step_is_read_from_the_warnings() -> None:
    (moved,) = dirty.with_course("step of 10 sigma", (6,), 1)
    assert moved is not None
    assert (moved.found, moved.before_step) == ("step", dirty.AFTER)


def test_courses_end_at_the_last_bias_and_have_their_size() -> None:
    rng = np.random.default_rng(7)
    for name, (_, course) in dirty.COURSES.items():
        moved = course(rng)
        assert np.array_equal(moved[-1], np.zeros(6))
        if name == "drift by 20 sigma":
            assert np.linalg.norm(moved[0]) == pytest.approx(20.0)


def test_not_knowing_a_course_costs() -> None:
    assert dirty.cost_of_not_knowing(np.zeros((24, 1))) == pytest.approx(1.0)
    assert dirty.cost_of_not_knowing(np.arange(24.0)[::-1, None]) > 1.2


@pytest.mark.slow
def test_the_true_reading_of_a_measured_set_comes_first() -> None:
    assert all(row.met for row in ranks(measured_sets()["Panda, Mini45"]))


def test_contacts_of_a_shift_do_not_touch_each_other() -> None:
    found = live.touches(np.random.default_rng(8), 3_600_000, 1000.0, 125)
    assert len(found) == 125
    assert found[-1].stop < 3_600_000
    assert all(a.stop + 500 < b.start for a, b in pairwise(found))
    assert all(np.linalg.norm(each.wrench[:3]) >= 1.0 for each in found)


def test_a_shift_judges_what_is_missed_and_what_is_none() -> None:
    """Two contacts, one not flagged and learned away; one reported where there is none."""
    contacts = [live.Touch(1000, 2000, np.ones(6)), live.Touch(5000, 6000, np.ones(6))]
    flag, pressed = np.zeros(9000, dtype=bool), np.zeros(9000, dtype=int)
    flag[1005:2005], pressed[1000:2000], pressed[5000:6000] = True, 1, 2
    error, inside = np.full(9, 0.01), np.zeros(9, dtype=int)
    error[6], inside[6] = 0.9, 2
    reported = [Contact(at, at + 1.0, np.zeros(6), np.zeros(6), np.eye(6), onset_seen=True) for at in (1.0, 7.5)]
    rows = {row.what: row for row in live.judged(contacts, flag, pressed, error, inside, reported, 1000.0)}
    assert rows["contacts held for 99 % of their time"].value == 50.0
    assert rows["seconds in contact with 0.5 N of it learned away"].value == 1
    assert rows["contacts that were none"].value == 1
    assert not rows["RMS bias error of a force axis"].met


def test_figures_are_added_to_a_file_with_one_header(tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    for value in (1.0, 2.0):
        append("a title, with a comma", [Row("what", value, "N", most=1.5), Row("else", value)], path)
    with path.open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == HEADER
    assert [row[3:] for row in rows] == [
        ["a title, with a comma", "what", "1", "N", "at most 1.5", "yes", ""],
        ["a title, with a comma", "else", "1", "", "", "", ""],
        ["a title, with a comma", "what", "2", "N", "at most 1.5", "no", ""],
        ["a title, with a comma", "else", "2", "", "", "", ""],
    ]
    assert rows[0][1] == cw.__version__


def test_an_unknown_benchmark_is_refused_by_name() -> None:
    command = [sys.executable, "-m", "benchmarks", "acuracy"]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    alone = "speed, tables, plan, rig, measured, bags, clock_delay, stillness, live, live_devices, live_page"
    assert f"found acuracy, expected {alone}, accuracy, auto, dirty, inference, judgements, diagnose" in done.stderr
