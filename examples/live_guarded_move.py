"""A guarded move on the virtual lab: the arm goes down in small steps until the contact wrench says contact, and stops.

    contactwrench lab --live                                          # calibrate on its page; it says where it saved
    python examples/live_guarded_move.py SENSOR ROBOT CONTROL CAL.json   # the URIs that lab prints

On a robot of your own `order` is its own motion interface: nothing of contactwrench moves a robot.
"""

import json
import socket
import sys
import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.live.session import Session
from contactwrench.live.sink import Turn
from contactwrench.live.source import Source, now
from contactwrench.live.uri import source_of

START, STEP, LOWEST = 0.21, 0.002, 0.15
"""m of the flange above the base: from where on steps are small, how small, and where the search ends."""
FELT = 3.0
"""N that a contact must have."""
LIGHT = "a light touch, or inertia"
JUDGED = ("free", LIGHT, "contact")
"""What can be felt, where it is known."""
LONGEST, SETTLED = 20.0, 0.05
"""s that a contact wrench may take; s after each step in which the last readings come."""


class Arm:
    """The virtual arm: its pose and its contact wrench come from the devices, orders go to the lab's control port."""

    def __init__(self, sensor: Source, robot: Source, control: str, calibration: cw.Calibration) -> None:
        host, _, port = control.removeprefix("tcp://").rpartition(":")
        self._control = socket.create_connection((host, int(port)), timeout=5.0)
        self._answers = self._control.makefile("rb")
        self._sensor, self._robot = sensor, robot
        self._session = Session(calibration, sensor=sensor.uri, robot=robot.uri)
        self._session.opened("sensor", sensor.open(), now())
        self._session.opened("robot", robot.open(), now())
        self.last: Turn | None = None

    def close(self) -> None:
        """Leave the arm where it is."""
        self._answers.close()
        self._control.close()

    def order(self, what: dict[str, Any]) -> dict[str, Any]:
        """Tell the lab, and take its answer."""
        self._control.sendall(json.dumps(what).encode() + b"\n")
        answer: dict[str, Any] = json.loads(self._answers.readline())
        if "error" in answer:
            raise SystemExit(answer["error"])
        return answer

    def feel(self) -> str:
        """Take what came: `contact`, `free`, or why neither is known."""
        poses, readings = self._robot.read(0.0), self._sensor.read(0.002)
        turn = self._session.feed(readings, poses, t=now())
        self.last = turn if len(turn.pose_t) else self.last
        if turn.contact is None or not len(turn.t):
            return "nothing came"
        if not turn.contact.valid[-1]:
            return str(turn.contact.reason[-1])
        if turn.contact.contact[-1] == 1:  # an arm that accelerates feels its tool's inertia: that is no surface
            return "contact" if np.linalg.norm(turn.contact.wrench[-1, :3]) > FELT else LIGHT
        return "free" if turn.contact.contact[-1] == 0 else "not judged yet"

    def wait(self, *wanted: str) -> str:
        """Stand until one of these is felt, or for `LONGEST` s at most; what is felt then."""
        until = time.monotonic() + LONGEST
        while (felt := self.feel()) not in wanted and time.monotonic() < until:
            pass
        return felt

    def height(self) -> float:
        """Of the flange above the base, m."""
        return float("nan") if self.last is None else float(self.last.position[-1][2])

    def go(self, height: float, *, guarded: bool) -> bool:
        """To a height, straight; whether a contact ended that."""
        last = self.last
        if last is None:
            raise SystemExit("the robot has sent no pose")
        R = Rotation.from_quat(last.pose[-1]).as_matrix().tolist()
        x, y, _ = last.position[-1].tolist()
        end = SETTLED + time.monotonic() + self.order({"move": R, "position": [x, y, height]})["seconds"]
        while time.monotonic() < end:
            if self.feel() == "contact" and guarded:
                self.order({"move": self.order({"state": True})["joints"]})  # to where it is: it stops
                return True
        return False


def guarded_move(arm: Arm) -> str:
    """Down until contact: what ended it. The way to the start is known to be free. No step is taken blindly: where a
    computer or a network is busy the arm stands, until it is felt again what is there.
    """
    if (felt := arm.wait("free")) != "free":
        return f"not begun: {felt}"
    arm.go(START, guarded=False)
    for height in np.arange(START, LOWEST, -STEP).tolist():
        if (felt := arm.wait(*JUDGED)) not in JUDGED:
            return f"ended at {arm.height():.4f} m: {felt}"
        if felt == "contact" or arm.go(height, guarded=True):
            return f"contact at {arm.height():.4f} m"
    return "no contact"


def main(sensor_uri: str, robot_uri: str, control: str, calibration: cw.Calibration) -> None:
    sensor, robot = source_of(sensor_uri), source_of(robot_uri)
    try:
        arm = Arm(sensor, robot, control, calibration)
        try:
            print(guarded_move(arm))
            truth = np.linalg.norm(arm.order({"state": True})["contact"][:3])
            print(f"true contact force as it stopped: {truth:.1f} N")
        finally:
            arm.close()
    finally:
        sensor.close()
        robot.close()


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    try:
        sensor_at, robot_at, control_at, file = sys.argv[1:]
        main(sensor_at, robot_at, control_at, cw.Calibration.load(file))
    except (cw.ContactWrenchError, OSError) as error:
        sys.exit(f"{error}")
