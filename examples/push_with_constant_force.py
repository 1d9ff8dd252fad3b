"""Pushing with 10 N against an upright plate while the tool leans and turns, the sensor zeroed once and calibrated.

Needs mujoco: pip install 'contactwrench[sim]'. Writes `pushing.gif` where pictures can be drawn off-screen.
"""

from pathlib import Path

import numpy as np

import contactwrench as cw
from contactwrench.errors import MissingExtraError
from contactwrench.simulate.kinematics import HOME, paper_joints
from contactwrench.simulate.recording import record_poses
from contactwrench.simulate.rig import build
from contactwrench.simulate.settings import Settings
from reproduction import film
from reproduction.closed_loop import servo_rig
from reproduction.pushing import joints_at, push
from reproduction.scenes import PLATE, PROBE, TOOL


def main() -> None:
    settings, rng = Settings(tool=TOOL), np.random.default_rng(1)
    free = record_poses(settings, paper_joints(build(settings)), rng=rng).samples
    calibration = cw.calibrate(free)
    zero = record_poses(settings, HOME[None], rng=rng).samples.wrench[0]  # the tool straight down

    rig = servo_rig(settings, PROBE, PLATE)
    R_base_plate, spot = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([0.55, -0.1, 0.45])
    joints = joints_at(rig, R_base_plate, spot)
    for name, sense in (("zeroed once", lambda wrench, R: wrench - zero), ("calibrated", calibration.compensate)):
        run = push(rig, R_base_plate, spot, joints, sense, np.random.default_rng(2))
        print(f"{name}: {run.normal_force.mean():.2f} N in the mean, error {run.error:.2f} N (root mean square)")
    try:
        view = film.View((0.45, -0.1, 0.45), 1.1, 215.0, -15.0)
        film.write_gif(film.frames(rig, run.trace, np.arange(1.5, 9.5, 1.0), view, 200, 200), Path("pushing.gif"), 0.3)
    except film.NoPicturesError as error:
        print(f"no pictures: {error}")


if __name__ == "__main__":
    try:
        main()
    except MissingExtraError as error:
        print(error)
