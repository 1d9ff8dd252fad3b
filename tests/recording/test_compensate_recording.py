"""From a recording to contact wrenches: rows, order, clocks, judgement, filters, frames and outputs.

The readings are those of tests/support/world.py along an attitude known as a function of time; pushes are added as
forces at a point of the tool: what comes out is held against these.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.calibration.calibration import Calibration
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.compensate.faults import Reason
from contactwrench.compensate.filters import LowPass
from contactwrench.recording import compensate as compensation
from contactwrench.recording import read as streaming
from contactwrench.recording.compensate import NOTHING, Treatment, compensated
from contactwrench.recording.in_doubt import SATURATED
from contactwrench.recording.options import Options
from contactwrench.report.contacts import ContactLog, summary, write_contact_report
from contactwrench.samples.still_noise import StillNoise
from tests.support.recordings import MATRIX, WRENCH, csv_text, run
from tests.support.world import DOWN, Array, Rig, noisy_readings, random_rotations, readings

Capture = pytest.CaptureFixture[str]

NOISE = np.array([0.02, 0.02, 0.02, 0.001, 0.001, 0.001])
RIG = Rig(
    12.0,
    np.array([0.01, -0.02, 0.06]),
    np.array([3.0, -5.0, 20.0, 0.2, -0.1, 0.05]),
    Rotation.from_rotvec([0.3, -0.5, 2.1]).as_matrix(),
    DOWN,
)
TIP = np.array([0.02, 0.01, 0.15])
LATE = 0.013
RATE, POSE_RATE = 500.0, 100.0
PUSHES = ((2.0, 2.5, np.array([4.0, -3.0, 1.0])), (5.2, 6.0, np.array([-1.0, 0.5, 2.0])))
"""s, s, and N in base axes."""


def attitude(t: Array) -> Array:
    """R_base_flange at times (n,), a smooth motion about all axes."""
    turns = np.stack([0.5 * np.sin(0.7 * t), 0.6 * np.sin(0.5 * t + 1.0), 0.4 * np.cos(0.4 * t)], axis=1)
    R: Array = (Rotation.from_rotvec([2.0, 0.4, -0.3]) * Rotation.from_rotvec(turns)).as_matrix()
    return R


def true_contact(t: Array) -> Array:
    """The contact wrench (n, 6), sensor axes, of the pushes on the tool's tip."""
    R_base_sensor = attitude(t) @ RIG.R_flange_sensor
    force = np.zeros((len(t), 3))
    for start, end, push in PUSHES:
        inside = (t >= start) & (t < end)
        force[inside] = R_base_sensor[inside].transpose(0, 2, 1) @ push
    return np.hstack([force, np.cross(TIP, force)])


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    rng = np.random.default_rng(3)
    R = random_rotations(40, rng)
    return cw.calibrate(cw.Samples(noisy_readings(RIG, R, 0.1 * NOISE, rng), R), "mount", noise=NOISE)


def recording(duration: float = 8.0) -> tuple[Array, Array, Array]:
    """Stamps of the wrench, `LATE` behind the motion, its readings, and stamps of the poses, a little longer."""
    rng = np.random.default_rng(5)
    at = np.arange(round(duration * RATE)) / RATE
    wrench = noisy_readings(RIG, attitude(at), NOISE, rng) + true_contact(at)
    return 100.0 + at + LATE, wrench, 100.0 + np.arange(-5, round(duration * POSE_RATE) - 5) / POSE_RATE


@cache
def texts(saturated: tuple[int, ...] | None = None) -> tuple[str, str]:
    """The wrench and the poses, with a column that marks those rows if there are any."""
    t, wrench, t_pose = recording()
    columns, names = [t, wrench], ["t", *WRENCH]
    if saturated is not None:
        columns, names = [*columns, np.isin(np.arange(len(t)), saturated).astype(np.float64)], [*names, "saturated"]
    poses = np.column_stack([t_pose, attitude(t_pose - 100.0).reshape(-1, 9)])
    return csv_text(names, np.column_stack(columns)), csv_text(("t", *MATRIX), poses)


def write_two_files(folder: Path, saturated: tuple[int, ...] | None = None) -> tuple[Path, Options]:
    for name, text in zip(("w.csv", "p.csv"), texts(saturated), strict=True):
        (folder / name).write_text(text)
    return folder / "w.csv", Options(pose_file=folder / "p.csv")


def two_files_and_calibration(folder: Path, calibration: Calibration) -> list[str | Path]:
    """The flags of `compensate` for the recording of two files."""
    write_two_files(folder)
    calibration.save(folder / "cal.json")
    return ["--wrench", folder / "w.csv", "--pose", folder / "p.csv", "-c", folder / "cal.json"]


