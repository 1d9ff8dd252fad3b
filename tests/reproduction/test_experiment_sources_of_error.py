"""Sources of error: none at size 0, as large as its size says otherwise, and every case in tables and pictures."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from contactwrench.errors import UnobservableError
from contactwrench.geometry.rotations import rotation_angle
from contactwrench.samples.samples import Samples
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.settings import Settings
from reproduction import sources_of_error
from reproduction.methods import Method, tare
from reproduction.part import Measured
from reproduction.sources_of_error import RIG, SOURCES
from reproduction.trials import (
    Squared,
    force_ratio,
    free_readings,
    in_words,
    joints_of_paper,
    ratio_of_rms,
    student,
    unseen_joints,
)
from tests.support.experiments import cell, figures, noise_free, one_thread

pytest.importorskip("mujoco")


def of_size(source: str, size: float, seed: int = 0) -> Settings:
    return SOURCES[source].rig(size, np.random.default_rng(seed))


@pytest.mark.parametrize("source", SOURCES)
def test_size_0_is_no_error_whatever_the_source(source: str) -> None:
    """All panels begin at the same readings, and at the same truth."""
    none, joints = of_size(source, 0.0), joints_of_paper()
    by_none, by_rig = (record_poses(one, joints, rng=np.random.default_rng(5)) for one in (none, RIG))
    np.testing.assert_array_equal(by_none.wrench, by_rig.wrench)
    np.testing.assert_array_equal(by_none.R_base_flange, by_rig.R_base_flange)
    truth = free_readings(RIG, unseen_joints()[:20]).wrench
    np.testing.assert_allclose(free_readings(none, unseen_joints()[:20], 30.0).wrench, truth, atol=1e-12)


def test_tilts_are_as_large_as_they_say() -> None:
    base, mounting = of_size("base tilt", 2.0), of_size("mounting tilt", 5.0)
    assert np.rad2deg(np.arccos(-base.gravity_direction[2])) == pytest.approx(2.0)
    turned = rotation_angle(RIG.R_flange_sensor.T @ mounting.R_flange_sensor)
    assert np.rad2deg(turned) == pytest.approx(5.0)


def test_crosstalk_leaves_each_axis_and_mixes_the_others() -> None:
    matrix = np.array(of_size("cross-talk", 3.0).sensor.crosstalk)
    ranges = np.array(RIG.sensor.ranges)
    share = matrix * ranges / ranges[:, None]
    assert not np.diag(matrix).any()
    assert share[~np.eye(6, dtype=bool)].std() == pytest.approx(0.03, rel=0.5)


def test_the_drift_ends_where_the_judge_has_it() -> None:
    """The last reading of a noise-free recording is the judge's at that time; the bias moved by the size meanwhile."""
    settings = noise_free(of_size("drift while recording", 0.2))
    recorded = record_poses(settings, joints_of_paper(), rng=np.random.default_rng(0))
    last = free_readings(settings, joints_of_paper(), float(recorded.t[-1])).wrench[-1]
    np.testing.assert_allclose(recorded.wrench[-1], last, atol=1e-3)
    start, end = (
        free_readings(settings, joints_of_paper()[:1], float(t)).wrench[0] for t in (recorded.t[0], recorded.t[-1])
    )
    np.testing.assert_allclose(np.abs(end - start)[:3], 0.2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(end - start) / RIG.sensor.ranges, 0.2 / 70.0, rtol=1e-6)


def test_pose_errors_and_motion_are_the_recording_s() -> None:
    joints = np.repeat(joints_of_paper(), 20, axis=0)
    quick = replace(
        of_size("pose error of the robot", 1.0), recording=replace(RIG.recording, settle=0.0, orientation_error_deg=1.0)
    )
    stated = record_poses(quick, joints, rng=np.random.default_rng(1)).R_base_flange
    true = free_readings(RIG, joints).R_base_flange
    angles = [rotation_angle(a.T @ b) for a, b in zip(stated, true, strict=True)]
    assert np.sqrt(np.mean(np.square(np.rad2deg(angles)))) == pytest.approx(np.sqrt(3.0), rel=0.15)
    assert of_size("motion while reading", 0.3).recording.creep == 0.3


def refused(samples: Samples) -> Method:
    raise UnobservableError("found nothing, expected something: look again")


