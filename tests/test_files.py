"""A file is written whole or not at all, and a failure is one line."""

import errno
import os
import re
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import contactwrench
from contactwrench.errors import FileAccessError
from contactwrench.files import identity, parts_of, read_bytes, write_text

FULL = Path("/dev/full")
WITHOUT_DISK = "cannot be written (no space left on device): check the space on the disk and the permissions"


def fail_with_full_disk(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def pieces_that_break_off() -> Iterator[str]:
    yield "half\n"
    raise RuntimeError("broke off")


def refusal(path: Path, content: str = "new") -> str:
    """The message with which `write_text` refuses, without the path."""
    with pytest.raises(FileAccessError) as caught:
        write_text(path, content)
    assert isinstance(caught.value, OSError)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def test_text_is_written_as_utf8_with_its_own_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    write_text(path, iter(["größe\r\n", "1\n"]))
    assert read_bytes(path) == "größe\r\n1\n".encode()
    write_text(path, "short")
    assert read_bytes(path) == b"short"


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("before", [None, "old\n"])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str, before: str | None
) -> None:
    path = tmp_path / "out.csv"
    if before is not None:
        path.write_text(before)
    if step == "fsync":
        monkeypatch.setattr(os, "fsync", fail_with_full_disk)
    else:
        monkeypatch.setattr(Path, "replace", fail_with_full_disk)
    assert refusal(path) == WITHOUT_DISK
    assert [entry.name for entry in tmp_path.iterdir()] == ([] if before is None else ["out.csv"])
    assert before is None or path.read_text() == before


def test_an_interruption_in_the_middle_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old\n")
    with pytest.raises(RuntimeError, match="broke off"):
        write_text(path, pieces_that_break_off())
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.csv"]
    assert path.read_text() == "old\n"


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_the_permissions_of_an_existing_file_are_kept(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    path.chmod(mode)
    write_text(path, "new")
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert path.read_text() == "new"


@pytest.mark.parametrize("may", [(0, 1), (1,), ()], ids=["both", "the group alone", "neither"])
def test_the_owner_of_an_existing_file_is_kept_where_it_may_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, may: tuple[int, ...]
) -> None:
    """As root, --force made the file of a user root's."""
    path, given = tmp_path / "out.csv", [-1, -1]
    path.write_text("old")
    path.chmod(0o640)
    there = path.stat()

    def chown(_: Path, *ids: int) -> None:
        for which, one in enumerate(ids):
            if one != -1:
                if which not in may:
                    raise PermissionError
                given[which] = one

    monkeypatch.setattr(os, "chown", chown)
    write_text(path, "new")
    assert given == [there.st_uid if 0 in may else -1, there.st_gid if 1 in may else -1]
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("new", 0o640)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root gives files away")
def test_root_gives_a_file_back_to_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    os.chown(path, 1234, 2345)
    write_text(path, "new")
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 2345)


def test_a_new_file_has_the_permissions_that_the_user_gives_new_files(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "out.csv", "new")
        assert os.umask(0o027) == 0o027
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out.csv").stat().st_mode) == 0o640


@pytest.mark.parametrize("exists", [True, False])
def test_a_symlink_is_written_through(tmp_path: Path, exists: bool) -> None:
    target, link = tmp_path / "data" / "target.csv", tmp_path / "link.csv"
    target.parent.mkdir()
    if exists:
        target.write_text("old")
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert not target.is_symlink()


def test_a_file_with_the_longest_possible_name_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 251 + ".csv")
    write_text(path, "new")
    assert path.read_text() == "new"


