"""The documentation holds: every link resolves, every block of code runs, and what a page shows is what comes out.

A page's blocks run in order, in one namespace and one folder, which holds the recordings that `contactwrench demo`
writes, and for a page of docs/robots/ what that robot's own recorder writes. In a ```console block every line
`$ contactwrench ...` must exit with status 0, or with the one that a line `$ echo $?` after it shows. What follows a
command, or a ```text block that follows a ```python block, must be the output: words exactly, numbers within 2 % or a
digit of the last place; a line `...` stands for any lines. A command with nothing after it may print what it likes.

After a change of the program's output: `python -m tests.test_docs`, of all pages or of those that are named, writes the
new output into docs/; read the difference before you keep it. A line `?` is replaced by the output; beside a line `...`
only numbers are renewed.
"""

from __future__ import annotations

import inspect
import io
import os
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest

import contactwrench
from contactwrench.cli.main import main
from tests.support.brands import BRANDS, EXAMPLES
from tests.support.recordings import program
from tests.support.robot_pages import (
    WRITTEN_BY_PROGRAM,
    assert_the_columns,
    assert_the_payload,
    assert_the_push,
    assert_the_tool,
)

ROOT = Path(__file__).resolve().parent.parent
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *DOCS]
DATA = Path(contactwrench.__file__).parent / "data"

FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)[^)]*\)|(?:src|href)=\"([^\"]+)\"")
IMPORT = re.compile(r"^(?: {4})*from contactwrench\.([\w.]+) import ([\w, ]+)$", re.MULTILINE)
GIVE_AS_THEY_SAY = ("contactwrench.live.source.now", "contactwrench.live.uri.source_of")
"""Functions whose first line is what they return."""
HEADING = re.compile(r"^#{1,6} +(.+?) *#*$", re.MULTILINE)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")
COMMAND, STATUS, ELLIPSIS = "$ contactwrench", "$ echo $?", "..."


def page_id(page: Path) -> str:
    return str(page.relative_to(ROOT))


# Links


def prose(page: Path) -> str:
    return re.sub(r"`[^`\n]*`", "", FENCE.sub("", page.read_text(encoding="utf-8")))


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives to a page's headings."""
    found: set[str] = set()
    for heading in HEADING.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
        same = sum(re.fullmatch(rf"{re.escape(slug)}(-\d+)?", other) is not None for other in found)
        found.add(f"{slug}-{same}" if same else slug)
    return found


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_links_resolve(page: Path) -> None:
    broken = []
    for groups in LINK.findall(prose(page)):
        link = "".join(groups)
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = page if not path else (page.parent / path).resolve()
        if not target.exists() or (anchor and (target.suffix != ".md" or anchor not in anchors(target))):
            broken.append(link)
    assert not broken


def test_every_page_is_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    names = [page.relative_to(ROOT / "docs").as_posix() for page in DOCS]
    assert [name for name in names if name != "README.md" and f"({name})" not in index] == []


