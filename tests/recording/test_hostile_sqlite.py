"""sqlite3 recordings and ROS 2 folders that are damaged, or cost too much: refused by name, or all of it read."""

from __future__ import annotations

import sqlite3
from collections import Counter
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactwrench.errors import ContactWrenchError, FileFormatError
from contactwrench.recording.bags.chunks import Logged
from contactwrench.recording.bags.copy import write_bag_with
from contactwrench.recording.bags.folder import LONGEST_YAML
from contactwrench.recording.bags.open import messages, opened_bag
from tests.support.bags import START, bag_streams, recording, write_bag
from tests.support.hostile_sqlite import CHANGED, ROWS, changed, endless

READINGS = recording(300, every=1)[0]
WHOLE = {"/wrench": 300, "/pose": 300}


def _read(path: Path, *, accept_damaged: bool = False) -> tuple[dict[str, int], str]:
    """How many messages each topic gives, and the damage."""
    read: Counter[str] = Counter()
    with opened_bag(path, accept_damaged=accept_damaged) as bag:
        for part in messages(bag, bag.counts):
            read.update({topic.name: len(logged) for topic, logged in part.items()})
        return dict(read), bag.damage.said


def _refused(path: Path) -> str:
    with pytest.raises(FileFormatError) as caught:
        _read(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value).removeprefix(f"{path}: ")


def _no_bag(reason: str, kind: str = "sqlite3 bag") -> str:
    return f"cannot be read as a ROS 2 {kind} ({reason}), expected a whole one: record or copy it again"


def _damaged(found: str, expected: str) -> str:
    return (
        f"found {found}, expected {expected}: the file is damaged; record or copy it again, or read what is left of it "
        "with --accept-damaged"
    )


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("a view that never ends", "no table messages with topic_id, timestamp, data stored in it"),
        ("a virtual table", "no table messages with topic_id, timestamp, data stored in it"),
        ("a column that is computed", "no table messages with data stored in it"),
        ("no topics", "no table topics with id, name, type, serialization_format stored in it"),
        ("a number as a type", "Expected `str`, got `bytes` - at `$.type`"),
    ],
)
def test_only_what_is_stored_in_tables_is_read(tmp_path: Path, what: str, reason: str) -> None:
    assert _refused(changed(tmp_path / "run.db3", READINGS, CHANGED[what])) == _no_bag(reason)


@pytest.mark.parametrize("what", ROWS)
def test_rows_that_are_no_messages_are_counted(tmp_path: Path, what: str) -> None:
    path = changed(tmp_path / "run.db3", READINGS, ROWS[what])
    found, expected = "2 rows of other types or of no topic in it", "messages: a topic, a stamp and bytes"
    assert _refused(path) == _damaged(found, expected)
    read, said = _read(path, accept_damaged=True)
    assert sum(read.values()) == 598
    assert said == f"{path} is damaged: found {found}, expected {expected}; what was left of it was read"


def test_a_tree_that_refers_to_one_page_again_and_again(tmp_path: Path) -> None:
    path = endless(tmp_path / "run.db3", READINGS)
    assert _refused(path) == _no_bag("more rows than a file of its size can hold")


def test_an_index_that_lost_a_row(tmp_path: Path) -> None:
    """It is given the index of another table, which has all rows but one."""
    path = changed(
        tmp_path / "run.db3",
        READINGS,
        "PRAGMA writable_schema = ON;"
        "CREATE TABLE fewer(topic_id, timestamp INTEGER, data);"
        "INSERT INTO fewer(rowid, topic_id, timestamp, data)"
        " SELECT id, topic_id, timestamp, data FROM messages WHERE id <> 7;"
        "CREATE INDEX of_fewer ON fewer(timestamp);"
        "UPDATE sqlite_master SET rootpage = (SELECT rootpage FROM sqlite_master WHERE name = 'of_fewer')"
        " WHERE name = 'timestamp_idx';"
        "DELETE FROM sqlite_master WHERE name = 'of_fewer'",
    )
    assert _refused(path) == _damaged("299 messages of /pose by its index of stamps", "300 as in its table")
    read, said = _read(path, accept_damaged=True)
    assert read == {"/wrench": 300, "/pose": 299}
    assert "found 299 messages of /pose by its index of stamps, expected 300 as in its table" in said


