"""The judge of the estimator draws what it says, its told fit is efficient, and its standard errors are such."""

from __future__ import annotations

import numpy as np
import pytest

import contactwrench as cw
from benchmarks import inference, realistic, trials
from benchmarks.errors import CONE, LEVER, NOISE, Contacts, Course, Realistic, in_order, poses, times, usual_rig
from benchmarks.table import Row
from benchmarks.told import told
from tests.support.world import Array, bound_on_prediction, random_rotations, readings
from tests.test_benchmarks import Here

COURSES = [Course(kind, 0.3) for kind in inference.KINDS]


@pytest.mark.parametrize("course", COURSES, ids=lambda course: course.kind)
def test_a_course_ends_at_the_last_bias_and_has_the_covariance_that_is_told(course: Course) -> None:
    rng, t = np.random.default_rng(1), times(12)
    changes, told_of = zip(*(course.drawn(t, rng) for _ in range(3000)), strict=True)
    assert all(not change[-1].any() for change in changes)
    drawn = np.einsum("knc,kmc->cnm", changes, changes) / len(changes)
    assert drawn == pytest.approx(np.mean(told_of, axis=0), abs=0.15 * 0.3**2 / 3.0)
    if course.kind != "walk":
        assert np.linalg.norm(changes[0][0, :3]) == pytest.approx(0.3)
        assert np.linalg.norm(changes[0][0, 3:]) == pytest.approx(0.3 * LEVER[3])


def test_a_step_lies_where_it_is_put() -> None:
    change, _ = Course("step", 1.0).drawn(times(6), np.random.default_rng(2), 5)
    assert [bool(row.any()) for row in change] == [True] * 5 + [False]
    assert not Course("steady").drawn(times(6), np.random.default_rng(2))[0].any()


def test_contacts_have_their_number_length_and_direction() -> None:
    rng = np.random.default_rng(3)
    for one in (True, False):
        added, bad = Contacts(30.0, one).drawn(24, 7, rng)
        pushes = added[bad] / NOISE
        assert bad.sum() == 7
        assert not added[~bad].any()
        assert np.linalg.norm(pushes, axis=1) == pytest.approx(np.full(7, 30.0))
        assert (np.ptp(pushes, axis=0).max() == 0.0) == one


def test_cones_are_cones_and_go_round_in_order() -> None:
    R = in_order(poses("24 cone", np.random.default_rng(4)))
    down = R[:, 2] * -1.0
    tilt = np.arccos(down[:, 2])
    assert tilt.max() < CONE
    inner = int(np.sum(tilt < CONE / 2.0))
    assert (tilt[:inner] < CONE / 2.0).all()
    azimuth = np.arctan2(down[inner:, 1], down[inner:, 0])
    assert (np.diff(azimuth) > 0.0).all()


def test_a_cable_pulls_alike_at_orientations_that_lie_close() -> None:
    rng = np.random.default_rng(5)
    R = random_rotations(200, rng)
    rig = usual_rig(rng)
    drawn = [Realistic(cable=0.3).drawn(rig, rng).cable(R)[:, 0] for _ in range(300)]
    alike: Array = np.transpose(drawn) @ np.array(drawn) / (len(drawn) * 0.3**2)
    angle = np.arccos(np.clip((np.einsum("aij,bij->ab", R, R) - 1.0) / 2.0, -1.0, 1.0))
    assert np.std(drawn) == pytest.approx(0.3, rel=0.05)
    assert alike[(angle > 0.4) & (angle < 0.6)].mean() == pytest.approx(np.exp(-0.5), abs=0.06)
    assert abs(alike[angle > 2.0].mean()) < 0.02


def test_errors_are_as_large_as_they_say() -> None:
    rng = np.random.default_rng(6)
    rig, R = usual_rig(rng, 20.0), random_rotations(400, rng)
    off = {}
    for name, kind in realistic.KINDS.items():
        reality = kind.drawn(rig, rng)
        off[name] = reality.read(R, rng) - reality.steady(R)
        if not kind.gain:
            assert reality.steady(R) == pytest.approx(readings(rig, R))
    force = {name: float(np.sqrt(np.mean(np.sum(each[:, :3] ** 2, axis=1)))) for name, each in off.items()}
    of_noise = float(np.linalg.norm(NOISE[:3]))
    assert force["gain and cross-talk 1 %"] == pytest.approx(of_noise, rel=0.1)
    assert force["backlash 0.3 N"] == pytest.approx(np.hypot(0.3, of_noise), rel=0.1)
    assert force["robot 0.3 deg"] == pytest.approx(np.hypot(20.0 * np.deg2rad(0.3) * np.sqrt(2.0), of_noise), rel=0.1)


