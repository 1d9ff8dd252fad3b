"""Times that are not numbers of seconds: of rows that came at a stated rate, and written as dates."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.errors import FileFormatError, InputError
from tests.recording.test_missing_readings import Capture, N, calibrated, recorded, rows_of
from tests.support.recordings import MATRIX, WRENCH, csv_text, run, written
from tests.support.world import Array

HZ = 100.0


def timeless(folder: Path, wrench: Array, R: Array, kind: str = "csv") -> Path:
    columns = np.column_stack([wrench, R.reshape(-1, 9)])
    if kind == "csv":
        return written(folder, csv_text((*WRENCH, *MATRIX), columns), "timeless.csv")
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "timeless.h5", "w") as file:
        for k, half in enumerate((slice(None, N // 2), slice(N // 2, None))):
            file[f"data/demo_{k}/wrench"] = wrench[half]
            file[f"data/demo_{k}/rotation"] = R[half].reshape(-1, 9)
    return folder / "timeless.h5"


def test_its_rows_have_the_times_of_their_numbers(tmp_path: Path) -> None:
    t, wrench, R = recorded(5)
    samples = cw.read(timeless(tmp_path, wrench, R), rate=HZ)
    assert samples.t == pytest.approx(t)
    assert samples.read_as["rate"] == HZ
    assert samples.wrench == pytest.approx(wrench)
    assert cw.read(timeless(tmp_path, wrench, R)).t is None


def test_it_is_calibrated_and_compensated_as_one_with_times(tmp_path: Path, capsys: Capture) -> None:
    t, wrench, R = recorded(6)
    timed = written(tmp_path, csv_text(("t", *WRENCH, *MATRIX), np.column_stack([t, wrench, R.reshape(-1, 9)])))
    for path, how, name in ((timed, (), "a"), (timeless(tmp_path, wrench, R), ("--rate", "100"), "b")):
        done = run(capsys, "calibrate", path, *how, "-o", tmp_path / f"{name}.json")
        assert done.status == 0, done.err
        out = tmp_path / f"{name}.csv"
        done = run(capsys, "compensate", path, *how, "-c", tmp_path / f"{name}.json", "--contact", "-o", out)
        assert done.status == 0, done.err
    a, b = (cw.Calibration.load(tmp_path / f"{name}.json") for name in "ab")
    assert b.weight == pytest.approx(a.weight, abs=1e-9)
    assert b.std["weight"] == pytest.approx(a.std["weight"])
    assert rows_of(tmp_path / "a.csv") == rows_of(tmp_path / "b.csv")


def test_each_episode_of_a_set_begins_at_its_own_first_row(tmp_path: Path, capsys: Capture) -> None:
    _, wrench, R = recorded(7)
    path, tool = timeless(tmp_path, wrench, R, "h5"), calibrated(tmp_path, 7)
    how = ("--hdf5", "wrench=wrench,pose=rotation", "--orientation", "matrix", "--rate", "100", "--contact")
    out = tmp_path / "out.csv"
    done = run(capsys, "compensate", path, *how, "--all-episodes", "-c", tool, "-o", out)
    assert done.status == 0, done.err
    assert [float(row["t"]) for row in rows_of(out)] == pytest.approx(np.tile(np.arange(N // 2) / HZ, 2))


def test_beside_times_it_is_refused_unless_these_are_left_alone(tmp_path: Path, capsys: Capture) -> None:
    t, wrench, R = recorded(8)
    columns = np.column_stack([t, wrench, R.reshape(-1, 9)])
    path = written(tmp_path, csv_text(("Time [s]", *WRENCH, *MATRIX), columns))
    done = run(capsys, "calibrate", path, "--rate", "50")
    assert done.complaint == (
        f'{path}: found the times t from "Time [s]", and --rate 50, expected one of them: leave out --rate, or the '
        "times with --time-column none"
    )
    assert cw.read(path, rate=50.0, time_column="none").t == pytest.approx(2.0 * t)
    with pytest.raises(InputError) as error:
        cw.read(path, rate=-50.0)
    assert str(error.value) == "rate is -50, expected 0.001 to 1e+06 Hz"


def test_a_bag_has_times(tmp_path: Path, capsys: Capture) -> None:
    from tests.support.bags import recording, write_mcap

    bag = write_mcap(tmp_path / "run.mcap", recording(20)[0])
    done = run(capsys, "calibrate", bag, "--rate", "50")
    assert done.complaint == f"{bag}: found a bag, and rate 50.0, which is for tables: leave it out"


def test_two_files_have_times_of_their_own(tmp_path: Path, capsys: Capture) -> None:
    _, wrench, R = recorded(9)
    path = timeless(tmp_path, wrench, R)
    done = run(capsys, "calibrate", "--wrench", path, "--pose", path, "--rate", "100")
    assert done.complaint == "found two files and rate 100, expected times in each: leave it out"


NOON = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


@pytest.mark.parametrize(
    ("form", "separator", "mark", "zone"),
    [
        ("%Y-%m-%d %H:%M:%S.%f", ",", ".", 0.0),
        ("%Y-%m-%dT%H:%M:%S.%f+02:00", " ", ".", -7200.0),
        ('"%Y-%m-%d %H:%M:%S.%fZ"', "\t", ".", 0.0),
        ("%Y-%m-%d %H:%M:%S.%f", ";", ",", 0.0),
        ("%Y-%m-%d %H:%M:%S,%f", ";", ",", 0.0),
    ],
)
@pytest.mark.parametrize("unit", ["", "_ms"])
def test_dates_with_a_time_of_day_are_seconds(
    tmp_path: Path, form: str, separator: str, mark: str, zone: float, unit: str
) -> None:
    """As pandas writes an index of times, with gaps as it writes them."""
    t, wrench, R = recorded(7)
    rows = [separator.join((f"t{unit}", *WRENCH, *MATRIX))]
    for k, numbers in enumerate(np.column_stack([wrench, R.reshape(-1, 9)]).tolist()):
        cells = [f"{number:.9g}".replace(".", mark) for number in numbers]
        cells[0] = "nan" if k == 11 else cells[0]
        rows.append(separator.join(((NOON + timedelta(seconds=t[k])).strftime(form), *cells)))
    samples = cw.read(written(tmp_path, "\n".join(rows)))
    assert samples.t is not None
    assert samples.t - NOON.timestamp() - zone == pytest.approx(np.delete(t, 11), abs=2e-6)


@pytest.mark.parametrize(("first", "second"), [("2026-03-01 12:00:00", "1.5"), ("1.5", "2026-03-01 12:00:00")])
def test_dates_beside_seconds_are_refused(tmp_path: Path, first: str, second: str) -> None:
    header, numbers = ",".join(("t", *WRENCH, *MATRIX)), "1,2,3,4,5,6,1,0,0,0,1,0,0,0,1"
    path = written(tmp_path, f"{header}\n{first},{numbers}\n{second},{numbers}\n")
    with pytest.raises(FileFormatError, match=f"row 3, column t: found '{second}'"):
        cw.read(path)