def whole(rows: list[ContactWrenches]) -> ContactWrenches:
    assert all(part.judged for part in rows)
    return ContactWrenches.concatenate(rows)


def stamps(rows: ContactWrenches) -> Array:
    assert rows.t is not None
    return rows.t


def test_every_reading_has_its_row_and_its_own_orientation(tmp_path: Path, calibration: Calibration) -> None:
    path, layout = write_two_files(tmp_path)
    notes: list[str] = []
    found = whole(list(compensated(path, layout, calibration, Treatment(delay=LATE), note=notes.append)))
    t, _, t_pose = recording()
    assert np.array_equal(stamps(found), t)
    inside = (t - LATE >= t_pose[0]) & (t - LATE <= t_pose[-1])
    assert np.array_equal(found.valid, inside)
    assert np.isnan(found.wrench[~inside]).all()
    assert {reason for reason in found.reason if reason} == {"left out: after the last orientation"}
    assert notes == [
        "the wrench is taken to be stamped 13 ms later than the orientation, as stated",
        "29 readings after the last orientation left out",
    ]
    list(compensated(path, layout, calibration, Treatment(delay=-LATE), note=notes.append))
    assert notes[2] == "the wrench is taken to be stamped 13 ms earlier than the orientation, as stated"
    off = found.wrench[inside] - true_contact(t[inside] - LATE - 100.0)
    assert np.abs(off.mean(axis=0) / NOISE).max() < 0.5
    assert np.abs(off / NOISE).max() < 6.0


def test_without_the_delay_gravity_is_left_over(tmp_path: Path, calibration: Calibration) -> None:
    """By as much as it turns meanwhile."""
    path, layout = write_two_files(tmp_path)
    found = whole(list(compensated(path, layout, calibration, Treatment(delay=0.0))))
    at = stamps(found)[found.valid] - 100.0
    turned = readings(RIG, attitude(at - LATE)) - readings(RIG, attitude(at))
    off = found.wrench[found.valid] - true_contact(at - LATE) - turned
    assert np.abs(turned[:, :3]).max() > 3.0 * NOISE[0]
    assert np.abs(off / NOISE).max() < 6.0


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "judged"), [(83, True), (640, False), (640, True)])
def test_batches_are_the_whole(
    tmp_path: Path, calibration: Calibration, monkeypatch: pytest.MonkeyPatch, rows: int, judged: bool
) -> None:
    path, layout = write_two_files(tmp_path)
    treatment = Treatment(delay=LATE, judged=judged, noise=NOISE, output_frame="base", point=TIP)
    once = whole(list(compensated(path, layout, calibration, treatment)))
    monkeypatch.setattr(compensation, "ROWS", rows)
    parts = list(compensated(path, layout, calibration, treatment))
    in_parts = whole(parts)
    assert len(parts) > 4
    for name in ("t", "valid", "contact"):
        assert np.array_equal(getattr(once, name), getattr(in_parts, name)), name
    for name in ("wrench", "std"):
        assert np.allclose(getattr(once, name), getattr(in_parts, name), rtol=1e-9, atol=1e-12, equal_nan=True), name
    assert once.reason == in_parts.reason
    assert [contact.onset for contact in once.contacts] == [contact.onset for contact in in_parts.contacts]


def test_pushes_are_the_contacts(tmp_path: Path, calibration: Calibration) -> None:
    path, layout = write_two_files(tmp_path)
    treatment = Treatment(delay=LATE, judged=True, noise=NOISE, output_frame="base")
    found = whole(list(compensated(path, layout, calibration, treatment)))
    assert len(found.contacts) == len(PUSHES)
    for contact, (start, end, force) in zip(found.contacts, PUSHES, strict=True):
        assert contact.onset - LATE - 100.0 == pytest.approx(start, abs=0.01)
        assert contact.release == pytest.approx(end + LATE + 100.0, abs=0.02)
        assert contact.release is not None
        inside = (stamps(found) > contact.onset + 0.02) & (stamps(found) < contact.release - 0.02)
        assert (found.contact[inside] == 1).all()
        mean = found.wrench[inside, :3].mean(axis=0)
        assert np.abs(mean - force).max() < 0.05
        line = contact.line
        miss = np.linalg.norm(np.cross(TIP - line.point, line.direction))
        assert miss < 0.004  # the arm turns meanwhile, so the mean is of slightly different directions
    assert np.abs(found.wrench[untouched(found), :3]).max() < 0.2


