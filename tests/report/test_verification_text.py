"""What a check that failed says to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.report.text import verification_text
from tests.support.rigs import example, noisy
from tests.support.world import random_rotations

DO = "; nothing here tells why: see that the tool is free, then calibrate anew; contactwrench diff tells what changed"


def test_a_check_that_fails_without_a_finding_says_what_to_do() -> None:
    """Whatever says more itself stands alone: a finding, a limit, a check that passed."""
    rig, R, rng = example(12)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    right = noisy(rig, random_rotations(10, rng), rng)
    one = cw.Samples(right.wrench[:1] + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), right.R_base_flange[:1])
    failed = verify(calibration, one)
    assert (failed.passed, failed.findings) == (False, ())
    assert verification_text(failed).splitlines()[-1] == f"FAILED  {failed.reason}{DO}"
    moved = verify(calibration, cw.Samples(right.wrench + 1.0, right.R_base_flange))
    assert moved.findings
    for said in (moved, verify(calibration, one, limit_force=0.1), verify(calibration, right)):
        verdict = "PASSED" if said.passed else "FAILED"
        assert verification_text(said).splitlines()[-1] == f"{verdict}  {said.reason}"
    assert verification_text(replace(moved, findings=())).endswith(DO)
