"""What changed between two calibrations."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.difference import Difference
from contactwrench.report.text import difference_json, difference_text
from tests.support.recordings import rx, ry
from tests.support.rigs import NOISE, example, noise_free, noisy, rotation_angle
from tests.support.world import Array, Rig, random_rotations, readings


def _of(difference: Difference, name: str) -> tuple[float, float]:
    k = list(difference.names).index(name)
    return float(difference.change[k]), float(difference.std[k])


def _pair(seed: int, **changes: Any) -> tuple[Rig, Rig, cw.Calibration, cw.Calibration]:
    rig, R, _ = example(seed)
    other = replace(rig, **changes)
    return rig, other, cw.calibrate(noise_free(rig, R), "mount"), cw.calibrate(noise_free(other, R), "mount")


@pytest.mark.slow
def test_changes_are_after_less_before() -> None:
    com = np.array([0.01, -0.02, 0.05])
    rig, _, a, b = _pair(1, weight=7.5, com=com)
    change = a.diff(b)
    assert _of(change, "weight")[0] == pytest.approx(7.5 - rig.weight)
    for k, axis in enumerate("xyz"):
        assert _of(change, f"com_{axis}")[0] == pytest.approx(com[k] - rig.com[k], abs=1e-8)
    for axis in ("fx", "fy", "fz", "tx", "ty", "tz"):
        assert _of(change, f"bias_{axis}")[0] == pytest.approx(0.0, abs=1e-7)
    assert dict(zip(change.names, change.units, strict=True))["weight"] == "N"


def test_yaw_changes_the_short_way_round() -> None:
    before, after = (Rotation.from_euler("z", a).as_matrix() for a in (3.1, -3.1))
    rig, R, _ = example(2)
    a, b = (cw.calibrate(noise_free(replace(rig, R_flange_sensor=M), R), "yaw") for M in (before, after))
    assert _of(a.diff(b), "yaw")[0] == pytest.approx(2.0 * np.pi - 6.2, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.001, 5.0, 170.0])
def test_angle_between_two_mountings(degrees: float) -> None:
    rig, _, rng = example(3)
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    turned = rig.R_flange_sensor @ turn
    _, _, a, b = _pair(3, R_flange_sensor=turned)
    assert rotation_angle(rig.R_flange_sensor, turned) == pytest.approx(np.deg2rad(degrees))
    assert a.diff(b).mounting_angle == pytest.approx(np.deg2rad(degrees), rel=1e-3)


@pytest.mark.slow
def test_the_largest_change_of_the_free_wrench() -> None:
    rig, other, a, b = _pair(4, weight=9.0)
    largest = a.diff(b).free_wrench
    somewhere = random_rotations(20_000, np.random.default_rng(4))
    reached = np.abs(readings(other, somewhere) - readings(rig, somewhere)).max(axis=0)
    assert largest == pytest.approx(reached, rel=0.02)
    assert largest[:3] == pytest.approx(np.full(3, abs(9.0 - rig.weight)), rel=0.02)


def test_same_tool_measured_twice_is_not_significant_and_another_is() -> None:
    rig, R, rng = example(5)
    a, b = (cw.calibrate(noisy(rig, R, rng), "mount") for _ in range(2))
    heavier = cw.calibrate(noisy(replace(rig, weight=rig.weight + 1.0), R, rng), "mount")
    assert "weight" not in a.diff(b).significant
    assert "weight" in a.diff(heavier).significant
    assert _of(a.diff(b), "weight")[1] == pytest.approx(np.hypot(a.std["weight"], b.std["weight"]))


@pytest.mark.parametrize(("deviations", "named"), [(2.7, ()), (3.3, ("weight",))])
def test_what_changed_by_more_than_three_standard_deviations_is_named(
    deviations: float, named: tuple[str, ...]
) -> None:
    rig, R, _ = example(9)
    a = cw.calibrate(noise_free(rig, R), "mount", noise=NOISE)
    heavier = rig.weight + deviations * np.sqrt(2.0) * a.std["weight"]
    change = a.diff(cw.calibrate(noise_free(replace(rig, weight=float(heavier)), R), "mount", noise=NOISE))
    assert change.significant == named
    assert ("* more than 3 standard deviations: weight" in difference_text(change)) == bool(named)


def test_a_tool_counts_with_what_is_known_of_its_own_noise() -> None:
    """And not with that of the worst known bias, which hid 30 g that were 4.6 standard deviations."""
    a, b = _calibrated(RIG, 3), _calibrated(RIG, 4)
    few = np.where(np.array(a.parameter_names) == "bias_fz", 5.0, 60.0)
    a, b = (replace(c, dof=5.0, parameter_dof=few) for c in (a, b))
    heavier = replace(b, parameters=b.parameters + 6.0 * b.std["weight"] * (np.array(b.parameter_names) == "weight"))
    groups = {group.name: group for group in a.diff(heavier).groups}
    assert groups["tool"].test.dof == pytest.approx(120.0, rel=0.2)
    assert groups["bias"].test.dof == pytest.approx(10.0, rel=0.2)
    older = [replace(c, parameter_dof=None) for c in (a, heavier)]
    assert {group.test.dof < 12.0 for group in older[0].diff(older[1]).groups} == {True}


def test_models_without_a_tool_have_their_bias_in_common() -> None:
    rig, R, rng = example(6)
    samples = noisy(rig, R, rng)
    change = cw.calibrate(samples, "affine").diff(cw.calibrate(samples, "mount"))
    assert change.names == ("bias_fx", "bias_fy", "bias_fz", "bias_tx", "bias_ty", "bias_tz")
    assert change.mounting_angle is None


def test_a_calibration_does_not_differ_from_itself() -> None:
    rig, R, rng = example(7)
    calibration = cw.calibrate(noisy(rig, R, rng), "mount")
    change = calibration.diff(calibration)
    assert not change.change.any()
    assert not change.free_wrench.any()
    assert change.significant == ()
    assert change.mounting_angle == pytest.approx(0.0, abs=1e-7)


def test_two_bases_are_compared_each_in_its_own() -> None:
    """The same tool on an upright robot and on a wall: nothing changes for the tool that points to the ground."""
    rig, R, rng = example(8)
    turn = random_rotations(1, rng)[0]
    a = cw.calibrate(noise_free(rig, R), "mount")
    b = cw.calibrate(cw.Samples(readings(rig, R), turn @ R), "mount", gravity=turn @ rig.down)
    assert np.abs(_of(a.diff(b), "weight")[0]) < 1e-8


# What a difference means


@cache
def _calibrated(
    rig: Rig, seed: int, model: str = "mount", poses: int = 16, noise: tuple[float, ...] | None = None
) -> cw.Calibration:
    """The rig calibrated from noisy readings in poses of the seed's own."""
    rng = np.random.default_rng(seed)
    return cw.calibrate(noisy(rig, random_rotations(poses, rng), rng), model, noise=noise)


