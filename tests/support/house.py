"""The package's imports as a graph, read from its source: what the architecture test holds against the rules."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ORDER = (
    "geometry",
    "samples",
    "calibration",
    "estimation",
    "compensate",
    "assess",
    "recording",
    "report",
    "live",
    "cli",
)
"""Folders, each of which imports itself and what stands before it; the root's files stand with geometry."""

JUDGE = "simulate"
"""Imports geometry, samples and one file of assess, as it judges the rest; the command line alone imports it."""
SEEN_BY_JUDGE = ("geometry", "samples", "assess.robot_arms")
SEES_JUDGE = ("cli", "lab")

LAB = "lab"
"""The judge as time passes, behind fake devices: imports what the judge imports and the judge, never what listens."""

FILELESS = ("geometry", "samples", "calibration", "estimation", "compensate", "assess")
OUTSIDE_WORLD = {
    *(
        "asyncio",
        "datetime",
        "fileinput",
        "glob",
        "http",
        "io",
        "logging",
        "mmap",
        "multiprocessing",
        "os",
        "pathlib",
        "requests",
    ),
    *("random", "rclpy", "rospy", "rosbags", "select", "selectors", "shutil", "socket", "sqlite3", "ssl", "subprocess"),
    *(
        "tempfile",
        "threading",
        "time",
        "typer",
        "rich",
        "urllib",
        "websockets",
        "matplotlib",
        "mcap",
        "msgspec",
        "mujoco",
    ),
    "pyarrow",
}
BUILT_IN = {"input", "open", "print"}
"""Files, network, clocks, threads, chance and user interfaces: numerics import none of them, and call none of these."""

MAY_TOUCH = {
    *(("calibration.file", name) for name in ("msgspec", "pathlib", "threading")),
    ("calibration.calibration", "pathlib"),
    ("geometry.arrays", "datetime"),
    ("compensate.compensator", "threading"),
    *(("compensate.runner", name) for name in ("print", "threading")),
}
"""A calibration saves and loads itself, under a lock that msgspec needs; times may be `datetime`, no clock is asked; a
state refuses a second thread, and to compile it says on a terminal that it takes a while.
"""


@dataclass(frozen=True)
class Import:
    """That `module` imports `target`: of this package (both without its name) or from outside."""

    module: str
    target: str
    ours: bool


def modules(package: Path) -> Iterator[tuple[str, Path]]:
    """Every module of the package, without the package's name, and its file; a folder by its own name."""
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def imports(package: Path) -> list[Import]:
    """Every import of the package's files, those inside functions too; those for types alone left out."""
    known = dict(modules(package))
    return [
        Import(module, *target)
        for module, path in known.items()
        for statement in _statements(ast.parse(path.read_text(encoding="utf-8")))
        for target in _targets(path.relative_to(package).parent.parts, statement, package.name, known)
    ]


def _statements(node: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports, those by `import_module` of a name that is written out and calls of `BUILT_IN` as such too."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test).rpartition(".")[2] == "TYPE_CHECKING":
            for other in child.orelse:
                yield from _statements(ast.Module([other], []))
            continue
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif isinstance(child, ast.Call) and (called := _called(child)):
            yield called
        yield from _statements(child)


def _called(call: ast.Call) -> ast.Import | ast.ImportFrom | None:
    name = ast.unparse(call.func).rpartition(".")[2] if isinstance(call.func, ast.Name | ast.Attribute) else ""
    if isinstance(call.func, ast.Name) and name in BUILT_IN:
        return ast.Import([ast.alias(name)])
    if name not in {"import_module", "__import__"} or not isinstance(call.args[0], ast.Constant):
        return None
    module = str(call.args[0].value)
    absolute = module.lstrip(".")
    if absolute == module:
        return ast.Import([ast.alias(module)])
    folder, _, last = absolute.rpartition(".")
    return ast.ImportFrom(folder or None, [ast.alias(last)], len(module) - len(absolute))


def _targets(
    folder: tuple[str, ...], statement: ast.Import | ast.ImportFrom, package: str, known: dict[str, Path]
) -> Iterator[tuple[str, bool]]:
    if isinstance(statement, ast.Import):
        for alias in statement.names:
            head, _, rest = alias.name.partition(".")
            yield (rest, True) if head == package else (alias.name, False)
        return
    module = statement.module or ""
    if statement.level == 0 and module.partition(".")[0] != package:
        yield module, False
        return
    above = folder[: len(folder) - statement.level + 1] if statement.level else ()
    base = ".".join((*above, *filter(None, [module if statement.level else module.partition(".")[2]])))
    for alias in statement.names:
        inner = f"{base}.{alias.name}".strip(".")
        yield inner if inner in known else base, True


def folder_of(module: str) -> str:
    """The folder at the package's root in which a module lies; of a file at the root its own name."""
    return module.partition(".")[0]


def against_the_order(edges: list[Import]) -> list[str]:
    """Imports that go the wrong way between folders, in words."""
    return [f"{edge.module} imports {edge.target}" for edge in edges if edge.ours and not _goes_down(edge)]


def _goes_down(edge: Import) -> bool:
    importing, imported = folder_of(edge.module), folder_of(edge.target)
    if importing in {"", "__main__"}:
        return True
    if imported in {"", "__main__"}:
        return False
    if importing == imported:
        return True
    if importing == LAB and imported == JUDGE:
        return True
    if importing in {JUDGE, LAB}:
        return imported not in {*ORDER, JUDGE, LAB} or any(
            edge.target == seen or edge.target.startswith(f"{seen}.") for seen in SEEN_BY_JUDGE
        )
    if imported in {JUDGE, LAB}:
        return importing in (SEES_JUDGE if imported == JUDGE else ("cli",))
    return _floor(imported) <= _floor(importing)


def _floor(folder: str) -> int:
    return ORDER.index(folder) if folder in ORDER else 0


def circles(edges: list[Import]) -> list[str]:
    """Circles of files, and of folders at the root, in words: each a way along imports that comes back."""
    ours = [(edge.module, edge.target) for edge in edges if edge.ours]
    folders = [(folder_of(module), folder_of(target)) for module, target in ours]
    return [*_circles(ours), *_circles(folders)]


def _circles(edges: list[tuple[str, str]]) -> list[str]:
    graph: dict[str, set[str]] = {}
    for module, target in edges:
        if target and module != target and not module.startswith(f"{target}."):
            graph.setdefault(module, set()).add(target)
    done: set[str] = set()
    found: list[str] = []

    def visit(module: str, way: tuple[str, ...]) -> None:
        if module in way:
            found.append(" -> ".join((*way[way.index(module) :], module)))
        elif module not in done:
            for target in sorted(graph.get(module, ())):
                visit(target, (*way, module))
            done.add(module)

    for module in sorted(graph):
        visit(module, ())
    return found


def touching_the_outside_world(edges: list[Import]) -> list[str]:
    """Numerics that touch files, network, clocks, threads, chance or user interfaces, in words."""
    return [
        f"{edge.module} touches {edge.target}"
        for edge in edges
        if not edge.ours
        and folder_of(edge.module) in FILELESS
        and edge.target.partition(".")[0] in OUTSIDE_WORLD | BUILT_IN
        and (edge.module, edge.target.partition(".")[0]) not in MAY_TOUCH
    ]