def test_the_api_page_has_every_public_name() -> None:
    listed = re.findall(r"^::: (\S+)$", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert {f"contactwrench.{name}" for name in contactwrench.__all__ if name != "__version__"} <= set(listed)
    for name in listed:
        resolve_name(name)  # raises where there is none


def test_the_api_page_has_what_guide_and_examples_import() -> None:
    """But for the virtual rig, which only makes their data."""
    listed = set(re.findall(r"^::: contactwrench\.(\S+)$", (ROOT / "docs" / "api.md").read_text("utf-8"), re.MULTILINE))
    files = [*DOCS, *(ROOT / "examples").rglob("*.py")]
    imports = [
        f"{module}.{name}"
        for file in files
        for module, names in IMPORT.findall(file.read_text(encoding="utf-8"))
        for name in names.split(", ")
    ]
    assert {"assess.verify.verify", "live.counter.Counter"} <= set(imports)
    assert [name for name in imports if name not in listed and not name.startswith(("simulate.", "geometry."))] == []


def test_what_a_function_takes_and_gives_is_on_the_api_page() -> None:
    """With shapes and units, which no test can judge; but each argument by its name, and what comes back."""
    listed = re.findall(r"^::: (\S+)$", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.MULTILINE)
    functions = {name: made for name in listed if inspect.isfunction(made := resolve_name(name))}
    for name in ("run", "zero"):
        functions[name] = getattr(contactwrench.Compensator, name)
    assert len(functions) > 15
    for name, function in functions.items():
        taken = inspect.signature(function).parameters.keys() - {"self"}
        said = inspect.getdoc(function) or ""
        arguments = {
            each for names in re.findall(r"^    ([\w, ]+): ", said, re.MULTILINE) for each in names.split(", ")
        }
        assert taken <= arguments, name
        assert "\nReturns:\n" in said or name in GIVE_AS_THEY_SAY, name


def test_no_table_is_cut_in_two() -> None:
    assert [
        page for page in PAGES if re.search(r"^\|.*\n\n\|(?! *-)", page.read_text(encoding="utf-8"), re.MULTILINE)
    ] == []


# Blocks of code


@dataclass
class Shown:
    """One thing to run, what the page shows of its output, and what came out."""

    line: int
    kind: str
    source: str
    output: str | None
    status: int = 0
    actual: str = ""


def blocks(text: str) -> Iterator[tuple[re.Match[str], list[Shown]]]:
    """Every block that runs, with the text block that shows its output taken in; and what it runs."""
    found = list(FENCE.finditer(text))
    for k, block in enumerate(found):
        kind, body = block.group(1), block.group(2)
        line = text.count("\n", 0, block.start()) + 1
        if kind == "python":
            after = found[k + 1] if k + 1 < len(found) else None
            follows = after and after.group(1) == "text" and not text[block.end() : after.start()].strip()
            output = after.group(2) if after and follows else None
            yield (after if after and follows else block), [Shown(line, kind, body, output)]
        elif kind == "console":
            yield block, list(commands(body, line))


def commands(body: str, line: int) -> Iterator[Shown]:
    parts = re.split(r"^(?=\$ )", body, flags=re.MULTILINE)
    parts = [part for part in parts if part.strip()]
    for k, part in enumerate(parts):
        source, _, output = part.partition("\n")
        if source == STATUS:
            continue
        status = 0
        if k + 1 < len(parts) and parts[k + 1].startswith(STATUS + "\n"):
            status = int(parts[k + 1].partition("\n")[2])
        yield Shown(line, "console", source, output, status)


def provide_recordings(page: Path) -> None:
    """Put what the page's blocks read into the current folder."""
    copied = Path("contactwrench-demo")
    copied.mkdir()
    for name in ("panda_mini45.csv", "paper_six_poses.csv"):
        shutil.copy(DATA / name, copied / name)
    if page.parent.name == "robots":
        BRANDS[page.stem](Path(), EXAMPLES[page.stem], np.random.default_rng(list(BRANDS).index(page.stem)))


def run(page: Path) -> list[tuple[re.Match[str], list[Shown]]]:
    """Run a page's blocks in the current folder; `actual` of each is filled in."""
    text, where = page.read_text(encoding="utf-8"), page.name
    provide_recordings(page)
    namespace: dict[str, Any] = {"__name__": "__page__"}
    done = list(blocks(text))
    for _, items in done:
        for item in items:
            out = io.StringIO()
            if item.kind == "python":
                with redirect_stdout(out):
                    exec(compile(item.source, f"{where}:{item.line}", "exec"), namespace)
            elif item.source.startswith(COMMAND):
                if item.source == f"{COMMAND} demo":
                    shutil.rmtree("contactwrench-demo")  # as it is not there yet for who types that
                status = run_command(item.source, out)
                assert status == item.status, f"{where}: {item.source}: status {status}\n{out.getvalue()}"
            else:
                continue
            item.actual = out.getvalue()
    return done


def run_command(source: str, out: io.StringIO) -> int:
    before = sys.argv
    sys.argv = shlex.split(source.removeprefix("$ "))
    try:
        with redirect_stdout(out), redirect_stderr(out):
            main(program())
    except SystemExit as end:
        return int(end.code or 0)
    finally:
        sys.argv = before
    raise AssertionError("the program leaves with a status")


def words(line: str) -> str:
    return NUMBER.sub("#", " ".join(line.split()))


def same_line(shown: str, actual: str) -> bool:
    if words(shown) != words(actual):
        return False
    return all(
        abs(float(a) - float(b)) <= 0.02 * abs(float(a)) + 1.01 * last_place(a)
        for a, b in zip(NUMBER.findall(shown), NUMBER.findall(actual), strict=True)
    )


def last_place(number: str) -> float:
    digits, _, exponent = number.partition("e")
    return float(10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])))