def _measured(rig: Rig, seed: int, model: str = "mount", poses: int = 16, **changes: Any) -> Difference:
    """The rig calibrated before and after it changed."""
    return _calibrated(rig, seed, model, poses).diff(_calibrated(replace(rig, **changes), seed + 1000, model, poses))


RIG = Rig(
    weight=12.0,
    com=np.array([0.01, -0.02, 0.06]),
    bias=np.array([3.0, -5.0, 20.0, 0.2, -0.1, 0.05]),
    R_flange_sensor=Rotation.from_euler("zyx", [75.0, 30.0, -40.0], degrees=True).as_matrix(),
    down=np.array([0.0, 0.0, -1.0]),
)
FLAT = replace(RIG, R_flange_sensor=Rotation.from_euler("z", 0.5).as_matrix())
DRIFTED = RIG.bias + np.array([0.3, 0.0, 0.0, 0.0, 0.01, 0.0])


def _turned(R: Array, degrees: float, axis: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Array:
    turned: Array = R @ Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis)).as_matrix()
    return turned


@pytest.mark.slow
@pytest.mark.parametrize("model", ["mount", "mount+base", "yaw", "affine"])
def test_nothing_changed(model: str) -> None:
    change = _measured(FLAT, 0, model)
    assert not [group for group in change.groups if group.significant]
    (sentence,) = change.meaning
    assert sentence.startswith("nothing changed beyond the errors of both: chi-square ")


@pytest.mark.slow
def test_false_alarms_of_any_group_are_rare() -> None:
    pairs = pairwise(_calibrated(RIG, seed) for seed in range(16))
    alarms = sum(any(group.significant for group in before.diff(after).groups) for before, after in pairs)
    assert alarms == 0


