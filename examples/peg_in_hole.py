"""A peg into a hole 0.5 mm wider, in an upright face, which is not quite where the robot believes it to be.

The sensor is zeroed once with the tool straight down, as people do, or calibrated from the paper's six postures. Needs
mujoco: pip install 'contactwrench[sim]'.
"""

import numpy as np

import contactwrench as cw
from contactwrench.errors import MissingExtraError
from contactwrench.simulate.kinematics import HOME, paper_joints
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings
from reproduction.closed_loop import servo_rig
from reproduction.peg import insert, joints_over
from reproduction.scenes import TOOL, hole, peg_tool


def main() -> None:
    settings, rng = Settings(tool=TOOL), np.random.default_rng(1)
    calibration = cw.calibrate(record_poses(settings, paper_joints(build(settings)), rng=rng).samples)
    zero = record_poses(settings, HOME[None], rng=rng).samples.wrench[0]
    senses = {"zeroed once": lambda wrench, R: wrench - zero, "calibrated": calibration.compensate}

    rig = servo_rig(settings, peg_tool(), hole())
    R_base_hole, mouth = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([0.55, -0.1, 0.45])
    joints = joints_over(rig, R_base_hole, mouth)
    for number in range(3):
        for name, sense in senses.items():
            one = insert(rig, R_base_hole, mouth, joints, sense, np.random.default_rng(number))
            how = f"in after {one.seconds:.1f} s" if one.inserted else f"not in ({one.ended})"
            print(f"try {number + 1}, {name}: {how}, largest force {one.largest_force:.1f} N")


if __name__ == "__main__":
    try:
        main()
    except MissingExtraError as error:
        print(error)
