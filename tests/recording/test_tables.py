"""Recordings as tables: gaps, two files, Parquet; whole or in batches, the same streams come out."""

from __future__ import annotations

import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import contactwrench as cw
from contactwrench.errors import ContactWrenchError, FileFormatError, InputError
from contactwrench.recording.options import Options
from contactwrench.recording.read import are_pairs, batches, begins_with_pairs, blocks, read_streams, samples_of
from contactwrench.recording.tables.csv import open_csv
from contactwrench.recording.tables.table import Table
from contactwrench.samples.samples import Streams
from tests.recording.test_bad_files import assert_one_line_that_names
from tests.support.recordings import MATRIX, PANDA, WRENCH, Array, csv_text, run, written
from tests.support.world import random_rotations

KUKA = Path(__file__).resolve().parents[3] / "shared" / "data" / "kuka_atigamma"
POSITION = ("x", "y", "z")


class Motion:
    """A recording of 60 readings at 1 kHz; every fifth row has the pose."""

    rng = np.random.default_rng(5)
    t = 100.0 + 1e-3 * np.arange(60)
    wrench = rng.normal(size=(60, 6))
    R = random_rotations(60, rng)
    position = rng.normal(size=(60, 3))
    posed = np.arange(60) % 5 == 2


HEADER = ("t", *WRENCH, *MATRIX, *POSITION)


def rows() -> Array:
    return np.column_stack([Motion.t, Motion.wrench, Motion.R.reshape(-1, 9), Motion.position])


def with_gaps(cell: str = "") -> str:
    lines = csv_text(HEADER, rows()).splitlines()
    without_pose = [",".join([*line.split(",")[:7], *[cell] * 12]) for line in lines]
    kept = [line if posed else gap for line, gap, posed in zip(lines[1:], without_pose[1:], Motion.posed, strict=True)]
    return "\n".join([lines[0], *kept, ""])


def assert_same(found: Streams, R: Array, posed: Array | slice) -> None:
    assert np.array_equal(found.wrench.t, Motion.t)
    assert np.array_equal(found.wrench.wrench, Motion.wrench)
    assert np.array_equal(found.orientation.t, Motion.t[posed])
    assert found.orientation.R_base_flange == pytest.approx(R[posed], abs=1e-12)
    assert found.orientation.position is not None
    assert np.array_equal(found.orientation.position, Motion.position[posed])


def joined(parts: list[Streams]) -> Streams:
    from contactwrench.samples.samples import OrientationStream, WrenchStream

    wrench, poses = [part.wrench for part in parts], [part.orientation for part in parts]
    position = None
    if poses[0].position is not None:
        position = np.concatenate([pose.position for pose in poses if pose.position is not None])
    return Streams(
        WrenchStream(np.concatenate([one.t for one in wrench]), np.concatenate([one.wrench for one in wrench])),
        OrientationStream(
            np.concatenate([one.t for one in poses]), np.concatenate([one.R_base_flange for one in poses]), position
        ),
    )


def refusal(path: Path, layout: Options | None = None) -> str:
    """The message, without the folder, with which a recording is refused."""
    with pytest.raises((FileFormatError, InputError)) as caught:
        read_streams(path, layout or Options())
    message = str(caught.value)
    assert "\n" not in message
    return message.replace(f"{path}: ", "").replace(f"{path.parent}/", "")


# One table


def test_a_table_without_gaps_is_two_streams_of_the_same_times(tmp_path: Path) -> None:
    path = written(tmp_path, csv_text(HEADER, rows()))
    assert_same(read_streams(path), Motion.R, slice(None))
    samples = cw.read(path)
    assert np.array_equal(samples.wrench, Motion.wrench)
    assert samples.delay is None


@pytest.mark.parametrize(
    ("cell", "delimiter"), [("", ","), (" ", ";"), ("nan", "\t"), ("NaN", ","), ('""', ";"), ("", "\t")]
)
def test_rows_without_a_pose_belong_to_the_wrench_alone(tmp_path: Path, cell: str, delimiter: str) -> None:
    path = written(tmp_path, with_gaps(cell).replace(",", delimiter))
    assert_same(read_streams(path), Motion.R, Motion.posed)
    for n in (1, 2, 7, 60, 1000):
        assert_same(joined(list(batches(path, rows=n))), Motion.R, Motion.posed)


