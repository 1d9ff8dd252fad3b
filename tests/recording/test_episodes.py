"""Sets of recordings: lists and structs as columns, one recording an episode, LeRobot's folders, statistics or none."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.contact_wrenches import ContactWrenches
from contactwrench.errors import ContactWrenchError, FileFormatError
from contactwrench.recording import compensate as compensation
from contactwrench.recording.compensate import Treatment
from contactwrench.recording.compensate_set import compensated_set
from contactwrench.recording.contents import table_contents
from contactwrench.recording.options import Options
from contactwrench.recording.read import batches, read_streams
from contactwrench.recording.tables.columns import Column
from contactwrench.recording.tables.table import open_table
from tests.recording.test_bad_files import assert_one_line_that_names
from tests.recording.test_tables import HEADER, Motion, rows
from tests.support.recordings import PANDA, WRENCH, csv_text, run, written

pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

QUAT = Rotation.from_matrix(Motion.R).as_quat()
NO_NUMBER = "found no number, expected one: fill it in or leave the row out"
EPISODES = np.repeat([0, 1, 4], [20, 25, 15])


@cache
def panda() -> cw.Calibration:
    return cw.calibrate(cw.read(PANDA))


def robot_learning_set() -> Any:
    """Lists of a fixed and of any length, images, and times that begin anew in each episode."""
    wrench = [pa.array(Motion.wrench.tolist(), pa.list_(pa.float64()))]
    return pa.table(
        {
            "observation.state": pa.array(np.hstack([Motion.position, QUAT]).tolist(), pa.list_(pa.float64(), 7)),
            "wrench": wrench[0],
            "quat_xyzw": pa.array(QUAT.tolist(), pa.list_(pa.float64(), 4)),
            "observation.image": pa.array([[1, 2, 3] * 30] * 60, pa.list_(pa.uint8())),
            "points": pa.array([[[1.0, 2.0], [3.0, 4.0]]] * 60),
            "task": ["insert"] * 60,
            "t": np.concatenate([0.1 * np.arange(n) for n in (20, 25, 15)]),
            "episode_index": EPISODES,
        }
    )


def lerobot(folder: Path, version: int, table: Any = None) -> Path:
    """A folder as LeRobot writes it: an episode a file (2), or files with many episodes (3)."""
    table = robot_learning_set() if table is None else table
    for part in ("meta/episodes/chunk-000", "data/chunk-000", "data/chunk-001", "videos"):
        (folder / part).mkdir(parents=True)
    (folder / "meta" / "info.json").write_text('{"codebase_version": "v3.0"}')
    pq.write_table(pa.table({"episode_index": [0, 1, 4]}), folder / "meta/episodes/chunk-000/file-000.parquet")
    if version == 2:
        for k, name in enumerate(["chunk-000/episode_000000", "chunk-000/episode_000001", "chunk-001/episode_000004"]):
            some = table.filter(pa.array([0, 1, 4][k] == EPISODES))
            pq.write_table(some, folder / f"data/{name}.parquet", row_group_size=8)
    else:
        pq.write_table(table.slice(0, 30), folder / "data/chunk-000/file-000.parquet", row_group_size=8)
        pq.write_table(table.slice(30), folder / "data/chunk-001/file-000.parquet", write_statistics=False)
    return folder


def sets(folder: Path) -> list[Path]:
    """The same set in every kind of file that may hold one."""
    table = robot_learning_set()
    pq.write_table(table, folder / "set.parquet")
    numbers = np.column_stack([Motion.wrench, QUAT, table["t"].to_numpy(), EPISODES])
    text = csv_text((*WRENCH, "qx", "qy", "qz", "qw", "t", "Episode_Index"), numbers, delimiter=";")
    return [lerobot(folder / "v2", 2), lerobot(folder / "v3", 3), folder / "set.parquet", written(folder, text)]


def test_one_recording_an_episode(tmp_path: Path) -> None:
    for path in sets(tmp_path):
        for episode in (0, 1, 4):
            of_it = episode == EPISODES
            found = cw.read(path, episode=episode)
            assert np.array_equal(found.wrench, Motion.wrench[of_it])
            assert found.R_base_flange == pytest.approx(Motion.R[of_it], abs=1e-12)
            assert found.t == pytest.approx(0.1 * np.arange(len(found)), abs=1e-12)
            blocks = [part.wrench.wrench for part in batches(path, Options(episode=episode), rows=7)]
            assert np.array_equal(np.concatenate(blocks), Motion.wrench[of_it])


def test_several_episodes_are_named_with_the_flag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in sets(tmp_path):
        with pytest.raises(FileFormatError) as several:
            cw.read(path)
        assert str(several.value) == (
            f"{path}: found 3 episodes, 0, 1, 4, expected one recording: choose it, as with --episode 0; "
            "compensate --all-episodes takes each by itself"
        )
        with pytest.raises(FileFormatError) as none:
            cw.read(path, episode=9)
        assert str(none.value) == (
            f"{path}: found no episode 9, expected one that is there, as 0, 1, 4: choose with --episode"
        )
    for verb, of_no_tool, quickly in (("calibrate", {1, 2}, ("--model", "mount")), ("diagnose", {0}, ())):
        assert run(capsys, verb, path).complaint == str(several.value)
        assert run(capsys, verb, path, "--episode", "9").complaint == str(none.value)
        done = run(capsys, verb, path, "--episode", "1", *quickly)  # noise: a bad fit, or refused, as it falls
        assert done.status in of_no_tool
        assert "episode" not in done.err


def test_the_only_episode_needs_no_flag_and_a_flag_needs_episodes(tmp_path: Path) -> None:
    one = lerobot(tmp_path / "v2", 2) / "data/chunk-001/episode_000004.parquet"
    assert np.array_equal(cw.read(one).wrench, Motion.wrench[45:])
    with pytest.raises(FileFormatError) as caught:
        cw.read(PANDA, episode=3)
    assert str(caught.value) == (
        f"{PANDA}: found no column episode_index, expected one of which --episode 3 is: leave it out"
    )


def test_what_is_wrong_in_another_episode_does_not_matter(tmp_path: Path) -> None:
    lines = csv_text((*HEADER, "episode_index"), np.column_stack([rows(), EPISODES])).splitlines()
    lines[30] = ",".join(["what" if k == 2 else cell for k, cell in enumerate(lines[30].split(","))])
    path = written(tmp_path, "\n".join(lines))
    assert np.array_equal(cw.read(path, episode=4).wrench, Motion.wrench[45:])
    with pytest.raises(FileFormatError) as caught:
        cw.read(path, episode=1)
    assert str(caught.value) == (
        f"{path}: row 31, column fy: found 'what', expected a number: correct it or leave the row out"
    )


def test_info_says_which_episodes_there_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = lerobot(tmp_path / "set", 3)
    out = run(capsys, "info", path).out
    assert out.startswith(f"{path}\nTable, 60 rows of 22 columns\n  observation.state[0:7], ")
    assert ", observation.image, points, task, t, episode_index\n" in out
    assert (
        "  3 episodes, 0, 1, 4: --episode N chooses one; times of the first:\n"
        "  times: 1.9 s\n  rate: 10 Hz, longest gap 0.1 s at 0.500 s\n"
    ) in out
    assert table_contents(path).episodes == (0, 1, 4)


def test_parquet_to_parquet_keeps_the_episode_that_was_compensated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, tool = lerobot(tmp_path / "set", 3), tmp_path / "tool.json"
    panda().save(tool)
    out = tmp_path / "out.parquet"
    assert run(capsys, "compensate", path, "-c", tool, "-o", out, "--episode", "4").status == 0
    after = pq.read_table(out)
    assert after["observation.state"].to_pylist() == robot_learning_set()["observation.state"].to_pylist()[45:]
    assert after["fx_std"].null_count == 0


@pytest.mark.parametrize("judged", [(), ("--contact", "--noise", "0.1")])
def test_all_episodes_are_each_compensated_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], judged: tuple[str, ...]
) -> None:
    tool, out = tmp_path / "tool.json", tmp_path / "out.csv"
    panda().save(tool)
    for path in sets(tmp_path):
        expected = []
        for episode in (0, 1, 4):
            one = run(capsys, "compensate", path, "-c", tool, "--episode", str(episode), *judged)
            assert one.status == 0
            expected += [f"{episode},{line}{'' if judged else ',1,,'}" for line in one.out.splitlines()[1:]]
        done = run(capsys, "compensate", path, "-c", tool, "--all-episodes", *judged, "-o", out, "--force")
        header, *found = out.read_text(encoding="utf-8").splitlines()
        assert header.startswith("episode_index,t,fx,fy,fz,")
        assert found == expected
        assert ("60 samples in 3 episodes" in done.out) == bool(judged)


def test_all_episodes_stay_beside_the_columns_of_a_parquet_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, tool, out = lerobot(tmp_path / "set", 3), tmp_path / "tool.json", tmp_path / "out.parquet"
    panda().save(tool)
    assert run(capsys, "compensate", path, "-c", tool, "-o", out, "--all-episodes").status == 0
    after = pq.read_table(out)
    before = robot_learning_set()
    assert after.select(before.column_names).to_pydict() == before.to_pydict()
    assert after.column_names[len(before.column_names) :][:2] == ["fx", "fy"]
    calibration = cw.Calibration.load(tool)
    forces = np.column_stack([after[name].to_numpy() for name in ("fx", "fy", "fz")])
    assert forces == pytest.approx(calibration.compensate(Motion.wrench, Motion.R)[:, :3], abs=1e-9)


def test_episodes_that_are_treated_differently_have_the_same_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The calibration's delay concerns a motion, not poses at rest."""
    tool, out = tmp_path / "tool.json", tmp_path / "out.csv"
    replace(panda(), delay=0.03, delay_std=0.001).save(tool)
    table = np.column_stack([rows(), EPISODES])
    few = EPISODES == 1
    table[few, 0] = 20.0 * np.arange(25.0)
    path = written(tmp_path, csv_text((*HEADER, "episode_index"), table))
    for suffix in (".csv", ".parquet"):
        assert run(capsys, "compensate", path, "-c", tool, "--all-episodes", "-o", out.with_suffix(suffix)).status == 0
    lines = out.read_text(encoding="utf-8").splitlines()
    assert {line.count(",") for line in lines} == {16}
    assert pq.read_table(out.with_suffix(".parquet"))["valid"].to_pylist()[20:45] == [True] * 25


