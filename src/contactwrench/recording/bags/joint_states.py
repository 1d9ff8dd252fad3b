"""Joint angles of an arm among those that a `sensor_msgs/JointState` names, in the arm's order.

A driver is free to order joints as it likes (those of Universal Robots come by the alphabet, the elbow first) and to
report a gripper's with them, so names decide: those of the URDF; of a known arm, those that its drivers use.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...assess.robot_arms import Arm

UNIVERSAL_ROBOTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""In the order of the arm; a driver adds `_joint` behind and may put a robot's name before."""


def joint_places(names: Sequence[str], arm: Arm) -> list[int] | None:
    """Where in `names` the arm's joints are; None where they are not all there, or could be more than one arm's.

    Joints without recognised names are the arm's, in their order, if there are as many.
    """
    if arm.joint_names:
        return _all_of([names.index(name) if name in names else None for name in arm.joint_names])
    sets = [places for places in (*_numbered(names, len(arm)), *_named(names, len(arm))) if places is not None]
    if sets:
        return sets[0] if len(sets) == 1 else None
    return list(range(len(arm))) if len(names) in (0, len(arm)) else None


def _numbered(names: Sequence[str], count: int) -> list[list[int] | None]:
    """Sets of joints whose names are the same but for a number at the end, from 1 to `count` or from 0."""
    by_stem: dict[str, dict[int, int]] = {}
    for place, name in enumerate(names):
        if match := re.fullmatch(r"(.*?)(\d+)", name):
            by_stem.setdefault(match[1], {})[int(match[2])] = place
    sets: list[list[int] | None] = []
    for numbers in by_stem.values():
        if len(numbers) == count and sorted(numbers) in (list(range(1, count + 1)), list(range(count))):
            sets.append([numbers[number] for number in sorted(numbers)])
    return sets


def _named(names: Sequence[str], count: int) -> list[list[int] | None]:
    """Sets of joints named as those of Universal Robots' arms, whatever is put before."""
    if count != len(UNIVERSAL_ROBOTS):
        return []
    ends = [re.compile(f"(.*){part}(_joint)?") for part in UNIVERSAL_ROBOTS]
    places = [{m[1]: k for k, name in enumerate(names) if (m := end.fullmatch(name))} for end in ends]
    return [_all_of([place.get(prefix) for place in places]) for prefix in places[0]]


def _all_of(places: Sequence[int | None]) -> list[int] | None:
    known = [place for place in places if place is not None]
    return known if len(known) == len(places) else None
