"""Bota sensors, by the vendor's own package and the JSON file in which its driver is set up."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from ...errors import MissingExtraError
from ..counter import Counter
from ..source import About, Batch, DeviceError, Sample, Six
from ..uri import Uri
from .reader import Reader
from .transport import Driver

MODULUS = 1 << 32
"""Of the sensor's clock, microseconds."""


class _Frames:
    """The vendor's driver, asked twice a sample: its call that blocks has no end in silence."""

    def __init__(self, driver: Any) -> None:
        self._driver, self.pause, self._last = driver, 0.0, -1

    def take(self, timeout: float) -> list[Any]:
        """A new frame; the driver gives the last one again while there is none."""
        end = monotonic() + timeout
        while (frame := self._driver.read_frame()).timestamp == self._last:
            if monotonic() >= end:
                return []
            sleep(self.pause)
        self._last = frame.timestamp
        return [frame]

    def close(self) -> None:
        """End it."""
        self._driver.deactivate()
        self._driver.shutdown()


class Bota(Reader[Driver]):
    """The sensor. The vendor's driver writes what it does to standard output."""

    FORM = "bota:///PATH/OF/CONFIG.json"
    ABOUT = (
        "Bota, all of the vendor's driver (pip install bota-driver): wrench, temperature; its file says which sensor"
    )
    RATE = "as its file says"
    TESTED = "the vendor's driver with its dummy sensor; no sensor"

    any_thread = False

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Driver(uri.text, "Bota sensor"))
        self._path = uri.path

    def open(self) -> About:
        """As `Source`; how long the vendor's driver takes is its own affair: 0.5 s."""
        try:
            bota_driver = import_module("bota_driver")
        except ImportError:
            raise MissingExtraError(f"{self.uri}: found no bota_driver, expected it: pip install bota-driver") from None
        if not Path(self._path).is_file():
            raise self._error(f"no file {self._path or '(none)'}", "write the driver's JSON file, as Bota's pages say")
        try:
            driver = bota_driver.BotaDriver(self._path)
            with self._link.start(frames := _Frames(driver)):
                if not (driver.configure() and driver.activate()):
                    raise self._error("a driver that does not start", "read what it wrote")
                step = int(driver.get_expected_timestep_us())
            if step <= 0:
                raise self._error(f"a timestep of {step} us", "set the sensor's sampling in the driver's file")
        except RuntimeError as error:
            raise self._error(str(error) or "a refusal of the driver", "check the file and the cable") from None
        frames.pause = 0.5e-6 * step
        self._counter = Counter(1e-6, MODULUS, step)
        self._begin(self)
        return About("Bota", wrench=True, orientation=False, rate=1e6 / step, settings={"file": self._path})

    def read(self, timeout: float) -> Batch:
        """As `Source`."""
        try:
            return super().read(timeout)
        except RuntimeError as error:  # the driver's
            raise self._error(str(error), "check the cable") from None

    def feed(self, data: Any, arrival: float, batch: Batch) -> None:
        """Put a frame into the batch."""
        device = self._counter.take(int(data.timestamp), arrival, batch)
        if device is not None:
            wrench: Six = (*data.force, *data.torque)
            flaw = (
                "saturated: over range" if data.status.overrange else "broken: invalid" if data.status.invalid else ""
            )
            batch.samples.append(Sample(arrival, device, wrench, temperature=data.temperature, flaw=flaw))

    def _error(self, found: str, do: str) -> DeviceError:
        return self._link.error(found, "a Bota sensor", do)
