"""What the faults do not show: units and status of a Net F/T, KUKA's angles and answers, Modbus against pymodbus."""

from __future__ import annotations

import os
import re
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from itertools import count
from select import select
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactwrench.geometry.orientation import CONVENTIONS
from contactwrench.geometry.quaternions import from_kuka_abc
from contactwrench.lab.ft300 import Robotiq
from contactwrench.lab.netft import NetFt
from contactwrench.lab.rsi import Rsi
from contactwrench.lab.truth import Plain
from contactwrench.live.devices import probed
from contactwrench.live.source import Batch, NoteKind, Source
from contactwrench.live.sources import ft300, netft, rsi
from contactwrench.live.sources.ros2 import Ros2
from contactwrench.live.sources.transport import LISTENS
from contactwrench.live.uri import parsed, source_of
from tests.live.sources.test_sri_decoder import pieces_of
from tests.support.devices import KINDS, LOCALHOST, answering, free_port, numbered, read, refusal

angle = st.floats(-360.0, 360.0)


@given(angle, angle, angle)
def test_kuka_angles_are_those_of_recordings(a: float, b: float, c: float) -> None:
    R = CONVENTIONS["kuka_abc"].to_matrices(np.radians([[a, b, c]]))[0]
    assert np.allclose(Rotation.from_quat(np.array(from_kuka_abc(a, b, c))).as_matrix(), R)


@pytest.mark.parametrize(
    ("status", "saturated", "word"),
    [
        (0x8002_0000, "net", "saturated"),
        (0x8000_0020, "net", "broken"),
        (0x0001_0000, "net", ""),
        (0x8001_0000, "net", ""),
        (0x8000_0000, "net", "broken"),
        (0xC000_0000, "axia", "saturated"),
        (0x8000_0004, "axia", "broken"),
    ],
)
def test_a_status_of_ati_is_understood(status: int, saturated: str, word: str) -> None:
    decoder, batch = netft.NetFtDecoder(1e6, 1e6, 1e3, netft.SATURATED[saturated]), Batch()
    decoder.feed(struct.pack(">III6i", 1, 1, status, *[0] * 6), 1.0, batch)
    assert batch.samples[0].flaw.partition(":")[0] == word
    assert [note.kind for note in batch.notes] == [NoteKind.STATUS]


@pytest.mark.parametrize(("count", "is_end"), [(2**31 - 1, True), (-(2**31), True), (2**31 - 2, False)])
def test_counts_of_ati_at_the_end_of_their_range_are_no_reading(count: int, is_end: bool) -> None:
    decoder, batch = netft.NetFtDecoder(1e6, 1e6, 1e3, netft.SATURATED["net"]), Batch()
    decoder.feed(struct.pack(">III6i", 1, 1, 0, 0, 0, count, 0, 0, 0), 1.0, batch)
    assert batch.samples[0].flaw == "saturated: a count is at the end of its range" * is_end


