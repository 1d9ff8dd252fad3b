"""Every driver on every fault of its fake: refused, cut, silent, cut in pieces, garbled, out of order, begun anew."""

from __future__ import annotations

import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import repeat
from time import monotonic, sleep
from typing import Any

import pytest

from contactwrench.live.source import DeviceError, NoteKind
from contactwrench.live.sources import datagrams, netft, transport
from contactwrench.live.sources.reader import NOT_AGAIN, ZEROED
from contactwrench.live.uri import source_of
from tests.support.devices import KINDS, Kind, answering, consecutive, free_port, kinds, read, reading, refusal

ALL = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
HTTP = b"HTTP/1.0 400 Bad Request\r\nContent-Length: 3\r\n\r\nno\n"


def some(holds: str) -> pytest.MarkDecorator:
    names = [name for name, kind in KINDS.items() if getattr(kind, holds)]
    return pytest.mark.parametrize("kind", [KINDS[name] for name in names], ids=names)


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "PATIENCE", 0.8)
    monkeypatch.setattr(netft, "PATIENCE", 0.8)


@ALL
def test_a_stream_is_whole(kind: Kind) -> None:
    with reading(kind) as (_, source):
        found = read(source, 0.3)
    assert kinds(found.notes) == []
    assert len(found.samples) > 0.15 * kind.rate
    assert not any(sample.flaw for sample in found.samples)
    if kind.numbered:
        assert consecutive(found.samples)
    if kind.counts:
        times = [sample.device for sample in found.samples]
        assert times == pytest.approx([times[0] + k / kind.rate for k in range(len(times))], abs=1e-5)


def _timed_refusal(uri: str) -> tuple[str, float]:
    """The line that refuses what is not there, and s until that was said."""
    begun = monotonic()
    message = refusal(source_of(uri))
    return message, monotonic() - begun


def test_nobody_there_is_one_line() -> None:
    """All kinds at once: what takes long is to wait."""
    with ExitStack() as fakes:
        uris = [fakes.enter_context(kind.fake()).uri + kind.options for kind in KINDS.values()]
    with ThreadPoolExecutor(len(uris)) as pool:
        for uri, (message, seconds) in zip(uris, pool.map(_timed_refusal, uris), strict=True):
            assert seconds < 3.0, uri
            assert message.startswith(f"{uri}: found ")
            assert ", expected " in message
            assert "\n" not in message


def _refused(kind: Kind, answer: bytes) -> tuple[str, str, float]:
    """The URI at which another device answers, the line that refuses it, and s until that was said."""
    with answering(answer) as port:
        with kind.fake() as fake:
            uri = fake.uri.replace(str(getattr(fake, "http_port", fake.port)), str(port))
        return uri, *_timed_refusal(uri)


@pytest.mark.parametrize("answer", [HTTP, b""], ids=["another", "silent"])
def test_another_device_is_refused_in_one_line(answer: bytes) -> None:
    """All kinds at once: what takes long is to wait."""
    connecting = [kind for kind in KINDS.values() if kind.connects]
    with ThreadPoolExecutor(len(connecting)) as pool:
        for uri, message, seconds in pool.map(_refused, connecting, repeat(answer)):
            assert seconds < 3.0, uri
            assert message.startswith(f"{uri}: found ")
            assert "\n" not in message


def test_a_name_that_is_none_is_said() -> None:
    for scheme in ("sri", "ur", "netft", "ft300"):
        assert "found " in refusal(source_of(f"{scheme}://no-such-host.invalid"))