def test_rows_without_a_wrench_belong_to_the_pose_alone(tmp_path: Path) -> None:
    lines = csv_text(HEADER, rows()).splitlines()
    without = [",".join([cells[0], *[""] * 6, *cells[7:]]) for cells in (line.split(",") for line in lines[1:])]
    kept = [line if k % 3 else gap for k, (line, gap) in enumerate(zip(lines[1:], without, strict=True))]
    path = written(tmp_path, "\n".join([lines[0], *kept]))
    found = read_streams(path)
    assert np.array_equal(found.wrench.t, Motion.t[np.arange(60) % 3 > 0])
    assert np.array_equal(found.orientation.t, Motion.t)
    samples = cw.read(path)  # each reading has its own orientation: nothing is interpolated
    assert np.array_equal(samples.wrench, Motion.wrench[np.arange(60) % 3 > 0])
    assert samples.R_base_flange == pytest.approx(Motion.R[np.arange(60) % 3 > 0], abs=1e-12)
    assert samples.delay is None


T_QUAT = "t,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw"


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1,1,2,3,4,5,6,0,0,,1", "row 3, column qz: found nothing, expected a number: fill it in or leave the row out"),
        (",1,2,3,4,5,6,,,,", "row 3, column t: found nothing, expected a number: fill it in or leave the row out"),
        ("nan,1,2,3,4,5,6,,,,", "row 3, column t: found nan, expected a finite number: leave the row out"),
        ("1,1,2,3,4,inf,6,,,,", "row 3, column ty: found inf, expected a finite number: leave the row out"),
        ("1,1,2,3,4,no,6,,,,", "row 3, column ty: found 'no', expected a number: correct it or leave the row out"),
        (
            "1,,,,,,,0,0,0,2",
            "row 3, columns qx,qy,qz,qw: found a quaternion of length 2, expected 1 within 1 %: check the order of its "
            "parts and that none is cut off",
        ),
    ],
)
def test_half_an_orientation_and_what_is_no_number_are_named(tmp_path: Path, row: str, message: str) -> None:
    path = written(tmp_path, f"{T_QUAT}\n0,1,2,3,4,5,6,,,,\n{row}\n2,1,2,3,4,5,6,0,0,0,1\n")
    assert refusal(path) == message
    with pytest.raises(FileFormatError, match=re.escape(f"{path}: {message}")):
        list(batches(path, rows=1))


def test_a_row_with_a_time_alone_says_nothing(tmp_path: Path) -> None:
    path = written(tmp_path, f"{T_QUAT}\n0,1,2,3,4,5,6,0,0,0,1\n1,,,,,,,,,,\n2,1,2,3,4,5,6,0,0,0,1\n")
    assert read_streams(path).wrench.t.tolist() == [0.0, 2.0]
    assert cw.read(path).t is not None
    assert len(cw.read(path)) == 2


def test_a_table_without_times_has_no_gaps_and_is_no_stream(tmp_path: Path) -> None:
    header = T_QUAT.removeprefix("t,")
    path = written(tmp_path, f"{header}\n1,2,3,4,5,6,0,0,0,1\n1,2,3,4,5,6,,,,\n")
    with pytest.raises(FileFormatError) as caught:
        cw.read(path)
    assert str(caught.value) == (
        f"{path}: row 3, column qx: found nothing, expected a number: fill it in or leave the row out"
    )
    assert refusal(written(tmp_path, f"{header}\n1,2,3,4,5,6,0,0,0,1\n")) == (
        "found no column t, expected the time of each row of a recording: add it, or say --rate HZ, or use the file as "
        "a table of poses"
    )


