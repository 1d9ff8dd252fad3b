"""Where the arm begins its work: of the many postures that bring the flange to a pose, one with room to move."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from contactwrench.errors import InputError
from contactwrench.geometry.arrays import Array
from contactwrench.simulate.arm import JOINT_RANGE
from contactwrench.simulate.kinematics import HOME, flange_jacobian, joints_for
from contactwrench.simulate.rig import Rig

TRIED = 9
ROOM = 2.0
"""rad from the nearest limit that count as much as a Jacobian whose least singular value (m and rad) is `NIMBLE`."""
NIMBLE = 0.25


def roomy_joints(rig: Rig, R_base_flange: Array, position: Array) -> Array:
    """Joints (7,), rad, at a flange pose in base axes: the one of some random postures that is farthest from joint
    limits and singularities. `rig` has no joints but the arm's. Raises `InputError` where no posture reaches the pose.
    """
    rng = np.random.default_rng(0)
    found = [joints_for(rig, R_base_flange, position)]
    for near in rng.uniform(-0.6, 0.6, (TRIED, len(HOME))) * JOINT_RANGE:
        with suppress(InputError):
            found.append(joints_for(rig, R_base_flange, position, near))
    return max(found, key=lambda joints: _room(rig, joints))


def _room(rig: Rig, joints: Array) -> float:
    least = float(np.linalg.svd(flange_jacobian(rig, joints), compute_uv=False)[-1])
    return min(float(np.min(JOINT_RANGE - np.abs(joints))) / ROOM, least / NIMBLE)
