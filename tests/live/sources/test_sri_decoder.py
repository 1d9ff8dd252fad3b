"""SRI's packets from bytes cut anywhere, with anything between."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactwrench.live.source import Batch, NoteKind
from contactwrench.live.sources.sri import SriDecoder


def packet(number: int, *wrench: float) -> bytes:
    data = struct.pack("<6f", *(wrench or (float(number), -1.0, 2.5, 0.25, 0.5, -0.125)))
    return b"\xaa\x55" + struct.pack(">HH", 27, number % 65_536) + data + bytes([sum(data) % 256])


def decoded(pieces: list[bytes]) -> Batch:
    decoder, batch = SriDecoder(1_000.0), Batch()
    for k, piece in enumerate(pieces):
        decoder.feed(piece, 50.0 + 1e-3 * k, batch)
    return batch


def pieces_of(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in pairwise(places)]


@given(st.lists(st.integers(0, 10_000), max_size=30), st.integers(0, 65_535))
def test_packets_may_be_cut_anywhere(cuts: list[int], start: int) -> None:
    stream = b"".join(packet(start + k) for k in range(8))
    batch = decoded(pieces_of(stream, cuts))
    assert [sample.device for sample in batch.samples] == pytest.approx([1e-3 * k for k in range(8)])
    assert [sample.wrench[0] for sample in batch.samples if sample.wrench] == [float(start + k) for k in range(8)]
    assert batch.notes == []


@given(st.lists(st.integers(0, 10_000), max_size=10), st.binary(min_size=1, max_size=60))
def test_garbage_costs_no_packet(cuts: list[int], garbage: bytes) -> None:
    stream = packet(0) + packet(1) + garbage + packet(2) + packet(3) + packet(4)
    batch = decoded(pieces_of(stream, cuts))
    numbers = [sample.wrench[0] for sample in batch.samples if sample.wrench]
    assert numbers == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert sum(note.number for note in batch.notes if note.kind == NoteKind.GARBAGE) >= len(garbage)


@given(st.integers(6, 30), st.integers(1, 255))
def test_a_wrong_sum_is_one_lost_sample(place: int, change: int) -> None:
    spoiled = bytearray(packet(2))
    spoiled[place] ^= change
    batch = decoded([packet(0) + packet(1) + bytes(spoiled) + packet(3)])
    assert [sample.wrench[0] for sample in batch.samples if sample.wrench] == [0.0, 1.0, 3.0]
    assert [note.kind for note in batch.notes] == [NoteKind.WRONG_SUM, NoteKind.LOST]


def test_answers_before_the_first_packet_are_no_garbage() -> None:
    assert decoded([b"ACK+GSD=1$OK\r\n" + packet(0)]).notes == []


def test_a_number_that_is_none_is_a_flaw() -> None:
    batch = decoded([packet(0, *[float("nan")] * 6)])
    assert batch.samples[0].flaw == "broken: no number"


@given(st.binary(max_size=400))
def test_any_bytes_are_read(data: bytes) -> None:
    decoded([data])
