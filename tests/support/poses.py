"""The orientations of the benchmarks: the paper's six, six that spread gravity over all axes, and random ones."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

import contactwrench as cw
from tests.support.world import Array, random_rotations

SIX_SPREAD = np.array(
    [
        [[0.0, 0.940874546033, 0.338755204576], [0.0, 0.338755204576, -0.940874546033], [-1.0, 0.0, 0.0]],
        [[0.0, 0.934461473371, -0.356064256541], [0.0, 0.356064256541, 0.934461473371], [1.0, 0.0, 0.0]],
        [[-0.99536737763, 0.0, 0.096144597096], [-0.096144597096, 0.0, -0.99536737763], [0.0, -1.0, 0.0]],
        [[-0.223054410501, 0.0, 0.974805996061], [0.974805996061, 0.0, 0.223054410501], [0.0, 1.0, 0.0]],
        [[-0.943135359385, -0.332408925688, 0.0], [-0.332408925688, 0.943135359385, 0.0], [0.0, 0.0, -1.0]],
        [[-0.743294258083, -0.66896460736, 0.0], [0.66896460736, -0.743294258083, 0.0], [0.0, 0.0, 1.0]],
    ]
)
"""R_base_flange, (6, 3, 3): with gravity along +x, -x, +y, -y, +z and -z of the flange, turned about the vertical at
random. They are what six poses can do at best.
"""


def paper_six() -> Array:
    """R_base_flange, (6, 3, 3), of the paper's Table III, all within 27 deg of tool-down."""
    return cw.read(str(files("contactwrench") / "data" / "paper_six_poses.csv")).R_base_flange


def random_24() -> Array:
    """24 random orientations, always the same."""
    return random_rotations(24, np.random.default_rng(24))


POSE_SETS = {"6 spread": SIX_SPREAD, "24 random": random_24(), "paper's 6": paper_six()}
