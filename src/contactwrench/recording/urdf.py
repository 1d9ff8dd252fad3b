"""A robot arm from a URDF file: the joints from its root to its flange. Format: http://wiki.ros.org/urdf/XML/joint."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..assess.robot_arms import Arm, known_arm
from ..errors import FileFormatError, some_of
from ..files import name_of, read_bytes
from ..geometry.arrays import Array

FLANGES = ("tool0", "flange")
"""Links that ROS-Industrial and REP 199 call the flange, the preferred one first: tool0 has the controller's axes."""

REVOLUTE = ("revolute", "continuous")
WITHOUT_LIMIT = (-2.0 * np.pi, 2.0 * np.pi)

URDF = re.compile(r"(?P<file>.+\.urdf)(?::(?P<flange>.+))?", re.IGNORECASE | re.DOTALL)


MOST_JOINTS, FARTHEST = 2_000, 1e6
"""A humanoid with its hands has some 100; m or rad, and no axis is written shorter than the inverse."""


@dataclass(frozen=True, eq=False)
class _Joint:
    """A joint as the file writes it."""

    name: str
    kind: str
    parent: str
    child: str
    R_parent_joint: Array
    origin: Array
    axis: Array
    limits: tuple[float, float]
    max_speed: float


def arm_of(robot: str) -> Arm:
    """The arm that `NAME|URDF[:LINK]` names. Raises `InputError` for an unknown name, and as `read_urdf`."""
    urdf = URDF.fullmatch(robot)
    return known_arm(robot) if urdf is None else read_urdf(urdf["file"], urdf["flange"])


def read_urdf(path: str | Path, flange: str | None = None) -> Arm:
    """The arm from the root link of a URDF to the link `flange`; None: tool0 or flange, or the only end of the chain.

    Its base is the root link, its home the middle of each joint's range. Raises `FileAccessError`, and
    `FileFormatError` for what is no URDF, a link that is not there or not the only candidate, and joints that slide.
    """
    to_child = {joint.child: joint for joint in _joints(path)}
    tip = _flange(path, to_child) if flange is None else flange
    if tip not in to_child:
        raise FileFormatError(
            f"{path}: found no joint that carries a link {tip!r}, expected one of {some_of(to_child)}"
        )
    chain = _chain(path, tip, to_child)
    revolute: list[_Joint] = []
    R_before, offsets, R, offset = [], [], np.eye(3), np.zeros(3)
    for joint in chain:
        offset = offset + R @ joint.origin
        R = R @ joint.R_parent_joint
        if joint.kind == "fixed":
            continue
        if joint.kind not in REVOLUTE:
            raise FileFormatError(
                f"{path}: joint {joint.name} is {joint.kind}, expected revolute joints from root to {tip}: "
                "name the arm's flange, as in arm.urdf:LINK"
            )
        revolute.append(joint)
        R_before.append(R)
        offsets.append(offset)
        R, offset = np.eye(3), np.zeros(3)
    if not revolute:
        raise FileFormatError(f"{path}: found no revolute joint from root to {tip}, expected a robot arm")
    limits = np.array([joint.limits for joint in revolute])
    return Arm(
        name=f"{name_of(Path(path).name)}:{tip}",
        R_before=np.array(R_before),
        offset=np.array([*offsets, offset]),
        axis=np.array([joint.axis for joint in revolute]),
        R_last_flange=R,
        limits=limits,
        home=limits.mean(axis=1),
        max_speed=np.array([joint.max_speed for joint in revolute]),
        max_acceleration=np.full(len(revolute), np.nan),
        source=name_of(path),
        joint_names=tuple(joint.name for joint in revolute),
        base_frame=chain[0].parent,
    )


def _joints(path: str | Path) -> list[_Joint]:
    content = read_bytes(path)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter two: of the encoding it states
        raise FileFormatError(f"{path}: found no XML ({error}), expected a URDF") from None
    if root.tag != "robot":
        raise FileFormatError(f"{path}: found <{root.tag}>, expected <robot>: a URDF")
    # Only the robot's own: a <transmission> names joints too.
    elements = root.findall("joint")
    if len(elements) > MOST_JOINTS:
        raise FileFormatError(f"{path}: found {len(elements)} joints, expected at most {MOST_JOINTS}: leave some out")
    joints = [_joint(path, element) for element in elements]
    if not joints:
        raise FileFormatError(f"{path}: found no joint, expected a URDF (of a xacro file, run xacro on it first)")
    for what, names in (("joints named", [j.name for j in joints]), ("joints that carry", [j.child for j in joints])):
        name, count = Counter(names).most_common(1)[0]
        if count > 1:
            raise FileFormatError(f"{path}: found {count} {what} {name}, expected one: rename or remove the others")
    return joints


