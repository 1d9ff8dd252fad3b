"""What is known beside the readings: a weight from a scale, a com from a drawing, an earlier calibration."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.errors import AmbiguityError, InputError
from contactwrench.estimation.priors import (
    known_as,
    known_of,
    nominal_mounting,
    tool_of,
)
from contactwrench.model import PARAMETERS, stepped
from tests.support.poses import POSE_SETS
from tests.support.recordings import PANDA, Run, csv_text, run, written
from tests.support.rigs import NOISE, example, noisy, rotation_angle
from tests.support.world import noisy_readings, random_rotations, readings, tilted_down

Capture = pytest.CaptureFixture[str]
PAPER_POSES = POSE_SETS["paper's 6"]


@pytest.mark.parametrize("model", ["auto", "yaw", "mount", "mount+base"])
def test_a_known_weight_joins_the_readings(model: str) -> None:
    """Six poses near the vertical cannot tell the weight from the bias; a scale can."""
    rig, _, rng = example(1)
    rig = replace(rig, weight=10.0, R_flange_sensor=Rotation.from_euler("z", 0.7).as_matrix())
    samples = noisy(rig, PAPER_POSES, rng, 4.0 * NOISE)
    alone = cw.calibrate(samples, model)
    known = cw.calibrate(samples, model, known={"weight": (10.0, 0.02)})
    assert alone.std["weight"] > 0.05
    assert known.std["weight"] < 0.02
    assert known.weight == pytest.approx(10.0, abs=0.07)
    assert known.std["bias"][2] < alone.std["bias"][2]


def test_what_is_known_with_a_std_is_weighed_against_the_readings() -> None:
    """As two measurements of one weight: the mean by their inverse variances."""
    rig, R, rng = example(2)
    samples = noisy(rig, R, rng)
    alone = cw.calibrate(samples, "mount")
    assert alone.weight is not None
    std = alone.std["weight"]
    known = cw.calibrate(samples, "mount", known={"weight": (alone.weight + 2.0 * std, std)})
    assert known.weight == pytest.approx(alone.weight + std, abs=0.2 * std)
    assert known.std["weight"] == pytest.approx(std / np.sqrt(2.0), rel=0.05)


def test_known_com_mounting_and_gravity() -> None:
    rig, R, rng = example(3, poses=8)
    rig = replace(rig, down=tilted_down(np.deg2rad(40.0), rng))
    samples = noisy(rig, R, rng, 20.0 * NOISE)
    exact = {
        "com": (rig.com, 1e-5),
        "mount": (rig.R_flange_sensor, (1e-5, 1e-5, 1e-5)),
        "gravity": (7.0 * rig.down, 1e-5),
    }
    calibration = cw.calibrate(samples, "mount+base", known=exact)
    assert calibration.com == pytest.approx(rig.com, abs=1e-4)
    assert calibration.R_flange_sensor is not None
    assert rotation_angle(calibration.R_flange_sensor, rig.R_flange_sensor) < 1e-4
    assert calibration.gravity_direction == pytest.approx(rig.down, abs=1e-4)
    assert max(calibration.std["mount"]) < 2e-5
    assert max(calibration.std["gravity"]) < 2e-5


def test_known_things_can_stand_in_for_poses() -> None:
    """Two poses cannot tell everything; with com and mounting known they can."""
    rig, R, rng = example(4, poses=2)
    known = {"com": (rig.com, 1e-4), "mount": (rig.R_flange_sensor, 1e-4)}
    calibration = cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE, known=known)
    assert calibration.weight == pytest.approx(rig.weight, abs=6.0 * calibration.std["weight"])
    with pytest.raises(cw.ContactWrenchError, match="cannot separate"):
        cw.calibrate(noisy(rig, R, rng), "mount", noise=NOISE)


@pytest.mark.parametrize("model", ["auto", "yaw", "mount", "mount+base"])
def test_a_single_pose_gives_the_bias_anew(model: str) -> None:
    rig, R, rng = example(5)
    if model == "yaw":
        rig = replace(rig, R_flange_sensor=Rotation.from_euler("z", 2.0).as_matrix())
    earlier = cw.calibrate(noisy(rig, R, rng), model)
    moved = replace(rig, bias=rig.bias + np.array([1.0, -2.0, 3.0, 0.1, 0.0, -0.1]))
    one = random_rotations(1, rng)
    calibration = cw.calibrate(cw.Samples(noisy_readings(moved, one, NOISE, rng), one), prior=earlier)
    assert np.abs((calibration.bias - moved.bias) / calibration.std["bias"]).max() < 4.5
    assert (calibration.std["bias"] > 0.7 * earlier.noise).all()
    assert calibration.weight == pytest.approx(earlier.weight, rel=1e-6)
    assert calibration.std["weight"] == pytest.approx(earlier.std["weight"], rel=1e-3)
    assert calibration.dof == pytest.approx(earlier.dof, rel=0.15)


@pytest.mark.parametrize("poses", [4, 6])
def test_a_new_zero_knows_a_tool_no_better_than_the_few_poses_that_told_it(poses: int) -> None:
    """Their variance is uncertain: by a normal distribution the interval would be too narrow."""
    rig, R, rng = example(5, poses=poses)
    earlier, one = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(1, rng)
    now = cw.calibrate(cw.Samples(noisy_readings(rig, one, NOISE, rng), one), prior=earlier)
    for name in ("weight", "com", "yaw"):
        assert np.ptp(now.interval(name), axis=0) == pytest.approx(np.ptp(earlier.interval(name), axis=0), rel=0.05)
    assert now.dof < 1.5 * earlier.dof


def test_what_is_weighed_exactly_is_as_certain_beside_an_earlier_calibration_of_few_poses() -> None:
    rig, R, rng = example(5, poses=4)
    earlier, one = cw.calibrate(noisy(rig, R, rng), "mount"), random_rotations(1, rng)
    known = {"weight": (rig.weight, 1e-3 * earlier.std["weight"])}
    now = cw.calibrate(cw.Samples(noisy_readings(rig, one, NOISE, rng), one), prior=earlier, known=known)
    assert now.parameter_dof is not None
    assert now.parameter_dof[0] > 1e4
    assert now.parameter_dof[4:10].max() < 20.0


def test_a_new_zero_makes_no_sensor_exact() -> None:
    """Whose gains are 1 % off: at other orientations the contact force is as uncertain as it was."""
    rig, R, rng = example(6, poses=25)
    gain = np.eye(6) + 0.01 * rng.normal(size=(6, 6)) * np.outer([1.0] * 3 + [0.05] * 3, [1.0] * 3 + [20.0] * 3)
    wrench = (readings(rig, R) - rig.bias) @ gain.T + rig.bias + NOISE * rng.normal(size=(25, 6))
    earlier = cw.calibrate(cw.Samples(wrench[:24], R[:24]))
    now = cw.calibrate(cw.Samples(wrench[24:] + 0.1, R[24:]), prior=earlier)
    unseen = random_rotations(50, rng)
    left = now.compensate((readings(rig, unseen) - rig.bias) @ gain.T + rig.bias + 0.1, unseen)[:, :3]
    std = now.wrench_std(unseen)[:, :3]
    assert std.mean() > 0.95 * earlier.wrench_std(unseen)[:, :3].mean()
    assert np.sqrt(np.mean((left / std) ** 2)) < 2.0


def test_what_a_gain_reads_in_the_pose_of_a_new_zero_is_in_the_std_of_the_bias() -> None:
    off = []
    for seed in range(8):
        rig, R, rng = example(seed, poses=13)
        rig = replace(rig, weight=40.0)
        wrong = 0.01 * rng.normal(size=(6, 6)) * np.outer([1.0] * 3 + [0.05] * 3, [1.0] * 3 + [20.0] * 3)
        wrench = readings(rig, R) + (readings(rig, R) - rig.bias) @ wrong.T
        wrench += 0.02 * NOISE * rng.normal(size=(13, 6))
        now = cw.calibrate(cw.Samples(wrench[12:], R[12:]), prior=cw.calibrate(cw.Samples(wrench[:12], R[:12])))
        off.append((now.bias - rig.bias) / now.std["bias"])
    assert np.sqrt(np.mean(np.square(off))) < 1.3


@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ((None, None), (0.03, 1e-4)),
        ((0.8, 1.0), (0.03, 1e-4)),
        ((0.0302, 1e-4), (0.0301, 1e-4 / np.sqrt(2.0))),
        ((0.05, 5e-4), (0.05, 5e-4)),
    ],
)
def test_a_delay_is_known_from_an_earlier_calibration_until_a_recording_tells_another(
    own: tuple[float | None, float | None], expected: tuple[float, float]
) -> None:
    """A new zero says nothing of it, and without it contact forces are off by the weight's turn in that time."""
    rig, R, rng = example(4, poses=13)
    wrench = noisy_readings(rig, R, NOISE, rng)
    earlier = cw.calibrate(cw.Samples(wrench[:12], R[:12], delay=0.03, delay_std=1e-4))
    now = cw.calibrate(cw.Samples(wrench[12:], R[12:], delay=own[0], delay_std=own[1]), prior=earlier)
    assert (now.delay, now.delay_std) == pytest.approx(expected, rel=1e-3)
    assert cw.Compensator(now).delay == pytest.approx(expected[0], rel=1e-3)


