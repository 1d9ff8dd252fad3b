"""A calibration as a few lines of code for a loop of one's own: B, the direction of gravity, and one product."""

from __future__ import annotations

from collections.abc import Sequence

from ...calibration.calibration import Calibration
from ...model import wrench_matrix
from .target import Parameters, Setup, Target, WithHeader, commented
from .tool import numbers, rigid_tool

C = """\
#pragma once

/* Of a free tool: B [r, 1], N and N m, with r = R_base_flange^T d. */
static const double contactwrench_B[6][4] = {{
{rows}
}};

/* Direction of gravity, a unit vector in base axes. */
static const double contactwrench_d[3] = {{{d}}};

/* wrench: fx fy fz tx ty tz; R: R_base_flange, row by row; contact may be wrench itself. */
static inline void contactwrench_of_matrix(const double wrench[6], const double R[9], double contact[6])
{{
    double r[3];
    int i, j;
    for (j = 0; j < 3; ++j)
        r[j] = R[j] * contactwrench_d[0] + R[3 + j] * contactwrench_d[1] + R[6 + j] * contactwrench_d[2];
    for (i = 0; i < 6; ++i) {{
        const double *row = contactwrench_B[i];
        contact[i] = wrench[i] - (row[0] * r[0] + row[1] * r[1] + row[2] * r[2] + row[3]);
    }}
}}

/* The same with R_base_flange as a quaternion x, y, z, w of any length but 0. */
static inline void contactwrench_of_quaternion(const double wrench[6], const double q[4], double contact[6])
{{
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    const double s = 2.0 / (x * x + y * y + z * z + w * w);
    const double R[9] = {{
        1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
        s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w),
        s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y),
    }};
    contactwrench_of_matrix(wrench, R, contact);
}}
"""

PYTHON = """\
import numpy as np

B = np.array([
{rows}
])
d = np.array([{d}])


def contact_wrench(wrench, R_base_flange):
    # wrench (6,) or (n, 6): fx fy fz tx ty tz; R_base_flange (3, 3) or (n, 3, 3)
    return wrench - (d @ R_base_flange @ B[:, :3].T + B[:, 3])
"""

MATLAB = """\
function contact = contact_wrench(wrench, R_base_flange)
% wrench: 6 numbers fx fy fz tx ty tz; R_base_flange: 3 x 3; contact: 6 x 1
B = [
{rows}
];
d = [{d}].';
contact = wrench(:) - B * [R_base_flange.' * d; 1];
end
"""

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


def _target(name: str, program: str, template: str, row: str, between: str, with_header: WithHeader) -> Target:
    """A language: its `template`, in which B stands `row` by row with `between` between, every number in its shortest
    exact form.
    """

    def parameters(c: Calibration, setup: Setup) -> Parameters:
        B = c.B if setup.tool_mass is None else wrench_matrix(rigid_tool(c, setup, name))
        rows = between.join(row.format(numbers(line)) for line in B)
        remarks = (*REMARKS, *([INVERSE] if c.provenance.get("inverse_orientation") else []))
        return Parameters(template.format(rows=rows, d=numbers(c.gravity_direction)), remarks, B, c.gravity_direction)

    return Target(name, program, "", "", parameters, with_header)


TARGETS = (
    _target("c", "a loop of one's own in C99 or C++", C, "    {{{}}}", ",\n", in_c),
    _target("python", "a loop of one's own with numpy", PYTHON, "    [{}],", "\n", commented("#")),
    _target(
        "matlab", "a loop of one's own in MATLAB or Octave: contact_wrench.m", MATLAB, "    {}", ";\n", commented("%")
    ),
)
