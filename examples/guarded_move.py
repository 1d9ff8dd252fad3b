"""Feeling for a surface: the virtual arm goes ahead until it feels 5 N, zeroed once and calibrated.

Needs mujoco: pip install 'contactwrench[sim]'.
"""

import numpy as np

import contactwrench as cw
from contactwrench.errors import MissingExtraError
from contactwrench.simulate.kinematics import paper_joints
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings
from reproduction.closed_loop import servo_rig
from reproduction.guarded_move import approaches, guarded_move
from reproduction.scenes import PLATE, PROBE, TOOL


def main() -> None:
    settings = Settings(tool=TOOL)
    free = record_poses(settings, paper_joints(build(settings)), rng=np.random.default_rng(1))
    calibration = cw.calibrate(free.samples)
    zero = free.samples.wrench[0]
    senses = {"zeroed once": lambda wrench, R: wrench - zero, "calibrated": calibration.compensate}

    rig = servo_rig(settings, PROBE, PLATE)
    for number, joints in enumerate(approaches(rig, 8, np.random.default_rng(2))[:3]):
        for name, sense in senses.items():
            move = guarded_move(rig, joints, sense, np.random.default_rng(number))
            print(f"move {number + 1}, {name}: {move.ended}, true force at the stop {move.at_stop:.1f} N")


if __name__ == "__main__":
    try:
        main()
    except MissingExtraError as error:
        print(error)