def test_a_delay_between_two_clocks_is_of_one_recording_alone() -> None:
    rig, R, rng = example(4, poses=13)
    wrench = noisy_readings(rig, R, NOISE, rng)
    earlier = cw.calibrate(cw.Samples(wrench[:12], R[:12], delay=0.8, delay_std=1e-3))
    now = cw.calibrate(cw.Samples(wrench[12:], R[12:]), prior=earlier)
    assert (now.delay, now.delay_std) == (None, None)
    assert Kind.CLOCKS_APART not in [finding.kind for finding in now.findings]


def test_one_row_is_noisier_than_the_mean_of_many() -> None:
    """The earlier poses averaged 400 rows each; a single row scatters 20 times as much."""
    rig, R, rng = example(12, poses=8)
    noise = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    many = np.repeat(R, 400, axis=0)
    earlier = cw.calibrate(cw.Samples(noisy_readings(rig, many, noise, rng), many), "mount")
    off = []
    for _ in range(30):
        one = random_rotations(1, rng)
        now = cw.calibrate(cw.Samples(noisy_readings(rig, one, noise, rng), one), prior=earlier)
        off.append((now.bias - rig.bias) / now.std["bias"])
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=0.4)


def test_what_is_known_takes_the_place_of_the_prior() -> None:
    """A base 3 deg off level, known to within 5: the prior of 0.71 deg has no say in it."""
    rig, R, rng = example(13, poses=12)
    rig = replace(rig, weight=20.0, down=tilted_down(np.deg2rad(3.0), rng))
    calibration = cw.calibrate(noisy(rig, R, rng), known={"gravity": ((0, 0, -1), np.deg2rad(5.0))})
    assert calibration.gravity_direction == pytest.approx(rig.down, abs=0.01)
    assert calibration.assumptions[1].startswith("base: as known; gravity is found 2.9") or calibration.assumptions[
        1
    ].startswith("base: as known; gravity is found 3.0")
    mounted = cw.calibrate(noisy(rig, R, rng), known={"mount": (rig.R_flange_sensor, 0.01)})
    assert mounted.assumptions[0].startswith("mounting: as known; sensor's z is found ")


