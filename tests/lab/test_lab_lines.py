"""The fakes that speak in lines, read with nothing but a socket and json."""

from __future__ import annotations

import json
import socket
from itertools import pairwise

import pytest
from scipy.spatial.transform import Rotation

from contactwrench.lab.lines import TcpLines, UdpLines
from contactwrench.lab.truth import Plain
from tests.lab.clients import WAIT, connected, line, nothing_left

R = Rotation.from_rotvec([0.3, -1.0, 1.0])
STEP = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_json_from_a_server() -> None:
    signal = Plain(step=STEP, R_base_flange=R.as_matrix(), position=(1.0, 2.0, 3.0))
    with nothing_left(), TcpLines(signal, 500.0) as device, connected(device.port) as connection:
        rows = [json.loads(line(connection)) for _ in range(60)]
    assert list(rows[0]) == ["t", *["fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw", "x", "y", "z"]]
    assert all(after["fx"] - before["fx"] == 1.0 for before, after in pairwise(rows))
    assert rows[50]["t"] - rows[0]["t"] == pytest.approx(0.1)
    turned = Rotation.from_quat([rows[0][name] for name in ("qx", "qy", "qz", "qw")])
    assert (turned.inv() * R).magnitude() < 1e-12


@pytest.mark.parametrize("shows", ["wrench", "pose"])
def test_csv_in_datagrams(shows: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.bind(("127.0.0.1", 0))
        host.settimeout(WAIT)
        with UdpLines(Plain(), host.getsockname(), 100.0, form="csv", shows=shows) as device:  # type: ignore[arg-type]
            lines = [host.recv(2000).decode().strip() for _ in range(10)]
            assert device.uri == f"udp://:{host.getsockname()[1]}"
    names = "t,fx,fy,fz,tx,ty,tz" if shows == "wrench" else "t,qx,qy,qz,qw,x,y,z"
    assert lines[0] == names
    assert {len(row.split(",")) for row in lines} == {len(names.split(","))}


def test_a_slow_device_of_csv_names_its_columns_before_every_row() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.bind(("127.0.0.1", 0))
        host.settimeout(WAIT)
        with UdpLines(Plain(), host.getsockname(), 0.4, form="csv", shows="wrench"):
            assert host.recv(2000).startswith(b"t,fx")


def test_csv_from_a_server_begins_with_its_header() -> None:
    with TcpLines(Plain(), form="csv", shows="wrench") as device, connected(device.port) as connection:
        assert line(connection) == "t,fx,fy,fz,tx,ty,tz"
        assert line(connection).endswith(",0,0,0,0,0,0")
