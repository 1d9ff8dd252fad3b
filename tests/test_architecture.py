"""The house stays in order: folders, imports that go one way, lazy imports, public names, one version."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

import contactwrench as cw
from tests.support.house import (
    JUDGE,
    LAB,
    ORDER,
    Import,
    against_the_order,
    circles,
    imports,
    modules,
    touching_the_outside_world,
)

PACKAGE = Path(cw.__file__).parent
REPOSITORY = Path(__file__).resolve().parents[1]

MOST_FILES, MOST_LINES = 268, 47_365
"""A ratchet: lowered when the package shrinks, raised with the reason in the message of the commit that does it."""
MOST_AT_ROOT, MOST_FOLDERS = 8, 13
MOST_LINES_OF_FILE = 300


@cache
def edges_of_the_package() -> list[Import]:
    """All imports, read only where one of the tests below runs: every worker collects this file."""
    return imports(PACKAGE)


def test_the_root_is_small() -> None:
    at_root = list(PACKAGE.glob("*.py"))
    folders = [path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"]
    assert len(at_root) <= MOST_AT_ROOT
    assert set(folders) == {*ORDER, JUDGE, LAB, "data"}
    assert len(folders) <= MOST_FOLDERS


def test_the_whole_is_small() -> None:
    files = [path for _, path in modules(PACKAGE)]
    assert len(files) <= MOST_FILES
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files) <= MOST_LINES


@pytest.mark.parametrize(("module", "path"), list(modules(PACKAGE)), ids=[name for name, _ in modules(PACKAGE)])
def test_a_file_is_read_in_one_sitting(module: str, path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES_OF_FILE


def test_imports_go_one_way() -> None:
    assert against_the_order(edges_of_the_package()) == []


def test_there_is_no_circle_of_files_or_folders() -> None:
    assert circles(edges_of_the_package()) == []


def test_numerics_touch_no_file_network_clock_or_screen() -> None:
    assert touching_the_outside_world(edges_of_the_package()) == []


def _planted(folder: Path, files: dict[str, str]) -> Path:
    package = folder / "contactwrench"
    for name, text in files.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return package


UPWARDS = {
    "a lower folder imports a higher one": (
        {"samples/delay.py": "from ..report import html", "report/html.py": ""},
        "samples.delay imports report.html",
    ),
    "inside a function": (
        {"samples/delay.py": "def f():\n    from ..cli import main", "cli/main.py": ""},
        "samples.delay imports cli.main",
    ),
    "by the package's full name": (
        {"estimation/auto.py": "from contactwrench.assess.plan import plan", "assess/plan.py": ""},
        "estimation.auto imports assess.plan",
    ),
    "the root imports a folder": ({"model.py": "from .samples import poses", "samples/poses.py": ""}, None),
    "the judge sees what it judges": (
        {"simulate/rig.py": "from ..estimation import auto", "estimation/auto.py": ""},
        "simulate.rig imports estimation.auto",
    ),
    "the judge sees another file of assess": (
        {"simulate/rig.py": "from ..assess import plan", "assess/plan.py": ""},
        "simulate.rig imports assess.plan",
    ),
    "what is judged sees the judge": (
        {"assess/plan.py": "from ..simulate import rig", "simulate/rig.py": ""},
        "assess.plan imports simulate.rig",
    ),
    "what listens sees the rig that it listens to": (
        {"live/session.py": "from ..lab import rig", "lab/rig.py": ""},
        "live.session imports lab.rig",
    ),
    "the rig sees what listens to it": (
        {"lab/rig.py": "from ..live import session", "live/session.py": ""},
        "lab.rig imports live.session",
    ),
    "by its name as text": (
        {
            "samples/delay.py": 'from importlib import import_module\nimport_module("contactwrench.report.html")',
            "report/html.py": "",
        },
        "samples.delay imports report.html",
    ),
    "by its name as text, from where it is": (
        {
            "samples/delay.py": 'import importlib\nimportlib.import_module("..report.html", __package__)',
            "report/html.py": "",
        },
        "samples.delay imports report.html",
    ),
    "where types are not checked": (
        {"samples/delay.py": "if not TYPE_CHECKING:\n    from ..report import html", "report/html.py": ""},
        "samples.delay imports report.html",
    ),
    "or else": (
        {
            "samples/delay.py": "if typing.TYPE_CHECKING:\n    pass\nelse:\n    from ..report import html",
            "report/html.py": "",
        },
        "samples.delay imports report.html",
    ),
    "a part imports the whole": ({"samples/delay.py": "from .. import Samples", "__init__.py": ""}, None),
}


@pytest.mark.parametrize("planted", UPWARDS.values(), ids=UPWARDS)
def test_an_import_upwards_is_seen(planted: tuple[dict[str, str], str | None], tmp_path: Path) -> None:
    files, said = planted
    upwards = against_the_order(imports(_planted(tmp_path, files)))
    assert upwards == [said] if said is not None else len(upwards) == 1


def test_imports_for_types_and_downwards_are_no_violation(tmp_path: Path) -> None:
    files = {
        "samples/delay.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..report import html",
        "report/html.py": "from ..samples import delay\nfrom ..errors import InputError",
        "errors.py": "",
        "simulate/rig.py": "from ..assess import robot_arms\nfrom ..geometry import wrench\nfrom .. import errors",
        "assess/robot_arms.py": "",
        "geometry/wrench.py": "",
        "cli/simulate.py": "from ..simulate import rig",
    }
    edges = imports(_planted(tmp_path, files))
    assert against_the_order(edges) == []
    assert touching_the_outside_world(edges) == []
    assert circles(edges) == []


@pytest.mark.parametrize("lazy", [False, True])
def test_a_circle_is_seen(lazy: bool, tmp_path: Path) -> None:
    back = "def f():\n    from . import one" if lazy else "from . import one"
    files = {"report/one.py": "from . import two", "report/two.py": "from . import three", "report/three.py": back}
    assert circles(imports(_planted(tmp_path, files))) == ["report.one -> report.two -> report.three -> report.one"]


def test_a_circle_of_folders_is_seen(tmp_path: Path) -> None:
    files = {
        "geometry/a.py": "from ..samples import b",
        "geometry/c.py": "",
        "samples/b.py": "from ..geometry import c",
    }
    assert circles(imports(_planted(tmp_path, files))) == ["geometry -> samples -> geometry"]


TOUCHING = {
    "import socket": "socket",
    "def f():\n    from pathlib import Path": "pathlib",
    "def f(path):\n    with open(path) as file:\n        return file.read()": "open",
    "print(1)": "print",
    "from datetime import datetime": "datetime",
    "import threading": "threading",
    "import random": "random",
    'import importlib\nimportlib.import_module("socket")': "socket",
    '__import__("os.path")': "os.path",
}


@pytest.mark.parametrize(("statement", "touched"), TOUCHING.items())
def test_touching_the_outside_world_is_seen(statement: str, touched: str, tmp_path: Path) -> None:
    edges = imports(_planted(tmp_path, {"estimation/auto.py": statement, "recording/read.py": statement}))
    assert touching_the_outside_world(edges) == [f"estimation.auto touches {touched}"]


def test_nothing_of_the_package_sees_the_reproduction() -> None:
    assert [
        edge
        for edge in edges_of_the_package()
        if edge.target.partition(".")[0] in {"reproduction", "tests", "benchmarks"}
    ] == []


def test_the_rig_does_not_know_what_it_judges() -> None:
    """Also through others; the package's root is left out: it imports the estimators for the user."""
    graph: dict[str, set[str]] = {}
    for edge in edges_of_the_package():
        if edge.ours and edge.target:
            graph.setdefault(edge.module, set()).add(edge.target)
    reached = {module for module in graph if module.partition(".")[0] == JUDGE}
    waiting = list(reached)
    while waiting:
        new = graph.get(waiting.pop(), set()) - reached
        reached |= new
        waiting += new
    assert {"simulate.rig", "geometry.rotations"} <= reached
    judged = {"model", "subtract", "calibration", "estimation", "compensate"}
    assert {module for module in reached if module.partition(".")[0] in judged} == set()


