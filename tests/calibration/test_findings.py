"""Findings: decided by kind and severity, saved beside their texts, and read from files that had texts only."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import contactwrench as cw
from contactwrench.calibration.fields import Finding, Kind, Severity
from contactwrench.calibration.file import to_json
from contactwrench.errors import FileFormatError
from tests.support.recordings import PANDA, PAPER, written

SOUNDS_WEAK = Finding(Kind.OTHER, Severity.WARNING, "weak: or so it sounds")
IS_WEAK = Finding(Kind.POOR_FIT, Severity.WEAK, "much is left in the poses")


@cache
def good() -> cw.Calibration:
    """A calibration with no finding that makes it weak."""
    return cw.calibrate(cw.read(PANDA), "mount")


@cache
def weak() -> cw.Calibration:
    """One with several."""
    return cw.calibrate(cw.read(PAPER), "mount+base")


def saved(calibration: cw.Calibration) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(to_json(calibration))
    return values


def loaded(folder: Path, values: dict[str, Any]) -> cw.Calibration:
    return cw.Calibration.load(written(folder, json.dumps(values), "tool.json"))


def test_the_severity_decides_and_no_sentence() -> None:
    assert good().verdict.startswith("good: ")
    assert replace(good(), findings=(SOUNDS_WEAK,)).verdict == good().verdict
    doubted = replace(good(), findings=(IS_WEAK,))
    assert doubted.is_weak
    assert doubted.verdict == f"weak: {good().largest_error}"


def test_a_weak_finding_says_so_for_those_who_read_texts_only() -> None:
    assert weak().is_weak
    for finding in weak().findings:
        assert (finding.severity is Severity.WEAK) == finding.text.startswith("weak: ")
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
    del values["findings"]
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
        ({"warnings": ["all is well"]}, "found warnings other than the texts of findings: the file was edited"),
        ({"findings": []}, "found warnings other than the texts of findings: the file was edited"),
        ({"findings": [{"kind": "other", "text": "x"}]}, "missing required field `severity` - at `$.findings[0]`"),
        ({"findings": [{"kind": "other", "severity": "bad", "text": "x"}]}, "'bad' - at `$.findings[0].severity`"),
        ({"findings": None}, "Expected `array`, got `null` - at `$.findings`"),
    ],
)
def test_findings_that_are_none_are_refused_by_name(tmp_path: Path, edit: dict[str, Any], message: str) -> None:
    with pytest.raises(FileFormatError) as caught:
        loaded(tmp_path, saved(weak()) | edit)
    assert message in str(caught.value)