def untouched(found: ContactWrenches) -> NDArray[np.bool_]:
    """Valid rows with no push; a contact is told a few ms after it begins."""
    pushed = np.abs(true_contact(stamps(found) - LATE - 100.0)).max(axis=1)
    free: NDArray[np.bool_] = found.valid & (pushed == 0.0)
    return free


def test_std_in_base_axes_is_that_of_the_scatter(tmp_path: Path, calibration: Calibration) -> None:
    path, layout = write_two_files(tmp_path)
    treatment = Treatment(delay=LATE, judged=True, noise=NOISE, output_frame="base", point=TIP)
    found = whole(list(compensated(path, layout, calibration, treatment)))
    free = untouched(found)
    ratio = found.wrench[free].std(axis=0) / found.std[free].mean(axis=0)
    assert np.abs(ratio - 1.0).max() < 0.1


def test_the_first_rows_have_the_noise_of_the_files_rate(tmp_path: Path, calibration: Calibration) -> None:
    """White noise of which means over 10 ms are known, so that one of 500 rows in a second has sqrt(5) times that."""
    path, layout = write_two_files(tmp_path)
    of_means = np.outer([1.0, 0.1**0.5], NOISE)
    known = replace(calibration, still_noise=StillNoise(np.array([0.01, 0.1]), of_means))
    found = whole(list(compensated(path, layout, known, Treatment(judged=True, delay=LATE))))
    assert found.std[found.valid][:60] == pytest.approx(np.tile(5.0**0.5 * NOISE, (60, 1)), rel=0.03)


def test_what_a_delay_is_known_by_is_in_the_std_in_any_axes(tmp_path: Path, calibration: Calibration) -> None:
    """Of a calibration's delay, and not of one that is stated; the sum over the axes is the same in any."""
    path, layout = write_two_files(tmp_path)
    late = replace(calibration, delay=LATE, delay_std=0.3 * LATE)

    def variance(delay: float | None, frame: str) -> Array:
        treatment = Treatment(delay=delay, judged=True, noise=NOISE, output_frame=frame)
        found = whole(list(compensated(path, layout, late, treatment)))
        of_force: Array = np.sum(found.std[untouched(found), :3] ** 2, axis=1)[100:]
        return of_force

    here, there = variance(None, "sensor"), variance(None, "base")
    stated, stated_there = variance(LATE, "sensor"), variance(LATE, "base")
    assert here.mean() > 1.1 * stated.mean()
    assert there - stated_there == pytest.approx(here - stated, abs=0.02 * float(here.mean()))


def test_saturated_rows_are_there_and_not_valid(tmp_path: Path, calibration: Calibration) -> None:
    path, layout = write_two_files(tmp_path, (700, 701, 1500))
    found = whole(list(compensated(path, layout, calibration, Treatment(delay=LATE))))
    assert np.flatnonzero([reason == SATURATED for reason in found.reason]).tolist() == [700, 701, 1500]
    assert not found.valid[[700, 701, 1500]].any()
    assert found.valid[[699, 702]].all()


def test_a_low_pass_both_ways_is_not_late_and_stops_at_gaps(tmp_path: Path, calibration: Calibration) -> None:
    path, layout = write_two_files(tmp_path)
    rows = path.read_text().splitlines()
    path.write_text("\n".join([*rows[:3001], *rows[3201:]]) + "\n")  # 0.4 s from 6.0 s on are missing
    plain = whole(list(compensated(path, layout, calibration, Treatment(delay=LATE))))
    smooth = whole(list(compensated(path, layout, calibration, Treatment(delay=LATE, low_pass=LowPass(10.0)))))
    known = plain.valid
    assert np.array_equal(known, smooth.valid)
    truth = true_contact(stamps(plain) - LATE - 100.0)
    calm = known & (np.abs(truth).sum(axis=1) == 0.0) & (np.abs(stamps(plain) - 104.0) < 0.9)
    assert smooth.wrench[calm].std(axis=0)[0] < 0.35 * plain.wrench[calm].std(axis=0)[0]
    rise = np.flatnonzero(stamps(plain) >= 100.0 + LATE + 2.0)[0]
    half = 0.5 * truth[rise + 100, :3]
    assert np.abs(smooth.wrench[rise - 1 : rise + 1, :3].mean(axis=0) - half).max() < 0.25


