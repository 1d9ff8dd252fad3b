"""What the arm works with: a ball-ended probe and a plate on a spring, a peg and a block with a hole.

MuJoCo knows no concave shapes, so the hole is made of flat pieces that only their own part of the peg can touch: round
the peg's rim sit `SIDES` small balls, each against one flat of the hole's wall, of its chamfer and of the block's face;
and round the edge where the hole begins sit as many, against the peg's side. The flats touch a circle of the hole's
radius from outside. So the peg can tilt until it touches at two points, and jam, as a round peg does.
"""

from __future__ import annotations

import numpy as np

from contactwrench.geometry.arrays import Array
from contactwrench.simulate.arm import numbers
from contactwrench.simulate.rig import Rig
from contactwrench.simulate.settings import Tool

TOOL = Tool(mass=0.4, com=(-0.006, 0.006, 0.04))
"""Probe and gripper with peg alike: twice as heavy as the paper's, and lighter than most grippers, because the paper's
sensor has no room for more: its zero takes 0.963 of the 1 N m of one axis."""
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
CHAMFER = 0.002
"""m wide and deep, at 45 deg: as wide as the largest offset that the peg is tried with, so that no search is needed."""
HOLE_DEPTH = 0.03
FIXTURE_STIFFNESS, FIXTURE_TURNING = 20_000.0, 100.0
"""N/m and N m/rad: a vice on rubber feet, and the rubber of the gripper."""
BLOCK_MASS = 0.5
SIDES = 12
RIM = 0.001
"""Radius of the peg's rounded rim and of the hole's edge, m."""

BLUE, STEEL, DARK, RED = "0.16 0.35 0.55 1", "0.72 0.74 0.77 1", "0.3 0.32 0.35 1", "0.8 0.22 0.16 1"
BRIGHT, GLASS = "0.8 0.82 0.85 1", "0.55 0.68 0.78 0.45"
UNSEEN = 'rgba="0 0 0 0" group="4"'
SLIDING = "0.15 0.15 0.005 0.0001 0.0001"
"""Coulomb friction of greased steel."""
HARD = 'solref="0.004 1" solimp="0.95 0.99 0.0005"'

PROBE = (
    f'<geom type="cylinder" fromto="0 0 0 0 0 0.02" size="0.036" rgba="{BLUE}"/>'
    f'<geom type="cylinder" fromto="0 0 0.02 0 0 0.05" size="0.016" rgba="{STEEL}"/>'
    f'<geom type="capsule" fromto="0 0 0.05 0 0 0.095" size="0.006" rgba="{STEEL}"/>'
    f'<geom name="ball" type="sphere" size="{BALL_RADIUS}" pos="{numbers(TIP)}" rgba="{RED}"/>'
)

PLATE = (
    '<worldbody><body name="work" mocap="true">'
    f'<geom type="cylinder" fromto="0 0 -0.05 0 0 -0.012" size="0.03" rgba="{DARK}"/>'
    f'<geom type="box" size="0.1 0.1 0.006" pos="0 0 -0.056" rgba="{DARK}"/>'
    '<body name="plate" gravcomp="1">'
    f'<joint name="spring" type="slide" axis="0 0 1" stiffness="{PLATE_STIFFNESS}" '
    f'damping="{2.0 * np.sqrt(PLATE_STIFFNESS * PLATE_MASS):.6g}"/>'
    f'<inertial pos="0 0 0" mass="{PLATE_MASS}" diaginertia="0.001 0.001 0.001"/>'
    f'<geom name="plate" type="box" size="0.1 0.1 0.006" pos="0 0 -0.006" rgba="{BRIGHT}"/>'
    f'</body></body></worldbody><contact><pair geom1="plate" geom2="ball" friction="{SLIDING}" {HARD}/>'
    "</contact>"
)
"""The plate's face is at z = 0 of the work's axes, z out of it; it sinks along z on a critically damped spring."""


THICK, WIDE = 0.004, 0.006
"""Half the depth and width of a flat, m: no part of the peg comes out behind."""


def peg_tool() -> str:
    """A gripper that holds the peg, its end at `TIP`."""
    end = float(TIP[2])
    side = f'fromto="0 0 {end - 0.05} 0 0 {end - RIM}" size="{PEG_RADIUS}"'
    rounded = f'fromto="0 0 {end - RIM} 0 0 {end}" size="{PEG_RADIUS - RIM}"'
    fingers = "".join(
        f'<geom type="box" pos="0 {turn * 0.017} 0.055" size="0.009 0.006 0.015" rgba="{DARK}"/>' for turn in (1, -1)
    )
    rim = "".join(
        f'<geom name="rim{k}" type="sphere" size="{RIM}" rgba="{RED}" '
        f'pos="{numbers(_around(-angle, PEG_RADIUS - RIM, end - RIM))}"/>'
        for k, angle in enumerate(_angles())
    )
    return (
        f'<geom type="cylinder" fromto="0 0 0 0 0 0.02" size="0.036" rgba="{BLUE}"/>'
        f'<geom type="box" pos="0 0 0.031" size="0.02 0.03 0.011" rgba="{DARK}"/>{fingers}'
        f'<geom name="peg" type="cylinder" {side} rgba="{RED}"/><geom type="cylinder" {rounded} rgba="{RED}"/>{rim}'
    )