def _joint(path: str | Path, element: ElementTree.Element) -> _Joint:
    from scipy.spatial.transform import Rotation

    name, kind = element.get("name", "without a name"), element.get("type", "")

    def numbers(tag: str, attribute: str, otherwise: str) -> Array:
        found = element.find(tag)
        text = otherwise if found is None else found.get(attribute, otherwise)
        try:
            values = np.array([float(part) for part in text.split()])
        except ValueError:
            values = np.empty(0)
        count = len(otherwise.split())
        if values.size != count or not (np.abs(values) <= FARTHEST).all():
            expected = f"{count} number{'s' * (count > 1)}, at most {FARTHEST:g}"
            raise FileFormatError(f"{path}: joint {name}: {tag} {attribute} is {text!r}, expected {expected}")
        return values

    def bound(which: str) -> float:
        return float(numbers("limit", which, "0")[0])

    def link(tag: str) -> str:
        found = element.find(tag)
        if found is None or not found.get("link"):
            raise FileFormatError(f"{path}: joint {name} has no {tag} link, expected one")
        return str(found.get("link"))

    axis = numbers("axis", "xyz", "1 0 0")
    length, mimic = float(np.linalg.norm(axis)), element.find("mimic")
    if kind in REVOLUTE and length < 1.0 / FARTHEST:
        raise FileFormatError(
            f"{path}: joint {name} has the axis {axis[0]:g} {axis[1]:g} {axis[2]:g}, expected length 1"
        )
    if kind == "revolute" and element.find("limit") is None:
        raise FileFormatError(f"{path}: joint {name} is revolute and has no limit, expected lower and upper, rad")
    limits = (bound("lower"), bound("upper")) if kind == "revolute" else WITHOUT_LIMIT
    if limits[0] > limits[1]:
        found = f"joint {name} has the limits {limits[0]:g} to {limits[1]:g} rad"
        raise FileFormatError(f"{path}: {found}, expected lower below upper: exchange them")
    # 0 is what some exporters write for a speed that they do not know.
    max_speed = bound("velocity") or np.nan
    return _Joint(
        name,
        kind if mimic is None else f"a mimic of {mimic.get('joint')}",
        link("parent"),
        link("child"),
        Rotation.from_euler("xyz", numbers("origin", "rpy", "0 0 0")).as_matrix(),
        numbers("origin", "xyz", "0 0 0"),
        axis / max(length, 1.0 / FARTHEST),
        limits,
        max_speed if max_speed > 0.0 else np.nan,
    )


def _chain(path: str | Path, tip: str, to_child: dict[str, _Joint]) -> list[_Joint]:
    """The joints from the root to the link `tip`."""
    chain: list[_Joint] = []
    link = tip
    while link in to_child:
        chain.append(to_child[link])
        link = to_child[link].parent
        if len(chain) > len(to_child):
            *links, last = [joint.child for joint in chain]
            circle = [*links[len(links) - 1 - links[::-1].index(last) :], last]
            found = f"found links that go round in a circle ({some_of(circle, 8)})"
            raise FileFormatError(f"{path}: {found}, expected a tree: correct the parent of one of them")
    return chain[::-1]


def _flange(path: str | Path, to_child: dict[str, _Joint]) -> str:
    """The flange by its name, or the end of the longest chain if there is one only."""
    for name in FLANGES:
        if name in to_child:
            return name
    parents = {joint.parent for joint in to_child.values()}
    axes = {
        link: sum(joint.kind in REVOLUTE for joint in _chain(path, link, to_child))
        for link in to_child
        if link not in parents
    }
    ends = [link for link, count in axes.items() if count == max(axes.values())]
    if not ends:
        _chain(path, next(iter(to_child)), to_child)
    if len(ends) != 1:
        raise FileFormatError(
            f"{path}: found {len(ends)} ends of the arm ({some_of(ends, 8)}), expected one: name the flange, as in "
            "arm.urdf:LINK"
        )
    return ends[0]