def test_a_table_of_poses_is_taken_row_by_row(tmp_path: Path, calibration: Calibration) -> None:
    """The calibration's delay concerns a motion, not poses at rest."""
    R = random_rotations(7, np.random.default_rng(8))
    wrench = noisy_readings(RIG, R, NOISE, np.random.default_rng(9))
    t = 20.0 * np.arange(7)
    names = ("t", *WRENCH, *MATRIX)
    (tmp_path / "poses.csv").write_text(csv_text(names, np.column_stack([t, wrench, R.reshape(-1, 9)])))
    late = replace(calibration, delay=LATE, delay_std=1e-4)
    (rows,) = compensated(tmp_path / "poses.csv", Options(), late, Treatment())
    assert not rows.judged
    assert np.abs(rows.wrench).max() < 0.2
    assert rows.t is not None
    assert np.array_equal(rows.t, t)


@pytest.mark.slow
def test_the_page_tells_every_contact_and_what_is_wrong(tmp_path: Path, calibration: Calibration) -> None:
    path, layout = write_two_files(tmp_path)
    log = ContactLog()
    list(log.noted(compensated(path, layout, calibration, Treatment(delay=LATE, judged=True, noise=NOISE))))
    why = "29 not valid (29 after the last orientation)"
    assert summary(log) == f"4000 samples over 7.998 s: 2 contacts, 16.2% of the time; {why}."
    write_contact_report(tmp_path / "r.html", "Contacts", log, ())
    page = (tmp_path / "r.html").read_text()
    assert page.count("<tr><th>1</th>") == 1
    assert "after the last orientation</th><td>29</td>" in page
    assert (tmp_path / "r.html").stat().st_size < 600_000


def test_samples_with_something_wrong_are_counted_by_kind_whatever_the_words() -> None:
    reasons = (Reason("stuck: fx for 3 s", "stuck"), None, Reason("at a loss", "stuck"), Reason("stuck: or not", "gap"))
    valid = np.array([reason is None for reason in reasons])
    batch = ContactWrenches(np.zeros((4, 6)), np.zeros((4, 6)), np.arange(4.0), True, valid, reasons)
    log = ContactLog()
    list(log.noted([batch]))
    assert (log.faults, log.reasons) == (3, {"stuck": (2, 0.0), "gap": (1, 3.0)})


def test_a_page_without_contacts_says_so(tmp_path: Path) -> None:
    log = ContactLog()
    list(log.noted([NOTHING]))
    write_contact_report(tmp_path / "r.html", "Contacts", log, ())
    assert "<h3>Contacts</h3><p>None.</p>" in (tmp_path / "r.html").read_text()
    assert "Samples with something wrong" not in (tmp_path / "r.html").read_text()


@pytest.mark.slow
def test_from_the_command_line(tmp_path: Path, capsys: Capture, calibration: Calibration) -> None:
    files = two_files_and_calibration(tmp_path, calibration)
    judge: list[str | Path] = ["--noise", "0.02", "--delay", str(LATE), "--report", tmp_path / "r.html"]
    done = run(capsys, "compensate", *files, "-o", tmp_path / "out.csv", *judge)
    assert done.status == 0
    assert done.out.splitlines()[0].startswith("4000 samples over 7.998 s: 2 contacts, ")
    assert done.err.splitlines() == [
        "Note: the wrench is taken to be stamped 13 ms later than the orientation, as stated",
        "Note: 29 readings after the last orientation left out",
    ]
    with (tmp_path / "out.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[-3:] == ["valid", "contact", "reason"]
    assert len(rows) == 4000
    assert (rows[-1]["valid"], rows[-1]["contact"], rows[-1]["reason"]) == (
        "0",
        "",
        "left out: after the last orientation",
    )
    assert {row["contact"] for row in rows} == {"0", "1", ""}


def test_the_calibrations_delay_is_made_up_for_where_it_is_more_than_chance(
    tmp_path: Path, calibration: Calibration
) -> None:
    calibration.save(tmp_path / "cal.json")
    values = json.loads((tmp_path / "cal.json").read_text())
    for std, applied in ((0.001, LATE), (0.01, 0.0)):
        values |= {"delay": LATE, "delay_std": std}
        (tmp_path / "cal.json").write_text(json.dumps(values))
        assert Treatment().applied_delay(cw.Calibration.load(tmp_path / "cal.json")) == applied
    assert Treatment(delay=0.002).applied_delay(cw.Calibration.load(tmp_path / "cal.json")) == 0.002


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--lowpass", "fast"], "--lowpass is 'fast', expected HZ or HZ:ORDER, 0.001 to 1e+06 Hz, as in 20 or 20:4"),
        (
            ["--lowpass", "20:9"],
            "--lowpass 20:9: order of a low-pass is 9, expected 1 to 4 (Butterworth) or 0 (y += a (x - y))",
        ),
        (
            ["--sensor-filter", "-3"],
            "--sensor-filter -3: cut-off of a low-pass is -3, expected 0.001 to 1e+06 Hz",
        ),
        (
            ["--noise", "0"],
            "--noise is 0, expected 1e-09 to 1e+06 N, six with commas, fx..tz, or a recording of a free tool",
        ),
        (["--noise", "gone.csv"], "gone.csv: there is no such file, expected a readable file: check the path"),
        (["--output-frame", "tool"], "output frame is 'tool', expected sensor, flange, base"),
        (
            ["--delay", "20"],
            "Invalid value for '--delay': found 20, expected -10 to 10 s (is it in ms?): try 'contactwrench compensate "
            "--help'",
        ),
        (["-o", "out.mcap"], "out.mcap: found the suffix .mcap, expected .csv or .parquet: name it so"),
        (["-o", "out.foo"], "out.foo: found the suffix .foo, expected .csv or .parquet: name it so"),
    ],
)
def test_flags_that_cannot_be_meant(
    tmp_path: Path, capsys: Capture, calibration: Calibration, flags: list[str], message: str
) -> None:
    files = two_files_and_calibration(tmp_path, calibration)
    done = run(capsys, "compensate", *files, "-o", tmp_path / "out.csv", *flags)
    assert (done.status, done.err) == (2, f"contactwrench: {message}\n")
    assert not (tmp_path / "out.csv").exists()