def test_wrenches_in_base_axes_need_an_orientation_in_their_rows(tmp_path: Path) -> None:
    neat, gaps = written(tmp_path, csv_text(HEADER, rows())), written(tmp_path, with_gaps(), "gaps.csv")
    turned = read_streams(neat, Options(wrench_frame="base", sign="reaction"))
    assert turned.wrench.wrench[:, :3] == pytest.approx(
        np.array([-R.T @ w[:3] for R, w in zip(Motion.R, Motion.wrench, strict=True)]), abs=1e-12
    )
    assert refusal(gaps, Options(wrench_frame="base")) == (
        "found a wrench in base axes without an orientation in its row, expected both in each row: record them "
        "together, or the wrench in sensor axes"
    )
    inverse = read_streams(gaps, Options(inverse_orientation=True))
    assert_same(inverse, Motion.R.transpose(0, 2, 1), Motion.posed)


@pytest.mark.parametrize(("per_s", "name"), [(1.0, "t"), (1e3, "t"), (1e6, "t"), (1e9, "t"), (1e6, "t_us")])
def test_unix_times_are_told_by_their_size(tmp_path: Path, per_s: float, name: str) -> None:
    t = 1.7e9 + 0.25 * np.arange(3)
    table = csv_text(
        (name, *WRENCH, *MATRIX), np.column_stack([per_s * t, Motion.wrench[:3], Motion.R[:3].reshape(3, 9)])
    )
    found = cw.read(written(tmp_path, table))
    assert found.t is not None
    assert found.t == pytest.approx(t, abs=1e-6)


def test_a_clock_that_is_no_unix_time_counts_seconds(tmp_path: Path) -> None:
    for t in (5e8, 9e11, 3e13):
        table = csv_text(("t", *WRENCH, *MATRIX), [[t, *Motion.wrench[0], *Motion.R[0].ravel()]])
        assert cw.read(written(tmp_path, table)).t == pytest.approx([t], rel=1e-15)


def test_a_table_is_read_alike_in_blocks_with_comments_and_line_ends_of_every_kind(tmp_path: Path) -> None:
    table = csv_text(HEADER, rows()).splitlines()
    table[5:5] = ["# a comment, with a comma", "", "   "]
    for end in ("\n", "\r\n", "\r"):
        path = written(tmp_path, end.join(["# first", *table]).encode())
        for n in (1, 3, 1000):
            assert_same(joined(list(batches(path, rows=n))), Motion.R, slice(None))
    opened = open_csv(written(tmp_path, "\n".join(table)), 4)
    rows_of_file = [body.row_of(k) for body in opened.bodies(()) for k in range(len(body))]
    assert opened.places["t"] == 0
    assert rows_of_file == [2, 3, 4, 5, *range(9, 65)]


# Saturated rows


def saturated_table(values: list[str]) -> str:
    rows_of_panda = PANDA.read_text().splitlines()
    start = next(k for k, line in enumerate(rows_of_panda) if not line.startswith("#"))
    body = [f"{line},{value}" for line, value in zip(rows_of_panda[start + 1 :], values, strict=True)]
    return "\n".join([rows_of_panda[start] + ",saturated", *body, ""])


@pytest.mark.slow
def test_saturated_rows_are_left_out_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    note = "2 of 17 rows with a saturated channel were left out"
    path = written(tmp_path, saturated_table(["0"] * 6 + ["1", "1"] + ["0"] * 9))
    free = cw.read(PANDA)
    samples = cw.read(path)
    assert len(samples) == 17
    assert samples.saturated is not None
    assert np.flatnonzero(samples.saturated).tolist() == [6, 7]
    left = free.select(~samples.saturated)
    found, expected = cw.calibrate(samples), cw.calibrate(left)
    assert note in found.warnings
    assert note not in expected.warnings
    assert np.array_equal(found.B, expected.B)
    tool = tmp_path / "tool.json"
    found.save(tool)
    assert f"Warning  {note}\n" in run(capsys, "verify", path, "-c", tool).out
    assert f"Warning  {note}\n" in run(capsys, "weigh", path, "-c", tool).out + "\n"
    assert note not in run(capsys, "verify", PANDA, "-c", tool).out
    assert note not in run(capsys, "weigh", PANDA, "-c", tool).out
    out = tmp_path / "out.csv"
    assert run(capsys, "compensate", path, "-c", tool, "-o", out).status == 0
    assert len(out.read_text().splitlines()) == 18


