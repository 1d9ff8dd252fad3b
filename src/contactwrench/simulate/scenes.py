"""What the arm works with: a ball-ended probe and a plate on a spring, a peg and a block with a hole.

MuJoCo knows no concave shapes, so the hole is made of flat pieces that only their own part of the peg can touch: round
the peg's rim sit `SIDES` small balls, each against one flat of the hole's wall, of its chamfer and of the block's face;
and round the edge where the hole begins sit as many, against the peg's side. The flats touch a circle of the hole's
radius from outside. So the peg can tilt until it touches at two points, and jam, as a round peg does.
"""

from __future__ import annotations

import numpy as np

from ..orientation import Array
from .arm import numbers
from .rig import Rig
from .settings import Tool

TOOL = Tool(mass=0.4, com=(-0.006, 0.006, 0.04))
"""Probe and gripper with peg alike: twice the paper's, lighter than most grippers because the paper's sensor has no room
for more: its zero takes 0.963 of the 1 N m of one axis."""
TIP = np.array([0.0, 0.0, 0.1])
"""The ball's centre, and the middle of the peg's end; m, sensor axes."""

BALL_RADIUS = 0.01
PLATE_STIFFNESS = 20_000.0
"""N/m: of the spring under the plate. Steel on a rigid table would be harder, rubber softer."""
PLATE_MASS = 0.2

PEG_RADIUS = 0.01
CLEARANCE = 0.0005
"""m, on the diameter."""
HOLE_RADIUS = PEG_RADIUS + CLEARANCE / 2.0
CHAMFER = 0.003
"""m wide and deep, at 45 deg."""
HOLE_DEPTH = 0.03
SIDES = 12
RIM = 0.001
"""Radius of the peg's rounded rim and of the hole's edge, m."""

BLUE, STEEL, DARK, RED = "0.16 0.35 0.55 1", "0.72 0.74 0.77 1", "0.3 0.32 0.35 1", "0.8 0.22 0.16 1"
GREEN, BRIGHT = "0.42 0.6 0.5 1", "0.8 0.82 0.85 1"
UNSEEN = 'rgba="0 0 0 0" group="4"'
HARD = 'solref="0.004 1" solimp="0.95 0.99 0.0005"'

PROBE = (
    f'<geom type="cylinder" fromto="0 0 0 0 0 0.02" size="0.036" rgba="{BLUE}"/>'
    f'<geom type="cylinder" fromto="0 0 0.02 0 0 0.05" size="0.016" rgba="{STEEL}"/>'
    f'<geom type="capsule" fromto="0 0 0.05 0 0 0.095" size="0.006" rgba="{STEEL}"/>'
    f'<geom name="ball" type="sphere" size="{BALL_RADIUS}" pos="{numbers(TIP)}" rgba="{RED}"/>'
)

PLATE = (
    '<worldbody><body name="work" mocap="true">'
    f'<geom type="cylinder" fromto="0 0 -0.045 0 0 -0.012" size="0.03" rgba="{DARK}"/>'
    f'<geom type="box" size="0.1 0.1 0.006" pos="0 0 -0.051" rgba="{DARK}"/></body>'
    '<body name="plate" gravcomp="1">'
    "</body></worldbody>"
)


def tip_in_flange(rig: Rig) -> Array:
    """The tip (3,), m, in flange axes."""
    tip: Array = rig.settings.R_flange_sensor @ TIP + [0.0, 0.0, rig.settings.mounting.height]
    return tip
