"""Nothing that is read is overwritten, and nothing that is there without --force: over all verbs and their options."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator
from inspect import Parameter, signature
from itertools import cycle
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import pytest
import typer

from contactwrench.calibration.calibration import Calibration
from contactwrench.cli.main import app
from contactwrench.cli.outputs import Writes, guarded
from contactwrench.errors import FileAccessError
from contactwrench.files import write_text
from contactwrench.report.html import page as html_page
from tests.support.recordings import PANDA, PAPER, run, written

Capture = pytest.CaptureFixture[str]

VERBS: dict[str, Callable[..., Any]] = {
    each.callback.__name__: each.callback for each in app.registered_commands if each.callback
}
PARAMETERS = {name: signature(verb).parameters for name, verb in VERBS.items()}
READ_PATHS = {"file", "a", "b", "wrench", "pose", "recorded", "prior", "calibration"}
"""Arguments that are paths and are read: any other that is a path has to be marked as an output."""


def types(parameter: Parameter) -> set[Any]:
    """The types of its values, those in lists and unions too."""
    found, left = set(), [parameter.annotation]
    while left:
        kind = left.pop()
        found.add(kind)
        left += get_args(kind)[:1] if get_origin(kind) is Annotated else get_args(kind)
    return found


OUTPUTS = [
    (verb, name)
    for verb, parameters in PARAMETERS.items()
    for name, each in parameters.items()
    if Path in types(each)
    and name not in READ_PATHS
    and verb != "demo"  # which writes files in a folder, and reads none
]

MANY_OUTPUTS = ("live", "out")
"""A list of files and addresses."""
INPUTS = {
    verb: [
        name
        for name, each in parameters.items()
        if types(each) & {Path, str} and (verb, name) not in (*OUTPUTS, MANY_OUTPUTS) and name != "shared"
    ]
    for verb, parameters in PARAMETERS.items()
}


def test_every_path_is_read_or_marked_as_written() -> None:
    marked = [
        (verb, name)
        for verb, parameters in PARAMETERS.items()
        for name, each in parameters.items()
        if any(isinstance(mark, Writes) for mark in get_args(each.annotation))
    ]
    assert marked == [*OUTPUTS, MANY_OUTPUTS, ("demo", "out")]
    assert {verb for verb, _ in OUTPUTS} == {"plan", "calibrate", "compensate", "export", "simulate", "live"}


def test_every_verb_with_an_output_has_force() -> None:
    with_force = {verb for verb, parameters in PARAMETERS.items() if "force" in parameters}
    assert with_force == {"demo", *(verb for verb, name in OUTPUTS if name == "output")}


def complaint(verb: str, **stated: Any) -> str:
    """What a verb says against these arguments; of the others those that are required name what is not there."""
    values = {
        name: Path("gone.json") if each.default is Parameter.empty else each.default
        for name, each in PARAMETERS[verb].items()
    }
    with pytest.raises(FileAccessError) as caught:
        VERBS[verb](**values | stated)
    return str(caught.value)


def as_given(verb: str, name: str, text: str) -> Iterator[Any]:
    """The values by which an argument may name a file."""
    kinds = types(PARAMETERS[verb][name])
    if Path in kinds:
        yield [Path("other.csv"), Path(text)] if list[Path] in kinds else Path(text)
    else:
        yield from ([[each] if list[str] in kinds else each for each in (text, f"{text}:LINK", f"{text}:a:b")])


NAMES = ("in.csv", "sub/../in.csv", "link.csv", "to_link.csv", "hard.csv")
"""All of one file."""


@pytest.fixture
def one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that has all of `NAMES`, in the current folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "in.csv"
    path.write_text("precious")
    (tmp_path / "sub").mkdir()
    (tmp_path / "link.csv").symlink_to("in.csv")
    (tmp_path / "to_link.csv").symlink_to(tmp_path / "link.csv")
    (tmp_path / "hard.csv").hardlink_to(path)
    return path


@pytest.mark.parametrize("scheme", ["", "file:", "FILE:", " file:", "fi\tle:"])
def test_none_of_many_outputs_is_anything_that_is_read(one_file: Path, scheme: str) -> None:
    said = complaint("live", out=["udp://127.0.0.1:9000", f"{scheme}link.csv"], calibration=Path("in.csv"))
    assert said == "link.csv: found what is read as in.csv, expected another file to write: name one"
    assert one_file.read_text() == "precious"


@pytest.mark.parametrize(("verb", "output"), OUTPUTS)
def test_no_output_is_anything_that_is_read(one_file: Path, verb: str, output: str) -> None:
    force = {"force": True} if "force" in PARAMETERS[verb] else {}
    targets = cycle(NAMES)
    texts = (*NAMES, str(one_file))
    tried = {name: [(text, given) for text in texts for given in as_given(verb, name, text)] for name in INPUTS[verb]}
    assert len(tried) >= 5
    for name, pairs in tried.items():
        for (text, given), target in zip(pairs, targets, strict=False):
            said = complaint(verb, **{name: given, output: Path(target)}, **force)
            assert said == f"{target}: found what is read as {text}, expected another file to write: name one"
    assert one_file.read_text() == "precious"


def test_the_file_behind_stdin_is_read(one_file: Path) -> None:
    before = os.dup(0)
    with one_file.open("rb") as stdin:
        os.dup2(stdin.fileno(), 0)
    try:
        said = complaint("compensate", file=Path("-"), output=Path("hard.csv"), force=True)
    finally:
        os.dup2(before, 0)
        os.close(before)
    assert said == "hard.csv: found what is read as -, expected another file to write: name one"


PAIRS = [(verb, a, b) for verb, a in OUTPUTS for other, b in OUTPUTS if verb == other and a < b]


@pytest.mark.parametrize(("verb", "first", "second"), PAIRS)
@pytest.mark.parametrize("there", [True, False])
def test_two_outputs_are_two_files(one_file: Path, verb: str, first: str, second: str, there: bool) -> None:
    name, link = ("in.csv", "hard.csv") if there else ("new.csv", "to_new.csv")
    if not there:
        Path("to_new.csv").symlink_to("new.csv")
    for a, b in ((name, name), (name, link), (link, f"sub/../{name}")):
        said = complaint(verb, **{first: Path(a), second: Path(b), "force": True})
        assert said.endswith(": found two outputs in one file, expected one each: name another")


def test_what_a_verb_writes_beside_its_output_is_guarded(one_file: Path) -> None:
    poses, cal = one_file.rename("run.truth.json"), Path("tools", "in.json")
    assert complaint("simulate", poses=str(poses), output=Path("run.csv"), force=True) == (
        "run.truth.json: found what is read as run.truth.json, expected another file to write: name one"
    )
    assert complaint("simulate", output=Path("run.csv")) == (
        "run.truth.json: found a file there already, expected a new name: name another, or replace it with --force"
    )
    cal.parent.mkdir()
    cal.hardlink_to(poses)
    shared = {"file": [Path("in.csv"), Path("b.csv")], "shared": "mount", "output": cal.parent}
    assert complaint("calibrate", **shared) == (
        "tools/in.json: found a file there already, expected a new name: name another, or replace it with --force"
    )
    shared["file"] = [Path("in.csv"), poses]
    assert complaint("calibrate", **shared, force=True) == (
        "tools/in.json: found what is read as run.truth.json, expected another file to write: name one"
    )
    assert poses.read_text() == "precious"


PARTS = {
    "bag": ("metadata.yaml", "run_0.db3", "run_1.mcap"),
    "tables": ("part-0.parquet", "part-1.pq"),
    "set": ("meta/info.json", "meta/episodes.jsonl", "data/chunk-000/file-000.parquet"),
}
LATER = {"bag": ("run_0.db3-wal", "new.mcap"), "tables": ("new.parquet",), "set": ("data/chunk-000/file-001.parquet",)}


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folders that are recordings, with `PARTS`; the set's data are behind a link."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "set" / "data").symlink_to("../elsewhere")
    for folder, names in PARTS.items():
        for name in names:
            path = tmp_path / folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("precious")
    return tmp_path


def inputs_that_are_folders(folder: str) -> list[dict[str, Any]]:
    return [{"file": Path(folder)}, {"noise": folder}, {"pose": Path(folder)}, {"file": Path("to") / ".." / folder}]


@pytest.mark.parametrize("folder", PARTS)
def test_a_folder_that_is_read_keeps_its_parts(folders: Path, folder: str) -> None:
    (folders / "to").mkdir()
    for read in inputs_that_are_folders(folder):
        (given,) = read.values()
        for name in PARTS[folder]:
            path, link, hard = Path(folder, name), Path("link.csv"), Path("hard.csv")
            link.symlink_to(path)
            hard.hardlink_to(path)
            for output in (path, link, hard, Path("set/../to/..", path)):
                said = complaint("compensate", **read, output=output, force=True)
                assert said == f"{output}: found what is read as {given}, expected another file to write: name one"
            link.unlink()
            hard.unlink()
        for name in LATER[folder]:
            said = complaint("compensate", **read, report=Path(folder, name))
            path = Path(folder, name)
            assert said == f"{path}: found what would be read as {given}, expected another file to write: name one"
        said = complaint("compensate", **read, output=Path(folder))
        assert said == f"{folder}: found what is read as {given}, expected another file to write: name one"
    assert {path.read_text() for path in folders.rglob("*") if path.is_file()} == {"precious"}


@pytest.mark.parametrize("beside", ["run.db3-wal", "run.db3-shm", "run.db3-journal", "metadata.yaml"])
@pytest.mark.parametrize("there", [True, False])
def test_what_belongs_to_a_bag_is_kept(tmp_path: Path, beside: str, there: bool) -> None:
    bag, output = tmp_path / "run.db3", tmp_path / beside
    for path in (bag, output)[: 1 + there]:
        path.write_text("precious")
    said = complaint("calibrate", file=[bag], output=output, force=True)
    assert said == f"{output}: found what is read as {bag}, expected another file to write: name one"


def toy(writing: Callable[[Path], None]) -> Callable[..., None]:
    """A verb with an output and a page."""

    def verb(
        *,
        file: Annotated[list[Path] | None, typer.Argument()] = None,
        word: Annotated[str, typer.Option()] = "base",
        output: Annotated[Path | None, typer.Option(), Writes()] = None,
        report: Annotated[Path | None, typer.Option(), Writes(page=True)] = None,
    ) -> None:
        for path in (output, report):
            if path is not None:
                writing(path)

    def run_it(force: bool = False, **values: Any) -> None:
        guarded(verb)(**{"file": None, "word": "base", "output": None, "report": None, "force": force} | values)

    return run_it


def write_new(path: Path) -> None:
    write_text(path, "new")


ALREADY = "found a file there already, expected a new name: name another, or replace it with --force"


def test_what_is_there_is_replaced_with_force_alone(one_file: Path) -> None:
    verb = toy(write_new)
    for name in NAMES:
        with pytest.raises(FileAccessError) as caught:
            verb(output=Path(name))
        assert str(caught.value) == f"{name}: {ALREADY}"
    assert one_file.read_text() == "precious"
    verb(output=Path("in.csv"), force=True)
    assert one_file.read_text() == "new"
    assert Path("hard.csv").read_text() == "precious"
    with pytest.raises(FileAccessError) as caught:
        verb(report=Path("hard.csv"))
    assert str(caught.value) == f"hard.csv: {ALREADY}"
    page = Path("hard.csv").rename("page.html")
    with pytest.raises(FileAccessError):
        verb(report=page)
    page.write_text(html_page("title", (), "body"))
    Path("to-page.html").symlink_to(page)
    verb(report=Path("to-page.html"))
    assert page.read_text() == "new"


def test_what_somebody_changed_in_the_demo_s_folder_is_kept(tmp_path: Path, capsys: Capture) -> None:
    kept = written(tmp_path, "mine", "mine.json")
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "panda_mini45.json").symlink_to(kept)
    said = run(capsys, "demo", "--out", tmp_path / "demo").complaint
    assert said == f"{tmp_path / 'demo' / 'panda_mini45.json'}: {ALREADY}"
    assert kept.read_text() == "mine"


def test_what_nobody_can_lose_is_written_without_force(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty.csv").touch()
    Path("dangling.csv").symlink_to("new.csv")
    os.mkfifo("pipe")
    reader = os.open("pipe", os.O_RDONLY | os.O_NONBLOCK)
    for name in ("empty.csv", "dangling.csv", "other.csv", "pipe", "/dev/null"):
        toy(write_new)(output=Path(name), report=Path("/dev/null"))
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    assert {path.read_text() for path in tmp_path.glob("*.csv")} == {"new"}
    assert Path("dangling.csv").is_symlink()


def test_a_folder_of_the_name_of_a_word_is_not_read(folders: Path) -> None:
    toy(write_new)(word="tables", output=Path("tables/new.parquet"))
    toy(write_new)(file=[Path("tables")], output=Path("tables/tool.json"))
    toy(write_new)(file=[Path("bag"), Path("tables")], output=Path("elsewhere/new.parquet"))


@pytest.mark.parametrize("links", [True, False])
def test_of_two_writers_the_second_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool) -> None:
    if not links:

        def unsupported(*_: object) -> None:
            raise OSError(errno.EPERM, os.strerror(errno.EPERM))

        monkeypatch.setattr(os, "link", unsupported)
    for path in (tmp_path / "new.csv", tmp_path / "other.csv"):

        def pieces(path: Path = path) -> Iterator[str]:
            yield "second, "
            write_text(path, "first")
            yield "second"

        with pytest.raises(FileAccessError) as caught:
            toy(lambda path: write_text(path, pieces()))(output=path)
        assert str(caught.value) == f"{path}: {ALREADY}"
        assert path.read_text() == "first"
        toy(lambda path: write_text(path, pieces()))(output=path, force=True)
        assert path.read_text() == "second, second"
    assert {path.name for path in tmp_path.iterdir()} == {"new.csv", "other.csv"}


def test_of_two_who_calibrate_at_once_the_second_is_refused(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, save = tmp_path / "tool.json", Calibration.save

    def after_another(calibration: Calibration, path: Path) -> None:
        if not path.exists():
            path.write_text("another's")
        save(calibration, path)

    monkeypatch.setattr(Calibration, "save", after_another)
    assert run(capsys, "calibrate", PANDA, "-o", path).complaint == f"{path}: {ALREADY}"
    assert path.read_text() == "another's"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("n" * 300, "cannot be written (file name too long): name another"),
        ("loop", "cannot be written (too many levels of symbolic links): name another"),
        ("in.csv/x.json", "cannot be written (not a directory): name another"),
        ("gone/x.json", "found no folder FOLDER/gone, expected one: make it first"),
        ("sub", "found a folder, expected a new name: name another, or a file in it"),
        (
            "/proc/x.json",
            "cannot be written (no such file or directory): check the space on the disk and the permissions",
        ),
    ],
)
def test_what_cannot_be_written_is_said_with_its_cause(one_file: Path, name: str, said: str) -> None:
    Path("loop").symlink_to("loop")
    with pytest.raises(FileAccessError) as caught:
        toy(write_new)(output=Path(name))
    assert str(caught.value) == f"{name}: {said.replace('FOLDER', str(one_file.parent))}"


def test_the_cause_is_said_by_the_program_too(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / ("n" * 256)
    for verb in (("plan", "-o", path), ("calibrate", PANDA, "--report", path), ("demo", "--out", path)):
        assert run(capsys, *verb).complaint.endswith("(file name too long): name another")


@pytest.mark.parametrize("arguments", [("info", "run.csv"), ("calibrate", PANDA, "-o", "tool.json"), ("demo",)])
def test_a_current_folder_that_was_deleted_is_no_fault_of_a_file(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str | Path, ...]
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    said = "found that the current folder was deleted, expected one that is there: change to another with cd"
    assert run(capsys, *arguments).complaint == said
    assert run(capsys, "info", PANDA).status == 0
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "info", "run.csv").complaint.startswith("run.csv: there is no such file")


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("option", ["-o {}", "--output={}", "--report {}"])
def test_a_name_with_a_slash_at_its_end_is_no_file(tmp_path: Path, capsys: Capture, option: str) -> None:
    name = f"{tmp_path}/newd/"
    done = run(capsys, "calibrate", PANDA, *option.format(name).split())
    assert done.complaint == f"{name}: found a folder's name, expected a file's: leave out its last /"
    assert not list(tmp_path.iterdir())
    assert run(capsys, "calibrate", PANDA, *option.format(name.rstrip("/")).split(), "--model", "mount").status == 0


def test_a_folder_in_a_file_is_none(tmp_path: Path, capsys: Capture) -> None:
    """That a folder's name may end with a slash is in test_demo.py."""
    file = written(tmp_path, "1", "file")
    assert run(capsys, "demo", "--out", f"{file}//demo/").status != 0


