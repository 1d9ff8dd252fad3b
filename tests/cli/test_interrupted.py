"""A signal at any moment: one line, its own exit status, and no temporary file; and the process as its user left it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import contactwrench as cw
from contactwrench import __main__ as program
from tests.support.recordings import PANDA, beside_its_doubt
from tests.support.signals import heard

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")

PLANTED = """
import atexit, os, signal, sys

def strike(event, arguments):
    if event == {event!r} and {part!r} in str(arguments[0]):
        os.kill(os.getpid(), signal.{name})
        os.kill(os.getpid(), signal.{name})

if {event!r} == "exit":
    atexit.register(os.kill, os.getpid(), signal.{name})
sys.addaudithook(strike)
from contactwrench.__main__ import main
main()
"""
"""The program, which is sent a signal, twice, at the first audit event of that kind with that text."""
MOMENTS = {
    "as the first of it is imported": ("import", "contactwrench.cli", "SIGINT", 130, "interrupted"),
    "while it is imported": ("import", "numpy", "SIGINT", 130, "interrupted"),
    "while it reads": ("open", "run.csv", "SIGINT", 130, "interrupted"),
    "as a temporary folder is made": ("tempfile.mkdtemp", ".contactwrench-", "SIGHUP", 129, "its terminal is gone"),
    "while it is written": ("open", ".contactwrench-", "SIGTERM", 143, "terminated"),
    "when all is done": ("exit", "", "SIGINT", 0, ""),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("interrupted")
    (folder / "run.csv").write_bytes(PANDA.read_bytes())
    cw.calibrate(cw.read(PANDA), "mount").save(folder / "tool.json")
    return folder


def struck(
    folder: Path, event: str, part: str, name: str, before: Callable[[], object] = heard
) -> subprocess.CompletedProcess[str]:
    (folder / "out.csv").unlink(missing_ok=True)
    script = PLANTED.format(event=event, part=part, name=name)
    compensate = ["compensate", "run.csv", "-c", "tool.json", "-o", "out.csv"]
    arguments = ["show", "tool.json"] if event == "exit" else compensate
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, preexec_fn=before)


@pytest.mark.parametrize(("event", "part", "name", "status", "said"), MOMENTS.values(), ids=MOMENTS)
def test_a_signal_is_one_line_and_leaves_nothing(
    folder: Path, event: str, part: str, name: str, status: int, said: str
) -> None:
    done = struck(folder, event, part, name)
    assert (done.returncode, done.stderr) == (status, f"contactwrench: {said}\n" if said else "")
    assert {path.name for path in folder.iterdir()} == {"run.csv", "tool.json"}


def test_next_to_nothing_is_imported_before_a_signal_is_heard() -> None:
    """What comes before is Python's own start, and these, which take 2 ms: no `typing`, and nothing of the program."""
    script = "import sys; before = set(sys.modules); import contactwrench.__main__; print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-I", "-S", "-c", f"import sys; sys.path[:] = {sys.path}; {script}"],
                          capture_output=True, text=True, check=True)  # fmt: skip
    imported = {name.partition(".")[0] for name in done.stdout.split() if "__" not in name}
    ours = {name for name in done.stdout.split() if name.startswith("contactwrench")}
    assert ours == {"contactwrench", "contactwrench.version", "contactwrench.__main__"}
    assert not imported & {"typing", "re", "pathlib", "tempfile", "subprocess", "numpy", "typer", "logging"}