def test_a_new_zero_of_many_poses_leaves_the_tool_as_it_was() -> None:
    """They tell the bias better than one pose, and what else they tell is not mixed in."""
    rig, R, rng = example(6, poses=8)
    earlier = cw.calibrate(noisy(rig, R, rng), "mount")
    more = random_rotations(24, rng)
    samples = noisy(rig, more, rng)
    one, all_of_them = (cw.calibrate(each, prior=earlier) for each in (samples.select(slice(1)), samples))
    for name in ("weight", "com", "R_flange_sensor"):
        assert getattr(all_of_them, name) == pytest.approx(getattr(earlier, name), rel=1e-6, abs=1e-8)
    assert all_of_them.std["weight"] == pytest.approx(earlier.std["weight"], rel=1e-3)
    assert max(all_of_them.std["bias"] / one.std["bias"]) < 0.7
    assert np.abs((all_of_them.bias - rig.bias) / all_of_them.std["bias"]).max() < 4.0
    assert all_of_them.verdict == "good"


def test_a_tool_that_was_known_badly_is_no_fault_of_the_poses_of_a_new_zero() -> None:
    """A cone leaves much of it open: spread poses miss that tool, which is no noise of theirs."""
    off = []
    for seed in range(10):
        rig, _, rng = example(seed)
        rig = replace(rig, weight=20.0)
        cone = cw.calibrate(noisy(rig, PAPER_POSES, rng), "mount")
        now = cw.calibrate(noisy(rig, random_rotations(6, rng), rng), prior=cone)
        assert {finding.kind for finding in now.findings} <= {Kind.ADVICE, Kind.UNCERTAIN_PARAMETER}
        off.append((now.bias - rig.bias) / now.std["bias"])
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_gain_that_was_known_is_no_drift_and_no_backlash_of_a_new_zero() -> None:
    """And the poses that it was found with do not tell the tool better than they did."""
    for seed in range(5):
        rig, R, rng = example(seed, poses=36)
        rig = replace(rig, weight=20.0)
        wrong = 0.01 * rng.normal(size=(6, 6)) * np.outer([1.0] * 3 + [0.05] * 3, [1.0] * 3 + [20.0] * 3)
        wrench = readings(rig, R) + (readings(rig, R) - rig.bias) @ wrong.T + NOISE * rng.normal(size=(36, 6))
        t = 10.0 * np.arange(36.0)
        earlier = cw.calibrate(cw.Samples(wrench[:24], R[:24], t[:24]))
        for again in (slice(24, 36), slice(24)):
            now = cw.calibrate(cw.Samples(wrench[again], R[again], t[again]), prior=earlier)
            assert {finding.kind for finding in now.findings} <= {Kind.GAIN, Kind.CROSS_TALK}
            assert np.abs((now.bias - rig.bias) / now.std["bias"]).max() < 4.0


