"""`cw.live.open`: a device that is gone ends the loop with an error, and what is not to be used is NaN."""

from __future__ import annotations

from time import monotonic, sleep

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.lab.lines import TcpLines, UdpLines
from contactwrench.lab.sri import Sri
from contactwrench.live import stream
from contactwrench.live.source import DeviceError
from tests.support.devices import KINDS, LOCALHOST, free_port, numbered


def test_a_half_open_device_ends_the_loop_with_an_error() -> None:
    """It waited for ever."""
    with Sri(numbered()) as fake, cw.live.open(fake.uri) as sensor:
        fake.silence(30.0)
        begun = monotonic()
        with pytest.raises(DeviceError) as gone:
            for _ in sensor:
                pass
        assert 0.9 < monotonic() - begun < 3.0
    assert str(gone.value) == (
        f"{fake.uri}: found nothing for 1 s, expected samples: check its power and cable, and open it again"
    )


def test_a_cut_device_ends_the_loop_with_an_error() -> None:
    with TcpLines(numbered()) as fake, cw.live.open(fake.uri) as sensor:
        fake.cut()
        with pytest.raises(DeviceError, match="found the connection closed"):
            for _ in sensor:
                pass


def test_who_listens_and_who_is_slow_itself_is_not_told_of_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody has to send to a port; and a loop may do something for a while between two batches."""
    monkeypatch.setattr(stream, "HALF_OPEN", 0.3)
    port = free_port()
    with UdpLines(numbered(), (LOCALHOST, port)) as fake, cw.live.open(f"udp://127.0.0.1:{port}") as sensor:
        batches = iter(sensor)
        next(batches)
        fake.silence(0.8)
        begun = monotonic()
        while monotonic() - begun < 1.2:
            assert len(next(batches))
    with Sri(numbered(), 8.0) as slow, cw.live.open(slow.uri) as sensor:
        for k, _ in enumerate(sensor):
            sleep(0.5 if k < 3 else 0.0)
            if k > 8:
                break


def test_a_pose_that_is_not_to_be_used_is_nan() -> None:
    """As the wrench beside it: it was a plain number."""
    with KINDS["ur"].fake() as fake, cw.live.open(fake.uri) as robot:
        fake.status(9)
        end, seen = monotonic() + 5.0, dict[str, bool]()
        for batch in robot:
            for flaw, turn, wrench in zip(batch.flaw, batch.orientation, batch.wrench, strict=True):
                assert np.isnan(turn).all() == np.isnan(wrench).all() == bool(flaw)
                seen[flaw] = True
            if "broken: fault" in seen or monotonic() > end:
                break
    assert "broken: fault" in seen