@some("connects")
def test_a_cut_connection_is_said_and_can_be_made_again(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        read(source, 0.05)
        if kind.datagrams:
            fake.refuse(0.05)
            assert read(source, 3.0, NoteKind.RESTARTED).samples
            return
        fake.cut()
        with pytest.raises(DeviceError, match="found the connection closed"):
            read(source, 2.0)
        source.close()
        source.open()
        assert read(source, 0.2).samples


@ALL
def test_silence_is_no_error(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        fake.silence(0.3)
        read(source, 0.1)
        begun = monotonic()
        assert source.read(0.1).samples == []
        assert monotonic() - begun < 0.75
        assert read(source, 1.5, NoteKind.LOST if kind.counts else None).samples


@ALL
def test_a_wait_is_ended_from_another_thread(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        fake.silence(1.0)
        read(source, 0.05)
        threading.Timer(0.05, source.close).start()
        begun = monotonic()
        while threading.active_count() > 2 and monotonic() - begun < 3.0:
            source.read(2.0)
        assert monotonic() - begun < 0.9
        assert source.read(0.0).samples == []


@ALL
def test_it_is_closed_in_every_state(kind: Kind) -> None:
    before = set(threading.enumerate())
    with kind.fake() as fake:
        source = source_of(fake.uri + kind.options)
        source.close()
        source.open()
        source.close()
        source.close()
        source.open()
        read(source, 0.05)
        source.close()
    end = monotonic() + 2.0
    while set(threading.enumerate()) != before and monotonic() < end:  # who asks for a page ends with its answer
        sleep(0.01)
    assert set(threading.enumerate()) == before


@ALL
def test_packets_cut_in_two(kind: Kind) -> None:
    """A stream is put together; half a datagram is garbage."""
    with reading(kind) as (fake, source):
        read(source, 0.05)
        fake.split()
        found = read(source, 0.2)
        fake.split(False)
        after = read(source, 0.1)
    if kind.datagrams:
        assert set(kinds(found.notes)) <= {NoteKind.GARBAGE, NoteKind.LOST}
        assert NoteKind.GARBAGE in kinds(found.notes)
    else:
        assert kinds(found.notes) == []
        assert not kind.numbered or consecutive(found.samples)
    assert after.samples


@ALL
def test_garbage_between_packets(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        read(source, 0.05)
        fake.garbage(b"\xaa\x55\x00\x1b\xff{garbage}\n")
        found = read(source, 1.0, NoteKind.GARBAGE)
    assert NoteKind.GARBAGE in kinds(found.notes)
    assert set(kinds(found.notes)) <= {NoteKind.GARBAGE, NoteKind.LOST}
    assert len(found.samples) >= 10
    if kind.numbered and kind.datagrams:
        assert consecutive(found.samples)


@some("counts")
def test_lost_samples_are_counted(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        read(source, 0.05)
        fake.skip(5)
        found = read(source, 1.0, NoteKind.LOST)
    assert [note.number for note in found.notes if note.kind == NoteKind.LOST] == [5]


@some("counts")
def test_repeated_samples_are_one(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        read(source, 0.05)
        fake.repeat()
        found = read(source, 1.0, NoteKind.REPEATED)
    assert kinds(found.notes) == [NoteKind.REPEATED]
    assert not kind.numbered or consecutive(found.samples)


@some("counts")
def test_samples_out_of_order_are_left_out(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        read(source, 0.05)
        fake.backwards()
        found = read(source, 1.5, NoteKind.DISORDERED)
    assert kinds(found.notes) in ([NoteKind.LOST, NoteKind.DISORDERED], [])  # of one packet a wake-up there are no two
    times = [sample.device for sample in found.samples]
    assert times == sorted(times)


@some("counts")
def test_a_device_that_begins_anew(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        read(source, 0.2)
        fake.restart()
        found = read(source, 1.0, NoteKind.RESTARTED)
    assert kinds(found.notes).count(NoteKind.RESTARTED) == 1
    assert len(found.samples) >= 10


@some("bad_status")
def test_a_status_is_a_flaw_until_it_is_well_again(kind: Kind) -> None:
    with reading(kind) as (fake, source):
        well = fake.state
        fake.status(kind.bad_status)
        bad = read(source, 1.0, NoteKind.STATUS)
        fake.status(well)
        good = read(source, 1.0, NoteKind.STATUS)
    assert bad.samples[-1].flaw.partition(":")[0] in ("broken", "saturated")
    assert good.samples[-1].flaw == ""


def _said_at_half_the_rate(kind: Kind) -> list[NoteKind]:
    with reading(kind, true_rate=0.5 * kind.rate) as (_, source):
        return kinds(read(source, 1.0).notes)


def test_another_rate_is_no_loss() -> None:
    counting = {name: kind for name, kind in KINDS.items() if kind.counts}
    with ThreadPoolExecutor(len(counting)) as pool:
        assert dict(zip(counting, pool.map(_said_at_half_the_rate, counting.values()), strict=True)) == {
            name: [] for name in counting
        }


def test_sri_wraps_and_has_wrong_sums_and_old_names() -> None:
    with KINDS["sri"].fake(old=True) as fake:
        fake.counter = 65_500
        source = source_of(fake.uri + "?rate=500")
        assert source.open().rate == 500.0
        assert kinds(read(source, 0.2).notes) == []
        fake.wrong_sum()
        assert kinds(read(source, 1.0, NoteKind.LOST).notes) == [NoteKind.WRONG_SUM, NoteKind.LOST]
        source.close()
        assert not any("ADJZF" in command for command in fake.asked)


@pytest.mark.parametrize(("name", "zeroed"), [("sri", "AT+ADJZF=1;1;1;1;1;1"), ("netft", 0x42)])
def test_a_sensor_is_zeroed_only_when_it_is_asked_for(name: str, zeroed: str | int) -> None:
    """And once: connected to again, in whatever contact, it was zeroed anew, under a calibration of another zero."""
    assert (ZEROED, NOT_AGAIN) == (
        "the box was told to zero itself: its bias is not the sensor's",
        "the box was not told again: where it lost power it has lost its zero too, so take a new one with a free tool",
    )
    for options in ("", "zero=1"):
        with KINDS[name].fake() as fake:
            source = source_of(fake.uri + ("&" if "?" in fake.uri else "?") + options)
            about = source.open()
            source.close()
            again = source.open()
            source.close()
            assert fake.asked.count(zeroed) == len(options[:1])
            assert about.settings.get("zero") == (ZEROED if options else None)
            assert again.settings.get("zero") == (NOT_AGAIN if options else None)


def test_a_port_in_use_is_said() -> None:
    from contactwrench.live.sources.lines import UdpLines
    from contactwrench.live.uri import parsed

    other = datagrams.Udp("other", "other")
    port = other.bind("127.0.0.1", free_port())
    assert f"port {port} taken" in refusal(UdpLines(parsed(f"udp://127.0.0.1:{port}")))
    other.close()


def test_a_box_is_read_where_its_page_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a name with two addresses the first may be another's; by UDP nobody says so."""
    known = socket.getaddrinfo

    def both(host: str, port: int, *given: Any, **named: Any) -> Any:
        hosts = ["::1", "127.0.0.1"] if host == "box" else [host]
        return [each for host in hosts for each in known(host, port, *given, **named)]

    monkeypatch.setattr(socket, "getaddrinfo", both)
    with KINDS["netft"].fake() as fake:
        source = source_of(fake.uri.replace("127.0.0.1", "box"))
        assert source.open().rate == 1000.0
        source.close()