def test_a_weight_from_a_scale_is_mixed_with_that_of_an_earlier_calibration() -> None:
    rig, R, rng = example(6, poses=8)
    earlier, again = (cw.calibrate(noisy(rig, R, rng), "mount"), noisy(rig, random_rotations(6, rng), rng))
    assert earlier.weight is not None
    std = earlier.std["weight"]
    now = cw.calibrate(again, prior=earlier, known={"weight": (earlier.weight + std, std)})
    assert now.weight == pytest.approx(earlier.weight + 0.5 * std, abs=0.05 * std)
    assert now.std["weight"] == pytest.approx(std / np.sqrt(2.0), rel=0.02)


def test_errors_that_were_there_before_do_not_average_out_over_new_zeros() -> None:
    """A sensor whose gains are 1 % off: from zero to zero its weight stays as uncertain as it was, and as right."""
    off = []
    for seed in range(6):
        rig, R, rng = example(seed, poses=48)
        rig = replace(rig, weight=20.0)
        wrong = 0.01 * rng.normal(size=(6, 6)) * np.outer([1.0] * 3 + [0.05] * 3, [1.0] * 3 + [20.0] * 3)
        wrench = readings(rig, R) + (readings(rig, R) - rig.bias) @ wrong.T + NOISE * rng.normal(size=(48, 6))
        first = now = cw.calibrate(cw.Samples(wrench[:24], R[:24]))
        for begin in (24, 36):
            now = cw.calibrate(cw.Samples(wrench[begin : begin + 12], R[begin : begin + 12]), prior=now)
        assert now.std["weight"] > 0.99 * first.std["weight"]
        off.append(np.append((now.bias - rig.bias) / now.std["bias"], (now.weight - rig.weight) / now.std["weight"]))  # type: ignore[operator]
    assert np.sqrt(np.mean(np.square(off), axis=0)).max() < 2.0


@pytest.mark.parametrize(("weight", "push"), [(20.0, 0.0), (21.0, 0.0), (20.0, 5.0)])
def test_in_four_poses_with_times_another_tool_or_a_push_is_no_bias_that_moves(weight: float, push: float) -> None:
    for seed in range(5):
        rig, R, rng = example(seed, poses=16)
        rig = replace(rig, weight=20.0)
        earlier = cw.calibrate(noisy(rig, R[:12], rng))
        wrench = noisy_readings(replace(rig, weight=weight), R[12:], NOISE, rng)
        wrench[3, 2] -= push
        now = cw.calibrate(cw.Samples(wrench, R[12:], 20.0 * np.arange(4.0)), prior=earlier)
        contradicts = [each.severity for each in now.findings if each.kind is Kind.CONTRADICTS_PRIOR]
        assert contradicts == ([] if weight == 20.0 and push == 0.0 else [Severity.WEAK])


