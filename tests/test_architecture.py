"""The house stays in order: layers, lazy imports, public names, one version."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

import contactwrench as cw

PACKAGE = Path(cw.__file__).parent
REPOSITORY = Path(__file__).resolve().parents[1]

LAYER = {
    "errors": 0,
    "orientation": 0,
    "wrench": 0,
    "rotations": 0,
    "travel": 0,
    "exchange": 0,
    "alternative": 3,
    "version": 0,
    "chi_square": 0,
    "samples": 1,
    "streams": 1,
    "stillness": 2,
    "clock": 3,
    "compensator": 4,
    "poses": 2,
    "model": 2,
    "robots": 2,
    "compensate": 2,
    "compensate_fused": 2,
    "calibration": 3,
    "calibration_text": 3,
    "difference": 3,
    "difference_text": 3,
    "observability": 3,
    "calibrate": 4,
    "plan": 5,
    "diagnose": 5,
    "screening": 5,
    "ways_to_read": 5,
    "verify": 5,
    "baselines": 5,
    "contact": 5,
    "contact_noise": 5,
    "weigh": 5,
    "recording": 6,
    "calibration_file": 6,
    "files": 6,
    "demonstration": 6,
    "report": 6,
    "simulate": 6,
    "experiment": 6,
    "cli": 7,
    "__init__": 7,
    "__main__": 7,
}
"""By the first name under the package."""

SAVED_WHEN_CALLED = {("calibration", "calibration_file")}
"""`Calibration.save` and `load` import layer 6 when they are called."""

OUTSIDE_WORLD = {
    *("asyncio", "fileinput", "glob", "http", "io", "logging", "mmap", "multiprocessing", "os", "pathlib", "requests"),
    *("rclpy", "rospy", "rosbags", "select", "selectors", "shutil", "socket", "sqlite3", "ssl", "subprocess"),
    *("tempfile", "time", "typer", "rich", "urllib", "websockets", "matplotlib", "msgspec", "mujoco"),
}
"""Files, network, clocks and user interfaces: layers 0 to 5 import none of them."""

ALLOWED = {
    ("calibration", "pathlib"),  # the annotation of save and load
    ("compensate_fused", "os"),  # the number of cores
}


def _files() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py"))


def _module(path: Path) -> str:
    parts = list(path.relative_to(PACKAGE).with_suffix("").parts)
    if parts[-1] == "__init__" and len(parts) > 1:
        parts.pop()
    return ".".join(parts)


def _only_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def _imports(node: ast.AST) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Every import statement, and whether it runs when the module is imported; those for types alone left out."""

    def walk(node: ast.AST, at_import: bool) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
        for child in ast.iter_child_nodes(node):
            if _only_for_types(child):
                continue
            if isinstance(child, ast.Import | ast.ImportFrom):
                yield child, at_import
            inside = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            yield from walk(child, at_import and not inside)

    yield from walk(node, True)


def _targets(path: Path, statement: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, bool]]:
    """The modules that a statement imports, and whether each is of this package (then without its name)."""
    if isinstance(statement, ast.Import):
        for alias in statement.names:
            head, _, rest = alias.name.partition(".")
            yield (rest, True) if head == "contactwrench" else (alias.name, False)
        return
    module = statement.module or ""
    if statement.level == 0:
        head, _, rest = module.partition(".")
        if head != "contactwrench":
            yield module, False
            return
        base = rest
    else:
        package = path.relative_to(PACKAGE).parent.parts
        base = ".".join((*package[: len(package) - statement.level + 1], *filter(None, [module])))
    for alias in statement.names:
        inner = f"{base}.{alias.name}".strip(".")
        is_module = (PACKAGE / (inner.replace(".", "/") + ".py")).exists() or (
            PACKAGE / inner.replace(".", "/") / "__init__.py"
        ).exists()
        yield inner if is_module else base, True


def _layer(module: str) -> int:
    return LAYER[module.partition(".")[0] or "__init__"]


def _edges() -> list[tuple[str, str, bool]]:
    """(module, what it imports of this package, whether on import)."""
    return [
        (_module(path), target, at_import)
        for path in _files()
        for statement, at_import in _imports(ast.parse(path.read_text(encoding="utf-8")))
        for target, ours in _targets(path, statement)
        if ours
    ]