@pytest.mark.parametrize(
    ("units", "newtons", "newton_metres"),
    [
        (("lbf", "lbf-in"), 4.4482216, 0.11298483),
        (("N", "N-m"), 1.0, 1.0),
        (("klbf", "lbf-ft"), 4448.2216, 1.3558179),
        (("kN", "N-mm"), 1000.0, 0.001),
        (("kgf", "kgf-cm"), 9.80665, 0.0980665),
        (("gf", "kN-m"), 0.00980665, 1000.0),
    ],
)
def test_a_net_ft_in_any_of_its_units_is_read_in_newtons(
    units: tuple[str, str], newtons: float, newton_metres: float
) -> None:
    """The force and torque units of ATI's pages."""
    signal = Plain(step=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    with NetFt(signal, units=units, counts=(1e5, 1e4)) as fake:
        source = source_of(fake.uri)
        source.open()
        found = read(source, 0.1).samples
        source.close()
    first, last = found[0].wrench, found[-1].wrench
    assert first is not None
    assert last is not None
    assert (last[0] - first[0]) / (len(found) - 1) == pytest.approx(newtons, rel=1e-6)
    assert (last[5] - first[5]) / (len(found) - 1) == pytest.approx(newton_metres, rel=1e-6)


@pytest.mark.parametrize(
    ("units", "said"),
    [
        (("kg", "kg-cm"), "1e+06 per kg, expected counts of a unit of force: set its force units to N on its page"),
        (
            ("N", "stone"),
            "1e+06 per stone, expected counts of a unit of torque: set its torque units to N-m on its page",
        ),
    ],
)
def test_units_of_no_known_size_are_refused(units: tuple[str, str], said: str) -> None:
    with NetFt(numbered(), units=units) as fake:
        assert refusal(source_of(fake.uri)) == f"{fake.uri}: found {said}"


@pytest.mark.parametrize(
    ("tag", "said", "found"),
    [
        ("comrdtrate", "often", "found no rate on the page, expected comrdtrate"),
        ("comrdtrate", "inf", "found no rate on the page, expected comrdtrate"),
        ("cfgcpf", "1,000,000", "found 1,000,000 per N, expected counts of a unit of force: set it on its page"),
        ("cfgcpt", "inf", "found inf per Nm, expected counts of a unit of torque: set it on its page"),
    ],
)
def test_a_page_without_numbers_is_refused(tag: str, said: str, found: str) -> None:
    numbers = {"comrdtrate": "1000", "cfgcpf": "1e6", "scfgfu": "N", "cfgcpt": "1e6", "scfgtu": "Nm", tag: said}
    page = "".join(f"<{name}>{text}</{name}>" for name, text in numbers.items())
    with answering(f"HTTP/1.0 200 OK\r\n\r\n{page}".encode()) as port:
        assert found in refusal(source_of(f"netft://127.0.0.1?http={port}"))


def test_an_answer_is_shown_as_it_is_and_escaped_once() -> None:
    with answering(b"<!DOCTYPE HTML>\n<html>") as port:
        assert refusal(source_of(f"ur://127.0.0.1:{port}")) == (
            f"ur://127.0.0.1:{port}: found an answer that begins '<!DOCTYPE HTML>\\u000a<html>', expected an RTDE "
            "server: check that this is the robot's controller, RTDE switched on"
        )


def test_a_controller_with_another_version_is_no_robot() -> None:
    with answering(struct.pack(">HBB", 4, ord("V"), 1), struct.pack(">HBI", 7, ord("v"), 5)) as port:
        assert "found an answer that begins" in refusal(source_of(f"ur://127.0.0.1:{port}"))


@pytest.mark.parametrize("scheme", ["netft", "sri", "ur", "ft300"])
@pytest.mark.parametrize(
    ("host", "found"), [("", "no host, expected its name"), ("a..b", "no host a..b, expected the")]
)
def test_a_host_that_is_none_is_said(scheme: str, host: str, found: str) -> None:
    assert found in refusal(source_of(f"{scheme}://{host}"))


def test_a_place_to_listen_at_that_is_none_is_said() -> None:
    assert refusal(source_of("udp://a..b:9000")) == (
        "udp://a..b:9000: found no host a..b, expected a name or an address of this computer's: correct it, or leave "
        "it out"
    )


def test_a_robot_is_answered_with_its_ipoc_and_no_correction() -> None:
    assert re.fullmatch(rb'<Sen Type="ImFree"><RKorr( [XYZABC]="0.0000"){6}/><IPOC>77</IPOC></Sen>', rsi.answer(77))
    with KINDS["rsi"].fake() as fake:
        source = source_of(fake.uri)
        assert isinstance(source, rsi.Rsi)
        source.corrections = lambda sample: (0.25, 0.0, 0.0, 0.0, 0.0, 0.5)
        source.open()
        read(source, 0.2)
        source.close()
        assert fake.correction.tolist() == [0.25, 0.0, 0.0, 0.0, 0.0, 0.5]


OTHERS = {
    "no RIst": (
        lambda data: data.replace(b"RIst", b"RSol"),
        "datagrams without RIst, expected RIst and IPOC in each: set DEF_RIst in the RSI configuration",
    ),
    "no IPOC": (
        lambda data: data.partition(b"<IPOC>")[0] + b"</Rob>",
        "datagrams without IPOC, expected RIst and IPOC in each: let RSI's own Ethernet object send them",
    ),
    "commas": (
        lambda data: data.replace(b".", b","),
        'X="0,000000", expected numbers: send them with a decimal point',
    ),
    "single quotes": (
        lambda data: data.replace(b'"', b"'"),
        'RIst that is not whole, expected X="..", Y, Z, A, B, C in it: send all six, in double quotes',
    ),
    "joints": (
        lambda data: re.sub(rb'A2="[^"]*"', b'A2="?"', data),
        'A2="?", expected numbers: send them with a decimal point',
    ),
}


@pytest.mark.parametrize(("change", "said"), OTHERS.values(), ids=OTHERS)
def test_a_robot_that_sends_something_else_is_told_what(
    change: Callable[[bytes], bytes], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rsi, "LISTENS", 0.5)

    class Other(Rsi):
        def cycle_at(self, t: float, number: int) -> bytes:
            return change(super().cycle_at(t, number))

    with Other(numbered(), (LOCALHOST, free_port())) as robot:
        assert refusal(source_of(robot.uri)) == f"{robot.uri}: found {said}"


def test_where_no_robot_sends_that_is_said() -> None:
    assert LISTENS == 2.5
    uri = f"rsi://{LOCALHOST}:{(port := free_port())}"
    assert refusal(source_of(uri)) == (
        f"{uri}: found port {port} open and nobody who sends yet, expected the robot's RSI datagrams: start the "
        "program with RSI_MOVECORR on the robot"
    )


def test_a_datagram_that_is_none_is_said_between_others() -> None:
    decoder, batch = rsi.RsiDecoder(), Batch()
    decoder.feed(b"<Rob><IPOC>4</IPOC></Rob>", 0.0, batch)
    assert batch.notes == [
        (NoteKind.GARBAGE, "datagrams without RIst: set DEF_RIst in the RSI configuration", 25, 0),
    ]


def test_late_answers_are_told() -> None:
    decoder, batch = rsi.RsiDecoder(), Batch()
    for k, late in enumerate((0, 0, 2, 2)):
        pose = '<RIst X="1" Y="2" Z="3" A="0" B="0" C="0"/><AIPos A1="90"/>'
        text = f'<Rob Type="KUKA">{pose}<Delay D="{late}"/><IPOC>{100 + 4 * k}</IPOC></Rob>'
        decoder.feed(text.encode(), 0.004 * k, batch)
    assert [(note.kind, note.number) for note in batch.notes] == [(NoteKind.LATE, 2)]
    assert batch.samples[0].position == pytest.approx((0.001, 0.002, 0.003))
    assert batch.samples[0].joints == pytest.approx((np.pi / 2,))


def test_a_place_that_nobody_filled_in_is_none() -> None:
    """As of a publisher of orientations: no flange is at the base's origin."""
    topic, batch, turn = Ros2(parsed("ros2://pose")), Batch(), SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    for x in (0.0, 0.4):
        message = SimpleNamespace(position=SimpleNamespace(x=x, y=0.0, z=0.0), orientation=turn)
        topic.feed(message, 1.0, batch)
    assert [sample.position for sample in batch.samples] == [None, (0.4, 0.0, 0.0)]
    assert [sample.orientation for sample in batch.samples] == [(0.0, 0.0, 0.0, 1.0)] * 2


@given(st.lists(st.integers(0, 200), max_size=6), st.lists(st.integers(-32768, 32767), min_size=6, max_size=6))
def test_a_serial_answer_has_a_sum_that_pymodbus_makes_too(cuts: list[int], values: list[int]) -> None:
    framer = pytest.importorskip("pymodbus.framer.rtu")
    body = ft300.ANSWER + struct.pack(">6h", *values)
    assert int.from_bytes(ft300.crc(body), "big") == framer.FramerRTU.compute_CRC(body)
    decoder, batch = ft300.Ft300Decoder(serial=True), Batch()
    for piece in pieces_of(b"".join([body + ft300.crc(body), body + b"\0\0", body + ft300.crc(body)]), cuts):
        decoder.feed(piece, 0.0, batch)
    spoiled = ft300.crc(body) != b"\0\0"
    assert [note.kind for note in batch.notes] == [NoteKind.WRONG_SUM] * spoiled
    scaled = tuple(each * scale for each, scale in zip(values, [0.01] * 3 + [0.001] * 3, strict=True))
    assert [sample.wrench for sample in batch.samples] == [pytest.approx(scaled)] * (3 - spoiled)


BODY = ft300.ANSWER + struct.pack(">6h", 100, 0, 0, 0, 0, 0)
WHOLE = BODY + ft300.crc(BODY)


@contextmanager
def on_a_line(answers: Callable[[bytes], bytes], streams: bool = False) -> Iterator[tuple[Source, list[bytes]]]:
    """A sensor that gives to each question its answer, by a serial line, and all that it was sent; one that `streams`
    sends frames until it has been sent 50 times 0xFF, and hears nothing else.
    """
    if sys.platform == "win32":
        pytest.skip("no serial lines of this kind")
    pty, tty = import_module("pty"), import_module("tty")
    master, line = pty.openpty()
    tty.setraw(line)
    sent: list[bytes] = []

    def run() -> None:
        with suppress(OSError):
            while streams and b"".join(sent).count(b"\xff") < 50:
                os.write(master, b"\x20\x4e" + BODY[3:] + b"\0\0")
                sleep(0.01)
                if select([master], [], [], 0.0)[0]:
                    sent.append(os.read(master, 64))
            while data := os.read(master, 64):
                sent.append(data)
                sleep(0.02)
                os.write(master, answers(data))

    thread = threading.Thread(target=run)
    thread.start()
    source = source_of(f"ft300://{os.ttyname(line)}")
    try:
        yield source, sent
    finally:
        source.close()
        os.close(line)
        thread.join()
        os.close(master)


def test_a_serial_line_gives_what_it_can() -> None:
    """It is asked 100 times a second, answers 50 times, and that is not another rate than it says."""
    with on_a_line(lambda _: WHOLE) as (source, _):
        assert probed(source, wrench=True, orientation=False)[0].rate is None
        assert source.read(0.5).samples[0].wrench == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("spoiled", "kind"),
    [
        (BODY + b"\0\0", NoteKind.WRONG_SUM),
        (WHOLE[:9] + WHOLE[10:], NoteKind.GARBAGE),
        (b"\0" + WHOLE[1:], NoteKind.GARBAGE),
        (b"", None),
    ],
    ids=["wrong sum", "a byte lost", "no head", "no answer"],
)
def test_a_spoiled_answer_is_asked_for_again_at_once(
    monkeypatch: pytest.MonkeyPatch, spoiled: bytes, kind: NoteKind | None
) -> None:
    """And one that does not come, after a while: then nobody may be there."""
    asked = count()
    with on_a_line(lambda _: spoiled if next(asked) % 2 else WHOLE) as (source, _):
        source.open()
        monkeypatch.setattr(ft300, "AGAIN", 30.0)
        found = read(source, 10.0, kind) if kind else read(source, 0.5)
    assert {note.kind for note in found.notes} == ({kind} if kind else set())
    assert len(found.samples) >= 10 if kind else len(found.samples) == 1
    assert {sample.wrench for sample in found.samples} == {(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)}


