"""What a Net F/T's page says while records come: what a count is worth, which no record does."""

from __future__ import annotations

import threading
from time import monotonic, sleep

import pytest

from contactwrench.lab.netft import NetFt
from contactwrench.lab.truth import Plain
from contactwrench.live.source import DeviceError
from contactwrench.live.sources import netft
from contactwrench.live.uri import source_of
from tests.support.devices import read

TRUE = (10.0, 20.0, 30.0, 0.1, 0.2, 0.3)


@pytest.mark.parametrize(
    ("counts", "found"),
    [((1e5, 1e6), "100000 counts of one N"), ((1e6, 1e3), "1000 counts of one N m"), ((1e6, 1e6), "")],
)
def test_counts_that_change_in_mid_stream_are_seen(
    counts: tuple[float, float], found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A factor of ten, which nothing else would show; then it is connected to again, and reads what is there."""
    monkeypatch.setattr(netft, "LOOK_AGAIN", 0.2)
    threads = threading.active_count()
    with NetFt(Plain(wrench=TRUE)) as fake:
        source = source_of(fake.uri)
        source.open()
        read(source, 0.5)
        fake.set_counts(counts)
        if found:
            with pytest.raises(DeviceError) as raised:
                read(source, 3.0)
            assert str(raised.value) == (
                f"{fake.uri}: found {found}, expected what its page said before: it is connected to again; what it "
                "sent in the last 0.2 s may be off by that"
            )
            source.close()
            source.open()
        last = read(source, 0.5).samples[-1]
        source.close()
    assert last.wrench == pytest.approx(TRUE, abs=1e-3)
    end = monotonic() + 2.0
    while threading.active_count() > threads and monotonic() < end:
        sleep(0.01)
    assert threading.active_count() == threads


def test_a_page_that_is_gone_is_no_fault_while_records_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(netft, "LOOK_AGAIN", 0.1)
    with NetFt(Plain(wrench=TRUE)) as fake:
        source = source_of(fake.uri)
        source.open()
        monkeypatch.setattr(fake, "_page", str)
        came = read(source, 0.6)
        source.close()
    assert len(came.samples) > 300
    assert not any(sample.flaw for sample in came.samples)