@pytest.mark.parametrize(("free", "stuck"), [("0", "1"), ("False", "True"), ("false", "TRUE"), ("0.0", "1.0")])
def test_saturation_is_written_as_a_number_or_a_word(tmp_path: Path, free: str, stuck: str) -> None:
    samples = cw.read(written(tmp_path, saturated_table([free] * 16 + [stuck])))
    assert samples.saturated is not None
    assert samples.saturated.tolist() == [False] * 16 + [True]
    with pytest.raises(ValueError, match="read-only"):
        samples.saturated[0] = True


def test_another_mark_of_saturation_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, saturated_table(["0"] * 16 + ["2"]))
    with pytest.raises(FileFormatError) as caught:
        cw.read(path)
    assert str(caught.value) == (
        f"{path}: row 18, column saturated: found 2, expected 0 or 1: correct it or leave the row out"
    )


def test_a_shape_of_saturation_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"^saturated has shape \(2,\), expected \(n,\) with n = 3 as in wrench$"):
        cw.Samples(Motion.wrench[:3], Motion.R[:3], saturated=np.zeros(2, dtype=np.bool_))


# Two files


def two_files(folder: Path) -> tuple[Path, Options]:
    posed = Motion.posed
    wrench = written(folder, csv_text(("t", *WRENCH), rows()[:, :7]), "wrench.csv")
    poses = np.column_stack([Motion.t[posed], Motion.R[posed].reshape(-1, 9), Motion.position[posed]])
    return wrench, Options(pose_file=written(folder, csv_text(("t", *MATRIX, *POSITION), poses), "pose.csv"))


def test_two_files_are_the_two_streams(tmp_path: Path) -> None:
    path, layout = two_files(tmp_path)
    assert_same(read_streams(path, layout), Motion.R, Motion.posed)
    for n in (1, 4, 13, 1000):
        assert_same(joined(list(batches(path, layout, rows=n))), Motion.R, Motion.posed)


def test_a_batch_of_two_files_is_of_one_moment(tmp_path: Path) -> None:
    path, layout = two_files(tmp_path)
    parts = list(batches(path, layout, rows=10))
    assert max(len(part.wrench) for part in parts) <= 10
    for before, after in pairwise(parts):
        earlier = [*before.wrench.t, *before.orientation.t]
        assert max(earlier) <= min([*after.wrench.t, *after.orientation.t])


@pytest.mark.slow
@given(n=st.integers(1, 9), shift=st.floats(-0.1, 0.1), spike=st.integers(0, 59))
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_two_clocks_that_run_apart_or_jump_lose_no_row(tmp_path: Path, n: int, shift: float, spike: int) -> None:
    t = Motion.t + shift
    t[spike] += 7.0
    wrench = written(tmp_path, csv_text(("t", *WRENCH), np.column_stack([t, Motion.wrench])), "wrench.csv")
    _, layout = two_files(tmp_path / "poses") if (tmp_path / "poses").exists() else two_files(made(tmp_path / "poses"))
    whole = joined(list(batches(wrench, layout, rows=n)))
    assert np.array_equal(whole.wrench.wrench, Motion.wrench)
    assert np.array_equal(whole.orientation.t, Motion.t[Motion.posed])


def made(folder: Path) -> Path:
    folder.mkdir()
    return folder


@pytest.mark.parametrize("without", ["wrench", "pose"])
def test_both_of_two_files_have_times(tmp_path: Path, without: str) -> None:
    path, layout = two_files(tmp_path)
    named = tmp_path / f"{without}.csv"
    named.write_text(named.read_text().replace("t,", "clock,", 1))
    message = refusal(path, layout).replace("pose.csv: ", "")
    assert message.startswith(
        "found no column t, expected one in each of two files, on one clock: add the times, or name them with "
        "--time-column (found"
    )


