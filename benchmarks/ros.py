"""`python -m benchmarks.ros` in the environment of `make test-ros`: latency and load of the ROS node at 1 kHz.

The node is a process of its own; this one is sensor, arm and listener. Latency is from the stamp, taken just before the
reading is published, to the contact wrench's arrival here: two hops of the middleware and what Python does in three
places. The share that belongs to the listener is in it.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from .table import Row, print_table

SECONDS, RATE = 20.0, 1000.0


def main() -> None:
    """Print the table."""
    os.environ.update(ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST", ROS_DOMAIN_ID=str(os.getpid() % 100 + 1))
    from tests_ros.rig import Rig, save_calibration

    with TemporaryDirectory() as folder:
        path = str(Path(folder) / "tool.json")
        save_calibration(path)
        rig = Rig(apart=True, calibration=path, noise=0.02, lowpass=20.0, drift=0.05)
        try:
            rig.run(Rotation.random(random_state=8), 2.0, rate=RATE)
            begun, spent = len(rig.sent), cpu_seconds(rig)
            rig.run(Rotation.random(random_state=8), SECONDS, rate=RATE)
            spent = cpu_seconds(rig) - spent
            time.sleep(0.5)
        finally:
            rig.close()
    stamps = [(message.header.stamp.sec, message.header.stamp.nanosec) for message in rig.found]
    published = set(rig.sent[begun:])
    arrived = [
        now - sec - 1e-9 * ns for now, (sec, ns) in zip(rig.arrived, stamps, strict=True) if (sec, ns) in published
    ]
    latency = 1e3 * np.array(arrived)
    rows = [
        Row("readings lost", len(published) - len(arrived), "", most=0.0, remark=f"of {len(published)}"),
        Row("latency, stamp to contact wrench here: median", float(np.median(latency)), "ms", most=2.0),
        Row("p99.9", float(np.quantile(latency, 0.999)), "ms"),
        Row("the node's own CPU time a reading", 1e6 * spent / len(published), "us"),
    ]
    print_table(f"ROS 2: {RATE:g} Hz of WrenchStamped, tf at 100 Hz, for {SECONDS:g} s, without numba", rows)


def cpu_seconds(rig: Any) -> float:
    """What the node's process has spent so far."""
    fields = Path(f"/proc/{rig.program.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


if __name__ == "__main__":
    main()
