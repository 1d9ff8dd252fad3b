"""RTDE's data packages from bytes cut anywhere, with anything between; the flange against scipy."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactwrench.geometry.arrays import Array
from contactwrench.lab.sockets import Client
from contactwrench.lab.truth import Plain
from contactwrench.lab.ur import Ur
from contactwrench.live.source import Batch, NoteKind
from contactwrench.live.sources.ur import COMPENSATED, RAW, Recipe, UrDecoder
from contactwrench.live.uri import source_of
from tests.live.sources.test_sri_decoder import pieces_of
from tests.support.devices import refusal

NAMES = ["timestamp", "actual_TCP_pose", "tcp_offset", "actual_q", "safety_status", "robot_mode", RAW]
TYPES = ["DOUBLE", *["VECTOR6D"] * 3, "INT32", "INT32", "VECTOR6D"]
ZERO = (0.0,) * 6


def data(t: float, pose: object = ZERO, offset: object = ZERO, wrench: object = ZERO, state: object = (1, 7)) -> bytes:
    values = struct.pack(">B19d2i6d", 1, t, *pose, *offset, *ZERO, *state, *wrench)  # type: ignore[misc]
    return struct.pack(">HB", 3 + len(values), ord("U")) + values


def message(text: str) -> bytes:
    said = text.encode()
    body = bytes([len(said)]) + said + bytes([3]) + b"urc" + bytes([1])
    return struct.pack(">HB", 3 + len(body), ord("M")) + body


def decoded(pieces: list[bytes], wrench: str = RAW) -> Batch:
    names = [*NAMES[:-1], wrench]
    decoder, batch = UrDecoder(Recipe(1, names, TYPES), 500.0, wrench), Batch()
    for k, piece in enumerate(pieces):
        decoder.feed(piece, 50.0 + 2e-3 * k, batch)
    return batch


class Pushed(Plain):
    """A signal that is touched."""

    def true_contact(self, t: float) -> Array:
        """In flange axes, about the flange."""
        return np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])


@pytest.mark.parametrize(
    ("cb3", "said"),
    [
        (True, "moved from the TCP, about which a CB3 says it, to the flange"),
        (False, "about the flange, as an e-series says it; of a sensor that a URCap feeds in, it may be about the TCP"),
    ],
)
def test_the_compensated_torque_is_about_the_flange(cb3: bool, said: str) -> None:
    """Of a CB3 it stayed about the TCP, off by the offset times the force."""
    with Ur(Pushed(), cb3=cb3, tcp_offset=(0.01, 0.1, 0.2, 0.3, 0.5, 0)) as fake:
        source = source_of(f"{fake.uri}?force=compensated")
        about = source.open()
        wrench = source.read(1.0).samples[0].wrench
        source.close()
    assert about.settings["torque"] == said
    assert wrench == pytest.approx(Pushed().true_contact(0.0), abs=1e-9)


def test_a_field_in_use_is_said() -> None:
    """It was left out, or PolyScope was to be updated."""

    class Used(Ur):
        def _set_up(self, client: Client, payload: bytes) -> bytes:
            names = payload[8:].split(b",")
            return b"\0" + b",".join(b"IN_USE" if each == b"tcp_offset" else b"DOUBLE" for each in names)

    with Used(Plain()) as fake:
        assert refusal(source_of(fake.uri)) == (
            f"{fake.uri}: found tcp_offset in use by another client of RTDE, expected it free: "
            "end that one, or its input"
        )


six = st.tuples(*[st.floats(-1.5, 1.5)] * 6)


@given(st.lists(st.integers(0, 10_000), max_size=30))
def test_packages_may_be_cut_anywhere(cuts: list[int]) -> None:
    stream = b"".join(data(10.0 + 0.002 * k, wrench=(k, 0, 0, 0, 0, 0)) for k in range(6))
    batch = decoded(pieces_of(stream, cuts))
    assert [sample.device for sample in batch.samples] == pytest.approx([0.002 * k for k in range(6)])
    assert [sample.wrench[0] for sample in batch.samples if sample.wrench] == [float(k) for k in range(6)]
    assert batch.notes == []


@settings(max_examples=40)
@given(st.lists(st.integers(0, 10_000), max_size=10), st.binary(min_size=1, max_size=60), st.text(max_size=30))
def test_garbage_and_messages_cost_no_package(cuts: list[int], garbage: bytes, text: str) -> None:
    """Garbage that begins as a message may hide what follows, but no more than one message's length."""
    stream = [data(0.0), data(0.002), message(text), data(0.004), b"\xff" + garbage, *(data(k / 500) for k in (3, 4))]
    batch = decoded(pieces_of(b"".join(stream), cuts))
    assert [sample.device for sample in batch.samples] == pytest.approx([0.0, 0.002, 0.004, 0.006, 0.008])
    assert [note.text for note in batch.notes if note.kind == NoteKind.STATUS] == [f"the robot says {text!r}"]
    assert sum(note.number for note in batch.notes if note.kind == NoteKind.GARBAGE) == len(garbage) + 1