def test_an_episode_that_cannot_be_compensated_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tool = tmp_path / "tool.json"
    panda().save(tool)
    path = written(tmp_path, csv_text((*HEADER, "episode_index"), np.column_stack([rows()[:21], EPISODES[:21]])))
    said = run(capsys, "compensate", path, "-c", tool, "--all-episodes", "--contact", "-o", tmp_path / "out.csv")
    lacks = f"{path}: found 1 orientation, expected 2 or more to interpolate between"
    assert said.complaint == f"episode 1: {lacks}; --accept-damaged takes the others"


@pytest.mark.parametrize(
    ("suffix", "episode", "judged"),  # any two of them in every combination
    [
        (".parquet", 0, ()),
        (".csv", 4, ()),
        (".parquet", 4, ("--contact", "--noise", "0.1")),
        (".csv", 0, ("--contact", "--noise", "0.1")),
    ],
)
def test_of_a_set_with_a_damaged_episode_the_others_are_compensated_where_that_is_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str, episode: int, judged: tuple[str, ...]
) -> None:
    whole, path, tool = tmp_path / f"whole{suffix}", tmp_path / f"set{suffix}", tmp_path / "tool.json"
    panda().save(tool)
    table = np.column_stack([Motion.wrench, QUAT, 0.1 * np.arange(60.0), EPISODES])
    damaged, row = table.copy(), int(np.argmax(episode == EPISODES)) + 3
    damaged[row, 6:10] *= 1.3
    for file, numbers in ((whole, table), (path, damaged)):
        names = (*WRENCH, "qx", "qy", "qz", "qw", "t", "episode_index")
        if suffix == ".csv":
            file.write_text(csv_text(names, numbers), encoding="utf-8")
        else:
            pq.write_table(pa.table(dict(zip(names, numbers.T, strict=True))), file, row_group_size=16)
    wanted, found = tmp_path / f"wanted{suffix}", tmp_path / f"found{suffix}"
    every: tuple[str | Path, ...] = ("-c", tool, "--all-episodes", *judged)
    assert run(capsys, "compensate", whole, *every, "-o", wanted).status == 0
    where = f"row {row + 1 + (suffix == '.csv')}, columns qx,qy,qz,qw"
    why = (
        f"{path}: {where}: found a quaternion of length 1.3, expected 1 within 1 %: check the order of its parts and "
        "that none is cut off"
    )
    refused = run(capsys, "compensate", path, *every, "-o", found)
    assert refused.complaint == f"episode {episode}: {why}; --accept-damaged takes the others"
    assert not found.exists()
    accepted = run(capsys, "compensate", path, *every, "-o", found, "--accept-damaged")
    assert accepted.status == 0
    assert f"Note: left out: {why} (episode {episode})" in accepted.err
    expected, got = (_contact_wrenches(file) for file in (wanted, found))
    whole_ones = episode != EPISODES
    assert got[whole_ones].tolist() == expected[whole_ones].tolist()
    assert {tuple(row) for row in got[~whole_ones, 6:].tolist()} == {(False, f"left out: {why}")}
    assert np.isnan(got[~whole_ones, :6].astype(float)).all()


