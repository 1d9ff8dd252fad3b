"""The fake KUKA controller against an answering host of a few lines."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.lab.rsi import Rsi
from contactwrench.lab.truth import Plain
from tests.lab.clients import WAIT, nothing_left

R = Rotation.from_rotvec([0.3, -1.0, 1.0])
SIGNAL = Plain(position=(0.1, 0.2, 0.3), joints=(0.1,) * 7, R_base_flange=R.as_matrix())
CORRECTION = '<RKorr X="1.5" Y="0" Z="0" A="0" B="0" C="-0.25"/>'


@pytest.fixture
def host() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(WAIT)
        yield listening


def answer(host: socket.socket, ipoc: int = 0) -> ElementTree.Element:
    data, robot = host.recvfrom(2000)
    said = ElementTree.fromstring(data)
    number = ipoc or int(said.findtext("IPOC", ""))
    host.sendto(f'<Sen Type="ImFree">{CORRECTION}<IPOC>{number}</IPOC></Sen>'.encode(), robot)
    return said


def forty_cycles() -> tuple[list[ElementTree.Element], float]:
    """What the robot said, each cycle answered at once, and how long it took."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
        host.bind(("127.0.0.1", 0))
        host.settimeout(WAIT)
        with nothing_left(), Rsi(SIGNAL, host.getsockname(), cycle=0.012) as robot:
            start = time.monotonic()
            said = [answer(host) for _ in range(40)]
            took = time.monotonic() - start
            assert robot.uri == f"rsi://:{host.getsockname()[1]}"
            time.sleep(0.03)
            assert robot.correction.tolist() == [1.5, 0, 0, 0, 0, -0.25]
    return said, took


def delays(said: ElementTree.Element) -> int:
    return int(re.sub(r"\D", "", said.find("Delay").get("D")))  # type: ignore[union-attr,arg-type]


def test_each_cycle_is_sent_and_its_answer_taken() -> None:
    said, took = forty_cycles()
    for _ in range(5):
        if delays(said[-1]):  # this machine was busy, and an answer late
            said, took = forty_cycles()
    ipoc = [int(each.findtext("IPOC", "")) for each in said]
    assert np.array_equal(np.diff(ipoc), np.full(39, 12))
    assert delays(said[-1]) == 0
    pose = {name: float(value) for name, value in said[0].find("RIst").attrib.items()}  # type: ignore[union-attr]
    assert [pose["X"], pose["Y"], pose["Z"]] == [100, 200, 300]
    turned = Rotation.from_euler("ZYX", [pose["A"], pose["B"], pose["C"]], degrees=True)
    assert (turned.inv() * R).magnitude() < 1e-7
    assert float(said[0].find("AIPos").get("A6")) == pytest.approx(np.rad2deg(0.1), abs=1e-6)  # type: ignore[union-attr,arg-type]
    assert 0.4 < took < 0.65


def test_late_and_wrong_answers_are_counted_until_the_robot_stops(host: socket.socket) -> None:
    with Rsi(SIGNAL, host.getsockname(), most_late=10) as robot:
        for _ in range(5):
            answer(host, ipoc=1)
        said = answer(host)
        assert delays(said) >= 4
        time.sleep(0.2)
        assert robot.stopped
        assert robot.delays == 11
