"""Streams and tables of poses: which is which, and what calibrate, verify and weigh make of a stream."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.assess.verify import verify
from contactwrench.assess.weigh import weigh
from contactwrench.calibration.findings import Kind, Severity
from contactwrench.estimation.findings_of_recording import of_recording
from contactwrench.report.html import write_calibration_report
from contactwrench.report.signals import signals_over_time
from contactwrench.samples.poses import Pose
from contactwrench.samples.recorded_poses import RecordedPoses, is_stream, resting_poses
from contactwrench.samples.still_segments import still_segments
from contactwrench.simulate.kinematics import random_joints
from contactwrench.simulate.recording import record_motion, record_poses
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings, changed
from contactwrench.simulate.trajectory import exciting, stopping, sweeping
from tests.support.measured_sets import measured_sets
from tests.support.recordings import run as run_program
from tests.support.rigs import NOISE, example, noisy
from tests.support.runs import Run, run
from tests.support.world import Array, readings

pytest.importorskip("mujoco")


@cache
def recorded(pushed: bool = False, rate: float = 200.0) -> Run:
    def push(t: Array, wrench: Array) -> Array:
        in_contact = (t > 18.2) & (t < 19.0)  # the middle of the sixth stop to its end
        return wrench + np.outer(in_contact, [0.0, 3.0, 0.0, 0.1, 0.0, 0.0])

    return run(stops=14, rate=rate, seed=8, settings=("sensor.low_pass=10",), disturb=push if pushed else None)


@cache
def calibrated(pushed: bool = False) -> cw.Calibration:
    return cw.calibrate(recorded(pushed).samples, "mount")


def true_poses(made: Run) -> cw.Samples:
    middle = np.searchsorted(made.samples.t, made.stops.mean(axis=1))  # type: ignore[arg-type]
    return cw.Samples(made.wrench, made.samples.R_base_flange[middle])


def in_seconds(samples: cw.Samples, t: Array | None) -> cw.Samples:
    return replace(samples, t=t)


@pytest.mark.slow
def test_a_recording_through_the_moves_is_a_stream() -> None:
    for rate in (1000.0, 100.0, 10.0):
        assert is_stream(run(stops=4, rate=rate).samples)
    noisy_run = run(stops=4, rate=100.0, orientation_noise_deg=0.05).samples
    assert is_stream(noisy_run)
    assert noisy_run.t is not None
    assert is_stream(in_seconds(noisy_run, noisy_run.t + 1.7e9))
    rig = changed(Settings(), ["recording.rate=50"])
    assert is_stream(record_motion(rig, sweeping(200.0, 50.0), rng=np.random.default_rng(0)).samples)


def test_a_recording_without_times_is_a_table() -> None:
    assert not is_stream(in_seconds(recorded().samples, None))


@pytest.mark.parametrize(
    ("rows", "settle", "creep"), [(1, 2.0, 0.0), (3, 0.0, 0.0), (200, 2.0, 0.0), (300, 0.0, 0.0), (50, 1.0, 0.02)]
)
def test_poses_recorded_one_by_one_are_a_table(rows: int, settle: float, creep: float) -> None:
    settings = changed(Settings(), [f"recording.rows={rows}", f"recording.settle={settle}", f"recording.creep={creep}"])
    rng = np.random.default_rng(1)
    made = record_poses(settings, random_joints(build(settings), 12, rng), rng=rng)
    assert not is_stream(made.samples)


def test_single_rows_at_poses_are_a_table_however_their_times_are_counted() -> None:
    rig, R, rng = example(3, poses=30)
    samples = noisy(rig, R, rng)
    for step in (0.01, 0.1, 1.0, 60.0):
        assert not is_stream(in_seconds(samples, step * np.arange(30.0)))
    assert not is_stream(in_seconds(samples, np.linspace(0.0, 1.0, 30)))
    mixed = rng.permutation(len(recorded().samples))
    assert not is_stream(recorded().samples.select(mixed))


@pytest.mark.slow
def test_a_run_calibrates_as_its_true_poses_do() -> None:
    made = recorded(rate=1000.0)
    found, true = cw.calibrate(made.samples, "mount+base"), cw.calibrate(true_poses(made), "mount+base")
    assert len(found.poses) == 14
    assert found.weight is not None
    assert found.com is not None
    assert true.weight is not None
    assert true.com is not None
    assert abs(found.weight - true.weight) < 3.5 * found.std["weight"]
    assert (np.abs(found.com - true.com) < 3.5 * found.std["com"]).all()
    assert (np.abs(found.bias - true.bias) < 3.5 * found.std["bias"]).all()
    assert found.std["weight"] < 0.005
    assert found.verdict.startswith("good")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_program_calibrates_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = recorded(pushed=True)
    s = made.samples.select(slice(None, None, 2))
    table = np.column_stack([s.t, s.wrench, s.R_base_flange.reshape(-1, 9)])  # type: ignore[list-item]
    names = "t,fx,fy,fz,tx,ty,tz,r11,r12,r13,r21,r22,r23,r31,r32,r33"
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=names, comments="")
    done = run_program(capsys, "calibrate", tmp_path / "run.csv", "--model", "mount", "--report", tmp_path / "run.html")
    assert done.status == 0
    assert "13 of 14 poses from 4750 rows" in done.out
    said = " ".join(done.out.split())
    assert "1 of 14 stretches in which the arm stood were left out: t = 17." in said
    assert "s, the reading moves by 3 N and 1" in said
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert "<h3>The recording</h3>" in page
    assert "Green: the 13 stretches" in page
    assert "Hatched: stretches that were left out" in page


@pytest.mark.usefixtures("undrawn")
def test_a_stretch_that_was_left_out_is_hatched_where_a_channel_was_saturated_too(tmp_path: Path) -> None:
    samples = recorded(pushed=True).samples.select(slice(None, None, 2))
    assert samples.t is not None
    saturated = replace(samples, saturated=(samples.t > 18.3) & (samples.t < 18.4))
    write_calibration_report(tmp_path / "run.html", cw.calibrate(saturated, "mount"), saturated)
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert "Green: the 13 stretches" in page
    assert "Hatched: stretches that were left out" in page
    assert "<pattern" in page


@pytest.mark.slow
def test_visits_follow_a_bias_that_steps_half_way() -> None:
    there_and_back = changed(Settings(), ["sensor.noise.force=0.05"])
    rig = build(there_and_back)
    joints = random_joints(rig, 1, np.random.default_rng(5)) * 0.3
    turns = joints + np.random.default_rng(6).uniform(-0.4, 0.4, size=(8, 7))
    motion = stopping(np.vstack([turns, turns[::-1]]), 1.5, 1.0, 100.0)
    samples = record_motion(there_and_back, motion, rng=np.random.default_rng(7)).samples
    stepped = samples.wrench + np.outer(np.arange(len(samples)) > len(samples) // 2, [1.0, 0, 0, 0, 0, 0])
    found = cw.calibrate(replace(samples, wrench=stepped), "mount")
    (step,) = (finding.text for finding in found.findings if finding.kind is Kind.BIAS_STEPPED)
    assert float(step.partition("up to ")[2].split()[0]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_a_rejected_stretch_is_kept_with_its_reason_and_not_fitted(tmp_path: Path) -> None:
    found = calibrated(pushed=True)
    out = [pose for pose in found.poses if pose.rejected is not None]
    assert len(out) == 1
    assert out[0].rejected is not None
    assert out[0].rejected.startswith("the reading moves by 3 N")
    assert len(found.fitted_poses) == 13
    found.save(tmp_path / "run.json")
    assert [pose.rejected for pose in cw.Calibration.load(tmp_path / "run.json").poses] == [
        pose.rejected for pose in found.poses
    ]


@pytest.mark.slow
def test_verify_and_weigh_take_the_still_stretches_of_a_run() -> None:
    calibration = calibrated()
    second = run(stops=5, rate=200.0, seed=9, settings=("sensor.low_pass=10",)).samples
    verified = verify(calibration, second)
    assert verified.passed
    assert len(verified.residuals) == 5
    held = weigh(calibration, second)
    assert held.poses == 5
    assert abs(held.mass) < 4.0 * held.mass_std


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1000.0, 10.0])
def test_a_run_that_never_stops_is_refused_in_one_line(rate: float) -> None:
    rig = changed(Settings(), [f"recording.rate={rate}", "sensor.ranges=[700,700,700,30,30,30]"])
    motion = exciting(20.0, rate, np.random.default_rng(5))
    moving = slice(round(2 * rate), round(18 * rate))  # it rises from rest and comes back to it
    samples = record_motion(rig, motion, rng=np.random.default_rng(0)).samples.select(moving)
    with pytest.raises(cw.ContactWrenchError) as refusal:
        cw.calibrate(samples)
    said = str(refusal.value)
    assert said.startswith("virtual rig: found no stretch in ")
    assert " s in which arm and reading are still" in said
    assert said.endswith(": stop for a second or two at each orientation; calibrate --prior needs one")
    assert "\n" not in said


@pytest.mark.slow
def test_a_run_with_too_few_stops_says_how_many_there_are() -> None:
    with pytest.raises(cw.ContactWrenchError) as refusal:
        cw.calibrate(run(stops=2, rate=100.0).samples)
    assert str(refusal.value).endswith(" (still stretches: 2, left out: 0; stop for a second or two at each)")


@pytest.mark.slow
@pytest.mark.parametrize("way", ["smooth", "wandering"])
def test_thousands_of_orientations_on_the_way_are_refused_at_once(way: str) -> None:
    wander = np.cumsum(0.01 * np.random.default_rng(0).normal(size=(6_000, 3)), axis=0)
    smooth = np.linspace([0.0, 0.0, 0.0], [40.0, 25.0, 30.0], 6_000)
    turn = Rotation.from_euler("ZYX", smooth).as_matrix()
    if way == "wandering":
        turn = Rotation.from_rotvec(wander).as_matrix()
    samples = cw.Samples(np.ones((6_000, 6)), turn, source="run.csv")
    for use in (cw.calibrate, resting_poses):
        with pytest.raises(
            cw.ContactWrenchError, match=r"run\.csv: found about \d+ orientations in 6000 rows"
        ) as refusal:
            use(samples)
        assert str(refusal.value).endswith(
            "expected poses at rest: give the times in a column t, or state --rate HZ, so that the "
            "still stretches are found, or give only "
            "rows at rest"
        )


@pytest.mark.slow
def test_thousands_of_orientations_with_times_are_stops_that_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which is found before they are averaged."""
    monkeypatch.setattr("contactwrench.samples.poses.averaged", None)
    R = np.repeat(Rotation.random(12_500, rng=0).as_matrix(), 2, axis=0)
    samples = cw.Samples(np.ones((len(R), 6)), R, t=np.linspace(0.0, 50.0, len(R)), source="run.csv")
    with pytest.raises(cw.ContactWrenchError) as refusal:
        cw.calibrate(samples)
    assert str(refusal.value).endswith(
        "in 25000 rows, expected poses at rest: stop for a second or two at each orientation, or give only rows at rest"
    )


