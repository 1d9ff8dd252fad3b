"""Lines: JSON and CSV, names and units and conventions of a recording, headers that come late or again."""

from __future__ import annotations

import io
import os
import socket
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactwrench.errors import InputError
from contactwrench.live.devices import probed
from contactwrench.live.intake import NEVER_KNOWN, Intake
from contactwrench.live.source import Batch, DeviceError, NoteKind, Sample
from contactwrench.live.sources import datagrams
from contactwrench.live.sources.lines import LinesDecoder
from contactwrench.live.uri import source_of
from contactwrench.recording.tables.columns import Naming
from tests.live.sources.test_sri_decoder import pieces_of
from tests.support.devices import free_port, refusal

WRENCH = "fx,fy,fz,tx,ty,tz"


def decoded(text: str, cuts: tuple[int, ...] = (), columns: str = "", orientation: str = "auto") -> Batch:
    decoder = LinesDecoder(Naming(orientation), None, columns.split(",") if columns else ())
    batch = Batch()
    for piece in pieces_of(text.encode(), list(cuts)):
        decoder.feed(piece, 1.0, batch)
    return batch


def only(batch: Batch) -> Sample:
    assert batch.notes == []
    (sample,) = batch.samples
    return sample


@given(st.lists(st.integers(0, 500), max_size=8).map(tuple))
def test_lines_may_be_cut_anywhere(cuts: tuple[int, ...]) -> None:
    rows = [f"{k / 1000},{k},0,0,0,0,1,0,0,0,1\n" for k in range(5)]
    batch = decoded(f"t,{WRENCH},qx,qy,qz,qw\n" + "".join(rows), cuts)
    assert batch.notes == []
    assert [sample.device for sample in batch.samples] == [0.0, 0.001, 0.002, 0.003, 0.004]
    assert all(sample.orientation == (0.0, 0.0, 0.0, 1.0) for sample in batch.samples)


def test_units_stand_in_names() -> None:
    sample = only(decoded('{"t_ms": 5, "fx": 1, "fy": 2, "fz": 3, "tx_nmm": 4000, "ty_nmm": 0, "tz_nmm": 6}\n'))
    assert sample.device == pytest.approx(0.005)
    assert sample.wrench == pytest.approx((1.0, 2.0, 3.0, 4.0, 0.0, 0.006))


@pytest.mark.parametrize(
    ("name", "first", "per_s"),
    [
        ("timestamp", 1_700_000_000_000_000_000, 1e9),
        ("timestamp", 1_700_000_000_000_000, 1e6),
        ("timestamp", 1_700_000_000_000, 1e3),
        ("t", 1_700_000_000, 1.0),
        ("t", 0, 1.0),
        ("t_ns", 1_700_000_000_000_000_000, 1e9),
        ("t_ns", 5_000_000_000, 1e9),
        ("timestamp_ms", 1_700_000_000_000, 1e3),
        ("t [us]", 5_000_000, 1e6),
    ],
)
def test_the_unit_of_times_is_told_as_in_recordings(name: str, first: int, per_s: float) -> None:
    """By the name, or else by the size; the 100 s without a line are 100 s, and no counter that began anew."""
    decoder, batch, six = LinesDecoder(Naming(), None), Batch(), '"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0'
    for s in (0, 100, 101):
        decoder.feed(f'{{"{name}": {first + round(s * per_s)}, {six}}}\n'.encode(), 5.0 + s, batch)
    assert batch.notes == []
    assert [each.device for each in batch.samples] == pytest.approx(
        [first / per_s + s for s in (0, 100, 101)], abs=1e-6
    )


def test_a_stamp_that_is_not_set_at_first_hides_no_unit() -> None:
    decoder, batch, six = LinesDecoder(Naming(), None), Batch(), '"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0'
    for t in ("null", "1e999", "0", "1700000000000000000", "1700000000002000000"):
        decoder.feed(f'{{"t": {t}, {six}}}\n'.encode(), 5.0, batch)
    assert [note.kind for note in batch.notes] == [NoteKind.GARBAGE, NoteKind.RESTARTED]
    assert batch.samples[-1].device - batch.samples[-2].device == pytest.approx(0.002, abs=1e-6)


