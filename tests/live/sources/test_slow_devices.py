"""A device that is slow, and sound, is taken: behind a gateway, a VPN, or just begun; what is too old is not used."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

import pytest

from contactwrench.lab.ft300 import Ft300
from contactwrench.lab.netft import NetFt
from contactwrench.lab.sri import Sri
from contactwrench.lab.ur import Ur
from contactwrench.live.devices import probed
from contactwrench.live.source import Batch, NoteKind
from contactwrench.live.sources import transport
from contactwrench.live.sources.ft300 import OLD, Ft300Decoder, crc
from contactwrench.live.uri import source_of
from tests.support.devices import answering, numbered, read, refusal

SLOW = 3.2
"""s until it says something."""


def opened(made: Callable[..., Any], late: float) -> str:
    """The device's name, or why it was refused."""
    with made(numbered()) as fake:
        (fake.silence if made is NetFt else fake.late)(late)
        source = source_of(fake.uri)
        try:
            return str(source.open().name)
        finally:
            source.close()
            fake.late(0.0)  # it would answer what was asked meanwhile, one by one


def test_a_device_that_takes_seconds_to_answer_is_taken() -> None:
    cases = {Ft300: SLOW, NetFt: 1.6, Ur: 0.8, Sri: 0.8}
    with ThreadPoolExecutor(4) as pool:
        names = list(pool.map(opened, cases, cases.values()))
    assert names == [
        "Robotiq FT 300",
        "ATI Virtual Net F/T",
        "Universal Robots e-series, PolyScope 5.15.0",
        "SRI M8128",
    ]


def test_the_first_line_may_take_seconds() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor(1) as pool:
        source = source_of(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        opening = pool.submit(source.open)
        connection, _ = server.accept()
        sleep(SLOW)
        connection.sendall(b'{"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}\n')
        assert opening.result().wrench
        source.close()
        connection.close()


def test_a_box_on_a_slow_network_is_heard_to_the_end() -> None:
    """Its rate above all, by which its samples are timed: unheard it was taken to be 1000 Hz."""
    with Sri(numbered(), 500.0) as fake:
        fake.late(0.4)
        source = source_of(fake.uri)
        about = source.open()
        source.close()
    assert about.rate == 500.0
    assert "not confirmed by the box" not in about.settings.values()


def test_a_device_that_never_answers_is_refused_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    assert transport.PATIENCE == 10.0
    monkeypatch.setattr(transport, "PATIENCE", 0.5)
    with Ft300(numbered()) as fake:
        fake.silence(5.0)
        begun = monotonic()
        assert refusal(source_of(fake.uri)) == (
            f"{fake.uri}: found no answer, expected six Modbus registers from 180 on: check that this is the Robotiq "
            "FT 300, and that no one else uses it"
        )
        assert monotonic() - begun < 2.0


@pytest.mark.parametrize("lost", [0, 2, 3])
def test_to_connect_is_tried_again(lost: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first packet on a network is lost more easily than others: who is where is not known yet."""
    connected, tried = transport.Tcp._connected, []

    def lossy(*given: Any) -> str:
        tried.append(given)
        return "no answer" if len(tried) <= lost else connected(*given)

    monkeypatch.setattr(transport.Tcp, "_connected", lossy)
    with Ft300(numbered()) as fake:
        source = source_of(fake.uri)
        if lost == 3:
            assert "found no answer at 127.0.0.1 port" in refusal(source)
        else:
            assert source.open().wrench
        source.close()
    assert len(tried) == min(lost + 1, 3)


def test_who_closes_waits_for_no_connection() -> None:
    """An attempt takes a second: so long nothing was closed."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as full, socket.socket() as one, socket.socket() as other:
        for client in (one, other):  # there is no room for a third
            client.setblocking(False)
            client.connect_ex(full.getsockname())
        source = source_of(f"sri://127.0.0.1:{full.getsockname()[1]}")
        opens = Thread(target=refusal, args=(source,))
        opens.start()
        sleep(0.3)
        begun = monotonic()
        source.close()
        opens.join()
        assert monotonic() - begun < 0.5


def test_a_process_with_a_thousand_open_files_can_connect() -> None:
    resource = pytest.importorskip("resource")  # not on Windows
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(4096, limits[1]), limits[1]))
    try:
        with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as files:
            for _ in range(1100):
                files.enter_context(Path(os.devnull).open("rb"))
            source = source_of(f"tcp://127.0.0.1:{server.getsockname()[1]}?columns=fx,fy,fz,tx,ty,tz")
            with ThreadPoolExecutor(1) as pool:
                opening = pool.submit(source.open)
                connection, _ = server.accept()
                connection.sendall(b"1,0,0,0,0,0\n" * 3)
                assert opening.result().wrench
                connection.close()
            source.close()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_a_gateway_to_a_serial_line_gives_what_that_can() -> None:
    """The sensor has no other: 44 of the 100 samples a second that it was asked for were another rate, and refused."""
    with Ft300(numbered()) as fake:
        fake.late(0.022)
        source = source_of(fake.uri)
        about, early = probed(source, wrench=True, orientation=False)
        early.add(read(source, 1.0))
        source.close()
    assert about.rate is None
    assert float(about.settings["rate"].removesuffix(" Hz")) > 25.0
    assert 20 < len(early.samples) < 60
    assert not any(sample.flaw for sample in early.samples)


