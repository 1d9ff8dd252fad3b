"""The KUKA LBR iiwa 7 R800: link lengths, limits and masses, and its body in MuJoCo's language.

Lengths, joint ranges, largest torques and speeds: KUKA, LBR iiwa 7 R800, LBR iiwa 14 R820, Specification. KUKA does not
publish the masses of the links: these are assumed, so that the whole arm weighs the 23.9 kg of the data sheet, and
every link is taken for a homogeneous cylinder along its length. The arm is drawn from primitive shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..assess.robot_arms import known_arm
from ..geometry.arrays import Array

BASE_TO_SHOULDER = 0.34
SHOULDER_TO_ELBOW = 0.4
ELBOW_TO_WRIST = 0.4
WRIST_TO_FLANGE = 0.126
"""m. The paper's R800 is the reach, from the shoulder to the wrist."""

BASE_MASS = 4.6
"""kg. It does not move."""

JOINT_RANGE = known_arm("iiwa7").limits[:, 1]
"""rad, to both sides."""
MAX_TORQUE = np.array([176.0, 176.0, 110.0, 110.0, 110.0, 40.0, 40.0])
"""N m."""
MAX_SPEED = known_arm("iiwa7").max_speed
"""rad/s."""


@dataclass(frozen=True, eq=False)
class Link:
    """A link and the joint before it: the joint turns about the link's z.

    `position` (3,) m and `twist_deg`, a rotation about x, place the link in the one before. The mass (kg) is a cylinder
    of `radius` and `length` (m) along the link's axis `along` (x, y or z) about `com` (3,) m.
    """

    position: tuple[float, float, float]
    twist_deg: float
    mass: float
    com: tuple[float, float, float]
    radius: float
    length: float
    along: str

    @property
    def inertia(self) -> Array:
        """The diagonal (3,) of the inertia about the centre of mass, kg m^2, link axes."""
        across = self.mass * (3.0 * self.radius**2 + self.length**2) / 12.0
        diagonal = np.full(3, across)
        diagonal["xyz".index(self.along)] = 0.5 * self.mass * self.radius**2
        return diagonal


LINKS = (
    Link((0.0, 0.0, 0.15), 0.0, 3.5, (0.0, -0.03, 0.12), 0.065, 0.24, "z"),
    Link((0.0, 0.0, BASE_TO_SHOULDER - 0.15), -90.0, 3.6, (0.0, -0.06, 0.03), 0.065, 0.24, "y"),
    Link((0.0, -0.2, 0.0), 90.0, 3.4, (0.0, 0.03, 0.12), 0.06, 0.24, "z"),
    Link((0.0, 0.0, SHOULDER_TO_ELBOW - 0.2), 90.0, 3.3, (0.0, 0.06, 0.03), 0.06, 0.24, "y"),
    Link((0.0, 0.2, 0.0), -90.0, 2.0, (0.0, 0.02, 0.1), 0.055, 0.22, "z"),
    Link((0.0, 0.0, ELBOW_TO_WRIST - 0.2), -90.0, 2.8, (0.0, 0.0, 0.0), 0.055, 0.16, "z"),
    Link((0.0, -0.081, 0.0), 90.0, 0.7, (0.0, 0.0, 0.02), 0.04, 0.06, "z"),
)
FLANGE_HEIGHT = WRIST_TO_FLANGE - 0.081
"""Of the flange over the last link's origin, m."""

WHITE, ORANGE, GREY = "0.86 0.87 0.88 1", "0.93 0.45 0.13 1", "0.32 0.34 0.37 1"


def arm_xml(at_flange: str) -> str:
    """The base and the links as nested MuJoCo bodies, with `at_flange` (more XML) inside the last one.

    A site `flange` has the maker's flange axes, z out of the flange.
    """
    inside = f'<site name="flange" pos="0 0 {FLANGE_HEIGHT!r}" size="0.004" rgba="0 0 0 0"/>{at_flange}'
    for number in range(len(LINKS), 0, -1):
        inside = _link_xml(number, LINKS[number - 1], inside)
    inertia = numbers((BASE_MASS * 0.08**2,) * 3)
    return (
        f'<inertial pos="0 0 0.07" mass="{BASE_MASS!r}" diaginertia="{inertia}"/>'
        f'<geom type="cylinder" fromto="0 0 0 0 0 0.02" size="0.11" rgba="{GREY}"/>'
        f'<geom type="cylinder" fromto="0 0 0.02 0 0 0.15" size="0.078" rgba="{WHITE}"/>{inside}'
    )


def _link_xml(number: int, link: Link, inside: str) -> str:
    half = np.deg2rad(link.twist_deg) / 2.0
    twist = (np.cos(half), np.sin(half), 0.0, 0.0)
    reach = JOINT_RANGE[number - 1]
    return (
        f'<body name="link{number}" pos="{numbers(link.position)}" quat="{numbers(twist)}">'
        f'<joint name="q{number}" axis="0 0 1" range="{numbers((-reach, reach))}"/>'
        f'<inertial pos="{numbers(link.com)}" mass="{link.mass!r}" diaginertia="{numbers(link.inertia)}"/>'
        f"{_shape(number)}{inside}</body>"
    )


def _shape(number: int) -> str:
    """What a link looks like: odd links are the tubes between the joints, even ones the housings of elbow and wrist."""
    if number == 7:
        return (
            f'<geom type="cylinder" fromto="0 0 0 0 0 {FLANGE_HEIGHT - 0.008!r}" size="0.046" rgba="{WHITE}"/>'
            f'<geom type="cylinder" fromto="0 0 {FLANGE_HEIGHT - 0.008!r} 0 0 {FLANGE_HEIGHT!r}" size="0.04" '
            f'rgba="{GREY}"/>'
        )
    radius = 0.075 if number < 3 else 0.068 if number < 5 else 0.06
    if number % 2:
        height = LINKS[number].position[2]
        return (
            f'<geom type="cylinder" fromto="0 0 0 0 0 0.012" size="{radius + 0.003!r}" rgba="{ORANGE}"/>'
            f'<geom type="capsule" fromto="0 0 0.012 0 0 {height!r}" size="{radius!r}" rgba="{WHITE}"/>'
        )
    across = f'<geom type="cylinder" fromto="0 0 {-radius!r} 0 0 {radius!r}" size="{radius!r}" rgba="{WHITE}"/>'
    rings = "".join(
        f'<geom type="cylinder" fromto="0 0 {side * radius!r} 0 0 {side * (radius + 0.008)!r}" '
        f'size="{0.8 * radius!r}" rgba="{ORANGE}"/>'
        for side in (-1.0, 1.0)
    )
    far = LINKS[number].position
    return (
        f'{across}{rings}<geom type="capsule" fromto="0 0 0 {numbers(far)}" size="{0.95 * radius!r}" rgba="{WHITE}"/>'
    )


def numbers(values: Array | tuple[float, ...]) -> str:
    """Numbers in MuJoCo's XML, with all their digits."""
    return " ".join(repr(float(value)) for value in values)
