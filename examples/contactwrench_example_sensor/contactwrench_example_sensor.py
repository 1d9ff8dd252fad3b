"""A sensor for `contactwrench live --sensor example://NAME`: a sine on fz, in place of the hardware that you have.

Install it beside contactwrench (`pip install ./examples/contactwrench_example_sensor`), and `contactwrench devices`
lists it.
"""

from __future__ import annotations

from math import sin, tau
from threading import Event
from time import monotonic

from contactwrench.errors import InputError
from contactwrench.live.counter import Counter
from contactwrench.live.source import About, Batch, DeviceError, Sample, now
from contactwrench.live.uri import Uri

RATE = 100.0


class ExampleSensor:
    """What a class needs: four texts about itself, a constructor that takes the URI, `open`, `read` and `close`."""

    FORM = "example://NAME[?amplitude=N]"
    ABOUT = "an example: a sine on fz"
    RATE = "100 Hz"
    TESTED = "nothing"

    def __init__(self, uri: Uri) -> None:
        uri.only("amplitude")  # another option is refused by name
        self.uri = uri.text
        amplitude = uri.options.get("amplitude", "10")
        try:
            self._name, self._amplitude = uri.host, float(amplitude)
        except ValueError:
            raise InputError(f"{uri}: found amplitude={amplitude}, expected N, as amplitude=10: correct it") from None
        self._closed = Event()

    def open(self) -> About:
        """Connect. One line of error: what was found, what was expected, what to do."""
        if not self._name:
            raise DeviceError(f"{self.uri}: found no name, expected one, as example://bench: add it")
        self._closed.clear()
        self._start, self._sent = monotonic(), 0
        self._counter = Counter(1.0 / RATE)  # turns the device's numbers into its time; sees what was lost
        return About(f"Example {self._name}", wrench=True, orientation=False, rate=RATE)

    def read(self, timeout: float) -> Batch:
        """All samples since the last call; waits for one at most so long, and not once `close` was called."""
        batch = Batch()
        wait = self._start + self._sent / RATE - monotonic()
        if self._closed.wait(min(max(wait, 0.0), timeout)):
            return batch
        while self._sent <= (monotonic() - self._start) * RATE:
            arrival = now()
            device = self._counter.take(self._sent, arrival, batch)
            if device is not None:
                wrench = (0.0, 0.0, self._amplitude * sin(tau * device), 0.0, 0.0, 0.0)
                batch.samples.append(Sample(arrival, device, wrench))
            self._sent += 1
        return batch

    def close(self) -> None:
        """From any thread; also twice."""
        self._closed.set()