@pytest.mark.parametrize("late", [0.2, 0.6])
def test_a_gateway_that_is_very_slow_is_said(late: float) -> None:
    """Five samples a second were taken without a word."""
    with Ft300(numbered()) as fake:
        fake.late(late)
        source = source_of(fake.uri)
        rate, _, said = source.open().settings["rate"].partition(" ")
        source.close()
    assert 1 <= float(rate) <= 6
    assert said == "Hz of the 100 that it can: let one program alone ask, or take a faster gateway"


@pytest.mark.parametrize(
    ("code", "meaning"),
    [(2, "it has no such registers"), (11, "the gateway gets no answer from it"), (99, "of no known meaning")],
)
def test_a_modbus_exception_is_said(code: int, meaning: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was no answer."""
    monkeypatch.setattr(transport, "PATIENCE", 1.3)
    with answering(*[bytes([0, 1, 0, 0, 0, 3, 9, 0x83, code])] * 9) as port:
        assert refusal(source_of(f"ft300://127.0.0.1:{port}")) == (
            f"ft300://127.0.0.1:{port}: found Modbus exception {code} ({meaning}), expected six Modbus registers from "
            "180 on: check that the Robotiq FT 300 is behind it, as unit 9, with power"
        )


@pytest.mark.parametrize("serial", [False, True])
def test_a_modbus_exception_between_readings_is_a_status(serial: bool) -> None:
    """And what looks like one within a reading is none."""
    decoder, batch, reading = Ft300Decoder(serial), Batch(), answer(1)[:9] + b"\0\3\x09\x83\x02" + bytes(7)
    refused = answer(1)[:4] + bytes([0, 3, 9, 0x83, 2])
    whole = [reading, refused, reading]
    if serial:
        whole = [each[6:] + crc(each[6:]) for each in whole]
    for each in b"".join(whole):
        decoder.feed(bytes([each]), 1.0, batch)
    assert [(note.kind, note.text) for note in batch.notes] == [
        (NoteKind.STATUS, "Modbus exception 2 (it has no such registers)")
    ]
    assert [sample.wrench[1] for sample in batch.samples if sample.wrench] == [24.35, 24.35]


def answer(number: int) -> bytes:
    """A Modbus answer of zeros, to the question of this number."""
    return number.to_bytes(2) + bytes([0, 0, 0, 15, 9, 3, 12]) + bytes(12)


def test_an_answer_to_an_earlier_question_is_late() -> None:
    """A gateway that is behind answers what was asked half a second ago, for ever, and it looked like now."""
    decoder, batch = Ft300Decoder(serial=False), Batch()
    first, second, third = (int.from_bytes(decoder.number(unanswered)) for unanswered in (False, True, True))
    for number in (first, second, third, 0):  # 0: of a gateway that says no number
        decoder.feed(answer(number), 1.0, batch)
    assert [sample.flaw for sample in batch.samples] == [OLD, OLD, "", ""]
    assert (
        OLD == "late: it answers a question of 0.5 s ago or more: let one program alone ask, or take a faster gateway"
    )


def test_a_question_that_was_lost_makes_no_answer_late_when_its_number_comes_again() -> None:
    """11 minutes later, at 100 a second."""
    decoder, batch = Ft300Decoder(serial=False), Batch()
    lost = decoder.number(False)
    decoder.number(True)
    while decoder.number(False) != lost:
        pass
    decoder.feed(answer(int.from_bytes(lost)), 1.0, batch)
    assert [sample.flaw for sample in batch.samples] == [""]


def test_a_gateway_that_is_behind_is_not_believed() -> None:
    with Ft300(numbered()) as fake:
        source = source_of(fake.uri)
        source.open()
        assert not any(sample.flaw for sample in read(source, 0.3).samples)
        fake.late(0.7)
        slow = read(source, 3.0).samples
        source.close()
    assert len(slow) > 2
    assert {sample.flaw for sample in slow[1:]} == {OLD}


def test_a_gateway_that_was_behind_once_is_believed_again() -> None:
    """After one stall each answer was taken for that to the question before, for ever."""
    with Ft300(numbered()) as fake:
        source = source_of(fake.uri)
        source.open()
        fake.late(0.8)
        read(source, 0.3)
        fake.late(0.015)
        read(source, 1.2)
        after = read(source, 0.5).samples
        source.close()
    assert len(after) > 10
    assert not any(sample.flaw for sample in after)