ONE_ON_STDOUT = "expected one output on standard output: name a file for the others"


@pytest.mark.parametrize(
    ("verb", "arguments", "found"),
    [
        ("calibrate", ("--json", "--report", "-"), "--json and --report -"),
        ("calibrate", ("-o", "-", "--report", "-"), "--output - and --report -"),
        ("calibrate", ("-o", "-", "--json", "--report", "-"), "--output - and --json and --report -"),
        ("compensate", ("-c", "gone.json", "-o", "-", "--report", "-"), "--output - and --report -"),
        ("compensate", ("-c", "gone.json", "--report", "-"), "--output - and --report -"),
    ],
)
def test_two_outputs_on_stdout_are_refused_before_anything_is_read(
    capsys: Capture, verb: str, arguments: tuple[str, ...], found: str
) -> None:
    assert run(capsys, verb, "gone.csv", *arguments).complaint == f"found {found}, {ONE_ON_STDOUT}"


@pytest.mark.usefixtures("undrawn")
def test_a_page_on_stdout_is_all_that_is_there(tmp_path: Path, capsys: Capture) -> None:
    saved, table = tmp_path / "tool.json", tmp_path / "contact.csv"
    for arguments in (
        ("calibrate", PANDA, "-o", saved, "--report", "-"),
        ("calibrate", PANDA, "--report", "-"),
        ("compensate", PANDA, "-c", saved, "-o", table, "--rate", "10", "--report", "-"),
    ):
        done = run(capsys, *arguments)
        assert done.status == 0
        assert done.out.startswith("<!doctype html>")
        assert done.out.endswith("</html>\n")
    assert f"Wrote the contact wrenches, 17 rows, to {table}" in done.err
    assert run(capsys, "calibrate", PANDA, "-o", "-", "--json").out.count('"schema"') == 1  # one and the same


