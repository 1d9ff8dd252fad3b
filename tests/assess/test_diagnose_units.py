"""Units and signs that free air cannot tell: the tool that each would mean, the most plausible first."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from contactwrench.assess.diagnose import Diagnosis, diagnose
from contactwrench.estimation.plausibility import BEHIND, REVERSED, Unseen, likelier, unseen
from contactwrench.recording.interpretations import interpretations
from contactwrench.report.diagnosis import diagnosis_json, diagnosis_text, verdict
from tests.support.recordings import run, written
from tests.support.world import DOWN, Array, Rig, noisy_readings, random_rotations
from tests.support.written import QUAT, Written, quat

G, LBF, INCH = 9.80665, 4.4482216152605, 0.0254
COM = np.array([0.002, 0.003, 0.06])
NOISE = np.array([0.03, 0.03, 0.03, 0.001, 0.001, 0.001])
R = random_rotations(12, np.random.default_rng(1))
WRENCH = noisy_readings(Rig(10.0, COM, np.ones(6), np.eye(3), DOWN), R, NOISE, np.random.default_rng(2))
FAR, NEAR = "com too far for the mass", "com too near for the mass"


def diagnosed(folder: Path, force: float, torque: float, header: str = "tx,ty,tz") -> Diagnosis:
    text = Written(QUAT, quat).text(R, WRENCH * np.repeat([force, torque], 3)).replace("tx,ty,tz", header, 1)
    return diagnose(interpretations(written(folder, text)), "mount")


@pytest.mark.parametrize("mass", [0.3, 1.0, 5.0])
@pytest.mark.parametrize(
    ("force", "torque", "label"),
    [
        pytest.param(1.0, 1 / LBF / INCH, "--units force=N,torque=lbfin", id="N, lbf in"),
        pytest.param(1.0, 100 / G, "--units force=N,torque=kgfcm", id="N, kgf cm"),
        pytest.param(1 / G, 100 / G, "--units force=kgf,torque=kgfcm", id="kgf, kgf cm"),
        pytest.param(1 / LBF, 1 / LBF / INCH, "--units force=lbf,torque=lbfin", id="lbf, lbf in"),
    ],
)
def test_the_reading_that_was_meant_is_listed(
    mass: float, force: float, torque: float, label: str, tmp_path: Path
) -> None:
    """Of tools of any mass, in inches and centimetres, beside forces in N too."""
    com = COM * np.cbrt(mass)
    readings = noisy_readings(Rig(mass * G, com, np.ones(6), np.eye(3), DOWN), R, NOISE, np.random.default_rng(2))
    text = Written(QUAT, quat).text(R, readings * np.repeat([force, torque], 3))
    diagnosis = diagnose(interpretations(written(tmp_path, text)), "mount")
    meant = next(each for each in diagnosis.unseen if each.label == label)
    assert meant.mass == pytest.approx(mass, rel=0.02)
    assert not meant.odd
    assert meant.com == pytest.approx(com, rel=0.05, abs=3e-3)
    assert f"{label} (plausible)" in diagnosis_text(diagnosis)


@pytest.mark.parametrize(
    ("force", "torque", "why", "label"),
    [
        pytest.param(1 / G, 1.0, FAR, "--units force=kgf,torque=Nm", id="kgf, N m"),
        pytest.param(1 / LBF, 1 / LBF / INCH, FAR, "--units force=lbf,torque=lbfin", id="lbf, lbf in"),
        pytest.param(1e3, 1.0, NEAR, "--units force=mN,torque=Nm", id="mN, N m"),
        pytest.param(1.0, -1.0, BEHIND, REVERSED, id="torques reversed"),
    ],
)
def test_the_reading_that_was_meant_is_the_most_plausible(
    force: float, torque: float, why: str, label: str, tmp_path: Path
) -> None:
    """None is recommended, as the fit is as good as given; that no tool is so is said in the first line."""
    diagnosis = diagnosed(tmp_path, force, torque)
    assert diagnosis.read_rightly
    no_tool = f"; no other interpretation explains it better, but no tool is so ({why}): see the units and signs below"
    assert verdict(diagnosis).endswith(no_tool)
    first = diagnosis.unseen[0]
    assert (first.label, first.odd) == (label, "")
    assert first.mass == pytest.approx(10.0 / G, rel=5e-3)
    assert first.com == pytest.approx(COM, abs=1e-3)
    values = json.loads(diagnosis_json(diagnosis))
    assert values["plausible"] is False
    assert values["unseen"][0] == {"label": label, "mass": first.mass, "com": first.com.tolist(), "odd": ""}


def test_a_tool_that_can_be_is_left_alone(tmp_path: Path) -> None:
    """The other units are listed beside it, and what speaks against reversed torques."""
    diagnosis = diagnosed(tmp_path, 1.0, 1.0)
    assert verdict(diagnosis).endswith("; no other interpretation explains it better: it is read rightly, units apart")
    head = "Free air cannot tell these from the first (plausible) either; weigh the tool:\n"
    columns, *plausible, _, reversed_ = diagnosis_text(diagnosis).partition(head)[2].splitlines()
    assert len(plausible) == len([each for each in diagnosis.unseen if not each.odd and REVERSED not in each.label])
    assert {"--units force=N,torque=kgfcm", "--units force=N,torque=lbfin"} <= {
        line.split("  ")[-1][:-12] for line in plausible
    }
    assert columns.split() == ["mass", "kg", "com", "mm", "interpretation"]
    assert plausible[0] == "      9.99     2.0,    3.1,   60.0  --units force=kgf,torque=kgfm (plausible)"
    assert all(line.endswith(" (plausible)") for line in plausible)
    assert reversed_ == f"      {REVERSED} ({BEHIND})"
    assert json.loads(diagnosis_json(diagnosis))["plausible"] is True


def test_torques_in_nmm_are_taken_where_they_are_likeliest(tmp_path: Path) -> None:
    diagnosis = diagnosed(tmp_path, 1.0, 1e3)
    assert diagnosis.best.interpretation.options == ("--units torque=Nmm",)
    assert diagnosis.best.odd == ""
    assert "\nFree air cannot tell these from the first:\n  as given\nTo decide:\n" in diagnosis_text(diagnosis)
    assert "force=N,torque=Nmm" not in "".join(each.label for each in diagnosis.unseen)
    assert [each.odd for each in diagnosis.unseen if each.label == REVERSED] == [BEHIND]


def test_units_that_the_columns_name_are_changed_in_words(tmp_path: Path) -> None:
    first = diagnosed(tmp_path, 1 / G, 1.0, "tx_nm,ty_nm,tz_nm").unseen[0]
    assert first.label == "forces in kgf, torques in N m"


def test_nothing_is_listed_where_no_tool_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    noise = np.random.default_rng(0).normal(size=(12, 6))
    path = written(tmp_path, Written(QUAT, quat).text(R, noise))
    assert "weigh the tool" not in run(capsys, "diagnose", path, "--model", "mount").out


KGF = ("kgf", G, 1.0)
BOTH = (("N", 1.0, 1.0), KGF)


def test_readings_are_known_by_hand() -> None:
    """Forces in kgf: 9.81 times the weight, a ninth of the distance; the tool itself is none of them."""
    taken, com = unseen(BOTH, 1.0, G, COM, 0.06), COM / G
    found: list[tuple[str, float, Array, str]] = [(u.label, u.mass, u.com, u.odd) for u in taken]
    assert [label for label, *_ in found] == ["kgf", "kgf, " + REVERSED, REVERSED]
    for (_, mass, at, odd), expected in zip(found, [(G, com, ""), (G, -com, ""), (1.0, -COM, BEHIND)], strict=True):
        assert mass == pytest.approx(expected[0])
        assert at == pytest.approx(expected[1])
        assert odd == expected[2]


def test_where_the_tool_is_on_either_side_torques_as_they_stand_come_first() -> None:
    first, *_ = unseen(BOTH[:1], 1.0, G, COM, np.nan)
    assert isinstance(first, Unseen)
    assert (first.label, first.odd) == (REVERSED, "")


@pytest.mark.parametrize(
    ("distance", "units", "is_likelier"),
    [(60.0, BOTH, True), (0.06, BOTH, False), (2.4, (("lbf in", LBF, LBF * INCH),), False)],
    ids=["far off", "where tools are", "another unit is likelier by far"],
)
def test_when_torques_are_taken_for_nmm(
    distance: float, units: tuple[tuple[str, float, float], ...], is_likelier: bool
) -> None:
    assert likelier(1e-3, units, 2.25, np.array([0.0, 0.0, distance])) is is_likelier
