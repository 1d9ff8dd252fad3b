"""Readings that stand still in a recording, at a limit or altogether, are not valid from their first row on."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.compensate.faults import Reason
from contactwrench.recording.in_doubt import StuckReadings
from contactwrench.samples.limits import channels_at_limit
from tests.support.live import calibrated, times
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.rigs import NOISE
from tests.support.world import Array, noisy_readings, random_rotations, readings

Capture = pytest.CaptureFixture[str]
RATE, SECONDS = 100.0, 40.0
N = int(RATE * SECONDS)


def stops(rng: np.random.Generator, n: int, rate: float) -> Array:
    """An arm that stands for 3 s and moves for 1 s, by turns."""
    t = np.arange(n) / rate
    way = Rotation.random(int(t[-1] / 4.0) + 2, random_state=rng).as_rotvec()
    before, share = (t // 4.0).astype(int), 0.5 - 0.5 * np.cos(np.pi * np.clip(t % 4.0 - 3.0, 0.0, 1.0))[:, None]
    R: Array = Rotation.from_rotvec(way[before] + share * (way[before + 1] - way[before])).as_matrix()
    return R


def pushed(noise: float = 1.0, rate: float = RATE, n: int = N) -> tuple[Array, Array]:
    """What a tool reads that somebody pushes along z for 1, 2 and 3 s, by 40 N; and the orientations."""
    _, rig, rng = calibrated(3)
    R, t = stops(np.random.default_rng(3), n, rate), np.arange(n) / rate
    wrench = readings(rig, R) + noise * NOISE * rng.normal(size=(n, 6))
    for begin, end in ((8.0, 9.0), (15.0, 17.0), (29.0, 32.0)):
        phase = np.clip((t - begin) / (end - begin), 0.0, 1.0)
        wrench[:, 2] += 40.0 * np.sin(np.pi * phase)
    return wrench, R


def in_steps(wrench: Array, quantum: float) -> Array:
    """Of so many N, and as many N m at a lever of 4 cm."""
    steps = quantum * np.repeat([1.0, 0.04], 3)
    return np.asarray(np.round(wrench / steps) * steps)


def judged(
    folder: Path,
    capsys: Capture,
    wrench: Array,
    R: Array,
    rate: float = RATE,
    noise: float = 0.1,
    tool: cw.Calibration | None = None,
) -> tuple[NDArray[np.bool_], list[str], list[str], str]:
    """What `compensate --contact` writes of each row, `valid`, `contact` and `reason`, and what it says."""
    (tool or calibrated(3)[0]).save(folder / "tool.json")
    rows = np.column_stack([times(len(R), rate), wrench, R.reshape(-1, 9)])
    path = written(folder, csv_text(("t", *WRENCH, *MATRIX), rows), "run.csv")
    judging = ("--contact", "--noise", str(noise))
    done = run(capsys, "compensate", path, "-c", folder / "tool.json", "-o", folder / "o.csv", *judging)
    assert done.status == 0, done.err
    with (folder / "o.csv").open(newline="") as file:
        written_rows = list(csv.DictReader(file))
    valid = np.array([row["valid"] == "1" for row in written_rows])
    return valid, [row["contact"] for row in written_rows], [row["reason"] for row in written_rows], done.err


@pytest.mark.parametrize(("quantum", "rate", "n"), [(0.1, RATE, N), (0.001, 1000.0, 10_000)])
def test_a_clipped_channel_is_not_valid_from_its_first_row_on(
    tmp_path: Path, capsys: Capture, quantum: float, rate: float, n: int
) -> None:
    wrench, R = pushed(rate=rate, n=n)
    wrench = in_steps(wrench, quantum)
    limit = wrench[:, 2].max() - 15.0
    clipped = wrench[:, 2] >= limit
    wrench[clipped, 2] = limit
    valid, _, reasons, said = judged(tmp_path, capsys, wrench, R, rate)
    assert valid[~clipped].all()
    assert valid[clipped].mean() < 0.02, "less than 20 rows that stand are chance"
    first = int(np.argmax(np.convolve(clipped, np.ones(40), "valid") == 40))
    assert reasons[first] == "saturated: a channel stands at its limit"
    rows = sum(reason.startswith("saturated") for reason in reasons)
    assert f"Note: readings stand at the sensor's limit and show less than there was: fz in {rows} rows" in said


@pytest.mark.parametrize(
    ("held", "quantum", "noise"),  # any two of them in every combination
    [(1, 0.001, 0.4), (1, 0.1, 1.0), (8, 0.001, 1.0), (8, 0.1, 0.4)],
)
def test_coarse_quiet_and_held_readings_stand_at_no_limit(
    tmp_path: Path, capsys: Capture, held: int, quantum: float, noise: float
) -> None:
    wrench, R = pushed(noise)
    wrench = in_steps(wrench, quantum)
    wrench = wrench[np.arange(N) - np.arange(N) % held]
    scatter = float(np.hypot(noise * NOISE[0], quantum / np.sqrt(12.0)))
    valid, _, reasons, said = judged(tmp_path, capsys, wrench, R, noise=scatter)
    assert "limit" not in said
    assert valid.all(), set(reasons)


def test_a_quiet_coarse_sensor_at_rest_may_stand_at_its_least_value(tmp_path: Path, capsys: Capture) -> None:
    """At one orientation, pushed once: by the readings alone that is the picture of a channel at its limit."""
    _, rig, rng = calibrated(3)
    R = np.tile(np.eye(3), (2000, 1, 1))
    quiet = readings(rig, R) + 0.4 * NOISE * rng.normal(size=(2000, 6))
    quiet[1000:1100, 2] += 20.0 * np.sin(np.linspace(0.0, np.pi, 100))
    steps = 0.2 * np.repeat([1.0, 0.04], 3)
    begin = np.array([0.5, 0.5, 0.0, 0.5, 0.5, 0.5]) * steps + readings(rig, R)[0]
    wrench = in_steps(quiet - begin, 0.2) + begin
    assert channels_at_limit(wrench)[:, 2].sum() > 1000
    valid, _, reasons, said = judged(tmp_path, capsys, wrench, R, noise=0.06)
    assert "limit" not in said
    assert valid.all(), set(reasons)


def test_a_channel_that_is_not_measured_and_a_short_repeat_at_a_maximum_are_honest(
    tmp_path: Path, capsys: Capture
) -> None:
    _, rig, rng = calibrated(3)
    turns = random_rotations(24, rng)
    tool = cw.calibrate(cw.Samples(noisy_readings(rig, turns, NOISE, rng) * [1.0, 1.0, 1.0, 1.0, 1.0, 0.0], turns))
    wrench, R = pushed(n=2_000)
    wrench[:, 5] = 0.0
    peak = int(np.argmax(wrench[:, 2]))
    wrench[peak : peak + 15, 2] = wrench[peak, 2]
    valid, _, reasons, said = judged(tmp_path, capsys, wrench, R, tool=tool)
    assert "limit" not in said
    assert valid.all(), set(reasons)


def test_one_that_is_zero_throughout_and_that_the_calibration_has_is_dead(tmp_path: Path, capsys: Capture) -> None:
    wrench, R = pushed(n=3_000)
    wrench[:, 5] = 0.0
    valid, _, reasons, _ = judged(tmp_path, capsys, wrench, R)
    assert not valid[1:].any()
    assert reasons[2000] == "stuck: tz has not moved for 2000 readings while others did"


@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_a_frozen_reading_is_not_valid_from_its_first_repeated_row_on(
    tmp_path: Path, capsys: Capture, rate: float
) -> None:
    wrench, R = pushed(rate=rate, n=int(14.0 * rate))
    frozen = slice(int(10.0 * rate), int(13.0 * rate))
    wrench[frozen] = wrench[frozen.start]
    valid, contact, reasons, _ = judged(tmp_path, capsys, wrench, R, rate)
    assert np.array_equal(np.flatnonzero(~valid), np.arange(frozen.start + 1, frozen.stop))
    assert reasons[frozen.start + 1] == "stuck: the whole reading has begun to stand still"
    assert reasons[frozen.stop - 1].startswith("stuck: the whole reading has not moved for")
    assert set(contact[frozen.start + 1 : frozen.stop]) == {""}


def test_a_channel_that_sticks_is_not_valid_from_its_first_repeated_row_on(tmp_path: Path, capsys: Capture) -> None:
    wrench, R = pushed()
    wrench[1000:1400, 4] = wrench[1000, 4]
    valid, _, reasons, _ = judged(tmp_path, capsys, wrench, R)
    assert np.array_equal(np.flatnonzero(~valid), np.arange(1001, 1400))
    assert reasons[1001] == "stuck: ty has begun to stand still"


def test_what_stands_on_from_batch_to_batch_and_batches_without_readings() -> None:
    told_before, rows = StuckReadings(), np.arange(60.0)[:, None] * np.ones(6)
    rows[20:, 3] = 7.0
    stuck = (Reason("in whatever words", "stuck", channel=3),)

    def part(of: slice, reasons: tuple[Reason | None, ...]) -> ContactWrenches:
        wrench = rows[of]
        valid = np.array([reason is None for reason in reasons], dtype=np.bool_)
        told = ContactWrenches(wrench, wrench, np.arange(float(len(wrench))), True, valid, reasons)
        return told_before.marked(told, cw.Samples(wrench, np.tile(np.eye(3), (len(wrench), 1, 1)), told.t))

    assert part(slice(30), (None,) * 30).valid.all()
    assert not len(part(slice(0), ()))
    assert not part(slice(30, 60), (None,) * 20 + 10 * stuck).valid.any()