@pytest.mark.parametrize("streams", [True, False])
def test_a_stream_that_another_program_left_is_ended(streams: bool) -> None:
    with on_a_line(lambda _: WHOLE, streams) as (source, sent):
        settings = source.open().settings
        assert source.read(0.5).samples[0].wrench == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert settings.get("stream") == ("another program had left one running, it was ended" if streams else None)
    assert b"".join(sent).count(b"\xff") == 50 * streams


@given(st.binary(max_size=300))
def test_any_bytes_are_read(data: bytes) -> None:
    decoders = netft.NetFtDecoder(1.0, 1.0, 1e3, 0), rsi.RsiDecoder(), ft300.Ft300Decoder(serial=True)
    for decoder in decoders:
        decoder.feed(data, 0.0, Batch())


@pytest.mark.parametrize(
    "uri",
    [
        "sri://a?rat=1",
        "sri://a?rate=-1",
        "sri://a?zero=yes",
        "netft://a?zero=true",
        "ur://a?force=raw",
        "udp://",
        "tcp://a",
    ],
)
def test_an_option_that_is_none_is_refused(uri: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        source_of(uri)


def test_the_robot_of_the_lab_waits_for_a_session() -> None:
    """Of which the first was late by all of the time that a person takes to start it."""
    with Rsi(numbered(), (LOCALHOST, free_port())) as robot:
        sleep(0.7)
        source = source_of(robot.uri)
        source.open()
        assert source.read(0.5).samples
        assert not robot.stopped
        source.close()
        sleep(0.7)
        assert robot.stopped


READING = b"( 2.25 , -0.10 , 29.3 , 0.01 , 0.02 , 0.0 )"


@pytest.mark.parametrize("end", [b"", b"\n", b"\r\n"])
def test_readings_of_robotiqs_urcap_are_newtons_and_newton_metres(end: bytes) -> None:
    """In whichever pieces they come; six numbers make one, and what stands between them is said."""
    data = READING + end + b"( 1 , 2 , 3 )" + end + b"nothing" + b"(1e-05,2,3,4,5,-6)" + end + b"( 7 , 8"
    for size in (1, 7, len(data)):
        decoder, batch = ft300.RobotiqDecoder(), Batch()
        for k in range(0, len(data), size):
            decoder.feed(data[k : k + size], 1.0, batch)
        wrenches = [sample.wrench for sample in batch.samples]
        assert wrenches == [(2.25, -0.1, 29.3, 0.01, 0.02, 0.0), (1e-05, 2.0, 3.0, 4.0, 5.0, -6.0)]
        assert {note.kind for note in batch.notes} == {NoteKind.GARBAGE}
        assert sum(note.number for note in batch.notes) == len(b"( 1 , 2 , 3 )nothing")
        assert batch.notes[0].text == "13 bytes that are no reading"


def test_a_parenthesis_that_is_not_closed_is_not_kept_for_ever() -> None:
    decoder, batch = ft300.RobotiqDecoder(), Batch()
    for _ in range(100):
        decoder.feed(b"( 1 , 2", 1.0, batch)
    decoder.feed(READING, 2.0, batch)
    assert len(batch.samples) == 1
    assert sum(note.number for note in batch.notes) == 700


@pytest.mark.parametrize("rate", [100.0, 125.0])
@pytest.mark.parametrize("end", ["", "\n"])
def test_robotiqs_urcap_is_read(rate: float, end: str) -> None:
    with Robotiq(Plain(wrench=(2.254, -0.1, 29.3, 0.0104, 0.02, 0.0)), rate, end=end) as fake:
        source = source_of(fake.uri)
        about, early = probed(source, wrench=True, orientation=False)
        early.add(read(source, 0.5))
        source.close()
    assert (about.name, about.wrench, about.orientation) == ("Robotiq FT 300 by its URCap", True, False)
    assert len(early.samples) > 0.3 * rate
    assert {sample.wrench for sample in early.samples} == {(2.25, -0.1, 29.3, 0.01, 0.02, 0.0)}
    assert early.notes == []