@pytest.mark.slow
def test_rows_taken_on_the_way_are_not_called_good() -> None:
    rig = changed(Settings(), ["recording.rate=10", "tool.mass=1", "sensor.low_pass=3", "sensor.delay=0.1",
                               "sensor.ranges=[700,700,700,30,30,30]"])  # fmt: skip
    made = record_motion(rig, exciting(20.0, 10.0, np.random.default_rng(5)), rng=np.random.default_rng(0))
    found = cw.calibrate(in_seconds(made.samples, None), "mount")
    assert found.verdict.startswith("weak")
    assert any("what is left in one pose is left in the next too" in warning for warning in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("name", measured_sets())
@pytest.mark.parametrize("model", ["auto", "mount"])
def test_measured_poses_stay_good(name: str, model: str) -> None:
    found = cw.calibrate(measured_sets()[name], model)
    assert not [warning for warning in found.warnings if "what is left in one pose" in warning]


@pytest.mark.slow
def test_independent_poses_are_never_taken_for_alike() -> None:
    for seed in range(0, 20, 3):
        rig, R, rng = example(seed, poses=12 + seed)
        wrench = readings(rig, R) + NOISE * rng.normal(size=(len(R), 6))
        found = cw.calibrate(cw.Samples(wrench, R), "mount")
        assert not [warning for warning in found.warnings if "what is left in one pose" in warning]


@pytest.mark.slow
def test_the_picture_of_a_long_recording_stays_small() -> None:
    made = recorded()
    s = made.samples
    assert s.t is not None
    long = cw.Samples(
        np.tile(s.wrench, (3, 1)), np.tile(s.R_base_flange, (3, 1, 1)),
        np.concatenate([s.t + 60.0 * k for k in range(3)]),
    )  # fmt: skip
    calibration, still = calibrated(), still_segments(long)
    svg = signals_over_time(calibration, long, still)
    assert len(svg) < 300_000
    assert svg == signals_over_time(calibration, long, still)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_a_table_of_poses_has_no_picture_of_the_recording(tmp_path: Path) -> None:
    samples = true_poses(recorded())
    write_calibration_report(tmp_path / "table.html", cw.calibrate(samples, "mount"), samples)
    assert "The recording" not in (tmp_path / "table.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("moved", "weak"), [(1, False), (4, True)])
def test_a_recording_is_in_doubt_where_the_reading_moves_in_a_third_of_its_stretches(moved: int, weak: bool) -> None:
    """As where wrench and pose are of other moments, or somebody holds the tool all the time."""
    reason = "the reading moves by 2 N and 90 mN m though the arm stands: contact, drift or vibration"
    rejected = tuple(
        Pose(np.eye(3), np.zeros(6), np.zeros((6, 6)), 50, 3.0 * k, 3.0 * k + 1.0, reason) for k in range(moved)
    )
    (finding,) = of_recording(RecordedPoses((), None, rejected, moved, 8 - moved), 0.0)
    assert (finding.severity is Severity.WEAK) == finding.text.startswith("weak: ") == weak
    assert ("do wrench and pose belong together in time" in finding.text) == weak


@pytest.mark.parametrize("order", ["backwards", "shuffled"])
def test_rows_of_a_stream_out_of_order_are_no_poses(order: str) -> None:
    """Sorted by anything but time, as a data base gives them: each row on the way counted as a pose at rest."""
    t = np.arange(3_000) / 100.0
    angles = np.column_stack([np.sin(t / 3.0), np.cos(t / 2.0), np.sin(t / 5.0)])
    rows = np.arange(3_000)[::-1] if order == "backwards" else np.random.default_rng(3).permutation(3_000)
    R = Rotation.from_euler("ZYX", angles).as_matrix()
    back = int((np.diff(t[rows]) < 0.0).sum())
    with pytest.raises(cw.ContactWrenchError) as refusal:
        resting_poses(cw.Samples(np.ones((3_000, 6)), R[rows], t=t[rows], source="run.csv"))
    assert str(refusal.value) == (
        f"run.csv: found times that go back at {back} of 3000 rows, expected rows in the order of their times: sort "
        "them, or name another column of times, of poses none, with --time-column"
    )


def test_rows_of_whole_seconds_are_said_to_lack_their_decimals() -> None:
    """Of too many orientations, it was asked to stop at each."""
    t = np.arange(6_000) / 100.0
    R = Rotation.from_euler("ZYX", np.column_stack([np.sin(t), np.cos(t / 2.0), np.sin(t / 5.0)]))
    with pytest.raises(cw.ContactWrenchError, match="expected times in s, with their decimals"):
        resting_poses(cw.Samples(np.ones((6_000, 6)), R.as_matrix(), t=np.floor(t), source="run.csv"))