def test_what_was_done_of_an_episode_before_it_ended_stays_and_no_row_is_there_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In batches of five rows; one of the third in the second episode has a quaternion that is none."""
    monkeypatch.setattr(compensation, "ROWS", 5)
    table = np.column_stack([Motion.wrench, QUAT, 0.1 * np.arange(60.0), EPISODES])
    table[33, 6:10] *= 1.3
    path = written(tmp_path, csv_text((*WRENCH, "qx", "qy", "qz", "qw", "t", "episode_index"), table))
    every = compensated_set(path, Options(episode=0), panda(), Treatment(), [0, 1, 4], accept_damaged=True)
    found = ContactWrenches.concatenate(list(every))
    assert np.array_equal(np.asarray(found.episode), EPISODES)
    first = int(np.argmin(found.valid))
    assert 20 < first <= 33
    assert np.flatnonzero(~found.valid).tolist() == list(range(first, 45))
    right = panda().compensate(Motion.wrench, Motion.R)[found.valid]
    assert found.wrench[found.valid] == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_lost_episode_of_two_streams_has_a_row_for_each_reading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    """Readings and orientations in rows of their own; a Parquet set keeps all of its rows."""
    path, tool, out = tmp_path / "set.parquet", tmp_path / "tool.json", tmp_path / f"out{suffix}"
    panda().save(tool)
    turns = Rotation.from_rotvec(np.outer(0.02 * np.arange(60), [0.6, 0.0, 0.8])).as_quat()
    times = np.concatenate([0.01 * np.arange(n) for n in (20, 25, 15)])
    table = np.column_stack([Motion.wrench, turns, times, EPISODES])
    is_pose = np.arange(60) % 3 == 0
    table[is_pose, :6], table[~is_pose, 6:10] = np.nan, np.nan
    table[30, 6:10] *= 1.3
    names = (*WRENCH, "qx", "qy", "qz", "qw", "t", "episode_index")
    columns = {name: pa.array(column, from_pandas=True) for name, column in zip(names, table.T, strict=True)}
    pq.write_table(pa.table(columns), path, row_group_size=16)
    done = run(capsys, "compensate", path, "-c", tool, "--all-episodes", "--accept-damaged", "-o", out)
    assert done.status == 0
    assert "columns qx,qy,qz,qw: found a quaternion of length 1.3" in done.err
    lost = (EPISODES == 1) & ~is_pose
    if suffix == ".csv":
        lines = out.read_text(encoding="utf-8").splitlines()[1:]
        assert [line.partition(",")[0] for line in lines] == [str(e) for e in EPISODES[~is_pose]]
        return
    valid = np.array(pq.read_table(out)["contact_valid"].to_pylist(), object)
    assert len(valid) == 60
    assert {*valid[lost]} == {False}
    assert {*valid[is_pose]} == {None}


def _contact_wrenches(path: Path) -> Any:
    """Wrench, whether it is valid, and why not, (n, 8)."""
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as file:
            cells = list(csv.DictReader(file))
        numbers = np.array([[float(cell[name]) for name in WRENCH] for cell in cells], object)
        return np.column_stack([numbers, [c["valid"] == "1" for c in cells], [c["reason"] or None for c in cells]])
    table = pq.read_table(path)
    names = [f"contact_{name}" for name in (*WRENCH, "valid", "reason")]
    return np.array([table[name].to_pylist() for name in names], object).T


def test_a_set_of_which_no_episode_can_be_compensated_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tool = tmp_path / "tool.json"
    panda().save(tool)
    two = np.column_stack([rows()[:2], [0, 1]])
    path = written(tmp_path, csv_text((*HEADER, "episode_index"), two))
    said = run(capsys, "compensate", path, "-c", tool, "--all-episodes", "--contact", "--accept-damaged")
    lacks = f"{path}: found 1 orientation, expected 2 or more to interpolate between"
    assert said.complaint == f"none of 2 episodes can be compensated: {lacks}"


def test_a_damaged_row_group_of_another_episode_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "set.parquet"
    pq.write_table(robot_learning_set().select(["wrench", "quat_xyzw", "t", "episode_index"]), path, row_group_size=5)
    group = pq.ParquetFile(path).metadata.row_group(11)
    chunk = group.column(0)
    content = bytearray(path.read_bytes())
    end = chunk.data_page_offset + chunk.total_compressed_size
    content[end - 30 : end] = bytes(30)
    path.write_bytes(content)
    assert len(cw.read(path, episode=0)) == 20
    with pytest.raises(FileFormatError):
        cw.read(path, episode=4)


def test_what_is_said_of_many_episodes_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, tool = lerobot(tmp_path / "set", 2), tmp_path / "tool.json"
    panda().save(tool)
    said = run(capsys, "compensate", path, "-c", tool, "--all-episodes", "--contact").err
    noise = "noise of a sample unknown: a Compensator takes its first second for free air; --noise states it"
    assert said.count(f"{noise} (episode 0 and 2 others)") == said.count(noise) == 1


def test_of_many_different_notes_some_are_said(tmp_path: Path) -> None:
    numbers = np.repeat(np.arange(25.0), 8)
    wrench = np.tile(np.arange(8.0)[:, None], (25, 6)) + 0.1 * numbers[:, None]
    wrench[np.flatnonzero(np.diff(numbers, prepend=-1.0)) + 1, 0] = np.nan
    k = np.arange(8)[None] <= np.arange(25)[:, None] % 7
    wrench[k.ravel(), 1] = np.nan
    names = (*WRENCH, "qx", "qy", "qz", "qw", "t", "episode_index")
    rest = np.column_stack([np.tile([0.0, 0.0, 0.0, 1.0], (200, 1)), np.tile(0.1 * np.arange(8.0), 25), numbers])
    path, said = written(tmp_path, csv_text(names, np.column_stack([wrench, rest]))), list[str]()
    calibration = panda()
    rows_of_all = compensated_set(path, Options(), calibration, Treatment(), range(25), note=said.append)
    assert sum(len(batch) for batch in rows_of_all) == 200
    assert len(said) == len(set(said)) <= 21
    assert (
        "found no whole reading (nothing, NaN, zeros alone, or -9999 and the like) in 3 rows: not used "
        "(episode 2 and 3 others)" in said
    )


@pytest.mark.parametrize(
    ("change", "flags", "message"),
    [
        (
            lambda e: e[::-1][:0],
            (),
            "{}: found no column episode_index, expected a set of recordings: leave out --all-episodes",
        ),
        (
            lambda e: np.r_[e[30:], e[:30]],
            (),
            "{}: row 52: found episode 1 again, expected its rows together: sort the table by episode_index",
        ),
        (
            lambda e: e,
            ("--episode", "1"),
            "found --all-episodes and --episode, which is for one recording: leave one of them out",
        ),
        (
            lambda e: e,
            ("--report", "page.html"),
            "found --all-episodes and --report, which is for one recording: leave one of them out",
        ),
    ],
)
def test_what_does_not_go_with_all_episodes_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Any, flags: tuple[str, ...], message: str
) -> None:
    tool, episodes = tmp_path / "tool.json", change(EPISODES)
    panda().save(tool)
    names, columns = ((*HEADER, "episode_index"), [rows(), episodes]) if len(episodes) else (HEADER, [rows()])
    path = written(tmp_path, csv_text(names, np.column_stack(columns)))
    assert run(capsys, "compensate", path, "-c", tool, "--all-episodes", *flags).complaint == message.format(path)


def test_rows_are_counted_over_the_groups_that_are_left_out(tmp_path: Path) -> None:
    table = robot_learning_set()
    wrench = table["wrench"].to_pylist()
    wrench[50] = [1.0, 2.0]
    path = tmp_path / "set.parquet"
    place = table.schema.get_field_index("wrench")
    lists = pa.array(wrench, pa.list_(pa.float64()))
    pq.write_table(table.set_column(place, "wrench", lists), path, row_group_size=7)
    assert len(cw.read(path, episode=1)) == 25
    with pytest.raises(FileFormatError) as caught:
        cw.read(path, episode=4)
    assert str(caught.value) == (
        f"{path}: row 51, column wrench: found a list of 2, expected 6: complete it or leave the row out"
    )


def test_lists_stand_for_columns_by_their_places(tmp_path: Path) -> None:
    kinds = (pa.list_(pa.float64()), pa.list_(pa.float32(), 6), pa.large_list(pa.float64()))
    for kind in kinds:
        lists = pa.array([None, *Motion.wrench.tolist()[1:]], kind)
        path = tmp_path / "run.parquet"
        others = {"long": [[0.0] * 65] * 60, "words": [["a"]] * 60}
        pq.write_table(pa.table({"Observation.Wrench": lists, **others}), path)
        table = open_table(path)
        assert [name.lower() for name in table.places] == [
            *(f"observation.wrench[{k}]" for k in range(6)),
            *("long", "words"),
        ]
        columns = [Column(place, name, 1.0) for name, place in table.places.items()][:6]
        (body,) = table.bodies(columns)
        found = body.numbers(columns, may_lack=columns)
        assert np.isnan(found[0]).all()
        assert found[1:] == pytest.approx(Motion.wrench[1:], rel=1e-6)
        long = Column(table.places["long"], "long", 1.0)
        with pytest.raises(FileFormatError) as caught:
            next(table.bodies([long])).numbers([long])
        assert str(caught.value) == (
            f"{path}: column long: found list<element: double>, expected numbers: write it as double"
        )


def test_a_list_of_another_length_is_named_by_its_row(tmp_path: Path) -> None:
    lists = [*Motion.wrench.tolist()[:40], [1.0, 2.0], *Motion.wrench.tolist()[41:]]
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"ft": lists, "n": np.arange(60)}), path, row_group_size=9)
    table = open_table(path, rows=8)
    column = Column(table.places["ft[5]"], "ft[5]", 1.0)
    with pytest.raises(FileFormatError) as caught:
        [body.numbers([column]) for body in table.bodies([column])]
    assert str(caught.value) == (
        f"{path}: row 41, column ft: found a list of 2, expected 6: complete it or leave the row out"
    )


def test_structs_stand_for_columns_with_dots(tmp_path: Path) -> None:
    wrench = [
        None if k == 3 else {"force": dict(zip("xyz", one[:3], strict=True)), "torque": {"v": one[3:]}}
        for k, one in enumerate(Motion.wrench.tolist())
    ]
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"wrench": wrench}), path)
    table = open_table(path)
    assert [*table.places] == [
        *("wrench.force.x", "wrench.force.y", "wrench.force.z"),
        *("wrench.torque.v[0]", "wrench.torque.v[1]", "wrench.torque.v[2]"),
    ]
    columns = [Column(place, name, 1.0) for name, place in table.places.items()]
    (body,) = table.bodies(columns)
    found = body.numbers(columns, may_lack=columns)
    assert np.isnan(found[3]).all()
    assert np.array_equal(np.delete(found, 3, axis=0), np.delete(Motion.wrench, 3, axis=0))


def test_a_set_whose_files_differ_is_refused(tmp_path: Path) -> None:
    path = lerobot(tmp_path / "set", 2)
    other = path / "data/chunk-000/episode_000001.parquet"
    pq.write_table(pq.read_table(other).drop_columns(["task"]), other)
    with pytest.raises(FileFormatError) as caught:
        read_streams(path, Options(episode=0))
    assert str(caught.value) == (
        f"{other}: found other columns than in episode_000000.parquet, expected the same: name one file"
    )


def test_an_episode_index_that_is_no_number_is_refused(tmp_path: Path) -> None:
    table = robot_learning_set()
    place = table.schema.get_field_index("episode_index")
    path = tmp_path / "set.parquet"
    for values, said in (
        (["one"] * 60, "column episode_index: found string, expected numbers: write it as double"),
        (
            [None, *[1] * 59],
            "row 1, column episode_index: found no number, expected one: fill it in or leave the row out",
        ),
    ):
        pq.write_table(table.set_column(place, "episode_index", pa.array(values)), path)
        for episode in (None, 1):
            with pytest.raises(FileFormatError) as caught:
                cw.read(path, episode=episode)
            assert str(caught.value) == f"{path}: {said}"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "good.parquet"
    pq.write_table(robot_learning_set(), path, row_group_size=20)
    return path.read_bytes()


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_sets_are_refused_in_one_line(tmp_path: Path, whole: bytes, data: st.DataObject) -> None:
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path = written(tmp_path, bytes(content), "damaged.parquet")
    try:
        found = cw.read(path, episode=1)
    except ContactWrenchError as error:
        assert_one_line_that_names(error, path)
    else:
        assert np.isfinite(found.wrench).all()


NAMES = ["x", "y", "z", "qx", "qy", "qz", "qw", "fx", "fy", "fz", "tx", "ty", "tz"]


@pytest.mark.parametrize(
    "names",
    [NAMES, {"motors": NAMES}, {"arm": NAMES[:7], "wrist": NAMES[7:]}, {name: k for k, name in enumerate(NAMES)}],
)
def test_names_that_lerobot_gives_to_the_elements_of_a_list_tell_what_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], names: Any
) -> None:
    state = np.hstack([Motion.position, QUAT, Motion.wrench])
    columns = {"observation.state": state.tolist(), "action": state.tolist(), "timestamp": 0.1 * np.arange(60)}
    folder = lerobot(tmp_path / "set", 3, pa.table({**columns, "episode_index": np.zeros(60, dtype=int)}))
    described = {"observation.state": {"names": names}, "action": {"names": NAMES}, "image": {"names": None}}
    (folder / "meta/info.json").write_text(json.dumps({"features": described}))
    for orientation in ("auto", "quat_xyzw:observation.state[3:7]"):
        samples = cw.read(folder, orientation)
        assert np.array_equal(samples.wrench, Motion.wrench)
        assert samples.R_base_flange == pytest.approx(Motion.R, abs=1e-12)
    told = str(samples.read_as["columns"])
    assert told.startswith(
        'fx..fz from "observation.state[7:10]", tx..tz from "observation.state[10:13]", '
        'qx..qw from "observation.state[3:7]", t from "timestamp"'
    )
    assert "observation.state[12].tz, action[0].x, " in run(capsys, "info", folder).out


def test_two_axes_of_a_rotation_are_found_by_the_names_of_elements(tmp_path: Path) -> None:
    state = np.hstack([Motion.R[:, :, 0], Motion.R[:, :, 1], Motion.wrench])
    columns = {"observation.state": state.tolist(), "timestamp": 0.1 * np.arange(60)}
    folder = lerobot(tmp_path / "set", 3, pa.table({**columns, "episode_index": np.zeros(60, dtype=int)}))
    names = [f"rot6d_{k}" for k in range(6)] + NAMES[7:]
    (folder / "meta/info.json").write_text(json.dumps({"features": {"observation.state": {"names": names}}}))
    assert cw.read(folder, "rot6d").R_base_flange == pytest.approx(Motion.R, abs=1e-12)
    inverse = np.transpose(Motion.R, (0, 2, 1))
    assert cw.read(folder, "rot6d_rows").R_base_flange == pytest.approx(inverse, abs=1e-12)


def test_names_that_do_not_fit_a_list_say_nothing_and_what_is_no_json_is_refused(tmp_path: Path) -> None:
    folder = lerobot(tmp_path / "set", 3)
    described = {"observation.state": {"names": ["fx", "fy"]}, "quat_xyzw": {"names": [0, 1, 2, 3]}}
    (folder / "meta/info.json").write_text(json.dumps({"features": described}))
    assert np.array_equal(cw.read(folder, episode=1).wrench, Motion.wrench[20:45])
    (folder / "meta/info.json").write_text("{")
    with pytest.raises(FileFormatError) as caught:
        cw.read(folder, episode=1)
    assert str(caught.value) == (
        f"{folder}/meta/info.json: cannot be read as JSON (Input data was truncated), expected a whole JSON file: "
        "write it anew"
    )
