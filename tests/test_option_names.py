"""Messages name options of the command line: docs/python.md says what each is from Python."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from inspect import signature
from pathlib import Path
from typing import Any

import contactwrench as cw

PACKAGE = Path(cw.__file__).parent
ROWS = re.findall(r"^\| (`--.*?) \| (.*) \|$", (Path(__file__).parents[1] / "docs/python.md").read_text("utf-8"), re.M)
OPTION = re.compile(r"(?<![\w-])--([a-z][a-z0-9-]*[a-z0-9])")
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "`cw.read`;": cw.read,
    "`cw.calibrate`;": cw.calibrate,
    "`cw.Compensator`;": cw.Compensator,
}


def _in_messages() -> set[str]:
    """Options in the texts of the package, docstrings and the command line's own apart."""
    found: set[str] = set()
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] in ("cli", "lab"):
            continue
        tree = ast.parse(path.read_text("utf-8"))
        docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        texts = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in docs)
        found.update(name for text in texts if isinstance(text.value, str) for name in OPTION.findall(text.value))
    return found


def test_every_option_of_a_message_is_in_the_table() -> None:
    of_table = {name for row in ROWS for name in OPTION.findall(" ".join(row))}
    assert "sign" in (named := _in_messages())
    assert sorted(named - of_table) == []


def test_options_of_the_table_are_arguments_of_the_same_name() -> None:
    checked = 0
    for options, where in ROWS:
        if function := FUNCTIONS.get(where.partition(" --")[0].split(" ")[0]):
            arguments = {name.replace("-", "_") for name in OPTION.findall(options)}
            assert sorted(arguments - set(signature(function).parameters)) == []
            checked += 1
    assert checked == len(FUNCTIONS)
