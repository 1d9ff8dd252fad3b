"""The fake M8128 against a client of a few lines: commands, stream, rate, and every fault."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator

import numpy as np
import pytest

from contactwrench.errors import FileAccessError
from contactwrench.lab.sri import Sri
from contactwrench.lab.truth import Plain
from tests.lab.clients import connected, exactly, line, nothing_left, sri_packet

NUMBERED = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def sri() -> Iterator[Sri]:
    with nothing_left(), Sri(Plain(wrench=(0, 2, 3, 4, 5, 6), step=NUMBERED)) as device:
        yield device


@pytest.fixture
def stream(sri: Sri) -> Iterator[socket.socket]:
    with connected(sri.port) as connection:
        connection.sendall(b"AT+GSD\r\n")
        yield connection


def test_commands_are_answered_as_the_box_answers(sri: Sri) -> None:
    with connected(sri.port) as connection:
        connection.sendall(b"AT+EIP=?\r\nAT+SMPF=500\r\nAT+SG")
        assert [line(connection), line(connection)] == ["ACK+EIP=127.0.0.1$OK", "ACK+SMPF=500$OK"]
        connection.sendall(b"DM=(A01,A02,A03,A04,A05,A06);E;2;(WMA:1)\r\nAT+DCKMD=SUM\r\nAT+NONSENSE=1\r\nAT+GOD\r\n")
        assert [line(connection) for _ in range(3)] == [
            "ACK+SGDM=(A01,A02,A03,A04,A05,A06);E;2;(WMA:1)$OK",
            "ACK+DCKMD=SUM$OK",
            "ACK+NONSENSE=$ERROR",
        ]
        assert sri_packet(connection)[1].tolist() == [[0, 2, 3, 4, 5, 6]]
        assert sri.rate == 500.0
        assert "AT+ADJZF=1;1;1;1;1;1" not in sri.asked


def test_who_asks_for_the_rate_that_it_has_does_not_stop_it(sri: Sri, stream: socket.socket) -> None:
    """Its clock began anew, and stood as long as the answer took: what it took meanwhile was not counted."""
    first, begun = sri_packet(stream)[0], time.monotonic()
    sri.late(0.1)
    with connected(sri.port) as other:
        other.sendall(b"AT+SMPF=1000\r\n")
        assert line(other) == "ACK+SMPF=1000$OK"
    number = first
    while time.monotonic() - begun < 0.4:
        number = sri_packet(stream)[0]
    assert number - first > 1000.0 * (time.monotonic() - begun) - 50.0


def test_old_firmware_answers_without_ok() -> None:
    with Sri(Plain(), old=True) as sri, connected(sri.port) as connection:
        connection.sendall(b"AT+SMPR=200\r\nAT+SMPF=?\r\n")
        assert [line(connection), line(connection)] == ["ACK+SMPR=200", "ACK+SMPF=$ERROR"]


def test_the_stream_is_numbered_whole_and_at_its_rate(stream: socket.socket) -> None:
    start = time.monotonic()
    packets = [sri_packet(stream) for _ in range(600)]
    took = time.monotonic() - start
    assert [number for number, _, _ in packets] == list(range(600))
    assert np.array_equal([samples[0, 0] for _, samples, _ in packets], np.arange(600))
    assert all(right for _, _, right in packets)
    assert 0.5 < took < 0.75
    stream.sendall(b"AT+GSD=STOP\r\n")


def test_the_number_wraps(sri: Sri, stream: socket.socket) -> None:
    sri_packet(stream)
    sri.restart(65_530)
    numbers = [sri_packet(stream)[0] for _ in range(60)]
    assert 65_535 in numbers
    assert numbers[numbers.index(65_535) + 1] == 0


def test_losses_doubles_and_disorder_show_in_the_number(sri: Sri, stream: socket.socket) -> None:
    first = sri_packet(stream)
    sri.skip(10)
    sri.repeat()
    sri.backwards()
    sri.wrong_sum()
    packets = [first, *(sri_packet(stream) for _ in range(100))]
    steps = np.diff([number for number, _, _ in packets]).tolist()
    assert sorted(set(steps)) == [-1, 0, 1, 2, 11]
    assert [right for _, _, right in packets].count(False) == 1
    sri.restart()
    assert np.diff([packets[-1][0], *(sri_packet(stream)[0] for _ in range(50))]).min() < -50


def test_packets_are_cut_and_interrupted_by_garbage(sri: Sri, stream: socket.socket) -> None:
    sri_packet(stream)
    sri.split()
    sri.garbage(b"\xaa\x55\x00nonsense")
    read = exactly(stream, 31 * 40 + 11)
    assert read.count(b"nonsense") == 1
    whole = read.replace(b"\xaa\x55\x00nonsense", b"")
    assert {whole[k * 31 : k * 31 + 4] for k in range(40)} == {b"\xaa\x55\x00\x1b"}


def test_cut_silent_refusing_and_back(sri: Sri, stream: socket.socket) -> None:
    number = sri_packet(stream)[0]
    sri.silence(0.1)
    after = [sri_packet(stream)[0] for _ in range(30)]
    assert max(np.diff([number, *after])) > 80  # the box went on counting
    sri.cut()
    with pytest.raises(ConnectionError):
        exactly(stream, 1 << 20)
    with connected(sri.port):
        pass
    sri.refuse(0.15)
    with pytest.raises(ConnectionRefusedError):
        connected(sri.port)
    time.sleep(0.25)
    with connected(sri.port) as again:
        again.sendall(b"AT+GSD\r\n")
        sri_packet(again)


def test_its_rate_is_its_own() -> None:
    with Sri(Plain(step=NUMBERED), true_rate=500.0, clock_drift=50_000.0, jitter=0.002) as sri:
        with connected(sri.port) as connection:
            connection.sendall(b"AT+SMPF=1000\r\nAT+GSD\r\n")
            assert line(connection) == "ACK+SMPF=1000$OK"
            time.sleep(0.5)
            rows = sri.clock.row
        assert abs(rows - 0.5 * 525.0) < 30


def test_a_client_that_does_not_read_is_dropped_and_the_others_go_on() -> None:
    with Sri(Plain(), 1000.0) as sri, socket.socket() as asleep, connected(sri.port) as awake:
        asleep.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        asleep.connect((sri.host, sri.port))
        asleep.sendall(b"AT+SMPF=9999\r\nAT+GSD\r\n")
        deadline = time.monotonic() + 20.0
        while len(sri._clients) != 1 and time.monotonic() < deadline:
            for client in sri._clients:
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
            time.sleep(0.02)
        assert len(sri._clients) == 1
        awake.sendall(b"AT+EIP=?\r\n")
        assert line(awake) == "ACK+EIP=127.0.0.1$OK"


def test_nonsense_does_not_end_it(sri: Sri) -> None:
    with connected(sri.port) as connection:
        connection.sendall(b"\xff\x00GET / HTTP/1.1\r\nAT+SGDM=(A01);C;x\r\nAT+SMPF=nan\r\n")
        assert [line(connection) for _ in range(3)] == ["ACK+=$ERROR", "ACK+SGDM=$ERROR", "ACK+SMPF=$ERROR"]


def test_a_port_that_is_taken_is_said(sri: Sri) -> None:
    with pytest.raises(FileAccessError, match=f"port {sri.port} of 127.0.0.1 cannot be listened on"):
        Sri(Plain(), port=sri.port).__enter__()


@pytest.mark.parametrize("trouble", ["cut", "silence", "refuse", "split"])
def test_it_ends_in_every_state(trouble: str) -> None:
    with nothing_left(), Sri(Plain()) as sri, connected(sri.port) as connection:
        connection.sendall(b"AT+GSD\r\n")
        sri_packet(connection)
        getattr(sri, trouble)(*{"silence": [60.0], "refuse": [60.0]}.get(trouble, []))