@pytest.mark.slow
def test_a_measured_recording_of_two_files(capsys: pytest.CaptureFixture[str]) -> None:
    wrench, pose = KUKA / "1-baseline_wrench.csv", KUKA / "1-baseline_orientations.csv"
    if not wrench.exists():
        pytest.skip("the measured recordings are not here")
    found = read_streams(wrench, Options(pose_file=pose))
    assert (len(found.wrench), len(found.orientation)) == (4376, 627)
    assert found.wrench.t[0] == pytest.approx(1708857503.929545, abs=1e-6)
    assert np.median(1.0 / np.diff(found.orientation.t)) == pytest.approx(100.0, rel=0.02)
    samples = cw.read(wrench, orientation="matrix", pose_file=pose)
    assert 4300 < len(samples) <= 4376
    done = run(capsys, "calibrate", "--wrench", wrench, "--pose", pose, "--orientation", "matrix", "--json")
    assert done.status == 2  # an arm that turns about one axis cannot identify the tool
    assert "Traceback" not in done.err


# The flags

CANNOT = [
    (["--wrench", "w.csv"], "found --wrench without --pose, expected both: add --pose, or give one FILE with all"),
    (["--pose", "p.csv"], "found --pose without --wrench, expected both: add --wrench, or give one FILE with all"),
    (
        [PANDA, "--wrench", "w.csv", "--pose", "p.csv"],
        "found FILE and --wrench and --pose, expected FILE, or --wrench and --pose: leave one of them out",
    ),
    ([PANDA, "--pose", "p.csv"], "found FILE and --pose, expected FILE, or --wrench and --pose: leave one of them out"),
    ([PANDA, "--frames", "base"], "--frames is 'base', expected two names BASE,FLANGE"),
    ([PANDA, "--frames", "base,"], "--frames is 'base,', expected two names BASE,FLANGE"),
    (
        [PANDA, "--wrench-topic", "/ft"],
        f"{PANDA}: found a table, and wrench_topic /ft, which is for bags: leave it out",
    ),
    ([PANDA, "--robot", "iiwa7"], f"{PANDA}: found a table, and robot iiwa7, which is for bags: leave it out"),
    (
        [PANDA, "--frames", "base,tool0"],
        f"{PANDA}: found a table, and frames base,tool0, which is for bags: leave it out",
    ),
    (
        ["run.mcap", "--orientation", "quat_wxyz"],
        "run.mcap: found a bag, and orientation quat_wxyz, which is for tables: leave it out",
    ),
    (
        ["--wrench", "w.mcap", "--pose", "p.csv"],
        "w.mcap: found a bag as one of two files, expected tables: give it alone",
    ),
    (
        ["--wrench", "gone.csv", "--pose", "p.csv"],
        "gone.csv: there is no such file, expected a readable file: check the path",
    ),
    ([], "Missing argument 'FILE': try 'contactwrench {verb} --help'"),
]