def test_a_bag_comes_back_with_the_contact_wrench_beside_it(
    tmp_path: Path, capsys: Capture, calibration: Calibration
) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    from contactwrench.recording.bags.write import write_streams_bag
    from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
    from tests.support.bags import bag_streams

    t, wrench, t_pose = recording(3.0)
    poses = OrientationStream(t_pose, attitude(t_pose - 100.0))
    write_streams_bag(tmp_path / "run.mcap", Streams(WrenchStream(t, wrench), poses))
    calibration.save(tmp_path / "cal.json")
    command: list[str | Path] = ["compensate", tmp_path / "run.mcap", "-c", tmp_path / "cal.json", "--delay", str(LATE)]
    assert run(capsys, *command, "-o", tmp_path / "out.mcap").status == 0
    added = bag_streams(tmp_path / "out.mcap", wrench_topic="/wrench/contact").wrench
    assert np.allclose(added.t, t, atol=1e-9)
    there = np.isfinite(added.wrench).all(axis=1)
    assert there.mean() > 0.95
    off = added.wrench[there] - true_contact(t[there] - LATE - 100.0)
    assert np.abs(off / NOISE).max() < 6.0
    same = bag_streams(tmp_path / "out.mcap", wrench_topic="/wrench").wrench
    assert np.array_equal(same.wrench, wrench)


def test_reading_a_bag_tells_how_far_it_is(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    from contactwrench.recording.bags.write import write_streams_bag
    from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream

    t, wrench, t_pose = recording(3.0)
    for suffix in (".mcap", ".db3", ".bag"):
        path = tmp_path / f"run{suffix}"
        write_streams_bag(path, Streams(WrenchStream(t, wrench), OrientationStream(t_pose, attitude(t_pose - 100.0))))
        told: list[float] = []
        list(streaming.batches(path, rows=100, advance=told.append))
        assert told == sorted(told)
        assert 0.0 <= told[0] <= 1.0
        assert told[-1] == pytest.approx(1.0, abs=0.02)


def test_stamps_that_repeat_are_spread_before_they_are_judged(tmp_path: Path, calibration: Calibration) -> None:
    """A clock of 10 ms at 500 Hz: every reading counts, and both pushes are found."""
    path, layout = write_two_files(tmp_path)
    t, wrench, _ = recording()
    coarse = np.floor(t / 0.01 + 1e-6) * 0.01
    path.write_text(csv_text(("t", *WRENCH), np.column_stack([coarse, wrench])))
    found = whole(
        list(compensated(path, layout, calibration, Treatment(delay=LATE - 0.005, judged=True, noise=3.0 * NOISE)))
    )
    assert found.valid.mean() > 0.98
    assert len(found.contacts) == len(PUSHES)


def test_a_sensor_filter_that_is_made_up_for_is_not_in_the_delay_too(calibration: Calibration) -> None:
    late = replace(calibration, delay=0.02, delay_std=1e-4)
    assert Treatment().applied_delay(late) == 0.02
    behind = Treatment(sensor_filter=LowPass(10.0, 1)).applied_delay(late)
    assert behind == pytest.approx(0.02 - 1.0 / (2.0 * np.pi * 10.0))
