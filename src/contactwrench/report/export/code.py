"""A calibration as a few lines of code for a loop of one's own: B, the direction of gravity, and one product."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from string import Template

from ...calibration.calibration import Calibration
from ...model import wrench_matrix
from .target import Parameters, Setup, Target, WithHeader, commented, numbers, rigid_tool

REMARKS = (
    "wrench: fx fy fz in N, tx ty tz in N m, sensor axes, about the sensor's origin: what tool and environment exert "
    "on the sensor; so is the contact wrench that comes out",
    "R_base_flange turns coordinates in flange axes into base axes: of the flange and base whose orientation was "
    "recorded for the calibration",
)
INVERSE = "the robot reports R_flange_base (--inverse-orientation): hand over its transpose"


def in_c(header: Sequence[str], body: str) -> str:
    """A header above the body as one comment of C, which no line of it can end."""
    lines = [line.replace("*/", "* /").replace("/*", "/ *") for line in header]
    return "/*\n" + "".join(f" * {line}".rstrip() + "\n" for line in lines) + " */\n" + body


def _target(name: str, program: str, row: str, between: str, with_header: WithHeader) -> Target:
    """A language: its template beside this file, in which B stands `row` by row with `between` between, every number in
    its shortest exact form.
    """

    def parameters(c: Calibration, setup: Setup) -> Parameters:
        B = c.B if setup.tool_mass is None else wrench_matrix(rigid_tool(c, setup, name))
        rows = between.join(row.format(numbers(line)) for line in B)
        remarks = (*REMARKS, *([INVERSE] if c.provenance.get("inverse_orientation") else []))
        template = Template((files(__package__) / f"{name}.template").read_text(encoding="utf-8"))
        body = template.substitute(rows=rows, d=numbers(c.gravity_direction))
        return Parameters(body, remarks, B, c.gravity_direction)

    return Target(name, program, "", "", parameters, with_header)


TARGETS = (
    _target("c", "a loop of one's own in C99 or C++", "    {{{}}}", ",\n", in_c),
    _target("python", "a loop of one's own with numpy", "    [{}],", "\n", commented("#")),
    _target("matlab", "a loop of one's own in MATLAB or Octave: contact_wrench.m", "    {}", ";\n", commented("%")),
)