def test_a_signal_that_the_parent_ignores_is_ignored(folder: Path) -> None:
    done = struck(folder, "open", "run.csv", "SIGHUP", lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    assert (done.returncode, beside_its_doubt(done.stderr)) == (0, "")
    assert (folder / "out.csv").exists()


def test_folders_and_files_that_tempfile_made_are_removed(tmp_path: Path) -> None:
    """On a terminal that shows a bar, which is wiped away."""
    script = (
        "import contactwrench.__main__ as start, contactwrench.cli.main as program, os, rich.live, signal, tempfile\n"
        "def work(*_):\n"
        f"    made = tempfile.mkdtemp(dir={str(tmp_path)!r})\n"
        "    open(os.path.join(made, 'part.db3'), 'w').close()\n"
        f"    os.close(tempfile.mkstemp(dir={str(tmp_path)!r})[0])\n"
        f"    os.rmdir(tempfile.mkdtemp(dir={str(tmp_path)!r}))\n"
        f"    open(os.path.join({str(tmp_path)!r}, 'kept'), 'w').close()\n"
        "    os.isatty = lambda _: True\n"
        "    os.kill(os.getpid(), signal.SIGTERM)\n"
        "program.exit_status = work\n"
        "start.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (143, b"\r\x1b[2K\x1b[?25hcontactwrench: terminated\n")
    assert list(tmp_path.iterdir()) == [tmp_path / "kept"]


def test_to_import_the_package_touches_no_signal_and_no_limit() -> None:
    script = (
        "import resource, signal, sys\n"
        "def state():\n"
        "    return [signal.getsignal(n) for n in signal.valid_signals()], resource.getrlimit(resource.RLIMIT_DATA)\n"
        "before = state()\n"
        "import contactwrench, contactwrench.__main__, contactwrench.cli.main\n"
        "sys.exit(before != state())\n"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_what_libraries_warn_of_and_log_is_not_shown() -> None:
    script = (
        "import contactwrench.__main__ as start, contactwrench.cli.main as program, logging, warnings\n"
        "def warn(*_):\n"
        "    warnings.warn('overflow', RuntimeWarning)\n"
        "    logging.getLogger('matplotlib').warning('created a temporary cache directory')\n"
        "    return 1\n"
        "program.exit_status = warn\n"
        "start.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (1, b"")
    shown = subprocess.run([sys.executable, "-W", "default", "-c", script], capture_output=True, check=False)
    assert b"RuntimeWarning: overflow" in shown.stderr


@pytest.mark.skipif(not Path("/proc/meminfo").exists(), reason="this system does not say what memory is left")
@pytest.mark.parametrize("stated", [False, True])
def test_memory_is_bounded_by_what_is_left_unless_it_is_already(stated: bool) -> None:
    import resource

    soft = 10**12 if stated else resource.RLIM_INFINITY
    script = (
        "import contactwrench.__main__ as start, contactwrench.cli.main as program, resource\n"
        f"resource.getrlimit = lambda _: ({soft}, resource.RLIM_INFINITY)\n"
        "resource.setrlimit = lambda _, bound: print(*bound)\n"
        "program.exit_status = lambda *_: 0\n"
        "start.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    limits = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") + (os.cpu_count() or 1) * program.RESERVED
    assert [(0 < bound <= memory, hard) for bound, hard in limits] == (
        [] if stated else [(True, resource.RLIM_INFINITY)]
    )


def test_the_virtual_rig_starts_no_other_program_that_a_signal_would_not_reach(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    script = PLANTED.format(event="subprocess.Popen", part="", name="SIGINT")
    command = [sys.executable, "-c", script, "simulate", "-o", "out.csv"]
    environment = {**os.environ, "MUJOCO_GL": "a library that there is not"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_report_needs_no_window_whatever_the_environment_wishes(tmp_path: Path) -> None:
    """All but the last of its drawing, which takes most of the time, knows no window."""
    pytest.importorskip("matplotlib")
    script = (
        "import contactwrench.report.figures as figures, contactwrench.__main__ as start\n"
        "figures.svg_text = lambda _: '<svg></svg>'\n"
        "start.main()\n"
    )
    arguments = ["calibrate", str(PANDA), "--model", "mount", "-o", "tool.json", "--report", "tool.html"]
    command = [sys.executable, "-c", script, *arguments]
    environment = {**os.environ, "MPLBACKEND": "one that there is not"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert {path.name for path in tmp_path.iterdir()} == {"tool.json", "tool.html"}