@pytest.mark.parametrize("kind", ["steady", "walk", "drift"])
def test_the_told_fit_is_as_good_as_it_can_be(kind: str) -> None:
    rng, R, t = np.random.default_rng(7), random_rotations(12, np.random.default_rng(8)), times(12)
    gained = []
    for _ in range(15):
        rig = usual_rig(rng)
        change, covariance = Course(kind, 0.3).drawn(t, rng)
        wrench = readings(rig, R) + NOISE * rng.normal(size=(12, 6)) + change
        fit = told(rig, R, wrench, covariance, trials.UNSEEN)
        gained.append(fit.squared / fit.expected)
        bound = bound_on_prediction(rig, "mount+base", R, NOISE, trials.UNSEEN)[0]
        assert kind != "steady" or 0.8 * bound**2 < fit.expected < 1.001 * bound**2
    assert np.mean(gained) == pytest.approx(0.9, abs=0.35)  # as of 30 recordings within 0.25


def test_standard_errors_are_those_of_many_runs() -> None:
    rng = np.random.default_rng(9)
    below = rng.chisquare(6.0, size=(500, 200))
    above = below * rng.uniform(0.8, 1.8, size=(500, 200))
    values, stated = np.transpose([trials.ratio(a, b) for a, b in zip(above, below, strict=True)])
    assert np.std(values) == pytest.approx(np.mean(stated), rel=0.1)
    shares = [trials.share_row("", (rng.uniform(size=100) < 0.1).astype(float)) for _ in range(500)]
    assert np.std([row.value for row in shares]) == pytest.approx(
        np.mean([row.standard_error or 0.0 for row in shares]), rel=0.15
    )
    none = trials.share_row("", np.zeros(100))
    assert none.standard_error == pytest.approx(0.7, rel=0.05)


@pytest.mark.parametrize(("value", "most", "word"), [(1.0, 1.25, "ok"), (1.3, 1.25, "missed?"), (2.0, 1.25, "MISSED")])
def test_a_miss_is_clear_from_two_standard_errors_on(value: float, most: float, word: str) -> None:
    assert Row("what", value, most=most, standard_error=0.1).judgement == word
    assert Row("what", value, most=0.0, standard_error=10.0).judgement == "MISSED"
    assert Row("what", value).judgement == ""


def test_one_recording_of_each_kind_is_judged() -> None:
    rng = np.random.default_rng(10)
    steady = inference.with_course(inference.Setting("12 random", True, Course("steady")), rng)
    assert 0.1 < steady["squared"] < 5.0
    assert steady["left"] == steady["moved"] == 0.0
    moved = inference.with_course(inference.Setting("24 random", False, Course("step", 3.0)), rng)
    assert moved["moved"] == 1.0
    assert set(inference.touched(inference.Touched(12, Contacts(100.0, False)), rng)) >= {"squared", "without"}
    assert inference.stepped(inference.Stepped("12 random", 1.0, 1), rng)["off"] > 0.0
    for cell in (realistic.Erring("6 spread", "creep 0.2 %"), realistic.Erring("24 random", "all together")):
        assert realistic.erring(cell, rng)["true"] > 0.0
    assert realistic.with_tilt(realistic.Tilted("6 spread", 10.0, 90.0), rng)["squared"] < 0.1


def test_a_refusal_is_counted() -> None:
    def refuses(_: object, rng: np.random.Generator) -> dict[str, float]:
        if rng.uniform() < 0.5:
            raise cw.ContactWrenchError("no")
        return {"squared": 1.0}

    (found,) = trials.run(Here(), refuses, ["a cell"], 60, (1,))
    assert len(found) + found.refused == 60
    assert 10 < found.refused < 50