SEVERAL = {
    "calibrate": ("calibrate", PANDA, "-o", "z.json", "--report", "{}/z.html"),
    "calibrate, the other": ("calibrate", PANDA, "--report", "z.html", "-o", "{}/z.json"),
    "several tools": ("calibrate", PANDA, PAPER, "--shared", "mount", "-o", "{}/tools"),
    "compensate": ("compensate", "gone.csv", "-c", "gone.json", "-o", "z.csv", "--report", "{}/z.html"),
    "plan": ("plan", "-o", "{}/z.csv"),
    "export": ("export", "gone.json", "--to", "ur", "-o", "{}/z.txt"),
    "simulate": ("simulate", "-o", "{}/z.csv"),
    "live": ("live", "--sensor", "sri://gone", "--record", "{}/z.csv"),
    "live, a sink": ("live", "--sensor", "sri://gone", "--out", "udp://127.0.0.1:9", "--out", "{}/z.csv"),
    "live, its result": ("live", "--sensor", "sri://gone", "-o", "{}/z.json"),
    "demo": ("demo", "--out", "{}/demo"),
}


@pytest.mark.parametrize("arguments", SEVERAL.values(), ids=SEVERAL)
def test_the_folder_of_every_output_is_looked_at_before_anything_is_done(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str | Path, ...]
) -> None:
    """A folder that is none, and one in which the system lets nobody make a file."""
    monkeypatch.chdir(tmp_path)
    asked = [str(each).replace("{}", "/proc") for each in arguments]
    said = run(capsys, *asked).complaint
    assert said.startswith("/proc/")
    assert said.endswith(
        ": cannot be written (no such file or directory): check the space on the disk and the permissions"
    )
    if arguments[0] != "demo" and "--shared" not in arguments:  # which make it
        asked = [str(each).replace("{}", "none") for each in arguments]
        said = run(capsys, *asked).complaint
        assert said.endswith(f": found no folder {tmp_path / 'none'}, expected one: make it first")
    assert not list(tmp_path.iterdir())


