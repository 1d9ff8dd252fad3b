"""Bota sensors, by the vendor's own package and the JSON file in which its driver is set up."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from threading import Event, Lock
from time import monotonic
from typing import Any

from ...errors import MissingExtraError
from ..counter import Counter
from ..source import About, Batch, DeviceError, Sample, Six, now
from ..uri import Uri

MODULUS = 1 << 32
"""Of the sensor's clock, microseconds."""


class Bota:
    """The sensor. The vendor's driver writes what it does to standard output."""

    FORM = "bota:///PATH/OF/CONFIG.json"
    ABOUT = (
        "Bota, all of the vendor's driver (pip install bota-driver): wrench, temperature; its file says which sensor"
    )
    RATE = "as its file says"
    TESTED = "the vendor's driver with its dummy sensor; no sensor"

    def __init__(self, uri: Uri) -> None:
        uri.only()
        self.uri, self._path = uri.text, uri.path
        self._driver: Any = None
        self._closed, self._lock = Event(), Lock()

    def open(self) -> About:
        """As `Source`; how long the vendor's driver takes is its own affair: 0.5 s."""
        try:
            bota_driver = import_module("bota_driver")
        except ImportError:
            raise MissingExtraError(f"{self.uri}: found no bota_driver, expected it: pip install bota-driver") from None
        if not Path(self._path).is_file():
            raise self._error(f"no file {self._path or '(none)'}", "write the driver's JSON file, as Bota's pages say")
        self._closed.clear()
        with self._lock:
            try:
                self._driver = bota_driver.BotaDriver(self._path)
                if not (self._driver.configure() and self._driver.activate()):
                    raise self._error("a driver that does not start", "read what it wrote")
                step = int(self._driver.get_expected_timestep_us())
                if step <= 0:
                    raise self._error(f"a timestep of {step} us", "set the sensor's sampling in the driver's file")
            except RuntimeError as error:
                raise self._error(str(error) or "a refusal of the driver", "check the file and the cable") from None
        self._pause = 0.5e-6 * step
        self._counter, self._last = Counter(1e-6, MODULUS, step), -1
        return About("Bota", wrench=True, orientation=False, rate=1e6 / step, settings={"file": self._path})

    def read(self, timeout: float) -> Batch:
        """As `Source`: the driver is asked twice a sample, as its call that blocks has no end in silence."""
        batch, end = Batch(), monotonic() + timeout
        while not self._take(batch) and monotonic() < end:
            if self._closed.wait(self._pause):
                break
        return batch

    def close(self) -> None:
        """As `Source`."""
        self._closed.set()
        with self._lock:
            driver, self._driver = self._driver, None
            if driver is not None:
                driver.deactivate()
                driver.shutdown()

    def _take(self, batch: Batch) -> bool:
        """Whether there was a new frame; the driver gives the last one again while there is none."""
        with self._lock:
            if self._driver is None:
                return False
            try:
                frame = self._driver.read_frame()
            except RuntimeError as error:
                raise self._error(str(error), "check the cable") from None
        if frame.timestamp == self._last:
            return False
        self._last, arrival = frame.timestamp, now()
        device = self._counter.take(int(frame.timestamp), arrival, batch)
        if device is not None:
            wrench: Six = (*frame.force, *frame.torque)
            status = frame.status
            flaw = "saturated: over range" if status.overrange else "broken: invalid" if status.invalid else ""
            batch.samples.append(Sample(arrival, device, wrench, temperature=frame.temperature, flaw=flaw))
        return device is not None

    def _error(self, found: str, do: str) -> DeviceError:
        return DeviceError(f"{self.uri}: found {found}, expected a Bota sensor: {do}")
