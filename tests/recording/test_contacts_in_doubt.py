"""A note where a contact is none that a hand makes: another tool, a zero that was set anew or drifted. Hands, whatever
they do, raise none.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import Contact, ContactWrenches, motion_of
from contactwrench.recording import compensate as compensation
from contactwrench.recording.compensate import Treatment, compensated
from contactwrench.recording.in_doubt import InDoubt, OffThroughout
from contactwrench.recording.options import Options
from contactwrench.samples.samples import Samples
from tests.support import in_motion
from tests.support.in_motion import at_stops, moving
from tests.support.live import calibrated, free
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.world import Array, readings

Capture = pytest.CaptureFixture[str]

N, RATE = 6000, 100.0
OTHERWISE = (
    "if nothing touches, the recording has another tool (calibrate it), another zero (--zero S), or is not "
    "read as the calibration was (sign, units, orientation)"
)
CAUSES = f"{OTHERWISE}, or it drifted (--drift)"
FROM_HALF = f"in contact for 50% of the time, from 30.1 s on to the end by a force as of a weight or a bias: {CAUSES}"


@pytest.fixture(autouse=True)
def in_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that the step is compiled, which a recording of one batch is not worth."""
    monkeypatch.setattr(compensation, "ROWS", N // 2)


def turning(n: int, rng: np.random.Generator) -> Array:
    """Orientations (n, 3, 3) of an arm that turns about all axes."""
    t = np.arange(n)[:, None] / RATE
    turns = np.sin(t * [0.31, 0.23, 0.17] + rng.uniform(0.0, 6.0, 3)) * [1.2, 1.0, 0.8]
    R: Array = (Rotation.random(random_state=rng) * Rotation.from_rotvec(turns)).as_matrix()
    return R


def recorded(folder: Path, seed: int, change: str) -> Path:
    return written(folder, text_of(seed, change), "run.csv")


@cache
def text_of(seed: int, change: str) -> str:
    """A minute of a free tool, from half of it on with a `change`, or with a hand on it now and then."""
    _, rig, _ = calibrated(3)
    rng = np.random.default_rng(seed)
    R, half = turning(N, rng), np.arange(N)[:, None] >= N // 2
    wrench = free(rig, R, rng)
    if change == "another tool":
        other = replace(rig, weight=rig.weight + 3.0, com=rig.com + np.array([0.0, 0.0, 0.02]))
        wrench += half * (readings(other, R) - readings(rig, R))
    elif change == "new zero":
        wrench -= half * readings(rig, R)[N // 2]
    elif change == "new zero, and a hand":
        wrench -= half * readings(rig, R)[N // 2]
        wrench[3400:3800] += [9.0, -12.0, 6.0, 0.9, 0.3, -0.6]
    elif change == "late":
        R = R[np.maximum(np.arange(N) - 40, 0)]
    elif change == "drift":
        wrench += np.linspace(0.0, 1.0, N)[:, None] * [1.5, -1.0, 2.0, 0.05, 0.0, 0.0]
    elif change != "free":
        wrench += hand(rng, change)
    rows = np.column_stack([np.arange(N) / RATE, wrench, R.reshape(N, 9)])
    return csv_text(("t", *WRENCH, *MATRIX), rows)


def hand(rng: np.random.Generator, change: str) -> Array:
    """Pushes (N, 6) that take `60 %` of the time in several, the last of them to the end, or one `at the end`."""
    count = int(rng.integers(3, 7)) if change == "60 %" else 1
    each = N // count
    ends = [(k * each + round(0.4 * each), (k + 1) * each) for k in range(count)]
    wrench = np.zeros((N, 6))
    for start, end in ends if change == "60 %" else [(N - 500, N)]:
        t = np.arange(end - start) / RATE
        ramp = np.minimum(t, t[-1] - t if end < N else 1.0).clip(0.0, 0.3) / 0.3
        wobble = 1.0 + rng.uniform(0.1, 0.4) * np.sin(2.0 * np.pi * rng.uniform(0.2, 1.0) * t + rng.uniform(0.0, 6.0))
        force = (ramp * wobble)[:, None] * rng.normal(size=3) * 5.0
        wrench[start:end] = np.hstack([force, np.cross([0.02, 0.01, 0.15], force)])
    return wrench


def notes_of(folder: Path, seed: int, change: str, drift: bool = False) -> list[str]:
    """What is said of contacts."""
    path = recorded(folder, seed, change)
    notes: list[str] = []
    treatment = Treatment(judged=True, drift=np.array([0.5] * 3 + [0.025] * 3) if drift else None)
    for _ in compensated(path, Options(), calibrated(3)[0], treatment, note=notes.append):
        pass
    return [note for note in notes if " contact " in note]


@pytest.mark.parametrize("change", ["another tool", "new zero"])
def test_another_tool_and_a_new_zero_half_way_are_asked_about(change: str, tmp_path: Path) -> None:
    assert notes_of(tmp_path, 0, change) == [FROM_HALF]


def test_a_new_zero_is_asked_about_though_a_hand_comes_later(tmp_path: Path) -> None:
    """The force is none of a weight or a bias, then, but nothing changes for long after it."""
    (note,) = notes_of(tmp_path, 0, "new zero, and a hand")
    start = re.fullmatch(
        r"from (.*) s on a contact does not change for 10 s or more: if nothing touches, the zero was set anew or "
        r"moved: cut the recording there, with --zero S for the rest",
        note,
    )
    assert start is not None
    assert float(start[1]) == pytest.approx(38.0, abs=0.3)


@pytest.mark.parametrize(("newtons", "std", "asked"), [(0.3, 0.05, True), (3.0, 0.05, False), (0.3, np.nan, False)])
def test_many_contacts_that_are_hardly_more_than_chance_are_asked_about(
    newtons: float, std: float, asked: bool
) -> None:
    """Two dozen of 0.4 s each, of 0.05 N of noise, or where what is known of it tells nothing."""
    calibration, rig, rng = calibrated(3)
    R, t, of_rows = turning(100, rng), np.arange(100) / 100.0, np.tile(std * np.repeat([1.0, 0.04], 3), (100, 1))
    doubt, peak = InDoubt(calibration), newtons * np.array([0.6, 0.0, 0.8, 0.0, 0.03, 0.0])
    for start in range(0, 48, 2):
        contact = Contact(start, start + 0.4, peak, peak, np.eye(6), True)
        touching = (t < 0.4).astype(np.int8)
        batch = ContactWrenches(
            touching[:, None] * peak, of_rows, start + t, True, contact=touching, contacts=(contact,)
        )
        doubt.add(Samples(readings(rig, R) + batch.wrench, R, start + t), batch)
    assert str(doubt) == (
        "24 of 24 contacts are hardly more than chance gives: if nothing touches, the bias drifted (--drift), or the "
        "noise is larger than is known (--noise)"
        if asked
        else ""
    )


@pytest.mark.parametrize("output_frame", ["sensor", "base"])
def test_a_weight_left_by_an_orientation_that_comes_late_is_told_by_where_it_acts(
    output_frame: str, tmp_path: Path
) -> None:
    notes: list[str] = []
    treatment, path = Treatment(judged=True, output_frame=output_frame), recorded(tmp_path, 0, "late")
    for _ in compensated(path, Options(), calibrated(3)[0], treatment, note=notes.append):
        pass
    assert [re.sub(r"^in \d+%", "in 90%", note) for note in notes if " contact " in note] == [
        "in 90% of the time in contact the force acts at the tool's own centre of mass: if nothing touches, the "
        "orientation comes late (--delay) or is off, or it is the inertia as the arm accelerates: record positions for "
        "--model dynamic, or state what it scatters by in motion (--noise)"
    ]


def test_a_pull_while_the_arm_moves_is_not_taken_for_the_inertia_that_is_subtracted() -> None:
    """Of 2 N along the tool, again and again, where its inertia, which the calibration knows, is as large."""
    calibration, samples = in_motion.calibrated(), in_motion.pushed().samples().select(slice(-5000, None))
    pull, motion = np.zeros((5000, 6)), motion_of(calibration, samples)
    pull[np.arange(5000) % 900 > 400] = [0.0, 0.0, 2.0, -0.04, -0.04, 0.0]
    samples = replace(samples, wrench=samples.wrench + pull)
    assert samples.t is not None
    doubt, compensator = InDoubt(calibration), cw.Compensator(calibration, noise=[0.05] * 3 + [0.002] * 3)
    doubt.add(samples, compensator.run(samples.wrench, samples.R_base_flange, samples.t, motion=motion))
    assert str(doubt) == ""


def test_a_drift_is_asked_about_and_followed_it_is_none(tmp_path: Path) -> None:
    (note,) = notes_of(tmp_path, 0, "drift")
    share = re.match(r"in contact for (\d+)% of the time, from ", note)
    assert share is not None
    assert float(share[1]) == pytest.approx(90.0, abs=3.0)
    assert note.endswith(f"s on to the end by a force as of a weight or a bias: {CAUSES}")
    assert notes_of(tmp_path, 0, "drift", drift=True) == []


@pytest.mark.parametrize(("change", "seeds"), [("free", 1), ("60 %", 3), ("at the end", 1)])
def test_hands_are_not(change: str, seeds: int, tmp_path: Path) -> None:
    for seed in range(seeds):
        assert notes_of(tmp_path, seed, change) == [], seed


def test_most_of_the_time_is_asked_about_whatever_the_force() -> None:
    calibration, rig, rng = calibrated(3)
    for share, asked in ((70, False), (80, True)):
        doubt = InDoubt(calibration)
        for start in range(10):
            R, t = turning(100, rng), start + np.arange(100) / 100.0
            contact = (np.arange(100) < share).astype(np.int8)
            wrench, std = rng.normal(size=(100, 6)), np.ones((100, 6))
            doubt.add(Samples(free(rig, R, rng), R, t), ContactWrenches(wrench, std, t, True, contact=contact))
        assert str(doubt) == (f"in contact for 80% of the time: {CAUSES}" if asked else "")


@pytest.mark.parametrize(("wobbles", "asked"), [(0.0, True), (3.0, False)])
def test_a_force_little_above_the_noise_is_even_or_not_by_as_much_as_the_noise_leaves(
    wobbles: float, asked: bool
) -> None:
    """From half-way on, of four standard deviations of a reading: a weight's is even but for these, a hand's is not."""
    calibration, rig, _ = calibrated(3)
    rng = np.random.default_rng(14)
    t = np.arange(N) / RATE
    R, touching = turning(N, rng), (t >= 30.0).astype(np.int8)
    force = touching[:, None] * (4.0 + wobbles * np.sin(2.0 * np.pi * 0.4 * t))[:, None] * [0.6, 0.0, 0.8]
    wrench = np.hstack([force + rng.normal(size=(N, 3)), np.zeros((N, 3))])
    doubt = InDoubt(calibration)
    doubt.add(
        Samples(readings(rig, R) + wrench, R, t), ContactWrenches(wrench, np.ones((N, 6)), t, True, contact=touching)
    )
    assert ("from 30" in str(doubt)) is asked


def of_inertia(calibration: cw.Calibration, samples: Samples, at_once: int) -> str:
    """What is said of a recording of the moving rig that is judged in batches of so many rows."""
    doubt, compensator = InDoubt(calibration), cw.Compensator(calibration, noise=0.05)
    for start in range(0, len(samples), at_once):
        part = samples.select(slice(start, start + at_once))
        assert part.t is not None
        doubt.add(part, compensator.run(part.wrench, part.R_base_flange, part.t))
    return str(doubt)


def test_the_inertia_that_a_calibration_does_not_know_is_named() -> None:
    samples = moving(11, stops=0, seconds=6.0, rate=250.0).samples()
    said = of_inertia(at_stops(), samples, 800)
    assert re.fullmatch(
        r"in (8|9)\d% of the time in contact the force, up to \d+\.?\d* N, is what the free tool exerts as the arm "
        r"accelerates: calibrate it with --model dynamic, or state what it scatters by in motion \(--noise\)",
        said,
    )
    assert "free tool" not in of_inertia(at_stops(), replace(samples, position=None), 800)
    known = cw.calibrate(moving(7, stops=8, seconds=8.0, rate=250.0).samples(), "dynamic")
    assert "free tool" not in of_inertia(known, samples, 800)


def test_hands_on_an_arm_that_moves_slowly_are_no_inertia() -> None:
    calibration, rig, _ = calibrated(3)
    rng = np.random.default_rng(0)
    R, t = turning(N, rng), np.arange(N) / RATE
    position = 0.2 * np.sin(t[:, None] * [0.5, 0.3, 0.7])
    samples = Samples(free(rig, R, rng) + hand(rng, "60 %"), R, t, position)
    assert of_inertia(calibration, samples, N // 2) == ""


def test_the_command_says_it_in_one_line(tmp_path: Path, capsys: Capture) -> None:
    calibrated(3)[0].save(tmp_path / "tool.json")
    for change, said in (("new zero", [f"Note: {FROM_HALF}"]), ("60 %", [])):
        path = recorded(tmp_path, 5, change)
        into = ("-c", tmp_path / "tool.json", "-o", tmp_path / "o.csv", "--force")
        done = run(capsys, "compensate", path, *into, "--contact")
        assert done.status == 0
        assert [line for line in done.err.splitlines() if "in contact" in line] == said


TORQUES = "torque=Nmm", "force=N,torque=kNm"


def off_throughout(folder: Path, *, with_times: bool, options: Options, change: str = "free") -> list[str]:
    """What is said of a minute that is not judged, of a table of rows with both or brought onto one clock."""
    notes: list[str] = []
    treatment = Treatment(delay=0.004 if with_times else None)
    for _ in compensated(recorded(folder, 2, change), options, calibrated(3)[0], treatment, note=notes.append):
        pass
    return [note for note in notes if "are left of the" in note]


@pytest.mark.parametrize(
    ("options", "with_times"),
    [
        (Options(sign="reaction"), False),
        (Options(inverse_orientation=True), True),
        (Options(units="force=kN,torque=Nm"), False),
        (Options(units=TORQUES[0]), False),
        (Options(units=TORQUES[1]), True),
    ],
)
def test_what_is_read_otherwise_than_the_calibration_is_asked_about(
    options: Options, with_times: bool, tmp_path: Path
) -> None:
    (note,) = off_throughout(tmp_path, with_times=with_times, options=options)
    left = "N m are left of the torque" if options.units in TORQUES else "N are left of the force"
    assert re.fullmatch(
        rf"more than \d+\.?\d* {left} in (9\d|100)% of the rows: "
        + re.escape(f"{OTHERWISE}, something is held, or the arm moves fast"),
        note,
    )


@pytest.mark.parametrize(
    ("change", "with_times"), [("free", False), ("new zero", False), ("new zero", True), ("60 %", True)]
)
def test_what_is_free_for_some_of_the_time_is_not(change: str, with_times: bool, tmp_path: Path) -> None:
    assert off_throughout(tmp_path, with_times=with_times, options=Options(), change=change) == []


@pytest.mark.parametrize(("rows", "asked"), [(99, False), (100, True)])
def test_few_rows_may_be_pushes_alone_and_those_without_a_contact_wrench_do_not_count(rows: int, asked: bool) -> None:
    off, wrench = OffThroughout(calibrated(3)[0]), np.full((200, 6), np.nan)
    wrench[:rows] = 1e3
    off.add(ContactWrenches(wrench, wrench))
    assert ("in 100% of the rows" in str(off)) is asked


@pytest.mark.parametrize(("newton_metres", "asked"), [(0.15, False), (0.45, True)])
def test_torque_left_is_held_against_that_of_a_long_tool(newton_metres: float, asked: bool) -> None:
    """A tenth of 10 N at 30 cm, 0.3 N m; at 5 cm it would be 0.05."""
    rng = np.random.default_rng(1)
    R = Rotation.random(24, random_state=rng).as_matrix()
    force = -10.0 * R[:, 2, :]
    wrench = np.hstack([force, np.cross([0.1, 0.2, 0.2], force)]) + 1e-4 * rng.normal(size=(24, 6))
    off = OffThroughout(cw.calibrate(cw.Samples(wrench, R), "mount"))
    off.add(ContactWrenches(np.tile([0.0, 0.0, 0.0, newton_metres, 0.0, 0.0], (200, 1)), np.zeros((200, 6))))
    assert ("N m are left of the torque in 100% of the rows" in str(off)) is asked


@pytest.mark.parametrize(("each", "seconds", "asked"), [(11, 30.0, True), (10, 30.0, False), (21, 180.0, False)])
@pytest.mark.parametrize("long", [0, 12])
def test_many_short_contacts_are_asked_about(each: int, seconds: float, asked: bool, long: int) -> None:
    calibration, rig, rng = calibrated(3)
    n = round(100.0 * seconds)
    R, t = turning(n, rng), np.arange(n) / 100.0
    contacts = tuple(
        Contact(0.5 + k, 0.5 + k + lasts, 20.0 * np.ones(6), np.ones(6), np.eye(6), onset_seen=True)
        for lasts, of in ((0.05, each), (0.3, long))
        for k in range(of)
    )
    doubt = InDoubt(calibration)
    free_wrench = ContactWrenches(rng.normal(size=(n, 6)), np.ones((n, 6)), t, True, contact=np.zeros(n, dtype=np.int8))
    for half in (slice(0, n // 2), slice(n // 2, n)):
        part = replace(free_wrench.select(half), contacts=contacts if half.start else ())
        doubt.add(Samples(free(rig, R[half], rng), R[half], t[half]), part)
    said = (
        f"{each} of {each + long} contacts last for less than 0.1 s: if nothing touches, the noise is larger than is "
        "known, as of an arm that moves: state what a free tool scatters by there (--noise FREE); with an inertia, "
        "record poses more often and with steadier stamps"
    )
    assert str(doubt) == (said if asked and each > long else "")
