"""Robotiq FT 300: six Modbus registers, asked for 100 times a second, by TCP or a serial line."""

from __future__ import annotations

from threading import Event, Lock
from time import monotonic
from typing import Any

from ...errors import MissingExtraError
from ..source import About, Batch, DeviceError, Note, NoteKind, Sample, now
from ..uri import Uri
from .rate import RateWatch

PORT, UNIT, FIRST = 502, 9, 180
"""Of Modbus; registers 180 to 185 are forces in 0.01 N and torques in 0.001 N m (Robotiq's manual)."""
BAUD = 19_200
RATE = 100.0
PATIENCE = 0.5
"""s for an answer."""


def wrench_of(registers: list[int]) -> tuple[float, float, float, float, float, float]:
    """N and N m of six registers of 16 bits with a sign."""
    fx, fy, fz, tx, ty, tz = (each - 0x1_0000 if each & 0x8000 else each for each in registers)
    return 0.01 * fx, 0.01 * fy, 0.01 * fz, 0.001 * tx, 0.001 * ty, 0.001 * tz


class Ft300:
    """The sensor. It has no counter and no status: a sample that it repeats is not seen."""

    FORM = "ft300://HOST[:502] or ft300:///dev/ttyUSB0"
    ABOUT = "Robotiq FT 300: wrench, 100 Hz by TCP, about 50 Hz by a serial line of 19,200 baud"
    TESTED = "its fake in the lab, written from Robotiq's manual; no sensor"

    def __init__(self, uri: Uri) -> None:
        uri.only()
        self.uri = uri.text
        self._at = uri
        self._client: Any = None
        self._closed, self._lock = Event(), Lock()

    def open(self) -> About:
        """As `Source`."""
        self._closed.clear()
        with self._lock:
            self._client = self._made()
            if not self._client.connect():
                self._drop()
                raise self._error("nobody listening", "check its power, its cable and the address")
        self._due, self._watch = monotonic(), RateWatch(RATE)
        first = Batch()
        for _ in range(3):
            self._ask(first)
            if first.samples:
                break
        else:
            raise self._error("no registers 180 to 185", "check that this is the sensor, and its unit 9")
        how = f"serial, {BAUD} baud" if self._at.path else "TCP"
        return About("Robotiq FT 300", wrench=True, orientation=False, rate=RATE, settings={"by": how})

    def read(self, timeout: float) -> Batch:
        """As `Source`: it asks for one sample when that is due."""
        batch = Batch()
        self._due = max(self._due + 1.0 / RATE, monotonic() - 1.0 / RATE)
        if not self._closed.wait(max(min(self._due - monotonic(), timeout), 0.0)):
            self._ask(batch)
            self._watch.take(batch, now())
        return batch

    def close(self) -> None:
        """As `Source`; a question under way ends first, within half a second."""
        self._closed.set()
        with self._lock:
            self._drop()

    def _ask(self, batch: Batch) -> None:
        from pymodbus.exceptions import ConnectionException, ModbusIOException

        with self._lock:
            if self._client is None:
                return
            try:
                answer = self._client.read_holding_registers(FIRST, count=6, device_id=UNIT)
            except ModbusIOException:
                return
            except (ConnectionException, OSError):
                raise self._error("the connection closed", "check its power and its cable") from None
        if answer.isError() or len(answer.registers) != 6:
            batch.notes.append(Note(NoteKind.GARBAGE, "an answer that is no six registers"))
        else:
            batch.samples.append(Sample(now(), wrench=wrench_of(answer.registers)))

    def _made(self) -> Any:
        try:
            from pymodbus.client import ModbusSerialClient, ModbusTcpClient
        except ImportError:
            raise MissingExtraError(
                f"{self.uri}: found no pymodbus, expected it: pip install 'contactwrench[live]'"
            ) from None
        if self._at.path:
            return ModbusSerialClient(self._at.path, baudrate=BAUD, timeout=PATIENCE, retries=0)
        return ModbusTcpClient(self._at.host, port=self._at.port or PORT, timeout=PATIENCE, retries=0)

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None

    def _error(self, found: str, do: str) -> DeviceError:
        return DeviceError(f"{self.uri}: found {found}, expected a Robotiq FT 300: {do}")