@pytest.mark.slow
def test_no_global_random_state_and_no_assert_in_the_package() -> None:
    for _, path in modules(PACKAGE):
        text = path.read_text(encoding="utf-8")
        said = "assert" in text  # few say it, and in words; those are looked at closely
        assert not said or not [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Assert)], path
        assert "np.random.seed" not in text, path


def test_public_names_are_the_contract() -> None:
    assert sorted(cw.__all__) == sorted(
        [
            "Calibration",
            "Compensator",
            "ContactWrench",
            "ContactWrenchError",
            "Samples",
            "__version__",
            "calibrate",
            "live",
            "read",
        ]
    )
    assert all(hasattr(cw, name) for name in cw.__all__)


def test_there_is_one_version() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == cw.__version__


def _loaded_by(code: str) -> set[str]:
    script = f"import sys\n{code}\nprint(' '.join({{name.partition('.')[0] for name in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_import_loads_only_what_is_needed() -> None:
    heavy = {"scipy", "numba", "matplotlib", "typer", "rich", "msgspec", "pandas"}
    assert _loaded_by("import contactwrench").isdisjoint({*heavy, "numpy"})
    loaded = _loaded_by("from contactwrench import *")
    assert "numpy" in loaded
    assert loaded.isdisjoint(heavy)


def test_a_name_that_is_not_there_is_said() -> None:
    with pytest.raises(AttributeError, match=r"^module 'contactwrench' has no attribute 'kalibrate'$"):
        cw.kalibrate  # noqa: B018
    assert set(dir(cw)) == set(cw.__all__)


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
def test_a_single_sample_is_compensated_without_compiling_anything() -> None:
    loaded = _loaded_by(
        "import numpy as np\n"
        "from contactwrench.model import stepper\n"
        "from contactwrench.subtract import compensate\n"
        "B, d = np.ones((6, 4)), np.array([0.0, 0.0, -1.0])\n"
        "compensate(B, d, np.ones(6), np.array([0.0, 0.6, 0.0, 0.8]))\n"
        "stepper(B, d)(*np.ones(6), 0.0, 0.6, 0.0, 0.8)"
    )
    assert loaded.isdisjoint({"scipy", "numba"})
