"""The fake Net F/T against a client of a few lines, and against pynetft."""

from __future__ import annotations

import socket
import struct
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from contactwrench.lab.netft import SATURATED, NetFt
from contactwrench.lab.truth import Plain
from tests.lab.clients import WAIT, nothing_left

NUMBERED = Plain(wrench=(0, 2, 3, 0.4, 0.5, -0.6), step=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@contextmanager
def streaming(device: NetFt, count: int = 0) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        client.settimeout(WAIT)
        client.sendto(struct.pack(">HHI", 0x1234, 2, count), (device.host, device.port))
        yield client


def record(client: socket.socket) -> tuple[int, ...]:
    data = client.recv(100)
    return struct.unpack(">III6i", data) if len(data) == 36 else (len(data),)


def test_every_record_comes_at_7_khz() -> None:
    signal = Plain(step=(1e-3, 0.0, 0.0, 0.0, 0.0, 0.0))
    with nothing_left(), NetFt(signal, 7000.0, counts=(1e6, 1e6)) as box, streaming(box) as client:
        start = time.monotonic()
        records = np.array([record(client) for _ in range(3500)])
        took = time.monotonic() - start
    assert np.array_equal(records[:, 0], np.arange(1, 3501))
    assert np.array_equal(records[:, 3], 1000 * np.arange(3500))
    assert np.diff(records[:, 1]).min() >= 0
    assert 0.45 < took < 0.7


def test_the_page_says_what_a_count_is_worth() -> None:
    with NetFt(Plain(), 2000.0, counts=(1e6, 2e5), units=("lbf", "lbf-in")) as box:
        page = f"http://{box.host}:{box.http_port}"
        with urllib.request.urlopen(f"{page}/netftapi2.xml", timeout=WAIT) as answer:
            text = answer.read().decode()
        for part in ("cfgcpf>1e+06<", "cfgcpt>200000<", "scfgfu>lbf<", "scfgtu>lbf-in<", "<comrdtrate>2000<"):
            assert part in text
        with pytest.raises(urllib.request.HTTPError):
            urllib.request.urlopen(f"{page}/index.htm", timeout=WAIT)


def test_requests_and_a_finite_stream() -> None:
    with NetFt(NUMBERED) as box, streaming(box, 10) as client:
        records = [record(client) for _ in range(10)]
        client.settimeout(0.1)
        with pytest.raises(TimeoutError):
            record(client)
        client.sendto(struct.pack(">HHI", 0x1234, 0x42, 0), (box.host, box.port))
        client.sendto(struct.pack(">HHI", 0x1234, 0, 0), (box.host, box.port))
        time.sleep(0.1)
        assert box.asked == [2, 0x42, 0]
    assert [sent[0] for sent in records] == list(range(1, 11))
    assert records[0][4:] == (2_000_000, 3_000_000, 400_000, 500_000, -600_000)


def test_faults_of_records() -> None:
    with NetFt(NUMBERED) as box, streaming(box) as client:
        first = record(client)
        box.skip(5)
        box.repeat()
        box.backwards()
        steps = np.diff([first[0], *(record(client)[0] for _ in range(80))])
        assert sorted(set(steps.tolist())) == [-1, 0, 1, 2, 6]
        box.status(SATURATED)
        assert SATURATED in {record(client)[2] for _ in range(20)}
        box.garbage(b"nonsense")
        assert (8,) in [record(client) for _ in range(20)]
        box.restart()
        assert 1 in [record(client)[0] for _ in range(20)]
        box.restart(2**32 - 3)
        numbers = [record(client)[0] for _ in range(30)]
        assert numbers[numbers.index(2**32 - 1) + 1] == 0
        box.split()
        assert (18,) in [record(client) for _ in range(20)]
        box.refuse(0.05)
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection((box.host, box.http_port), timeout=WAIT)


def test_pynetft_reads_it() -> None:
    pynetft = pytest.importorskip("pynetft", reason="pynetft is not installed")
    with NetFt(NUMBERED, 1000.0) as box:
        config = pynetft.Config(sensor_host=box.host, rdt_port=box.port, http_port=box.http_port)
        with pynetft.Client(config) as client:
            samples = client.samples(timeout=WAIT)
            first = next(samples)
            more = [next(samples) for _ in range(200)]
            health = client.health()
    assert first.wrench[1:] == pytest.approx((2, 3, 0.4, 0.5, -0.6))
    assert more[-1].rdt_sequence - first.rdt_sequence >= 200
    assert (health.lost_count, health.duplicate_count, health.malformed_count) == (0, 0, 0)
    assert (first.force_unit.value, first.torque_unit.value) == ("N", "N-m")