@pytest.mark.parametrize("dropped", ["message_definitions", "message_definitions type_description_hash", "all"])
def test_older_schemas(tmp_path: Path, dropped: str) -> None:
    sql = "DROP TABLE message_definitions; DROP TABLE schema; DROP TABLE metadata;"
    if "hash" in dropped or dropped == "all":
        sql += "ALTER TABLE topics DROP COLUMN type_description_hash;"
    if dropped == "all":
        sql += "ALTER TABLE topics DROP COLUMN offered_qos_profiles; DROP INDEX timestamp_idx;"
    path = changed(tmp_path / "run.db3", READINGS[::-1], sql)
    assert len(bag_streams(path).wrench) == 300
    stamps = [logged.stamp for part in _parts(path) for logged in part]
    assert all((later[1:] >= later[:-1]).all() for later in stamps)


def _parts(path: Path) -> list[list[Logged]]:
    with opened_bag(path) as bag:
        return [list(part.values()) for part in messages(bag, bag.counts)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write_bag(tmp_path_factory.mktemp("whole") / "run.db3", READINGS).read_bytes()


@settings(max_examples=75)
@given(data=st.data())
def test_no_message_is_lost_in_silence(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, data: st.DataObject
) -> None:
    """A byte that differs: names and numbers may be others, for which there is no checksum; their count may not."""
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        page = data.draw(st.integers(0, len(content) // 4096 - 1))
        at = data.draw(st.integers(0, 200) | st.integers(0, 4095))
        content[4096 * page + at] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "changed.db3"
    path.write_bytes(bytes(content))
    for accepted in (False, True):
        try:
            read, said = _read(path, accept_damaged=accepted)
        except ContactWrenchError as error:
            assert str(error).startswith(f"{path}: ")  # noqa: PT017
            assert "\n" not in str(error)  # noqa: PT017
        else:
            assert sorted(read.values()) == [300, 300] or said


def test_what_a_crash_left_beside_it(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "run.db3", READINGS)
    rest = path.with_name("run.db3-journal")
    rest.write_bytes(bytes(512))
    assert _read(path)[0] == WHOLE
    rest.write_bytes(b"\xd9\xd5\x05\xf9 \xa1c\xd7")
    assert _refused(path) == (
        "found run.db3-journal with messages beside it, expected a recording that was closed: join them with sqlite3 "
        "run.db3 'PRAGMA wal_checkpoint(TRUNCATE)'"
    )


def _folder(path: Path, old: str, new: str) -> Path:
    write_bag(path, READINGS)
    file = path / "metadata.yaml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    return path


def test_a_file_of_a_folder_may_be_a_link(tmp_path: Path) -> None:
    """As data stores keep large files."""
    path = write_bag(tmp_path / "run", READINGS)
    whole = _read(path)
    (path / "run.db3").rename(tmp_path / "stored")
    (path / "run.db3").symlink_to(tmp_path / "stored")
    assert _read(path) == whole


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  - run.db3", "  - ../run.db3", "found ../run.db3 in metadata.yaml, expected files in it: name that file"),
        ("  - run.db3", "  - sub/run.db3", "found sub/run.db3 in metadata.yaml, expected files in it: name that file"),
        ("  - run.db3", "  - /run.db3", "found /run.db3 in metadata.yaml, expected files in it: name that file"),
        (
            "  - run.db3",
            "  - run.db3\n  - run.db3",
            "found run.db3 twice in metadata.yaml, expected it once: take the second out",
        ),
        (
            "  - run.db3",
            "  - a.db3",
            "found no a.db3, expected it, as metadata.yaml says: copy the folder whole",
        ),
        ("version: 9", "version: 10", _no_bag("metadata.yaml of version 10, known is 9", "bag folder")),
        ("sqlite3", "rocksdb", _no_bag("storage 'rocksdb', known are sqlite3 and mcap", "bag folder")),
        (
            "compression_mode: ''",
            "compression_mode: FILE",
            _no_bag("compression file , known is zstd of files or messages", "bag folder"),
        ),
        ("version: 9", "version: &a 9\n  w: *a", _no_bag("YAML with an alias, *", "bag folder")),
        (
            "  message_count: 600\n  rel",
            "  message_count: 601\n  rel",
            _damaged("600 messages", "601 as in metadata.yaml"),
        ),
        (
            "message_count: 600\n    path",
            "message_count: 9\n    path",
            _damaged("600 messages in run.db3", "9 as in metadata.yaml"),
        ),
        ("name: /pose", "name: /poses", _damaged("0 messages of /poses", "300 as in metadata.yaml")),
    ],
)
def test_what_a_folder_says_of_its_files(tmp_path: Path, old: str, new: str, message: str) -> None:
    write_bag(tmp_path / "run.db3", READINGS[:20])
    path = _folder(tmp_path / "run", old, new)
    assert _refused(path) == message
    if message.endswith("--accept-damaged"):
        read, said = _read(path, accept_damaged=True)
        assert read == WHOLE
        assert message.partition(": the file")[0] in said


def test_folders_named_with_their_files_before_version_4(tmp_path: Path) -> None:
    path = _folder(tmp_path / "run", "  - run.db3", "  - old_name/run.db3")
    (path / "metadata.yaml").write_text((path / "metadata.yaml").read_text().replace("version: 9", "version: 3"))
    assert _read(path) == (WHOLE, "")


def test_a_folder_of_two_files(tmp_path: Path) -> None:
    path = _folder(tmp_path / "run", "  - run.db3", "  - run.db3\n  - second.db3")
    file = path / "metadata.yaml"
    text = (
        file.read_text()
        .replace("message_count: 300", "message_count: 310")
        .replace("message_count: 600\n  rel", "message_count: 620\n  rel")
    )
    part = text[text.index("  - duration:") : text.index("  message_count: 620")]
    write_bag(path / "second.db3", READINGS[:20])
    file.write_text(text.replace(part, part + part.replace("600", "20").replace("run.db3", "second.db3")))
    assert _read(path) == ({"/wrench": 310, "/pose": 310}, "")
    with opened_bag(path) as bag:
        assert bag.start == START * 1e-9
    out = tmp_path / "out"
    write_bag_with(path, out, [np.zeros((310, 6))])
    assert _read(out) == ({"/wrench": 310, "/pose": 310, "/wrench/contact": 310}, "")
    file.write_text(file.read_text().replace("message_count: 20", "message_count: 21"))
    assert _refused(path) == _damaged("20 messages in second.db3", "21 as in metadata.yaml")


@pytest.mark.parametrize(
    "yaml", ["[" * 1000, "a: " + "9" * 100_000, " " * (LONGEST_YAML + 1), "a: \xff".encode("latin1")]
)
def test_descriptions_of_any_length(tmp_path: Path, yaml: str | bytes) -> None:
    path = write_bag(tmp_path / "run", READINGS[:20])
    (path / "metadata.yaml").write_bytes(yaml if isinstance(yaml, bytes) else yaml.encode())
    assert _refused(path).startswith("cannot be read as a ROS 2 bag folder (")


@pytest.mark.parametrize("mode", ["file", "message"])
def test_what_unpacks_to_far_more(tmp_path: Path, mode: str) -> None:
    path = write_bag(tmp_path / "run", READINGS[:20], compression=mode)
    assert _read(path) == ({"/wrench": 10, "/pose": 10}, "")
    zstd = pytest.importorskip("zstandard")
    bomb = zstd.ZstdCompressor().compress(bytes(2**26))
    if mode == "file":
        (path / "run.db3.zstd").write_bytes(bomb)
        assert _refused(path) == _no_bag("run.db3.zstd unpacks to more than 200 times its size", "bag folder")
    else:
        with closing(sqlite3.connect(path / "run.db3")) as base:
            base.execute("UPDATE messages SET data = ?", (bomb,))
            base.commit()
        assert _refused(path) == _no_bag("its messages unpack to more than 200 times its size", "bag folder")
