"""A weight of next to nothing: its likeliest cause is named, and a light tool is not accused."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.errors import AmbiguityError
from tests.support.rigs import NOISE, example
from tests.support.world import Array, noisy_readings

CAUSE = (
    "likeliest the controller or driver subtracts the payload, or zeroes at each pose: record the sensor's raw signal "
    "(of a UR ft_raw_wrench, not an external force)"
)


def readings(weight: float, seed: int, noise: Array = NOISE) -> tuple[Array, Array]:
    rig, R, rng = example(seed, poses=15)
    return R, noisy_readings(replace(rig, weight=weight), R, noise, rng)


@pytest.mark.parametrize("model", ["auto", "mount"])
@pytest.mark.parametrize("seed", range(3))
def test_a_payload_that_is_subtracted_already_is_named(model: str, seed: int) -> None:
    """Once, in place of what is uncertain of a tool that is not there, and of other ways to read the file."""
    R, wrench = readings(1e-3, seed)
    calibration = cw.calibrate(cw.Samples(wrench, R), model)
    weak = [finding for finding in calibration.findings if finding.severity is Severity.WEAK]
    assert [finding.kind for finding in weak] == [Kind.PAYLOAD_SUBTRACTED]
    assert weak[0].text.startswith(f"weak: weight {calibration.weight:.2g} +- ")
    assert weak[0].text.endswith(f" N is next to nothing, though the poses tilt the tool: {CAUSE}")
    assert calibration.verdict == "weak"
    assert not any("diagnose" in text for text in calibration.warnings)


def test_a_tool_that_really_is_light_is_good_and_told_what_else_it_could_be() -> None:
    """A gripper's finger of 30 g on a sensor that sees it."""
    R, wrench = readings(0.3, 3, 0.05 * NOISE)
    calibration = cw.calibrate(cw.Samples(wrench, R))
    (note,) = (finding for finding in calibration.findings if finding.kind is Kind.PAYLOAD_SUBTRACTED)
    assert note.severity is Severity.NOTE
    assert note.text.endswith(f" N is next to nothing, though the poses tilt the tool; if it weighs more, {CAUSE}")
    assert calibration.verdict == "good"
    assert calibration.weight == pytest.approx(0.3, abs=4.0 * calibration.std["weight"])


def test_poses_that_hardly_tilt_and_tools_of_usual_weight_are_left_alone() -> None:
    R, wrench = readings(2.0, 4)
    assert Kind.PAYLOAD_SUBTRACTED not in [each.kind for each in cw.calibrate(cw.Samples(wrench, R)).findings]
    rig, _, rng = example(5)
    tilts = Rotation.from_rotvec(0.03 * rng.normal(size=(15, 3))).as_matrix()
    light = noisy_readings(replace(rig, weight=1e-3), tilts, NOISE, rng)
    try:
        found = [each.kind for each in cw.calibrate(cw.Samples(light, tilts)).findings]
    except AmbiguityError:
        found = []
    assert Kind.PAYLOAD_SUBTRACTED not in found


def test_a_payload_subtracted_twice_is_refused_with_the_cause() -> None:
    """A weight below zero by next to nothing is no reversed sign."""
    R, wrench = readings(0.3, 6, 0.1 * NOISE)
    with pytest.raises(AmbiguityError, match="; of so little weight likeliest the controller or driver subtracts"):
        cw.calibrate(cw.Samples(-wrench, R), "mount")


def test_a_reversed_sign_does_not_accuse_the_controller() -> None:
    R, wrench = readings(20.0, 7)
    with pytest.raises(AmbiguityError, match=r"one push by hand can$"):
        cw.calibrate(cw.Samples(-wrench, R), "mount")


@pytest.mark.parametrize(("model", "seed"), [("mount", 13), ("mount+base", 16)])
def test_a_sign_that_mends_nothing_names_diagnose(model: str, seed: int) -> None:
    """The inverse orientation: a weight below zero, or gravity on the other side, and much is left all the same."""
    rig, R, rng = example(seed, poses=8)
    wrench = noisy_readings(rig, R, NOISE, rng)
    with pytest.raises(AmbiguityError, match="N are left so too, and likelier the file is read wrongly: contactwrench"):
        cw.calibrate(cw.Samples(wrench, R.transpose(0, 2, 1)), model)