def test_a_page_that_cannot_be_drawn_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    saved = tmp_path / "tool.json"
    said = run(capsys, "calibrate", PANDA, "-o", saved, "--report", tmp_path / "r.html").complaint
    assert said.startswith("the report needs matplotlib, which ")
    assert not saved.exists()


@pytest.mark.parametrize(
    ("output", "report", "name", "expected"),
    [
        ("q.csv", "r.html", "q.csv", ".json"),
        ("q.PARQUET", "r.html", "q.PARQUET", ".json"),
        ("q.html", "r.html", "q.html", ".json"),
        ("q.json", "r.json", "r.json", ".html"),
        ("q.json", "r.mcap", "r.mcap", ".html"),
    ],
)
def test_a_name_of_another_kind_of_file_is_refused(
    tmp_path: Path, capsys: Capture, output: str, report: str, name: str, expected: str
) -> None:
    outputs = "-o", tmp_path / output, "--report", tmp_path / report
    said = run(capsys, "calibrate", "gone.csv", *outputs).complaint
    suffix = Path(name).suffix.lower()
    assert said == f"{tmp_path / name}: found the suffix {suffix}, expected {expected}: name it so"


def test_a_name_without_a_suffix_or_with_one_s_own_is_taken(tmp_path: Path, capsys: Capture) -> None:
    for name in ("tool", "tool.cal", "tool.JSON", "tool.2026"):
        assert run(capsys, "calibrate", PANDA, "-o", tmp_path / name, "--model", "mount").status == 0
    folder = tmp_path / "tools.csv"
    said = run(capsys, "calibrate", PANDA, "gone.csv", "--shared", "mount", "-o", folder).complaint
    assert said.startswith("gone.csv: there is no such file")
