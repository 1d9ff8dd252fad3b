"""A planned motion as a program, run here as far as it is arithmetic: it goes where the plan goes."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactwrench.assess import plan_motion as motion_design
from contactwrench.assess.plan_motion import STOP, DynamicPlan, plan_motion
from contactwrench.assess.robot_arms import ARMS
from contactwrench.geometry.arrays import Array
from contactwrench.recording.urdf import read_urdf
from contactwrench.report.motion_program import krl, motion_csv, program_of, urscript
from tests.assess.test_robot_arms import urdf_of
from tests.support.recordings import written


@pytest.fixture(scope="module")
def plan() -> DynamicPlan:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion_design, "STEPS", 40)
        return plan_motion(ARMS["ur5e"], n=3, duration=12.0)


def run_urscript(program: str, slower: float) -> dict[str, list[Any]]:
    """What its arm is sent, by command: the body as Python, which URScript's arithmetic and calls are."""
    sent: dict[str, list[Any]] = {"movej": [], "sleep": [], "servoj": [], "stopj": []}
    body = program[program.index("\ndef ") + 1 :].replace("slower = 10.0", f"slower = {slower}")
    body = re.sub(r"^\s*end$", "", body, flags=re.MULTILINE)
    name = body[4 : body.index("(")]
    known: dict[str, Any] = {
        "sin": math.sin,
        "cos": math.cos,
        "movej": lambda q, **how: sent["movej"].append((q, how)),
        **{word: (lambda *of, word=word: sent[word].append(of)) for word in ("sleep", "servoj", "stopj")},
    }
    exec(body, known)
    known[name]()
    return sent


def test_urscript_goes_where_the_plan_goes(plan: DynamicPlan) -> None:
    sent = run_urscript(urscript(plan, "my plan 2"), 1.0)
    assert "def my_plan_2():" in urscript(plan, "my plan 2")
    np.testing.assert_allclose(np.array([q for q, _ in sent["movej"]]), plan.visited, atol=1e-6)
    assert [how.get("t") for _, how in sent["movej"]] == [None, *np.round(plan.moves, 1).tolist()]
    assert sent["sleep"] == [(STOP,)] * 6
    t = np.arange(len(sent["servoj"]), dtype=np.float64) * 0.008
    np.testing.assert_allclose(np.array([each[0] for each in sent["servoj"]]), plan.motion.at(t)[0], atol=1e-7)
    assert {each[1:] for each in sent["servoj"]} == {(0, 0, 0.008, 0.1, 300)}
    assert 0.0 <= t[-1] + 0.008 - plan.motion.duration < 0.008
    assert len(run_urscript(urscript(plan, "p"), 10.0)["servoj"]) == pytest.approx(10 * len(t), abs=10)


def axes_rad(program: str, word: str) -> Array:
    """The axes (n, 6) of every command of that name."""
    lines = [line for line in program.splitlines() if line.strip().startswith(f"{word} {{")]
    return np.asarray(np.deg2rad(np.array([re.findall(r"A\d (.+?)[,}]", line) for line in lines], dtype=np.float64)))


def test_krl_goes_where_the_plan_goes(plan: DynamicPlan) -> None:
    program = krl(plan, "2 plans")
    assert program.startswith("DEF p2_plans( )\n; 3 stops and ")
    assert program.endswith(f"WAIT SEC {STOP}\nEND\n")
    stops, points = (axes_rad(program, word) for word in ("PTP", "SPTP"))
    np.testing.assert_allclose(stops, plan.visited, atol=1e-7)
    period = 1.0 / plan.motion.frequency
    t = np.asarray(period * np.arange(1, len(points) + 1) / len(points))
    np.testing.assert_allclose(points, plan.motion.at(t)[0], atol=1e-7)
    assert program.count("TIME_BLOCK PART = 1\n") == len(t)
    assert f"TIME_BLOCK END = {period:.6f}\n" in program
    assert f"FOR I = 1 TO {plan.motion.periods}\n  PTP_SPLINE\n    TIME_BLOCK START\n" in program
    for opened, closed in (("FOR ", "ENDFOR"), ("PTP_SPLINE", "ENDSPLINE")):
        assert len(re.findall(rf"^ *{opened}", program, re.MULTILINE)) == len(
            re.findall(rf"^ *{closed}", program, re.M)
        )
    assert max(map(len, program.splitlines())) <= 120


def test_both_say_what_to_check_first(plan: DynamicPlan) -> None:
    for program, comment in ((urscript(plan, "p"), "# "), (krl(plan, "p"), "; ")):
        comments = "\n".join(line for line in program.splitlines() if line.startswith(comment))
        for what in ("speed: joints ", "workspace: the flange", "payload: set the ", "collisions are not checked"):
            assert what in comments


def test_the_csv_is_the_plan(plan: DynamicPlan) -> None:
    header, *rows = motion_csv(plan).splitlines()
    assert header == "t,q1,q2,q3,q4,q5,q6"
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    assert table[-1, 0] == pytest.approx(plan.duration, abs=1e-4)
    assert (np.diff(table[:, 0]) > 0.0).all()
    np.testing.assert_allclose(table[:-1, 1:], plan.at(table[:-1, 0])[0], atol=1e-9)


def test_a_urdf_of_six_joints_has_programs_of_both(tmp_path: Path) -> None:
    arm = read_urdf(written(tmp_path, urdf_of("ur5e"), "arm.urdf"))
    assert program_of(Path("plan.script"), arm) is urscript
    assert program_of(Path("plan.SRC"), arm) is krl