@given(six, six, six)
def test_the_flange_is_the_tcp_without_its_offset(
    pose: tuple[float, ...], offset: tuple[float, ...], f: tuple[float, ...]
) -> None:
    for wrench in (RAW, COMPENSATED):
        (sample,) = decoded([data(1.0, pose, offset, f)], wrench).samples
        R = Rotation.from_rotvec(pose[3:]) * Rotation.from_rotvec(offset[3:]).inv()
        assert sample.orientation is not None
        assert sample.position is not None
        assert (Rotation.from_quat(sample.orientation) * R.inv()).magnitude() < 1e-12
        assert np.allclose(sample.position + R.apply(offset[:3]), pose[:3])
        turned = R.inv().apply(np.reshape(np.array(f), (2, 3))).ravel() if wrench == COMPENSATED else f
        assert np.allclose(sample.wrench, turned)  # type: ignore[arg-type]


def test_a_robot_mode_without_a_safety_status_is_no_safety_status() -> None:
    """An old PolyScope has no safety_status: 7 is a robot that runs, no emergency stop; 3 has no power."""
    recipe = Recipe(1, ["timestamp", "actual_TCP_pose", "robot_mode"], ["DOUBLE", "VECTOR6D", "INT32"])
    decoder, batch = UrDecoder(recipe, 500.0, ""), Batch()
    for k, mode in enumerate((7, 3)):
        values = struct.pack(">B7di", 1, 0.002 * k, *ZERO, mode)
        decoder.feed(struct.pack(">HB", 3 + len(values), ord("U")) + values, 50.0 + 2e-3 * k, batch)
    assert [note.text for note in batch.notes] == ["power off"]
    assert [sample.flaw for sample in batch.samples] == ["", "off: power off"]


def test_a_state_is_said_when_it_changes() -> None:
    states = [(1, 7), (1, 7), (3, 7), (3, 7), (9, 7), (1, 3), (1, 7), (1, 7)]
    batch = decoded([data(0.002 * k, state=state) for k, state in enumerate(states)])
    assert [note.text for note in batch.notes] == [
        "protective stop",
        "fault",
        "power off",
        "the robot is well again",
    ]
    flaws = [sample.flaw for sample in batch.samples]
    assert flaws == ["", "", "", "", "broken: fault", "off: power off", "", ""]


def test_stamps_that_stand_or_run_back_are_seen() -> None:
    times = [*(0.002 * k for k in range(-6, 1)), 0.002, 0.002, 0.004, 0.010, 0.008, 0.012]
    kinds = [note.kind for note in decoded([data(5.0 + t) for t in times]).notes]
    assert kinds == [NoteKind.REPEATED, NoteKind.LOST, NoteKind.DISORDERED]


@given(st.binary(max_size=400))
def test_any_bytes_are_read(garbage: bytes) -> None:
    decoded([garbage])


def test_a_slower_controller_than_was_asked_for_loses_nothing() -> None:
    """A CB3 of 125 Hz asked for 500; a package that was lost while that was learnt is counted."""
    batch = decoded([data(0.008 * k) for k in range(30) if k not in (3, 20)])
    assert [(note.kind, note.number) for note in batch.notes] == [(NoteKind.LOST, 1)] * 2
