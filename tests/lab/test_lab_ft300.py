"""The fake FT 300 against a Modbus client of a few lines, and against pymodbus."""

from __future__ import annotations

import socket
import struct
import time

import pytest

from contactwrench.lab.ft300 import Ft300
from contactwrench.lab.truth import Plain
from tests.lab.clients import connected, exactly, nothing_left

SIGNAL = Plain(wrench=(1.234, -2.5, 300.0, 0.1234, -1.0, 29.0))
COUNTS = [123, -250, 30_000, 123, -1000, 29_000]


def ask(connection: socket.socket, function: int, first: int, n: int, number: int = 7) -> tuple[int, bytes]:
    connection.sendall(struct.pack(">HHHBBHH", number, 0, 6, 9, function, first, n))
    answered, _, length, unit, function = struct.unpack(">HHHBB", exactly(connection, 8))
    assert (answered, unit) == (number, 9)
    return function, exactly(connection, length - 2)


@pytest.mark.parametrize("function", [3, 4])
def test_registers_hold_the_wrench(function: int) -> None:
    with nothing_left(), Ft300(SIGNAL) as sensor, connected(sensor.port) as connection:
        ask(connection, function, 180, 1)
        time.sleep(0.05)
        answered, data = ask(connection, function, 180, 6)
        assert (answered, data[0], list(struct.unpack(">6h", data[1:]))) == (function, 12, COUNTS)


@pytest.mark.parametrize(
    ("function", "first", "n", "code"), [(6, 180, 1, 1), (3, 514, 2, 2), (3, 180, 0, 3), (3, 1, 126, 3)]
)
def test_what_it_cannot_answer_is_an_exception(function: int, first: int, n: int, code: int) -> None:
    with Ft300(SIGNAL) as sensor, connected(sensor.port) as connection:
        assert ask(connection, function, first, n) == (0x80 | function, bytes([code]))


def test_answers_are_lost_and_late() -> None:
    with Ft300(SIGNAL) as sensor, connected(sensor.port) as connection:
        sensor.skip(1)
        connection.settimeout(0.1)
        with pytest.raises(TimeoutError):
            ask(connection, 3, 180, 6)
        sensor.late(0.15)
        with pytest.raises(TimeoutError):
            ask(connection, 3, 180, 6)


@pytest.mark.filterwarnings("ignore")
def test_pymodbus_reads_it() -> None:
    client = pytest.importorskip("pymodbus.client", reason="pymodbus is not installed")
    with Ft300(SIGNAL) as sensor:
        modbus = client.ModbusTcpClient(sensor.host, port=sensor.port)
        assert modbus.connect()
        modbus.read_holding_registers(180, count=6, device_id=9)
        time.sleep(0.05)
        read = modbus.read_input_registers(180, count=6, device_id=9)
        assert modbus.convert_from_registers(read.registers, modbus.DATATYPE.INT16) == COUNTS
        modbus.close()