@pytest.mark.parametrize(
    ("names", "numbers", "orientation", "turn"),
    [
        ("a,b,c", [10, 20, 30], "auto", Rotation.from_euler("ZYX", [10, 20, 30], degrees=True)),
        ("rx,ry,rz", [0.1, 0.2, 0.3], "auto", Rotation.from_rotvec([0.1, 0.2, 0.3])),
        (
            "q0,q1,q2,q3",
            [0.8, 0, 0.6, 0],
            "quat_wxyz:q0,q1,q2,q3",
            Rotation.from_quat([0, 0.6, 0, 0.8]),
        ),
    ],
)
def test_conventions_are_those_of_recordings(
    names: str, numbers: list[float], orientation: str, turn: Rotation
) -> None:
    sample = only(decoded(f"t,{names}\n1,{','.join(map(str, numbers))}\n", orientation=orientation))
    assert sample.wrench is None
    assert sample.orientation is not None
    assert (Rotation.from_quat(np.array(sample.orientation)) * turn.inv()).magnitude() < 1e-12


@pytest.mark.parametrize("lost", ["NaN", "null", "Infinity", "-Infinity"])
def test_a_reading_that_is_lost_is_a_flaw_and_the_stream_goes_on(lost: str) -> None:
    """As Python's `json.dumps` writes it: 10 s of such lines were no lines."""
    others = '"fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0'
    lines = "".join(f'{{"t": {0.1 * k}, "fx": {lost if k == 1 else k}, {others}}}\n' for k in range(3))
    batch = decoded(lines)
    assert batch.notes == []
    assert [sample.flaw for sample in batch.samples] == ["", "broken: no number", ""]
    assert [sample.device for sample in batch.samples] == pytest.approx([0.0, 0.1, 0.2])
    row = decoded(f"t,{WRENCH}\n0.1,nan,0,0,0,0,0\n")
    assert only(row).flaw == "broken: no number"
    both = decoded(f'{{"t": 1, "fx": {lost}, {others}, "qx": 0, "qy": 0, "qz": {lost}, "qw": 1}}\n')
    assert only(both).flaw == "broken: no number"


@pytest.mark.parametrize("lost", ["null", "NaN"])
def test_a_reading_that_is_lost_in_a_list_is_a_flaw_too(lost: str) -> None:
    lines = "".join(f'{{"t": {0.1 * k}, "wrench": [1, {lost if k == 1 else 2}, 3, 4, 5, 6]}}\n' for k in range(3))
    batch = decoded(lines)
    assert batch.notes == []
    assert [sample.flaw for sample in batch.samples] == ["", "broken: no number", ""]


@pytest.mark.parametrize("separator", [" ; ", " ;", "; ", " , ", ", ", " \t ", "\t "])
def test_names_that_end_in_numbers_are_a_header_between_blanks_too(separator: str) -> None:
    """It was refused as a row of numbers, and each sample below it."""
    names = "t,force 1,force 2,force 3,torque 1,torque 2,torque 3"
    row = "0.1,1,2,3,4,5,6"
    sample = only(decoded(f"{names}\n{row}\n".replace(",", separator)))
    assert (sample.device, sample.wrench) == (0.1, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))


def test_what_is_no_json_otherwise_is_no_sample() -> None:
    batch = decoded('{"fx": NaNo, "fy": 0}\n{"NaN": NaN}\n{"qx": NaN, "qy": 0, "qz": 0, "qw": 1}\n')
    assert batch.samples == []
    assert [note.text for note in batch.notes] == [
        "a line of 21 bytes that is no sample",
        "a line of 12 bytes that is no sample",
        "a line without a whole orientation",
    ]


