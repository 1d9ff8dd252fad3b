"""Base frames by their names: how one stands to another where that is known, and a calibration brought into another.

Universal Robots' arms have two bases: that of the controller, which ROS calls `base`, and ROS' `base_link`, half a turn
about z away from it, with x forward (Universal_Robots_ROS2_Description, urdf/ur_macro.xacro, base_link-base_fixed_joint
and base_link-base_link_inertia).
Of no other arm is anything known here: ROS-Industrial's `base` and `base_link` are alike on some and not on others.
"""

from __future__ import annotations

from shlex import join

import numpy as np

from ..assess.robot_arms import ARMS
from ..calibration.calibration import Calibration
from ..errors import InputError
from ..geometry.arrays import Array

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
OF_UNIVERSAL_ROBOTS = frozenset(arm.base_frame for name, arm in ARMS.items() if name.startswith("ur"))
AGAINST_CONTROLLER = {"base": np.eye(3), "base_link": HALF_TURN}
"""How the bases that ROS has of such an arm stand to its controller's."""


def R_between(frame: str, other: str) -> Array | None:
    """`R_frame_other` (3, 3) of two base frames; None where it is not known."""
    if frame == other:
        return np.eye(3)
    named = {frame, other} - OF_UNIVERSAL_ROBOTS
    return AGAINST_CONTROLLER.get(named.pop()) if len(named) == 1 else None  # either way: a half turn is its inverse


def in_base_of_recording(
    calibration: Calibration, base_frame: str | None, source: str
) -> tuple[Calibration, str | None]:
    """A calibration for a recording, `source` in words, whose orientations are in `base_frame` (None: it does not say),
    in that base; and what there is to say of it. Raises `InputError` where nobody knows how the two bases stand.
    """
    own, new = (str(name or "").removeprefix("/") for name in (calibration.provenance.get("base_frame"), base_frame))
    if not own or not new:
        upright = np.array_equal(np.abs(calibration.gravity_direction), [0.0, 0.0, 1.0])  # so no turn about z matters
        silent = "the calibration" if new else "this recording"
        said = f"{silent} does not name its base: taken to be {own or new} (--base-frame names it)"
        return calibration, said if (own or new) and not upright else None
    R = R_between(new, own)
    if R is None:
        raise InputError(
            f"{source}: found orientations in {new}, expected the calibration's base, {own}: if the two are one, say "
            f"{join(['--base-frame', own])}, else which way gravity points in {new}, with --gravity X,Y,Z"
        )
    if np.array_equal(R, np.eye(3)):
        return calibration, None
    said = f"orientations are in {new}, half a turn about z from the calibration's {own}: it was turned into that"
    return calibration.with_base(R, new), said