def test_every_file_has_a_layer() -> None:
    assert {_module(path).partition(".")[0] for path in _files()} <= set(LAYER)


def test_files_import_from_their_own_layer_or_lower_ones() -> None:
    upwards = [
        f"{module} imports {target}"
        for module, target, _ in _edges()
        if _layer(target) > _layer(module) and (module, target) not in SAVED_WHEN_CALLED
    ]
    assert upwards == []


def test_what_is_saved_when_called_is_not_imported_before() -> None:
    assert not [edge for edge in _edges() if edge[:2] in SAVED_WHEN_CALLED and edge[2]]


def test_there_is_no_cycle() -> None:
    graph: dict[str, set[str]] = {}
    for module, target, at_import in _edges():
        if at_import and target and module != target and not module.startswith(f"{target}."):
            graph.setdefault(module, set()).add(target)
    done: set[str] = set()

    def visit(module: str, way: tuple[str, ...]) -> None:
        assert module not in way, " -> ".join((*way, module))
        if module not in done:
            for target in sorted(graph.get(module, ())):
                visit(target, (*way, module))
            done.add(module)

    for module in sorted(graph):
        visit(module, ())


JUDGED = {"model", "calibrate", "calibration", "compensate", "plan", "observability", "alternative"}
"""What the virtual rig judges, and so never imports."""


def _reached_from(package: str) -> dict[str, str]:
    """Every module that the package's modules import, also through others and when called, by way of which one. The
    package's root is left out: it imports the estimators for the user.
    """
    imports: dict[str, set[str]] = {}
    for module, target, _ in _edges():
        if target:
            imports.setdefault(module, set()).add(target)
    reached = {module: "" for module in imports if module.partition(".")[0] == package}
    waiting = list(reached)
    while waiting:
        module = waiting.pop()
        for target in imports.get(module, set()) - reached.keys():
            reached[target] = module
            waiting.append(target)
    return reached


def test_the_rig_does_not_know_what_it_judges() -> None:
    reached = _reached_from("simulate")
    assert {"simulate.rig", "rotations"} <= reached.keys()
    assert {module: way for module, way in reached.items() if module.partition(".")[0] in JUDGED} == {}


def test_knowing_what_is_judged_would_be_seen() -> None:
    assert {"calibrate", "model", "calibration"} <= {module.partition(".")[0] for module in _reached_from("experiment")}


def test_numerics_touch_no_file_network_clock_or_screen() -> None:
    touching = [
        f"{_module(path)} imports {target}"
        for path in _files()
        if _layer(_module(path)) <= 5
        for statement, _ in _imports(ast.parse(path.read_text(encoding="utf-8")))
        for target, ours in _targets(path, statement)
        if not ours
        and target.partition(".")[0] in OUTSIDE_WORLD
        and (_module(path), target.partition(".")[0]) not in ALLOWED
    ]
    assert touching == []


@pytest.mark.parametrize("path", _files(), ids=_module)
def test_a_file_is_read_in_one_sitting(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


def test_no_global_random_state_and_no_assert_in_the_package() -> None:
    for path in _files():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert not [node for node in ast.walk(tree) if isinstance(node, ast.Assert)], path
        text = path.read_text(encoding="utf-8")
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
    loaded = _loaded_by("import contactwrench")
    assert "numpy" in loaded
    assert loaded.isdisjoint({"scipy", "numba", "matplotlib", "typer", "rich", "msgspec", "pandas"})


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
def test_a_single_sample_is_compensated_without_compiling_anything() -> None:
    loaded = _loaded_by(
        "import numpy as np\n"
        "from contactwrench.compensate import compensate, stepper\n"
        "B, d = np.ones((6, 4)), np.array([0.0, 0.0, -1.0])\n"
        "compensate(B, d, np.ones(6), np.array([0.0, 0.6, 0.0, 0.8]))\n"
        "stepper(B, d)(*np.ones(6), 0.0, 0.6, 0.0, 0.8)"
    )
    assert loaded.isdisjoint({"scipy", "numba"})