@pytest.mark.slow
def test_every_case_is_in_table_and_picture_and_refusals_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sources_of_error, "ESTIMATORS", {"ours": tare, "paper": tare, "mount": refused})
    with one_thread() as pool:
        part = sources_of_error.part(pool, 0.01, 6)
    assert len(part.tables) == len(part.pictures) == 2
    for table in part.tables:
        assert len(table.rows) == 13
        assert "mount with base tilt 2 deg in 2 of 2" in table.note
        assert all(cells[2] == "refused" for _, cells in table.rows)
    assert "not told apart: 13." in part.paragraphs[0]
    for picture in part.pictures:
        assert picture.html.startswith("<svg")
        for source in SOURCES.values():
            assert source.name in picture.html
    assert cell(part, "six_planned_poses", "no error but the noise", "ours").value == pytest.approx(2.8, abs=0.3)
    assert len(figures(part)) == 2 * 2 * 2 * 13


def trials_of(**forces: list[float | None]) -> list[dict[str, Squared]]:
    """Trials by the squared force that each estimator leaves; None where it refuses."""
    rows = zip(*forces.values(), strict=True)
    return [{name: Squared(f, f) for name, f in zip(forces, row, strict=True) if f is not None} for row in rows]


def test_a_way_that_refuses_is_not_the_best_and_ratios_are_over_what_both_solved() -> None:
    trials = trials_of(ours=[4.0, 4.0, 100.0], paper=[9.0, 9.0, None], tare=[1.0, 1.0, 1.0], mount=[0.1, 0.1, None])
    best, ratio = sources_of_error.against_best(trials)
    assert (best, ratio.trials) == ("tare", 3)
    assert ratio.value == pytest.approx(6.0)
    paper = force_ratio(trials, "paper", "ours")
    assert paper is not None
    assert paper.trials == 2
    assert paper.value == pytest.approx(1.5)
    assert force_ratio(trials_of(ours=[1.0], paper=[None]), "paper", "ours") is None


def test_chance_alone_is_called_a_difference_once_in_a_thousand() -> None:
    """Heavy tails and all: squared errors whose logarithm is normal."""
    rng = np.random.default_rng(1)
    named = [
        sources_of_error.told_apart(trials_of(ours=list(a), paper=list(b)))
        for a, b in np.exp(rng.normal(size=(4000, 2, 8)))
    ]
    assert sum(one is not None for one in named) < 12
    ours = np.exp(rng.normal(size=8))
    paper = 9.0 * ours * rng.uniform(0.9, 1.1, size=8)
    assert sources_of_error.told_apart(trials_of(ours=list(ours), paper=list(paper))) == "ours"
    assert sources_of_error.told_apart(trials_of(ours=list(paper), paper=list(ours))) == "paper"


def test_figures_in_words_and_students_t_are_those_of_the_tables() -> None:
    assert student(7, 0.001) == pytest.approx(5.408, abs=1e-3)
    assert student(15, 0.05) == pytest.approx(2.131, abs=1e-3)
    assert in_words(Measured(5.622, 0.93, 40)) == "5.6 +- 0.9"
    assert in_words(Measured(1.0, 0.0016, 16)) == "1.0000 +- 0.0016"
    assert in_words(Measured(39.7, 5.1, 16)) == "40 +- 5"
    assert in_words(None) == "(refused)"


def test_the_standard_error_of_a_ratio_is_that_of_its_repetition() -> None:
    rng = np.random.default_rng(3)
    common = rng.chisquare(8.0, size=(2000, 40))
    above, below = (
        4.0 * common * rng.chisquare(30.0, size=common.shape),
        common * rng.chisquare(30.0, size=common.shape),
    )
    ratios = [ratio_of_rms(a, b) for a, b in zip(above, below, strict=True)]
    stated = np.mean([one.standard_error or 0.0 for one in ratios])
    assert np.mean([one.value for one in ratios]) == pytest.approx(2.0, rel=0.01)
    assert np.std([one.value for one in ratios]) == pytest.approx(stated, rel=0.06)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_trials() -> None:
    arguments = ("cross-talk", 1.0, joints_of_paper(), unseen_joints()[:20])
    first, again, other = (sources_of_error.trials_at(*arguments, seed, range(1)) for seed in (1, 1, 2))
    assert first == again != other
    assert set(first[0]) == set(sources_of_error.ESTIMATORS)
    assert re.fullmatch(r"[a-z ]+", "".join(first[0]))
