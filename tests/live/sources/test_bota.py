"""Bota's driver, as far as a stand-in for its package tells."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import contactwrench as cw
from contactwrench.errors import ContactWrenchError


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