@pytest.mark.slow
def test_probabilities_are_those_of_chance() -> None:
    """With the noise given up to its scale, each group's probability is uniform."""
    pairs = pairwise(_calibrated(RIG, seed, "mount+base", noise=tuple(NOISE)) for seed in range(21))
    found = [[group.test.probability for group in before.diff(after).groups] for before, after in pairs]
    assert np.mean(found, axis=0) == pytest.approx(np.full(5, 0.5), abs=0.21)  # three of its std


def test_what_comes_from_one_calibration_is_no_evidence() -> None:
    """That only the zero changed, and that nothing did: of two generations, and of siblings; another one is."""
    rig, R, rng = example(5, 12)
    earlier, other = (cw.calibrate(noisy(rig, R, rng)) for _ in range(2))
    moved = replace(rig, bias=rig.bias + np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    later, same = (cw.calibrate(noisy(now, random_rotations(4, rng), rng), prior=earlier) for now in (moved, rig))
    again = cw.calibrate(noisy(rig, random_rotations(4, rng), rng), prior=later)
    drift, nothing = "drift, or a new zero", "nothing changed"
    for a, b, begins in (
        (earlier, later, drift),
        (earlier, same, nothing),
        (later, same, drift),
        (again, later, drift),
    ):
        for change in (a.diff(b), b.diff(a)):
            (said,) = change.meaning
            assert said.startswith(begins)
            assert said.endswith(
                "; tool, mounting and base of both come from one calibration (--prior): that they are the same is no "
                "finding"
            )
        assert "--prior" not in other.diff(b).meaning[0]
    assert "--prior" not in earlier.diff(earlier).meaning[0]


MOUNTED_ANEW = "the sensor slipped or was mounted anew, or the robot reports the orientation of another TCP"
CHANGES: list[tuple[str, Rig, str, dict[str, Any], list[str]]] = [
    ("heavier", RIG, "mount", {"weight": 13.0}, ["the tool changed: weight by +"]),
    (
        "another tool",
        RIG,
        "mount",
        {"weight": 9.0, "com": np.array([0.0, 0.0, 0.1])},
        ["the tool changed: weight by -"],
    ),
    (
        "moved",
        RIG,
        "mount",
        {"com": RIG.com + np.array([0.0, 0.0, 0.004])},
        ["something moved on the tool: com_z by +"],
    ),
    ("drift", RIG, "mount", {"bias": DRIFTED}, ["drift, or a new zero: only the bias changed, bias_fx by +0."]),
    (
        "drift, affine",
        RIG,
        "affine",
        {"bias": DRIFTED},
        ["drift, or a new zero: only the bias changed, bias_fx by +0."],
    ),
    (
        "tool and zero",
        RIG,
        "mount",
        {"weight": 9.0, "bias": DRIFTED},
        ["the tool changed: weight by -", "the bias changed as well: bias_fx by +0."],
    ),
    (
        "slipped",
        RIG,
        "mount",
        {"R_flange_sensor": _turned(RIG.R_flange_sensor, 3.0, (0.0, 1.0, 0.0))},
        [f"{MOUNTED_ANEW}: it is turned by "],
    ),
    (
        "slipped about z",
        FLAT,
        "yaw",
        {"R_flange_sensor": _turned(FLAT.R_flange_sensor, -3.0, (0.0, 0.0, 1.0))},
        [f"{MOUNTED_ANEW}: yaw by -"],
    ),
    (
        "other side",
        FLAT,
        "yaw",
        {"R_flange_sensor": _turned(FLAT.R_flange_sensor, 180.0)},
        ["the sensor was mounted anew, on its other side: its z points along the flange's in one of the two only"],
    ),
    ("stand", RIG, "mount+base", {"down": rx(0.05) @ RIG.down}, ["the base stands otherwise: gravity is "]),
    ("gain", RIG, "affine", {"weight": 13.0}, ["what gravity does changed (chi-square "]),
]


@pytest.mark.parametrize(
    ("rig", "model", "changes", "sentences"), [c[1:] for c in CHANGES], ids=[c[0] for c in CHANGES]
)
def test_what_changed_and_nothing_else(rig: Rig, model: str, changes: dict[str, Any], sentences: list[str]) -> None:
    found = _measured(rig, 1, model, **changes).meaning
    assert len(found) == len(sentences)
    for sentence, begin in zip(found, sentences, strict=True):
        assert sentence.startswith(begin)


@pytest.mark.slow
def test_a_tool_change_is_not_read_as_drift_nor_drift_as_a_tool() -> None:
    for seed in range(2):
        tool = {g.name for g in _measured(RIG, seed, weight=14.0).groups if g.significant}
        drift = {g.name for g in _measured(RIG, seed, bias=DRIFTED).groups if g.significant}
        assert tool == {"tool", "all"}
        assert drift == {"bias", "all"}


def test_the_turn_of_the_mounting_is_in_sensor_axes() -> None:
    """Small noise: the sentence as a whole."""
    rng = np.random.default_rng(2)
    after = replace(RIG, R_flange_sensor=_turned(RIG.R_flange_sensor, 4.0, (0.0, 0.6, 0.8)))
    a, b = (cw.calibrate(noisy(rig, random_rotations(20, rng), rng, 1e-2 * NOISE), "mount") for rig in (RIG, after))
    (sentence,) = a.diff(b).meaning
    head, _, tail = sentence.partition(" (chi-square ")
    begin = f"{MOUNTED_ANEW}: it is turned by 4 deg about"
    assert head.replace("-0.00", "0.00") == f"{begin} (0.00, 0.60, 0.80) in sensor axes"
    assert tail.endswith("probability under 0.01 %)")


def test_bases_that_were_stated_apart() -> None:
    rig, R, rng = example(8)
    turn = rx(0.5)
    a = cw.calibrate(noisy(rig, R, rng), "mount")
    b = cw.calibrate(cw.Samples(noisy(rig, R, rng).wrench, turn @ R), "mount", gravity=turn @ rig.down)
    assert a.diff(b).meaning[1:] == (
        "gravity was stated 28.6 deg apart in base axes: another stand, or another option",
    )
    assert len(a.diff(a).meaning) == 1


def test_poses_that_cannot_tell_a_tool_from_a_zero() -> None:
    """All poses within 2 deg of the vertical: a heavier tool and a shifted fz read alike."""
    rng = np.random.default_rng(3)
    tilts = np.deg2rad(2.0) * rng.uniform(-1.0, 1.0, size=(20, 2))
    R = np.array([rx(np.pi + a) @ ry(b) for a, b in tilts])
    upright = replace(RIG, R_flange_sensor=np.eye(3))
    heavier = replace(upright, weight=12.4)
    a, b = (cw.calibrate(noisy(rig, R, rng), "yaw", noise=NOISE) for rig in (upright, heavier))
    (sentence,) = a.diff(b).meaning
    assert sentence.startswith("something changed (chi-square ")
    assert sentence.endswith(
        "but these calibrations cannot tell what: the tool or the bias alone would explain it; calibrate with poses "
        "that tilt the tool further"
    )


def test_weight_and_com_that_show_together_only() -> None:
    change = _measured(RIG, 4, weight=13.0)
    (tool,) = (group for group in change.groups if group.name == "tool")
    covariance = np.diag([1.0, 1e-6, 1e-6, 1e-6])
    covariance[0, 1] = covariance[1, 0] = 0.999e-3
    together = replace(tool, change=np.array([1.5, -1.5e-3, 0.0, 0.0]), covariance=covariance)
    changed = replace(change, groups=(together, *change.groups[1:]))
    assert changed.meaning[0].startswith("the tool changed: weight and centre of mass together (chi-square ")


def test_yaw_is_left_out_between_sides() -> None:
    """Its zero is another one on the other side; the angle between the mountings speaks."""
    turned = replace(FLAT, R_flange_sensor=_turned(FLAT.R_flange_sensor, 180.0))
    for model in ("yaw", "mount"):
        change = _measured(FLAT, 5, model, R_flange_sensor=turned.R_flange_sensor)
        assert "yaw" not in change.names
        assert change.mounting_angle == pytest.approx(np.pi, abs=0.02)
        assert "mounting" in [group.name for group in change.groups if group.significant]
        assert "yaw" in _measured(FLAT, 5, model).names


def test_changes_in_standard_deviations() -> None:
    rig, R, rng = example(9)
    a, b = (cw.calibrate(noisy(rig, R, rng), "mount") for _ in range(2))
    change = a.diff(b)
    assert change.in_std == pytest.approx(change.change / change.std)
    assert not a.diff(a).in_std.any()


def test_two_ways_to_judge_agree() -> None:
    """The weight alone, as a group of one, and its column of standard deviations: z^2 is chi-square."""
    change = _measured(FLAT, 6, "yaw")
    (mounting,) = (group for group in change.groups if group.name == "mounting")
    assert mounting.test.misfit == pytest.approx(change.in_std[list(change.names).index("yaw")] ** 2)


def _moving(seed: int) -> cw.Calibration:
    """A calibration that knows an inertia, its std 1 kg cm^2 and 1 mm, correlated with the weight."""
    calibration: cw.Calibration = pytest.importorskip("tests.support.moving_tool").known(seed, "mount", noise=1.0)[1]
    return calibration


def _with_inertia(c: cw.Calibration, inertia: Array, offset: Array) -> cw.Calibration:
    assert c.dynamics is not None
    moved = replace(c.dynamics, inertia=c.dynamics.inertia + inertia, sensor_offset=c.dynamics.sensor_offset + offset)
    return replace(c, dynamics=moved)


def test_inertia_and_offset_are_compared_where_both_know_them() -> None:
    a = _moving(2)
    assert a.dynamics is not None
    b = _with_inertia(a, 1e-3 * np.diag([1.0, 2.0, 0.0]), np.array([0.0, 0.0, 0.04]))
    change = a.diff(b)
    std = np.sqrt(2.0) * a.dynamics.std
    expected = {"inertia_xx": (1e-3, std[0]), "inertia_yz": (0.0, std[4]), "offset_z": (0.04, std[8])}
    for name, pair in expected.items():
        assert _of(change, name) == pytest.approx(pair)
    units = dict(zip(change.names, change.units, strict=True))
    assert (units["inertia_yy"], units["offset_x"]) == ("kg m^2", "m")
    assert change.inertia_known == (True, True)
    groups = {group.name: group for group in change.groups}
    assert list(groups) == ["tool", "bias", "mounting", "inertia", "offset", "all"]
    assert len(groups["all"].parameters) == 10 + 3 + 9
    inertia = 2.0 * a.dynamics.covariance[:6, :6]
    by_hand = groups["inertia"].change @ np.linalg.solve(inertia, groups["inertia"].change) / 6.0
    assert groups["inertia"].test.chi2 == pytest.approx(by_hand)
    assert not groups["tool"].significant
    said = [sentence.partition(":")[0] for sentence in change.meaning]
    assert said == ["the tool's inertia changed", "the sensor's place on the flange changed"]
    assert "inertia_yy by +20 kg cm^2 (" in change.meaning[0]
    assert "offset_z by +40 mm (" in change.meaning[1]


def test_the_same_tool_twice_in_motion_has_not_changed() -> None:
    a = _moving(2)
    change = a.diff(_with_inertia(a, 1e-6 * np.eye(3), np.array([1e-5, 0.0, 0.0])))
    assert change.meaning[0].startswith("nothing changed beyond the errors of both: ")


@pytest.mark.parametrize(("known", "one"), [((True, False), "earlier"), ((False, True), "later")])
def test_an_inertia_that_one_knows_is_not_compared_and_that_is_said(known: tuple[bool, bool], one: str) -> None:
    moving = _moving(2)
    a, b = (moving if yes else replace(moving, dynamics=None) for yes in known)
    change = a.diff(b)
    assert change.inertia_known == known
    assert not any(name.startswith(("inertia", "offset")) for name in change.names)
    assert [group.name for group in change.groups] == ["tool", "bias", "mounting", "all"]
    line = f"  inertia and sensor offset are known of the {one} one only, and not compared"
    assert line in difference_text(change).splitlines()
    assert json.loads(difference_json(change))["inertia_known"] == list(known)


def test_a_changed_inertia_is_printed_in_kg_cm2_and_in_json_in_si() -> None:
    a = _moving(2)
    change = a.diff(_with_inertia(a, 1e-3 * np.diag([1.0, 2.0, 0.0]), np.zeros(3)))
    (line,) = (line for line in difference_text(change).splitlines() if "inertia_yy" in line.split()[:2])
    assert line.split()[:2] == ["*", "inertia_yy"]
    assert line.split()[2] == "+20"
    assert "kg cm^2" in line
    assert json.loads(difference_json(change))["change"]["inertia_yy"] == pytest.approx(2e-3)
