"""Findings: decided by kind and severity, saved beside their texts, and read from files that had texts only."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.calibration.file import ADDED, to_json
from contactwrench.calibration.findings import Doubt, Finding, Kind, Severity
from contactwrench.calibration.text import describe, verdict_sentences
from contactwrench.errors import FileFormatError
from tests.support.recordings import PANDA, PAPER, written

IS_WEAK = Finding(Kind.POOR_FIT, Severity.WEAK, "much is left in the poses")


@cache
def good() -> cw.Calibration:
    """A calibration with no finding that makes it weak or doubtful."""
    return replace(cw.calibrate(cw.read(PANDA), "mount"), findings=())


@cache
def weak() -> cw.Calibration:
    """One with several."""
    return cw.calibrate(cw.read(PAPER), "mount+base")


def saved(calibration: cw.Calibration) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(to_json(calibration))
    return values


def loaded(folder: Path, values: dict[str, Any]) -> cw.Calibration:
    return cw.Calibration.load(written(folder, json.dumps(values), "tool.json"))


@pytest.mark.parametrize(
    ("severities", "verdict"),
    [
        ((), "good"),
        (("note", "warning", "refused"), "good"),
        (("warning", "doubtful"), "doubtful"),
        (("weak", "doubtful", "note"), "weak"),
        (("weak",), "weak"),
    ],
)
def test_the_severities_decide_and_no_sentence(severities: tuple[str, ...], verdict: str) -> None:
    findings = tuple(Finding(Kind.OTHER, Severity(severity), "weak: or so it sounds") for severity in severities)
    assert replace(good(), findings=findings).verdict == verdict


@pytest.mark.parametrize(
    ("kinds", "reasons"),
    [
        (["cross_talk"], [Doubt.MODEL]),
        (["sign_not_confirmed"], [Doubt.ASSUMPTION]),
        (["pose_left_out", "bias_stepped", "cross_talk"], [Doubt.MOVED, Doubt.MODEL]),
        (["creep"], [Doubt.CREEP]),
        (["found_in_2030"], [Doubt.MODEL]),
    ],
)
def test_a_doubtful_verdict_says_each_of_its_reasons_once(kinds: list[str], reasons: list[Doubt]) -> None:
    doubtful = replace(good(), findings=tuple(Finding.doubtful(Kind(kind), "who knows") for kind in kinds))
    assert doubtful.warnings == ("doubtful: who knows",) * len(kinds)
    head, *said = verdict_sentences(doubtful)
    assert (head, said[:-1]) == ("doubtful", reasons)
    assert f"Verdict  doubtful: {reasons[0]}; " in describe(doubtful)
    assert verdict_sentences(good())[1:] == said[-1:]


def test_a_verdict_that_misses_what_is_required_reads_as_a_sentence() -> None:
    """Good in spite of that, and weak beside it."""
    missed = "force 1 N over 0.1"
    assert f"Verdict  good, but misses what is required, {missed}: at a new orientation" in describe(good(), missed)
    assert f"Verdict  weak, and misses what is required, {missed}: " in describe(weak(), missed)
    assert "misses" not in describe(good())


def test_a_note_reads_as_a_note_and_all_else_as_a_warning() -> None:
    findings = [Finding(Kind.MOTION_USED, severity, f"{severity} said") for severity in Severity]
    lines = describe(replace(good(), findings=tuple(findings))).splitlines()[-len(Severity) :]
    assert lines[0] == "Note     note said"
    assert lines[1:] == [f"Warning  {severity} said" for severity in list(Severity)[1:]]


def test_the_error_to_expect_counts_what_poses_differ_by() -> None:
    """More poses make the calibration sure, and the next pose no better."""
    assert good().expected_error == pytest.approx(
        [np.hypot(good().largest_std[k], np.linalg.norm(good().noise[3 * k : 3 * k + 3])) for k in (0, 1)]
    )
    sure = replace(good(), covariance=1e-12 * good().covariance, gain_covariance=None)
    assert sure.expected_error[0] == pytest.approx(np.linalg.norm(good().noise[:3]), rel=1e-6)


def test_the_verdict_and_the_error_are_saved_beside_the_fields_and_held_against_them(tmp_path: Path) -> None:
    values = saved(weak())
    assert values["verdict"] == "weak"
    assert tuple(values["expected_error"]) == weak().expected_error
    assert loaded(tmp_path, values).expected_error == weak().expected_error
    for stated in ("good", "splendid", "doubtful"):
        with pytest.raises(FileFormatError) as caught:
            loaded(tmp_path, values | {"verdict": stated})
        assert str(caught.value).endswith(
            f"tool.json: verdict is {stated!r}, and findings make it 'weak', expected a file as it was saved: "
            "calibrate again or restore the file"
        )
    older = {key: value for key, value in values.items() if key not in ADDED[ADDED.index("verdict") :]}
    assert loaded(tmp_path, older).verdict == "weak"


def test_a_weak_finding_says_so_for_those_who_read_texts_only() -> None:
    assert weak().verdict == "weak"
    for finding in weak().findings:
        assert (finding.severity is Severity.WEAK) == finding.text.startswith("weak: ")
        assert finding.text == finding.said or finding.text == f"{finding.severity}: {finding.said}"
        assert finding.said.split(": ")[0] == finding.brief
    kinds = [finding.kind for finding in weak().findings]
    assert Kind.UNCERTAIN_PARAMETER in kinds
    assert kinds.index(Kind.ADVICE) > kinds.index(Kind.UNCERTAIN_PARAMETER)
    assert Kind.OTHER not in kinds


def test_warnings_are_the_texts_of_the_findings_in_their_order() -> None:
    values = saved(weak())
    assert values["warnings"] == [finding["text"] for finding in values["findings"]] == list(weak().warnings)
    assert all(set(finding) == {"kind", "severity", "text"} for finding in values["findings"])
    assert {finding["severity"] for finding in values["findings"]} >= {"weak", "note"}


def test_a_file_from_before_findings_tells_how_bad_its_warnings_are(tmp_path: Path) -> None:
    values = saved(weak())
    values = {key: value for key, value in values.items() if key not in ADDED[ADDED.index("findings") :]}
    before = loaded(tmp_path, values)
    assert before.warnings == weak().warnings
    assert before.verdict == weak().verdict
    assert {finding.kind for finding in before.findings} == {Kind.OTHER}
    assert [finding.severity is Severity.WEAK for finding in before.findings] == [
        finding.severity is Severity.WEAK for finding in weak().findings
    ]


def test_a_kind_that_a_later_version_found_is_another_finding(tmp_path: Path) -> None:
    values = saved(replace(good(), findings=(IS_WEAK,)))
    values["findings"][0]["kind"] = "found_in_2030"
    (finding,) = loaded(tmp_path, values).findings
    assert finding == replace(IS_WEAK, kind=Kind.OTHER)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (
            {"warnings": ["all is well"]},
            "found warnings other than the texts of findings, expected a file as it was saved",
        ),
        ({"findings": []}, "found warnings other than the texts of findings, expected a file as it was saved"),
        ({"findings": [{"kind": "other", "text": "x"}]}, "missing required field `severity` - at `$.findings[0]`"),
        ({"findings": [{"kind": "other", "severity": "bad", "text": "x"}]}, "'bad' - at `$.findings[0].severity`"),
        ({"findings": None}, "Expected `array`, got `null` - at `$.findings`"),
    ],
)
def test_findings_that_are_none_are_refused_by_name(tmp_path: Path, edit: dict[str, Any], message: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        loaded(tmp_path, saved(weak()) | edit)
    assert message in str(caught.value)
