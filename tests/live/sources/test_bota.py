"""Bota's driver, as far as a stand-in for its package tells."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

import contactwrench as cw
from contactwrench.errors import ContactWrenchError
from contactwrench.live.sources.bota import Bota
from contactwrench.live.uri import parsed


class Driver:
    """One that starts, and says how often it samples."""

    step = 0

    def __init__(self, path: str) -> None: ...
    def configure(self) -> bool:
        return True

    def activate(self) -> bool:
        return True

    def get_expected_timestep_us(self) -> int:
        return self.step

    def deactivate(self) -> bool:
        return True

    def shutdown(self) -> bool:
        return True


def test_a_driver_without_a_timestep_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bota_driver", SimpleNamespace(BotaDriver=Driver))
    path = tmp_path / "driver.json"
    path.write_text("{}")
    with pytest.raises(ContactWrenchError) as caught, cw.live.open(f"bota:{path}"):
        pass
    assert str(caught.value) == (
        f"bota:{path}: found a timestep of 0 us, expected a Bota sensor: set the sensor's sampling in the driver's file"
    )


def test_who_closes_a_driver_that_starts_waits_until_it_has_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was shut down within its own start, and active thereafter."""
    done, starts, goes_on = list[str](), threading.Event(), threading.Event()

    class Slow(Driver):
        step = 1_000

        def activate(self) -> bool:
            starts.set()
            goes_on.wait(5.0)
            done.append("active")
            return True

        def shutdown(self) -> bool:
            done.append("shut down")
            return True

    monkeypatch.setitem(sys.modules, "bota_driver", SimpleNamespace(BotaDriver=Slow))
    path = tmp_path / "driver.json"
    path.write_text("{}")
    source = Bota(parsed(f"bota:{path}"))
    opens, closes = threading.Thread(target=source.open), threading.Thread(target=source.close)
    opens.start()
    assert starts.wait(5.0)
    closes.start()
    closes.join(0.1)
    goes_on.set()
    opens.join()
    closes.join()
    assert done == ["active", "shut down"]