@cache
def _tool() -> cw.Calibration:
    return cw.calibrate(cw.read(PANDA))


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "message"), CANNOT)
@pytest.mark.parametrize("verb", ["calibrate", "verify", "weigh", "compensate"])
def test_flags_that_do_not_go_together(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    verb: str,
    arguments: list[str | Path],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    more: list[str | Path] = []
    if verb != "calibrate":
        _tool().save("tool.json")
        more = ["-c", "tool.json"]
    if verb == "compensate":
        more += ["-o", "out.csv"]
    assert run(capsys, verb, *arguments, *more).complaint == message.replace("{verb}", verb)
    assert not Path("out.csv").exists()


def test_diagnose_passes_over_rows_that_lack_something(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = PANDA.read_text().splitlines()
    start = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    names, body = lines[start], lines[start + 1 :]
    gap = ",".join([""] * (names.count(",") + 1))
    table = [f"t,{names}", *(f"{k},{line}\n{k}.5,{gap}" for k, line in enumerate(body)), ""]
    found = run(capsys, "diagnose", written(tmp_path, "\n".join(table)), "--json")
    plain = run(capsys, "diagnose", PANDA, "--json")
    assert (found.status, found.out.replace(str(tmp_path / "poses.csv"), str(PANDA))) == (plain.status, plain.out)


# Batches of pairs


def test_pairs_come_in_batches(tmp_path: Path) -> None:
    path = written(tmp_path, csv_text(HEADER, rows()))
    parts = [block for block in blocks(path, rows=7) if are_pairs(block)]
    assert [len(part) for part in parts[:2]] == [6, 7]  # the header is a line too
    assert np.array_equal(np.concatenate([part.wrench for part in parts]), Motion.wrench)
    assert np.concatenate([part.orientation for part in parts]) == pytest.approx(Motion.R, abs=1e-12)
    assert begins_with_pairs(path)
    assert not begins_with_pairs(written(tmp_path, with_gaps()))
    assert not begins_with_pairs(*two_files(tmp_path))


def test_an_orientation_that_is_missing_late_is_named(tmp_path: Path) -> None:
    table = csv_text(HEADER, rows()).splitlines()
    table[51] = ",".join([*table[51].split(",")[:7], *[""] * 12])
    path = written(tmp_path, "\n".join(table))
    found = [block for block in blocks(path, rows=20) if isinstance(block, Table)]
    assert are_pairs(found[0])
    with pytest.raises(FileFormatError) as caught:
        [samples_of(table) for table in found]
    assert str(caught.value) == (
        f"{path}: found a wrench without an orientation at t = 100.050000 s, expected one in each row as in the first "
        "rows: fill it in, or give wrenches and poses as two files with --wrench and --pose"
    )


# Files that nobody should write

JUNK = ["", "nan", "inf", "1e999", "abc", "1,5", '"', "#", "\0", "1_0", "1e200", "-", "1700000000000"]


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_recordings_with_junk_are_streams_or_one_line(tmp_path: Path, data: st.DataObject) -> None:
    table = [line.split(",") for line in with_gaps().splitlines()[: data.draw(st.integers(1, 8))]]
    for _ in range(data.draw(st.integers(1, 4))):
        row = data.draw(st.integers(0, len(table) - 1))
        table[row][data.draw(st.integers(0, len(table[row]) - 1))] = data.draw(st.sampled_from(JUNK))
    path = written(tmp_path, "\n".join(",".join(row) for row in table))
    n = data.draw(st.integers(1, 4))
    outcomes: list[int | None] = []
    for whole in (True, False):
        try:
            found = read_streams(path) if whole else joined(list(batches(path, rows=n)))
        except ContactWrenchError as error:
            assert_one_line_that_names(error, path)
            outcomes.append(None)
        else:
            assert not np.isinf(found.wrench.wrench).any()  # NaN is a row without a reading
            assert np.isfinite(found.wrench.t).all()
            outcomes.append(len(found.wrench) + len(found.orientation))
    assert outcomes[0] == outcomes[1]


# Bags through the same door


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3", "run"])
def test_a_bag_is_read_by_the_same_flags(tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    from contactwrench.recording.bags.write import write_streams_bag

    path = tmp_path / name
    write_streams_bag(path, read_streams(written(tmp_path, with_gaps())))
    for found in (read_streams(path), joined(list(batches(path, rows=10)))):
        assert found.wrench.t == pytest.approx(Motion.t, abs=1e-9)
        assert np.array_equal(found.wrench.wrench, Motion.wrench)
        assert found.orientation.R_base_flange == pytest.approx(Motion.R[Motion.posed], abs=1e-9)
    turned = read_streams(path, Options(sign="reaction", inverse_orientation=True, wrench_topic="/wrench"))
    assert np.array_equal(turned.wrench.wrench, -Motion.wrench)
    assert turned.orientation.R_base_flange == pytest.approx(Motion.R[Motion.posed].transpose(0, 2, 1), abs=1e-9)
    assert refusal(path, Options(wrench_frame="base")).startswith("found a wrench in base axes without an orientation")
    assert not begins_with_pairs(path)
