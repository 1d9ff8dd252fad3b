"""What is said of a device from how its samples come."""

from __future__ import annotations

from contactwrench.live.intake import Intake
from contactwrench.live.snapshot import Event
from contactwrench.live.source import About, Batch, Sample


def said(rate: float, seconds: float, silence: float = 0.0) -> list[Event]:
    """Of a device at a rate that it stated, and then of silence."""
    intake, events = Intake("sri://sensor", "sensor"), list[Event]()
    intake.opened(About("a sensor", wrench=True, orientation=False, rate=rate), 0.0)
    due = 1.0 / rate
    for look in range(1, round((seconds + silence) / 0.02) + 1):
        t, batch = 0.02 * look, Batch()
        while due <= min(t, seconds):
            batch.samples.append(Sample(due, wrench=(0.0,) * 6))
            due += 1.0 / rate
        intake.take(batch)
        events += intake.look(t)
    return events


def test_a_slow_device_is_not_silent_between_two_samples() -> None:
    assert said(3.0, 10.0) == []


def test_silence_is_said_once_and_soon() -> None:
    (event,) = said(500.0, 5.0, 3.0)
    assert event.kind == "silent"
    assert 5.2 < event.t < 5.4
