"""The fake RTDE server against a client of a few lines, and against ur-rtde."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import time
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.lab.truth import Plain
from contactwrench.lab.ur import Ur
from tests.lab.clients import connected, nothing_left, rtde, rtde_package

R = Rotation.from_rotvec([0.3, -2.0, 1.0])
SIGNAL = {"position": (0.1, 0.2, 0.3), "joints": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7), "R_base_flange": R.as_matrix()}
NUMBERED = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
FIELDS = b"timestamp,actual_TCP_pose,actual_q,ft_raw_wrench,actual_TCP_force,tcp_offset,safety_mode,robot_status_bits"


def test_fields_come_in_the_order_and_at_the_rate_that_was_asked_for() -> None:
    with nothing_left(), Ur(Plain(step=NUMBERED, **SIGNAL)) as ur, connected(ur.port) as connection:
        assert rtde(connection, "V", b"\x00\x02") == b"\x01"
        assert struct.unpack(">4I", rtde(connection, "v"))[0] == 5
        answer = rtde(connection, "O", struct.pack(">d", 250.0) + FIELDS)
        kinds = b"DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,VECTOR6D,INT32,UINT32"
        assert (answer[0], answer[1:]) == (1, kinds)
        assert rtde(connection, "S") == b"\x01"
        rows = []
        for _ in range(100):
            kind, payload = rtde_package(connection)
            assert (kind, payload[0]) == ("U", 1)
            rows.append(struct.unpack(">d6d6d6d6d6diI", payload[1:]))
        table = np.array(rows)
        assert np.allclose(np.diff(table[:, 0]), 0.004, atol=1e-9)
        assert np.allclose(table[0, 1:7], [0.1, 0.2, 0.3, *R.as_rotvec()], atol=1e-12)
        assert np.allclose(table[0, 7:13], SIGNAL["joints"][:6])
        assert np.array_equal(np.diff(table[:, 13]), np.full(99, 2.0))  # every second row of 500 Hz
        assert rtde(connection, "P") == b"\x01"


def test_a_cb3_has_no_raw_wrench_and_an_offset_moves_the_pose() -> None:
    offset = (0.01, 0.0, 0.2, 0.0, 0.5, 0.0)
    with Ur(Plain(**SIGNAL), cb3=True, tcp_offset=offset) as ur, connected(ur.port) as connection:
        answer = rtde(connection, "O", struct.pack(">d", 125.0) + b"timestamp,ft_raw_wrench")
        assert answer == b"\x00DOUBLE,NOT_FOUND"
        assert rtde(connection, "S") == b"\x00"
        rtde(connection, "O", struct.pack(">d", 125.0) + b"actual_TCP_pose,safety_mode")
        ur.status(3)
        rtde(connection, "S")
        *pose, safety = struct.unpack(">6di", rtde_package(connection)[1][1:])
        assert safety == 3
        tcp = R * Rotation.from_rotvec(offset[3:])
        assert np.allclose(pose[3:], tcp.as_rotvec(), atol=1e-12)
        assert np.allclose(pose[:3], SIGNAL["position"] + R.apply(offset[:3]), atol=1e-12)


def test_its_time_goes_on_while_nobody_listens_and_nonsense_is_hung_up_on() -> None:
    with Ur(Plain()) as ur:
        stamps = []
        for _ in range(2):
            with connected(ur.port) as connection:
                rtde(connection, "O", struct.pack(">d", 500.0) + b"timestamp")
                rtde(connection, "S")
                stamps.append(struct.unpack(">d", rtde_package(connection)[1][1:])[0])
                time.sleep(0.2)
        assert 0.2 < stamps[1] - stamps[0] < 1.0
        with connected(ur.port) as connection, pytest.raises(ConnectionError):
            rtde(connection, "O", b"short")


READ = """
import json, sys, time, rtde_receive
robot = rtde_receive.RTDEReceiveInterface(sys.argv[1], 500.0, sys.argv[2].split(","))
time.sleep(0.1)
first = robot.getTimestamp()
time.sleep(0.2)
passed = robot.getTimestamp() - first
print(json.dumps([robot.getActualTCPPose(), robot.getFtRawWrench(), robot.getSafetyMode(), passed]))
robot.disconnect()
"""
"""By ur-rtde, in a process of its own: its constructor holds every thread of its process up."""


@pytest.mark.skipif(find_spec("rtde_receive") is None, reason="ur-rtde is not installed")
def test_ur_rtde_reads_it() -> None:
    host = f"127.{1 + os.getpid() % 250}.7.9"  # its port is fixed; the address is this process's own
    with nothing_left(), Ur(Plain(wrench=(1, 2, 3, 4, 5, 6), **SIGNAL), host=host, port=30_004):
        command = [sys.executable, "-c", READ, host, "timestamp,actual_TCP_pose,actual_q,ft_raw_wrench,safety_mode"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
    pose, wrench, safety, passed = json.loads(done.stdout.splitlines()[-1])
    assert np.allclose(pose, [0.1, 0.2, 0.3, *R.as_rotvec()], atol=1e-9)
    assert (wrench, safety) == ([1, 2, 3, 4, 5, 6], 1)
    assert 0.1 < passed < 0.5
