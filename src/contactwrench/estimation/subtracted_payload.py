"""A tool that weighs next to nothing: most often a controller has taken its payload off the readings already."""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array
from ..model import RigidTool, gravity_in_flange

LIGHTEST_TOOL = 0.5
"""N: few tools weigh less, and what a controller leaves of one whose payload it subtracts mostly does."""

WIDE_TILT = 0.1
"""Standard deviation of gravity's direction, seen from the flange, along the second of its main axes: poses tilted by
some 10 deg to all sides show the weight of a tool.
"""

LIKELIEST_CAUSE = (
    "likeliest the controller or driver subtracts the payload, or zeroes at each pose: record the sensor's raw signal "
    "(of a UR ft_raw_wrench, not an external force)"
)


def weighs_next_to_nothing(tool: RigidTool, R_base_flange: Array) -> bool:
    """Whether poses (n, 3, 3) that tilt the tool widely show next to no weight."""
    return abs(tool.weight) < LIGHTEST_TOOL and tilts_widely(R_base_flange, tool.gravity_direction)


def tilts_widely(R_base_flange: Array, gravity_direction: Array) -> bool:
    """Whether orientations (n, 3, 3) tilt a tool to all sides."""
    r = gravity_in_flange(R_base_flange, gravity_direction)
    spread = np.linalg.svd(r - r.mean(axis=0), compute_uv=False) / np.sqrt(len(r))
    return len(spread) > 1 and bool(spread[1] > WIDE_TILT)