@pytest.mark.parametrize("seed", range(3))
def test_poses_that_tell_the_tool_better_than_before_say_so(seed: int) -> None:
    rig, _, rng = example(seed)
    cone = cw.calibrate(noisy(rig, PAPER_POSES, rng), "mount")
    samples = noisy(rig, random_rotations(12, rng), rng)
    text = (
        "tool, mounting and base stay as the earlier calibration has them, and by themselves these poses tell them "
        "better: calibrate without --prior"
    )
    assert text in cw.calibrate(samples, prior=cone).warnings
    assert text not in cw.calibrate(noisy(rig, PAPER_POSES, rng), prior=cw.calibrate(samples, "mount")).warnings


def test_poses_that_contradict_the_earlier_calibration_are_said() -> None:
    rig, R, rng = example(7, poses=12)
    rig = replace(rig, weight=10.0)
    earlier = cw.calibrate(noisy(rig, R, rng), "mount")
    other = replace(rig, weight=12.0, com=rig.com + np.array([0.02, 0.0, 0.0]))
    calibration = cw.calibrate(noisy(other, R, rng), prior=earlier)
    (warning,) = (text for text in calibration.warnings if "earlier" in text)
    assert warning == (
        "weak: the poses contradict the earlier calibration: tool, mounting or base changed, the tool touches "
        "something, or the poses are noisier (--noise); calibrate anew, without --prior"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"known": {"mass": (1.0, 0.1)}},
            "known 'mass' is not an unknown of the tool, expected one of weight, com, mount, gravity",
        ),
        ({"known": {"weight": 3.0}}, "known weight is 3.0, expected a pair: the value and its std"),
        ({"known": {"weight": (3.0, 0.0)}}, "std of known weight is 0, expected 1e-06 to 1e+06 N"),
        (
            {"known": {"weight": (3.0, (1, 2, 3))}},
            "std of known weight is (1, 2, 3), expected a number, 1e-06 to 1e+06 N",
        ),
        ({"known": [1]}, "known is list, expected a mapping, as in {'weight': (12.3, 0.1)}"),
        ({"prior": 3}, "prior is int, expected a Calibration: cw.Calibration.load(path)"),
        ({"known": {"weight": (-3.0, 0.1)}}, "known weight is -3, expected 1e-06 to 1e+06 N"),
        ({"known": {"weight": (np.nan, 0.1)}}, "known weight is nan, expected 1e-06 to 1e+06 N"),
        ({"known": {"com": ([1.0], 0.1)}}, "known com is [1.0], expected numbers (3,), -10 to 10 m (is it in mm?)"),
        (
            {"known": {"weight": (3.0, 0.1)}, "model": "affine"},
            "model affine takes nothing as known: leave known out, or choose another model",
        ),
        (
            {"known": {"gravity": ((0, 0, -1), 0.1)}, "model": "mount"},
            "model mount holds gravity, and gravity is given as known with a std: choose auto or mount+base",
        ),
        (
            {"known": {"gravity": ((0, 0, -1), 0.1)}, "gravity": (0, 0, -1)},
            "gravity is stated and given as known too: leave one of them out",
        ),
    ],
)
def test_what_cannot_be_known_is_refused(arguments: dict[str, object], message: str) -> None:
    rig, R, rng = example(8)
    with pytest.raises(InputError) as refusal:
        cw.calibrate(noisy(rig, R, rng), **arguments)  # type: ignore[arg-type]
    assert str(refusal.value) == message


def test_an_earlier_calibration_brings_model_and_gravity() -> None:
    rig, R, rng = example(9)
    samples = noisy(rig, R, rng)
    earlier = cw.calibrate(samples, "mount")
    with pytest.raises(
        InputError, match=r"^an earlier calibration brings its model, and model mount is asked for: leave"
    ):
        cw.calibrate(samples, "mount", prior=earlier)
    with pytest.raises(InputError, match=r"^the prior is a calibration of model affine, expected a rigid tool: "):
        cw.calibrate(samples, prior=cw.calibrate(samples, "affine"))