def test_a_pipe_is_written_directly(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_text(path, "new")
        assert os.read(reader, 10) == b"new"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(path.stat().st_mode)


def test_a_pipe_that_nobody_reads_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    assert refusal(path) == "found a pipe without a reader, expected one: start it first"


def test_a_reader_of_a_pipe_may_be_slow(tmp_path: Path) -> None:
    """More than the pipe holds: nothing of it is lost."""
    path, text = tmp_path / "pipe", "0123456789\n" * 50_000
    os.mkfifo(path)
    slow = "import sys, time; file = open(sys.argv[1]); print(flush=True); time.sleep(0.3); print(len(file.read()))"
    with subprocess.Popen([sys.executable, "-c", slow, str(path)], stdout=subprocess.PIPE, text=True) as reader:
        writer = os.open(path, os.O_WRONLY)  # waits for the reader
        write_text(path, text)
        os.close(writer)
        assert reader.communicate()[0].split() == [str(len(text))]


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_device() -> None:
    assert refusal(FULL) == WITHOUT_DISK
    assert not stat.S_ISREG(FULL.stat().st_mode)


def test_a_directory_is_no_file_to_write(tmp_path: Path) -> None:
    assert refusal(tmp_path) == "found a folder, expected a new name: name another, or a file in it"
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    assert refusal(tmp_path / "gone" / "out.csv") == f"found no folder {tmp_path / 'gone'}, expected one: make it first"


def test_a_file_in_place_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    assert refusal(tmp_path / "file" / "out.csv").startswith("cannot be written (not a directory)")


def test_a_folder_without_permission_to_write(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        if os.access(tmp_path, os.W_OK):
            pytest.skip("this user may write everywhere")
        assert refusal(tmp_path / "out.csv") == (
            "cannot be written (permission denied): check the space on the disk and the permissions"
        )
    finally:
        tmp_path.chmod(0o700)


def test_standard_output_is_a_dash(capsys: pytest.CaptureFixture[str]) -> None:
    write_text("-", iter(["a\n", "b\n"]))
    assert capsys.readouterr().out == "a\nb\n"
    assert not Path("-").exists()


def test_a_pipe_without_a_name_is_written_directly() -> None:
    """As behind /dev/stdout, and as a shell's `>(command)` gives it."""
    reader, writer = os.pipe()
    write_text(f"/dev/fd/{writer}", "new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    os.close(writer)


def test_a_killed_writer_leaves_the_old_file_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    writing = (
        "import sys, time; from contactwrench.files import write_text\n"
        "def pieces():\n"
        "    yield 'new' * 100_000\n"
        "    print('writing', flush=True)\n"
        "    time.sleep(60)\n"
        "write_text(sys.argv[1], pieces())"
    )
    with subprocess.Popen([sys.executable, "-c", writing, path], stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"writing\n"
        writer.kill()
    assert path.read_text() == "old"


def test_a_file_that_is_read_keeps_its_other_names(tmp_path: Path) -> None:
    path, other = tmp_path / "out.csv", tmp_path / "other.csv"
    path.write_text("old")
    other.hardlink_to(path)
    write_text(path, "new")
    assert (path.read_text(), other.read_text()) == ("new", "old")


def test_identity_is_that_of_the_file(tmp_path: Path) -> None:
    path, link, hard = tmp_path / "a", tmp_path / "link", tmp_path / "hard"
    link.symlink_to(path)
    assert identity(path) == identity(link) == identity(tmp_path / "x" / ".." / "a") != identity(hard)
    path.touch()
    hard.hardlink_to(path)
    assert identity(path) == identity(link) == identity(hard) != identity(tmp_path)
    assert identity("n" * 5000) == identity(f"./{'n' * 5000}")


def test_a_name_of_any_bytes_can_stand_in_a_text(tmp_path: Path) -> None:
    write_text(tmp_path / "tool.py", "# from tool\udcff.json, é\n")
    assert (tmp_path / "tool.py").read_text(encoding="utf-8") == "# from tool\\udcff.json, é\n"


def test_a_folder_is_looked_into_as_deep_as_a_recording(tmp_path: Path) -> None:
    """A home folder, or /, is named by mistake."""
    deep = tmp_path / "[a]" / "data" / "chunk-000" / "file-000.parquet"
    (deep / "more").mkdir(parents=True)
    (deep.parent / "loop").symlink_to(tmp_path)
    found = {os.path.relpath(path, tmp_path / "[a]") for path in parts_of(str(tmp_path / "[a]"))}
    assert found == {"data", "data/chunk-000", "data/chunk-000/file-000.parquet", "data/chunk-000/loop"}


def test_only_files_py_opens_files_to_be_written() -> None:
    """The others write where `new_place` says, into the null device, into a folder of their own for a while, what
    grows while the arm runs, or to a serial device.
    """
    writes = re.compile(
        r"""\.open\(["'][wax]|\.(write_text|write_bytes|touch|rename|hardlink_to)\(|os\.(open|replace)\("""
    )
    package = Path(contactwrench.__file__).parent
    found = {
        path.relative_to(package).as_posix(): len(lines)
        for path in package.rglob("*.py")
        if (lines := writes.findall(path.read_text(encoding="utf-8")))
    }
    assert found == {
        **{"files.py": 3, "recording/bags/copy.py": 2, "recording/bags/folder.py": 1},
        **{"__main__.py": 1, "cli/streams.py": 2, "live/sinks/growing.py": 3, "live/sources/ft300.py": 1},
    }