def is_shown(shown: str, actual: str) -> bool:
    """Whether `shown`, in which a line `...` stands for any lines, is `actual`."""
    wanted = shown.rstrip().splitlines()
    lines = actual.rstrip().splitlines()

    def matches(w: int, k: int) -> bool:
        while w < len(wanted) and wanted[w].strip() != ELLIPSIS:
            if k >= len(lines) or not same_line(wanted[w], lines[k]):
                return False
            w, k = w + 1, k + 1
        if w == len(wanted):
            return k == len(lines)
        return any(matches(w + 1, later) for later in range(k, len(lines) + 1))

    return matches(0, 0)


@contextmanager
def folder(path: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(path)
    try:
        yield
    finally:
        os.chdir(before)


@pytest.fixture
def only_words(undrawn: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages show what the program says; what its reports look like is in report/test_report.py."""
    for name in ("contacts", "signals"):
        monkeypatch.setattr(import_module(f"contactwrench.report.{name}"), "svg_text", lambda _: "<svg></svg>")


@pytest.mark.slow
@pytest.mark.usefixtures("only_words")
@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_blocks_run_and_show_their_output(page: Path, tmp_path: Path) -> None:
    with folder(tmp_path):
        done = run(page)
    for _, items in done:
        for item in items:
            runs = item.kind == "python" or item.source.startswith(COMMAND)
            if runs and item.output:
                assert is_shown(item.output, item.actual), f"{page.name}:{item.line}: {item.source}\n{item.actual}"
    if page.parent.name == "robots":
        assert_identified(page, tmp_path, [item for _, items in done for item in items])


def assert_identified(page: Path, folder: Path, done: list[Shown]) -> None:
    """The tool and its payload, and while working the push."""
    brand, rig = page.stem, EXAMPLES[page.stem]
    if brand in WRITTEN_BY_PROGRAM:
        assert_the_columns(folder / WRITTEN_BY_PROGRAM[brand], page.read_text(encoding="utf-8"))
    for item in done:
        if item.source.startswith(f"{COMMAND} export"):
            assert_the_payload(item.source, item.actual, rig)
    if (folder / "contact.csv").exists():
        assert_the_push(folder / "contact.csv")
    assert_the_tool(contactwrench.Calibration.load(folder / "tool.json"), rig)


def test_every_page_of_a_robot_has_its_recorder() -> None:
    assert {page.stem for page in DOCS if page.parent.name == "robots"} == set(BRANDS)


@pytest.mark.parametrize(
    ("shown", "actual", "same"),
    [
        ("weight 7.73 +- 0.04 N\n", "weight  7.731  +- 0.041 N\n", True),
        ("weight 7.73 N\n", "weight 7.93 N\n", False),
        ("weight 7.73 N\n", "weight -7.73 N\n", False),
        ("weight 7.73 N\n", "mass 7.73 N\n", False),
        ("a\n...\nd\n", "a\nb\nc\nd\n", True),
        ("a\n...\nd\n", "a\nb\nd\ne\n", False),
        ("a\n", "a\nb\n", False),
    ],
)
def test_outputs_are_compared(shown: str, actual: str, same: bool) -> None:
    assert is_shown(shown, actual) is same


def renewed(page: Path) -> str:
    """The page with the outputs that it shows as they come out now."""
    text = page.read_text(encoding="utf-8")
    for block, items in reversed(run(page)):
        body = ""
        for item in items:
            body += f"{item.source}\n" if item.kind == "console" else ""
            shown, actual = (item.output or "").splitlines(), item.actual.rstrip().splitlines()
            if ELLIPSIS in shown:
                by_words = {words(line): line for line in actual}
                for line in shown:
                    if words(line) not in by_words and line != ELLIPSIS:
                        print(f"{page.name}: nothing comes out like {line.strip()!r}: renew it by hand")
                actual = [by_words.get(words(line), line) for line in shown]
            body += "".join(f"{line}\n" for line in (actual if shown and item.actual else shown))
            body += f"{STATUS}\n{item.status}\n" if item.status else ""
        if any(item.output for item in items):
            text = text[: block.start(2)] + body + text[block.end(2) :]
    return text


if __name__ == "__main__":
    for doc in [Path(name).resolve() for name in sys.argv[1:]] or DOCS:
        with tempfile.TemporaryDirectory() as scratch, folder(Path(scratch)):
            after = renewed(doc)
        if after != doc.read_text(encoding="utf-8"):
            doc.write_text(after, encoding="utf-8")
            print(f"renewed {doc.relative_to(ROOT)}")