def test_wrench_and_orientation_may_have_a_line_each() -> None:
    six = '"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0'
    batch = decoded(f'{{"t": 1, {six}}}\n{{"t": 1, "qx": 0, "qy": 0, "qz": 0, "qw": 1}}\n{{"t": 1.002, {six}}}\n')
    assert batch.notes == []
    assert [sample.wrench is not None for sample in batch.samples] == [True, False, True]


def test_a_header_may_come_again_and_be_another() -> None:
    batch = decoded(f"{WRENCH}\n1,2,3,4,5,6\n{WRENCH}\n1,2,3,4,5,6\nfz,fx,fy,tx,ty,tz\n3,1,2,4,5,6\n# said\n\n")
    assert batch.notes == []
    assert [sample.wrench for sample in batch.samples] == [(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)] * 3


def test_columns_may_be_stated_and_semicolons_have_decimal_commas() -> None:
    assert only(decoded("1,5;2;3;4;5;6\n", columns=WRENCH)).wrench == (1.5, 2.0, 3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize("line", ["1,2,3", "!!", '{"fx": "a"}', "{", '{"fx": 1}', "1,2,3,4,5,x", "\xff,1"])
def test_what_is_no_sample_is_garbage_and_ends_nothing(line: str) -> None:
    batch = decoded(f"{WRENCH}\n1,2,3,4,5,6\n{line}\n1,2,3,4,5,6\n")
    assert [note.kind for note in batch.notes] == [NoteKind.GARBAGE]
    assert len(batch.samples) == 2


LENGTH_2 = (
    "the orientation is a quaternion of length 2, expected 1 within 1 %: check the order of its parts and that none is "
    "cut off"
)


def test_a_quaternion_that_is_none_is_not_used_and_is_named() -> None:
    """Beside a reading, which is used, once for as long as it lasts; it was no orientation, without a word."""
    batch = decoded('{"qx": 0, "qy": 0, "qz": 0, "qw": 2}\n')
    assert batch.samples == []
    assert [note.text for note in batch.notes] == [LENGTH_2]
    six = '"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0'
    lengths = (1, 2, 2, 1, 1, 2)
    batch = decoded("".join(f'{{{six}, "qx": 0, "qy": 0, "qz": 0, "qw": {each}}}\n' for each in lengths))
    assert [sample.orientation is not None for sample in batch.samples] == [each == 1 for each in lengths]
    assert [note.text for note in batch.notes] == [LENGTH_2] * 2


@pytest.mark.parametrize(
    ("options", "row", "said"),
    [
        (
            "units=force=kgf",
            "1,2,3,4,5,6,0,0,0,1",
            "column fx is in kgf and tx says no unit, expected one for each: state it with units=torque=UNIT",
        ),
        ("", "1,2,3,4,5,6,0,0,0,2", LENGTH_2),
    ],
)
def test_columns_that_are_there_and_hold_nothing_are_not_missing(
    options: str, row: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To a sensor whose torque has no unit was said: found no wrench, name another device for that."""
    to_read, to_write = os.pipe()
    with io.FileIO(to_read) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(to_write, f"{WRENCH},qx,qy,qz,qw\n{row}\n".encode() * 3)
        source = source_of(f"stdin:?{options}")
        with pytest.raises(InputError) as raised:
            probed(source, wrench=True, orientation=True)
        assert str(raised.value) == f"stdin:?{options}: {said}"
        os.close(to_write)


def test_standard_input_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    to_read, to_write = os.pipe()
    with io.FileIO(to_read) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(to_write, f"t,{WRENCH}\n1,2,3,4,5,6,7\n".encode())
        source = source_of("stdin:")
        assert source.open().wrench
        assert len(source.read(0.1).samples) == 1
        os.close(to_write)
        with pytest.raises(DeviceError, match="found its end"):
            source.read(1.0)
        source.close()


@pytest.mark.parametrize(
    ("columns", "said"),
    [(f"{WRENCH},qx,qy,qz,qw", {"pose": "taken for the flange's in base axes"}), (WRENCH, {})],
    ids=["with a pose", "a wrench alone"],
)
def test_whose_pose_it_is_lines_cannot_tell(columns: str, said: object, monkeypatch: pytest.MonkeyPatch) -> None:
    to_read, to_write = os.pipe()
    with io.FileIO(to_read) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        numbers = ",".join(["0"] * columns.count(",") + ["1"])
        os.write(to_write, f"t,{columns}\n1,{numbers}\n".encode())
        source = source_of("stdin:")
        assert source.open().settings == said
        os.close(to_write)
        source.close()


@given(st.binary(max_size=200))
def test_any_bytes_are_read(data: bytes) -> None:
    LinesDecoder(Naming(), None).feed(data + b"\n", 0.0, Batch())


def test_a_closed_standard_input_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", None)
    assert refusal(source_of("stdin:")) == (
        "stdin:: found its end, expected more lines: keep the program that writes them running"
    )


SUCH = (
    'expected lines such as {"t": 0.001, "fx": 0, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0, "qx": 0, "qy": 0, '
    '"qz": 0, "qw": 1}, or CSV below a header: '
)
YET = f"open and nobody who sends yet, {SUCH}"
NAME_SO = "name what it sends so, or state ?columns=t,fx,fy,fz,tx,ty,tz,.."


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (b'{"force": 1}\n', f"""found the line '{{"force": 1}}', {SUCH}{NAME_SO}"""),
        (b"1,2,3,4,5,6\n", f"found the line '1,2,3,4,5,6', {SUCH}{NAME_SO}"),
        (b"\xaaU" * 40, f"found the line '{'ªU' * 30}', {SUCH}{NAME_SO}"),
        (
            b"",
            f"found standard input {YET}let the program write lines, and flush each of them",
        ),
    ],
    ids=["other names", "no header", "no lines", "nothing"],
)
def test_what_comes_in_place_of_lines_is_shown(sent: bytes, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactwrench.live.sources.lines._Lines.WAITS", 0.2)
    to_read, to_write = os.pipe()
    with io.FileIO(to_read) as stdin, io.FileIO(to_write, "w"):
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(to_write, sent)
        assert refusal(source_of("stdin:")) == f"stdin:: {said}"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0,1,2,3,4,5,6", ", all stamped alike, expected samples: let their time or number go on, or leave it out"),
        ("no sample", " without a sample, expected samples: check what sends them"),
    ],
)
def test_what_is_no_stream_is_said_with_its_cause(line: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactwrench.live.sources.reader.NOT_A_STREAM", 1_000)
    to_read, to_write = os.pipe()
    with io.FileIO(to_read) as stdin, io.FileIO(to_write, "w"):
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(to_write, f"t,{WRENCH}\n0,1,2,3,4,5,6\n".encode())
        source = source_of("stdin:")
        source.open()
        source.read(0.1)
        sent = f"{line}\n".encode() * 120
        os.write(to_write, sent)
        with pytest.raises(DeviceError) as raised:
            source.read(1.0)
        source.close()
    assert str(raised.value) == f"stdin:: found {len(sent)} bytes{said}"


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("units=force=kgv", "units: found force=kgv, expected one of N, kN, mN, kgf, gf, lbf"),
        ("orientation=euler:ZYY:deg", "orientation 'euler:ZYY:deg': found Euler letters 'ZYY', expected"),
        ("columns=t,fx", "found no orientation columns, expected qx qy qz qw, r11..r33, a b c (KUKA)"),
    ],
)
def test_what_a_uri_states_wrong_is_said_before_any_line_comes(option: str, said: str) -> None:
    """The unit that is none was the fault of each line, which was shown as such."""
    with pytest.raises(InputError) as refused:
        source_of(f"udp://:9000?{option}")
    assert str(refused.value).startswith(f"udp://:9000?{option}: {said}")
    source_of(f"udp://:9000?units=force=kgf,torque=kgfm&columns=t,{WRENCH}&orientation=auto").close()


def test_a_port_that_nobody_sends_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactwrench.live.sources.lines._Lines.WAITS", 0.2)
    port = free_port()
    assert refusal(source_of(f"udp://:{port}")) == (
        f"udp://:{port}: found port {port} {YET}let the sender send to port {port} of this computer"
    )


def test_a_port_of_ipv6_is_bound() -> None:
    source = source_of(f"udp://[::1]:{(port := free_port())}")
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sender, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(source.open)
        while not opening.done():
            sender.sendto(b'{"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}', ("::1", port))
            time.sleep(0.02)
        source.close()
    assert opening.result().wrench


@pytest.mark.skipif(sys.platform == "darwin", reason="one address of this computer's alone is up")
def test_two_that_send_to_one_port_are_not_mixed() -> None:
    """The first counts until no sample of it came for a second; what another computer or program sends meanwhile is
    said. What sends no samples keeps nobody else away, and a program that begins anew is taken from its new port.
    """
    first, again, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3))
    source = source_of(f"udp://127.0.0.1:{(port := free_port())}")
    other.bind(("127.0.0.2", 0))

    def sent(sender: socket.socket, line: str = "") -> None:
        fx = 2.0 if sender is other else 1.0
        whole = line or f'{{"fx": {fx}, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}}'
        sender.sendto(whole.encode(), ("127.0.0.1", port))

    def came(*senders: socket.socket) -> Batch:
        for sender in senders:
            sent(sender)
        return source.read(0.2)

    def forces(batch: Batch) -> list[float]:
        return [sample.wrench[0] for sample in batch.samples if sample.wrench]

    with first, again, other, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(source.open)
        while not opening.done():
            sent(first)
            time.sleep(0.02)
        source.read(0.0)
        both, alone = came(other, first, again, other), came(other)
        places = [f"{host} port {port}" for host, port in (other.getsockname(), ("127.0.0.1", again.getsockname()[1]))]
        second = came(first, again)
        time.sleep(1.05)
        sent(first, "hello")
        source.read(0.2)
        time.sleep(1.05)
        sent(first, "hello")
        after = came(other)
        time.sleep(1.05)
        begun_anew = came(again, first)
        source.close()
    assert forces(both) == [1.0]
    said = "another sender, {}, which is not used: let only one program send to this port"
    assert [(note.kind, note.number, note.text) for note in both.notes] == [
        (NoteKind.GARBAGE, 3, said.format(places[0]))
    ]
    assert [(note.kind, note.number, note.text) for note in alone.notes] == [
        (NoteKind.GARBAGE, 1, said.format(places[0]))
    ]
    assert [note.text for note in second.notes] == [said.format(places[1])]
    assert forces(second) == [1.0]
    assert forces(begun_anew) == [1.0, 1.0]  # one of each says nothing yet
    assert begun_anew.notes == []
    assert forces(alone) == []
    assert forces(after) == [2.0]


def test_a_socket_for_each_line_is_one_sender() -> None:
    source = source_of(f"udp://:{(port := free_port())}")

    def sent(k: int) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b'{"fx": %d, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}' % k, ("127.0.0.1", port))

    with ThreadPoolExecutor(1) as pool:
        opening = pool.submit(source.open)
        while not opening.done():
            sent(-1)
            time.sleep(0.02)
        source.read(0.0)
        for k in range(50):
            sent(k)
        came = source.read(0.2)
        source.close()
    assert [sample.wrench[0] for sample in came.samples if sample.wrench] == list(range(50))
    assert came.notes == []


@pytest.mark.parametrize("at_once", [False, True])
def test_a_program_that_begins_anew_is_taken_from_its_new_port_soon(
    at_once: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that is not answered for a second stops. Two at once are another matter."""
    monkeypatch.setattr(datagrams, "GONE", 0.15)  # a pause of this machine is none of a program
    source = source_of(f"udp://:{(port := free_port())}")
    old, new = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))

    def sent(sender: socket.socket) -> None:
        line = b'{"fx": %d, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}' % (sender is new)
        sender.sendto(line, ("127.0.0.1", port))
        time.sleep(0.01)

    with old, new, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(source.open)
        while not opening.done():
            sent(old)
        came = source.read(0.0)
        for k in range(60):
            if at_once or k < 10:
                sent(old)
            elif k == 10:
                time.sleep(0.2)
            if k >= 10:
                sent(new)
            came.add(source.read(0.0))
        source.close()
    forces = [sample.wrench[0] for sample in came.samples if sample.wrench]
    assert sum(forces) == (0.0 if at_once else 50.0)
    assert bool(came.notes) == at_once


