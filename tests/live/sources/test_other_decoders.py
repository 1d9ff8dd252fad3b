"""What the faults do not show: units and status of a Net F/T, KUKA's angles and answers, Modbus against pymodbus."""

from __future__ import annotations

import os
import re
import struct
import sys
import threading
from contextlib import suppress
from importlib import import_module
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactwrench.geometry.orientation import CONVENTIONS
from contactwrench.geometry.quaternions import from_kuka_abc
from contactwrench.lab.netft import NetFt
from contactwrench.lab.rsi import Rsi
from contactwrench.live.devices import probed
from contactwrench.live.source import Batch, NoteKind
from contactwrench.live.sources import ft300, netft, rsi
from contactwrench.live.sources.ros2 import Ros2
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
        (0xC000_0000, "axia", "saturated"),
        (0x8000_0004, "axia", "broken"),
    ],
)
def test_a_status_of_ati_is_understood(status: int, saturated: str, word: str) -> None:
    decoder, batch = netft.NetFtDecoder((1e6, 1e6), 1e3, netft.SATURATED[saturated]), Batch()
    decoder.feed(struct.pack(">III6i", 1, 1, status, *[0] * 6), 1.0, batch)
    assert batch.samples[0].flaw.partition(":")[0] == word
    assert [note.kind for note in batch.notes] == [NoteKind.STATUS]


def test_a_net_ft_in_pounds_is_read_in_newtons() -> None:
    with NetFt(numbered(), units=("lbf", "lbf-in"), counts=(1e5, 1e4)) as fake:
        source = source_of(fake.uri)
        source.open()
        found = read(source, 0.1).samples
        source.close()
    first, last = found[0].wrench, found[-1].wrench
    assert first is not None
    assert last is not None
    assert (last[0] - first[0]) / (len(found) - 1) == pytest.approx(4.4482216, rel=1e-6)


def test_units_that_nobody_knows_are_refused() -> None:
    with NetFt(numbered(), units=("stone", "Nm")) as fake:
        assert "per stone, expected counts of a unit of force" in refusal(source_of(fake.uri))


@pytest.mark.parametrize(
    ("tag", "said", "found"),
    [
        ("cfgcomrdtrate", "often", "found no rate on the page, expected cfgcomrdtrate"),
        ("cfgcomrdtrate", "inf", "found no rate on the page, expected cfgcomrdtrate"),
        ("cfgcpf", "1,000,000", "found 1,000,000 per N, expected counts of a unit of force"),
        ("cfgcpt", "inf", "found inf per Nm, expected counts of a unit of torque"),
    ],
)
def test_a_page_without_numbers_is_refused(tag: str, said: str, found: str) -> None:
    numbers = {"cfgcomrdtrate": "1000", "cfgcpf": "1e6", "scfgfu": "N", "cfgcpt": "1e6", "scfgtu": "Nm", tag: said}
    page = "".join(f"<{name}>{text}</{name}>" for name, text in numbers.items())
    with answering(f"HTTP/1.0 200 OK\r\n\r\n{page}".encode()) as port:
        assert found in refusal(source_of(f"netft://127.0.0.1?http={port}"))


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
    assert "found port 9000 taken (" in refusal(source_of("udp://a..b:9000"))


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
        topic._sample(message, 1.0, batch)
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


@pytest.mark.skipif(sys.platform == "win32", reason="no serial lines of this kind")
def test_a_serial_line_gives_what_it_can() -> None:
    """It is asked 100 times a second, answers 50 times, and that is not another rate than it says."""
    pty, tty = import_module("pty"), import_module("tty")
    master, line = pty.openpty()
    tty.setraw(line)
    body = ft300.ANSWER + struct.pack(">6h", 100, 0, 0, 0, 0, 0)

    def answers() -> None:
        with suppress(OSError):
            while os.read(master, 64):
                sleep(0.02)
                os.write(master, body + ft300.crc(body))

    thread = threading.Thread(target=answers)
    thread.start()
    source = source_of(f"ft300://{os.ttyname(line)}")
    try:
        assert probed(source, wrench=True, orientation=False)[0].rate is None
        assert source.read(0.5).samples[0].wrench == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    finally:
        source.close()
        os.close(line)
        thread.join()
        os.close(master)


@given(st.binary(max_size=300))
def test_any_bytes_are_read(data: bytes) -> None:
    decoders = netft.NetFtDecoder((1.0, 1.0), 1e3, 0), rsi.RsiDecoder(), ft300.Ft300Decoder(serial=True)
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
