"""What a live calibration is not sure of makes it doubtful: a sign that nobody tested, a side that nobody stated."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from contactwrench.calibration.findings import Kind
from contactwrench.live.fitting import Fitted, Stated, fitted, with_check
from contactwrench.live.push_test import Push
from tests.live.test_creep_of_poses import taken
from tests.support.live_world import LiveWorld

UP, PULL = (0.0, 0.0, 1.0), Stated(sign="pull")
POSES = taken(0.0, 1.0, seed=5)


def push(towards: str, along: tuple[float, float, float]) -> Push:
    """Of 9 N along a direction in flange axes, as the world of the poses feels it."""
    world = LiveWorld(5)
    force = 9.0 * world.mounting.inv().apply(along)
    return Push(towards, force, np.array([0.0, 0.0, 0.0, 1.0]))


@cache
def fit(stated: Stated) -> Fitted:
    """Without a push."""
    return fitted(POSES, (), stated, "test")


def doubts(found: Fitted) -> list[str]:
    assert found.calibration is not None
    return [each.text for each in found.calibration.findings if each.kind is Kind.SIGN_NOT_CONFIRMED]


def test_without_a_push_the_sign_is_doubtful_unless_it_was_stated() -> None:
    (said,) = doubts(fit(Stated()))
    assert said.startswith("doubtful: the sign of the readings was not tested: ")
    assert doubts(fit(PULL)) == []


def test_a_push_that_went_the_other_way_hangs_the_robot_and_is_doubtful() -> None:
    """A push towards -x where +x was asked for reads as a sensor of the other sign on a robot that hangs."""
    pushes = (push("down", (0.0, 0.0, -1.0)), push("+x", (-1.0, 0.0, 0.0)))
    wrong = fitted(POSES, pushes, Stated(), "test")
    (said,) = doubts(wrong)
    assert wrong.calibration is not None
    assert wrong.calibration.verdict == "doubtful"
    assert "the robot hangs, which is not what was stated or usual" in said
    assert said.endswith("push again, or state --gravity 0,0,1")


@pytest.mark.parametrize(("stated", "count"), [(Stated(), 0), (Stated(gravity=UP), 1)])
def test_the_right_pushes_are_doubtful_only_against_what_was_stated(stated: Stated, count: int) -> None:
    pushes = (push("down", (0.0, 0.0, -1.0)), push("+x", (1.0, 0.1, 0.0)))
    right = fitted(POSES, pushes, stated, "test")
    assert right.sign == 1.0
    assert len(doubts(right)) == count


@pytest.mark.parametrize(("passed", "verdict"), [(True, "good"), (False, "doubtful")])
def test_a_check_that_failed_makes_the_verdict_doubtful(passed: bool, verdict: str) -> None:
    calibration = fit(PULL).calibration
    assert calibration is not None
    assert with_check(calibration, passed, "3 N are left").verdict == verdict