def test_two_programs_that_begin_together_are_soon_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datagrams, "GONE", 1.0)  # a pause of this machine is none of a program
    first, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    source = source_of(f"udp://:{(port := free_port())}")
    with first, other, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(source.open)
        while not opening.done():
            for fx, sender in enumerate((first, other), 1):
                sender.sendto(b'{"fx": %d, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}' % fx, ("127.0.0.1", port))
            time.sleep(0.02)
        forces = [sample.wrench[0] for sample in source.read(0.0).samples if sample.wrench]
        source.close()
    one = forces[0]  # of the first it may be lost that the port was not open yet
    assert forces[:5] == [one, 3.0 - one, one, 3.0 - one, one]
    assert set(forces[5:]) == {one}


@pytest.mark.parametrize("there", ["127.0.0.1", "::1"])
def test_a_port_without_an_address_is_one_of_ipv6_too(there: str) -> None:
    source = source_of(f"udp://:{(port := free_port())}")
    family = socket.AF_INET6 if ":" in there else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as sender, ThreadPoolExecutor(1) as pool:
        opening = pool.submit(source.open)
        while not opening.done():
            sender.sendto(b'{"fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}', (there, port))
            time.sleep(0.02)
        source.close()
    assert opening.result().wrench


@pytest.mark.parametrize(("name", "leaps"), [("t", True), ("t_ms", False)])
def test_ms_since_power_on_under_a_name_without_a_unit_are_said_and_not_used(name: str, leaps: bool) -> None:
    decoder, batch, intake = LinesDecoder(Naming(), None), Batch(), Intake("udp://:9000", "sensor")
    for k in range(100):
        t = 5 * k + 13_700_000
        line = f'{{"{name}": {t}, "fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}}\n'
        decoder.feed(line.encode(), 0.005 * k, batch)
    flaws = [sample.flaw for _, sample in intake.take(batch)]
    said = "broken: t goes on by 5 s a line, expected s: name its unit, as t_ms, t_us or t_ns"
    assert flaws == ([NEVER_KNOWN] * 10 + [said] * 90 if leaps else [""] * 100)


def test_a_clock_that_is_set_once_is_no_other_unit() -> None:
    decoder, batch = LinesDecoder(Naming(), None), Batch()
    for k in range(100):
        t = 0.005 * k + (1_000.0 if k >= 50 else 0.0)
        decoder.feed(f'{{"t": {t}, "fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}}\n'.encode(), 0.005 * k, batch)
    assert [sample.flaw for sample in batch.samples] == [""] * 100
    assert [note.kind for note in batch.notes] == [NoteKind.RESTARTED]


def test_numbers_that_begin_with_no_digit_are_no_header() -> None:
    batch = decoded(f"nan,1,2,3,4,5,0,0,0,1\n{WRENCH},qx,qy,qz,qw\n1,2,3,4,5,6,0,0,0,1\n")
    assert [note.kind for note in batch.notes] == [NoteKind.GARBAGE]
    assert [sample.wrench for sample in batch.samples] == [(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