def hole() -> str:
    """A block with a chamfered hole: its face is at z = 0 of the work's axes, z out of the hole."""
    middle = CHAMFER / 2.0
    flats, pairs = [], []
    for k, angle in enumerate(_angles()):
        upright = (HOLE_DEPTH - CHAMFER) / 2.0
        flats += [
            _flat(f"wall{k}", angle, 0.0, (HOLE_RADIUS, -CHAMFER - upright), upright),
            _flat(f"chamfer{k}", angle, np.pi / 4.0, (HOLE_RADIUS + middle, -middle), np.sqrt(2.0) * middle),
            _flat(f"face{k}", angle, np.pi / 2.0, (HOLE_RADIUS + CHAMFER + 0.01, 0.0), 0.01),
            f'<geom name="edge{k}" type="sphere" size="{RIM}" {UNSEEN} '
            f'pos="{numbers(_around(angle, HOLE_RADIUS + RIM, -CHAMFER - RIM * np.tan(np.pi / 8.0)))}"/>',
        ]
        touching = [(f"{piece}{k}", f"rim{k}") for piece in ("wall", "chamfer", "face")] + [(f"edge{k}", "peg")]
        pairs += [f'<pair geom1="{a}" geom2="{b}" friction="{SLIDING}" {HARD}/>' for a, b in touching]
    return (
        f'<asset>{_block_mesh()}</asset><worldbody><body name="work" mocap="true"><body name="block" gravcomp="1">'
        f"{_fixture()}"
        f'<geom type="mesh" mesh="block" rgba="{GLASS}"/>{"".join(flats)}</body></body></worldbody>'
        f"<contact>{''.join(pairs)}</contact>"
    )


def _fixture() -> str:
    """Springs that hold the block, and its gripper's rubber with it: critically damped, along and about three axes."""
    inertia = BLOCK_MASS * 0.03**2
    slides = "".join(
        f'<joint type="slide" axis="{axis}" stiffness="{FIXTURE_STIFFNESS}" '
        f'damping="{2.0 * np.sqrt(FIXTURE_STIFFNESS * BLOCK_MASS):.6g}"/>'
        for axis in ("1 0 0", "0 1 0", "0 0 1")
    )
    return (
        f'{slides}<joint type="ball" stiffness="{FIXTURE_TURNING}" '
        f'damping="{2.0 * np.sqrt(FIXTURE_TURNING * inertia):.6g}"/>'
        f'<inertial pos="0 0 0" mass="{BLOCK_MASS}" diaginertia="{numbers((inertia,) * 3)}"/>'
    )


def _angles() -> Array:
    return np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)


def _around(angle: float, radius: float, height: float) -> tuple[float, float, float]:
    return float(radius * np.cos(angle)), float(radius * np.sin(angle)), float(height)


def _flat(name: str, angle: float, lean: float, middle: tuple[float, float], half_height: float) -> str:
    """A box whose face has its middle at (from the axis, above the block's face), at an angle about the axis, and leans
    from upright (0) to facing out of the hole (a right angle).
    """
    into = np.array([np.cos(lean) * np.cos(angle), np.cos(lean) * np.sin(angle), -np.sin(lean)])
    across = np.array([-np.sin(angle), np.cos(angle), 0.0])
    place = np.array(_around(angle, *middle)) + THICK * into
    return (
        f'<geom name="{name}" type="box" size="{numbers((THICK, WIDE, half_height))}" pos="{numbers(place)}" '
        f'xyaxes="{numbers(into)} {numbers(across)}" {UNSEEN}/>'
    )


def _block_mesh() -> str:
    """What is seen of the block: its outline turned about the hole's axis."""
    outside, bottom, segments = 0.04, -HOLE_DEPTH - 0.01, 48
    outline = np.array(
        [
            (1e-4, bottom),
            (outside, bottom),
            (outside, -0.001),
            (outside - 0.001, 0.0),
            (HOLE_RADIUS + CHAMFER, 0.0),
            (HOLE_RADIUS, -CHAMFER),
            (HOLE_RADIUS, -HOLE_DEPTH),
            (1e-4, -HOLE_DEPTH),
        ]
    )
    turn = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    vertices = np.concatenate([[_around(angle, r, z) for r, z in outline] for angle in turn])
    count = len(outline)
    faces = []
    for here in range(segments):
        a, b = here * count, (here + 1) % segments * count
        for k in range(count - 1):
            faces += [(a + k, b + k, b + k + 1), (a + k, b + k + 1, a + k + 1)]
    return (
        f'<mesh name="block" inertia="shell" vertex="{" ".join(f"{value:.6g}" for value in vertices.ravel())}" '
        f'face="{" ".join(str(corner) for face in faces for corner in face)}"/>'
    )


def tip_in_flange(rig: Rig) -> Array:
    """The tip (3,), m, in flange axes."""
    tip: Array = rig.settings.R_flange_sensor @ TIP + [0.0, 0.0, rig.settings.mounting.height]
    return tip
