"""A control loop at 500 Hz that knows the contact force: copy it, and put your controller where the force is printed.

contactwrench lab                                              # or a sensor and a robot of your own
python examples/live_loop.py SENSOR ROBOT CAL.json [SECONDS]   # the URIs that lab prints
"""

import sys
import time

import numpy as np

import contactwrench as cw
from contactwrench.live.session import Session
from contactwrench.live.source import now
from contactwrench.live.uri import source_of

PERIOD = 1.0 / 500.0
PRINTED = 0.1


def loop(sensor_uri: str, robot_uri: str, calibration: cw.Calibration, seconds: float) -> None:
    """Until the time is over, or a device is gone: then it raises, and whatever moves must stop."""
    sensor, robot = source_of(sensor_uri), source_of(robot_uri)
    session = Session(calibration, sensor=sensor_uri, robot=robot_uri)
    try:
        session.opened("sensor", sensor.open(), now())
        session.opened("robot", robot.open(), now())
        due = printed = time.monotonic()
        end = due + seconds
        while due < end:
            poses, readings = robot.read(0.0), sensor.read(0.0)
            contact = session.feed(readings, poses, t=now()).contact
            if contact is not None and len(contact.wrench):
                wrench, std = contact.wrench[-1], contact.std[-1]  # N and N m, sensor axes
                # Your controller goes here. A sample that is not valid must not move anything.
                if due - printed >= PRINTED:
                    printed = due
                    force, spread = np.linalg.norm(wrench[:3]), np.linalg.norm(std[:3])
                    touches = {0: "free", 1: "contact"}.get(int(contact.contact[-1]), "not judged")
                    print(f"{force:.2f} +- {spread:.2f} N, {touches}" if contact.valid[-1] else contact.reason[-1])
            for event in session.events():
                print(event.text, file=sys.stderr)
            due += PERIOD
            time.sleep(max(due - time.monotonic(), 0.0))
    finally:
        sensor.close()
        robot.close()


if __name__ == "__main__":
    try:
        sensor_at, robot_at, file, *more = sys.argv[1:]
        loop(sensor_at, robot_at, cw.Calibration.load(file), float(more[0]) if more else 60.0)
    except ValueError:
        sys.exit(__doc__)
    except cw.ContactWrenchError as error:
        sys.exit(f"{error}")
    except KeyboardInterrupt:
        print("stopped")