ON_A_WALL = Rotation.from_euler("z", 0.4, degrees=True).apply([-1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("stated", "refused"),
    [
        ((-1, 0, 0), ""),
        ((0, 0, -1), "0,0,-1 is stated, 90 deg from it, expected at most 2.1"),
        ((-1, 0.05, 0), "-0.999,0.0499,0 is stated, 3.3 deg from it, expected at most 2.1"),
    ],
)
@pytest.mark.parametrize("how", ["gravity", "known"])
def test_an_earlier_calibration_brings_its_gravity(stated: tuple[float, ...], refused: str, how: str) -> None:
    """It may be stated once more, and the earlier one's is kept; another one is refused, both named."""
    rig, R, rng = example(9)
    samples = noisy(replace(rig, down=ON_A_WALL), R, rng)
    earlier, again = cw.calibrate(samples, gravity=(-1, 0, 0)), samples.select(slice(1))
    arguments: dict[str, object] = {how: stated if how == "gravity" else {"gravity": (stated, np.deg2rad(0.71))}}
    if refused:
        with pytest.raises(InputError) as refusal:
            cw.calibrate(again, prior=earlier, **arguments)  # type: ignore[arg-type]
        found = f"an earlier calibration brings gravity -1,-0.0071,0, and {refused}: leave one of them out"
        assert str(refusal.value) == found
        return
    same = cw.calibrate(again, prior=earlier, **arguments)  # type: ignore[arg-type]
    alone = cw.calibrate(again, prior=earlier)
    assert same.bias == pytest.approx(alone.bias, abs=1e-3)
    assert same.gravity_direction == pytest.approx(earlier.gravity_direction, abs=1e-4)


def test_the_gravity_of_the_prior_may_be_said_again(tmp_path: Path, capsys: Capture) -> None:
    assert _calibrate(capsys, "-o", tmp_path / "tool.json").status == 0
    assert _calibrate(capsys, "--prior", tmp_path / "tool.json", "--gravity", "0,0,-1").status == 0
    other = _calibrate(capsys, "--prior", tmp_path / "tool.json", "--gravity=-1,0,0")
    assert other.status == 2
    assert re.fullmatch(
        r"an earlier calibration brings gravity \S+,-1, and -1,0,0 is stated, \d+ deg from it, expected at most 2\.\d: "
        "leave one of them out",
        other.complaint,
    )


def test_a_new_zero_keeps_the_gravity_of_its_place_and_so_the_mass(tmp_path: Path, capsys: Capture) -> None:
    earlier, again = tmp_path / "tool.json", tmp_path / "again.json"
    assert _calibrate(capsys, "-o", earlier, "--g", "9.78").status == 0
    for flags, g in (((), 9.78), (("--g", "9.83"), 9.83)):
        assert _calibrate(capsys, "--prior", earlier, "-o", again, "--force", *flags).status == 0
        assert cw.Calibration.load(again).g == pytest.approx(g, rel=1e-9)
    prior = cw.Calibration.load(earlier)
    assert cw.calibrate(cw.read(PANDA), prior=prior).g == pytest.approx(9.78, rel=1e-9)


def _calibrate(capsys: Capture, *flags: str | Path) -> Run:
    return run(capsys, "calibrate", PANDA, *flags)


@pytest.mark.slow
def test_the_flag_known_speaks_of_every_quantity(tmp_path: Path, capsys: Capture) -> None:
    rig, R, rng = example(10, poses=12)
    quats = Rotation.from_matrix(R).as_quat()
    wrench = noisy_readings(rig, R, NOISE, rng)
    path = written(
        tmp_path,
        csv_text(["fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw"], np.column_stack([wrench, quats])),
    )
    yaw_pitch_roll = Rotation.from_matrix(rig.R_flange_sensor).as_euler("ZYX", degrees=True)
    flags: dict[str, Callable[[cw.Calibration], bool]] = {
        f"mass={rig.weight / 9.80665!r}+-1e-6": lambda c: c.weight == pytest.approx(rig.weight, abs=1e-4),
        f"weight={rig.weight!r}+-1e-5": lambda c: c.weight == pytest.approx(rig.weight, abs=1e-4),
        f"com={','.join(map(repr, rig.com.tolist()))}+-1e-6": lambda c: c.com == pytest.approx(rig.com, abs=1e-5),
        f"com_mm={','.join(map(repr, (1e3 * rig.com).tolist()))}+-1e-3,1e-3,1e-3": lambda c: (
            c.com == pytest.approx(rig.com, abs=1e-5)
        ),
        f"mount={','.join(map(repr, yaw_pitch_roll.tolist()))}+-1e-4": lambda c: (
            rotation_angle(np.asarray(c.R_flange_sensor), rig.R_flange_sensor) < 1e-4
        ),
        f"mount={','.join(map(repr, rig.R_flange_sensor.ravel().tolist()))}+-1e-4": lambda c: (
            rotation_angle(np.asarray(c.R_flange_sensor), rig.R_flange_sensor) < 1e-4
        ),
        "gravity=0,0,-2+-1e-4": lambda c: c.gravity_direction == pytest.approx([0.0, 0.0, -1.0], abs=1e-5),
    }
    for flag, holds in flags.items():
        done = run(capsys, "calibrate", path, "--known", flag, "--force", "-o", tmp_path / "tool.json")
        assert done.status == 0, done.err
        assert holds(cw.Calibration.load(tmp_path / "tool.json")), flag


def test_the_flag_prior_re_zeroes_with_one_pose(tmp_path: Path, capsys: Capture) -> None:
    assert _calibrate(capsys, "-o", tmp_path / "tool.json").status == 0
    lines = [line for line in PANDA.read_text().splitlines() if line and not line.startswith("#")]
    one = written(tmp_path, "\n".join(lines[:2]))
    done = run(capsys, "calibrate", one, "--prior", tmp_path / "tool.json", "-o", tmp_path / "now.json")
    assert done.status == 0
    before, now = cw.Calibration.load(tmp_path / "tool.json"), cw.Calibration.load(tmp_path / "now.json")
    assert now.weight == pytest.approx(before.weight, rel=1e-6)
    assert now.provenance["prior"] == str(PANDA)
    assert now.compensate(cw.read(one).wrench, cw.read(one).R_base_flange) == pytest.approx(np.zeros((1, 6)), abs=1e-9)


def test_derivatives_of_what_is_known_are_those_of_finite_differences() -> None:
    rig, R, rng = example(11, poses=10)
    names = PARAMETERS["mount+base"]
    prior = cw.calibrate(noisy(rig, R, rng), "mount+base")
    earlier, (of_earlier, _) = tool_of(prior), known_of(prior, rows=1)
    pieces = (
        of_earlier,
        known_as("weight", 3.0, 0.1),
        known_as("com", rig.com, np.array([0.1, 0.2, 0.3])),
        known_as("mount", rig.R_flange_sensor, np.array([0.1, 0.2, 0.3])),
        known_as("gravity", rig.down, 0.1),
        nominal_mounting(0.1),
    )
    tool = stepped(earlier, 0.2 * rng.normal(size=len(names)), names)
    for piece in pieces:
        for k in range(len(names)):
            step = np.zeros(len(names))
            step[k] = 1e-6
            ahead, behind = (piece(stepped(tool, s, names), names).residuals for s in (step, -step))
            scale = float(np.abs(piece(tool, names).jacobian).max())
            assert (behind - ahead) / 2e-6 == pytest.approx(piece(tool, names).jacobian[:, k], abs=1e-7 * scale)


EXPECTED = (
    "expected NAME=VALUE+-STD with a std above 0, as in weight=12.3+-0.1 or com_mm=0,0,50+-2; names: weight, mass, "
    "com, com_mm, mount, gravity: try 'contactwrench calibrate --help'"
)


@pytest.mark.parametrize(
    "flag", ["weight", "weight=3", "weight=3+-0", "weight=x+-1", "weight=1,2+-1", "size=3+-1", "com=1,2,inf+-1"]
)
def test_a_known_that_cannot_be_read_is_refused(capsys: Capture, flag: str) -> None:
    assert _calibrate(capsys, "--known", flag).complaint == f"Invalid value: found --known {flag!r}, {EXPECTED}"


@pytest.mark.parametrize(
    ("flags", "found"),
    [
        (
            ["--mount-tilt-sd", "1", "--model", "mount"],
            "--mount-tilt-sd is for model auto, found --model mount: leave one of them out",
        ),
        (
            ["--base-tilt-sd", "1", "--model", "yaw"],
            "--base-tilt-sd is for model auto, found --model yaw: leave one of them out",
        ),
        (["--known", "weight=3+-1", "--known", "mass=1+-1"], "--known says weight twice, expected once: leave one out"),
        (
            ["--known", "weight=3+-1", "--model", "paper"],
            "model paper takes nothing as known, found --known: leave one of them out",
        ),
        (
            ["--known", "gravity=0,0,-1+-1", "--gravity", "0,0,-1"],
            "--gravity and --known gravity both state it: leave one of them out",
        ),
        (
            ["--known", "gravity=0,0,-1+-1", "--model", "mount"],
            "model mount holds gravity, found --known gravity: take --model auto or mount+base",
        ),
        (
            ["--prior", "x.json", "--model", "mount"],
            "--prior brings its model, found --model mount: leave one of them out",
        ),
        (
            ["--prior", "x.json", "--base-tilt-sd", "1"],
            "--prior brings its own mounting and base, found --base-tilt-sd too: leave one of them out",
        ),
    ],
)
def test_flags_that_contradict_each_other_are_refused_by_name(capsys: Capture, flags: list[str], found: str) -> None:
    assert _calibrate(capsys, *flags).complaint == f"Invalid value: {found}: try 'contactwrench calibrate --help'"


WRONG = {
    "weight": lambda rig: (1.05 * rig.weight, 0.05),
    "com": lambda rig: (rig.com + np.array([0.0, 0.0, 0.02]), 0.001),
    "mount": lambda rig: (rig.R_flange_sensor @ Rotation.from_euler("z", 0.1).as_matrix(), 0.005),
    "gravity": lambda rig: (Rotation.from_euler("x", 0.05).apply(rig.down), 0.002),
}
GIVEN = {
    "weight": r"20\.0\d \+- 0\.0\d+ N",
    "com": r"\(-?\d+\.\d, -?\d+\.\d, -?\d+\.\d\) mm, \+- 0\.\d+ mm",
    "mount": "another direction",
    "gravity": "another direction",
}


@pytest.mark.parametrize(("name", "seed"), [*zip(WRONG, (1, 2, 1, 2), strict=True)])
def test_what_is_known_is_held_against_the_readings(name: str, seed: int) -> None:
    """The one that is wrong is named, and not a gain; the right one beside it is not."""
    rig, R, rng = example(seed, 12)
    rig = replace(rig, weight=20.0)
    right = {"weight": (20.0, 0.1)} if name != "weight" else {"com": (rig.com, 0.002)}
    calibration = cw.calibrate(noisy(rig, R, rng), known={**right, name: WRONG[name](rig)})
    (said,) = (finding for finding in calibration.findings if finding.kind is Kind.CONTRADICTS_KNOWN)
    assert re.fullmatch(
        rf"weak: the readings contradict the known {name} \(probability .+\): by themselves they give ({GIVEN[name]}): "
        "one of the two is wrong",
        said.text,
    )
    assert calibration.findings[0] is said
    assert calibration.verdict == "weak"


def test_a_refusal_names_what_is_known_and_wrong() -> None:
    rig, R, rng = example(4, 12)
    turned = rig.R_flange_sensor @ Rotation.from_euler("x", np.pi).as_matrix()
    with pytest.raises(AmbiguityError, match="; but the readings contradict the known mount"):
        cw.calibrate(noisy(rig, R, rng), known={"mount": (turned, 0.005)})


@pytest.mark.parametrize(("model", "poses"), [("auto", 1), ("mount+base", 2), ("auto", 3)])
def test_right_values_are_not_contradicted_by_few_poses(model: str, poses: int) -> None:
    """That by themselves have several solutions, or none."""
    rig, R, rng = example(0, poses)
    rig = replace(rig, weight=20.0)
    known = {
        "weight": (20.1, 0.1),
        "com": (rig.com + 0.001, 0.002),
        "mount": (rig.R_flange_sensor @ Rotation.from_euler("y", 0.003).as_matrix(), 0.005),
        "gravity": (rig.down, 0.005),
    }
    found = cw.calibrate(noisy(rig, R, rng), model, NOISE, known=known)
    assert not [each for each in found.findings if each.kind is Kind.CONTRADICTS_KNOWN]
