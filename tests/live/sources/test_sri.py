"""An SRI box that is set otherwise: that it sends counts, other packets, or nothing, is said before a session."""

from __future__ import annotations

import re
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from contactwrench.lab.sri import Sri
from contactwrench.lab.truth import Plain
from contactwrench.live.sources import transport
from contactwrench.live.uri import source_of
from tests.support.devices import numbered, read, refusal

CHANNELS = "SGDM=(A01,A02,A03,A04,A05,A06);E;1;(WMA:1)"
COUNTS = CHANNELS[5:].replace("E", "C")
PACKETS = "expected packets of 31, one sample of six channels, a number and a sum: "
SET_IT = f"set AT+DCKMD=SUM and AT+{CHANNELS} in its maker's program"


class AllAlike(Sri):
    """Its running number does not run."""

    def _packet(self, number: int, rows: Any) -> bytes:
        return super()._packet(7, rows)


class Pairs(Sri):
    """Two samples a packet."""

    def _packet(self, number: int, rows: Any) -> bytes:
        return super()._packet(number, np.repeat(rows[:1], 2, axis=0))


class WrongSums(Sri):
    """Each of them."""

    def _packet(self, number: int, rows: Any) -> bytes:
        packet = super()._packet(number, rows)
        return packet[:-1] + bytes([packet[-1] ^ 1])


class Mute(Sri):
    """It answers, and sends no stream."""

    def _packets(self, *_: Any) -> list[bytes]:
        return []


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "PATIENCE", 2.0)


UNUSABLE: list[tuple[type[Sri], Mapping[str, str], str]] = [
    (Sri, {"DCKMD": "CRC32"}, f"found packets of 34 bytes, {PACKETS}{SET_IT}"),
    (Pairs, {}, f"found packets of 55 bytes, {PACKETS}{SET_IT}"),
    (WrongSums, {}, f"found packets whose sums are all wrong, {PACKETS}{SET_IT}"),
    (AllAlike, {}, f"found no two packets with numbers of their own, {PACKETS}{SET_IT}"),
    (
        Mute,
        {},
        "found no answer, expected packets after AT+GSD: check that this is the SRI interface box, and that no "
        "one else uses it",
    ),
    (
        Sri,
        {"SGDM": COUNTS},
        f"found AD counts ({COUNTS}), expected N and N m: set AT+{CHANNELS} in its maker's program, with the "
        "sensor's decoupling matrix",
    ),
]


def test_a_box_that_sends_nothing_usable_is_refused() -> None:
    """It was connected, and connected again, for ever; and counts were N. All at once: what takes long is to wait."""

    def refused(box: type[Sri], keeps: Mapping[str, str], _: str) -> str:
        with box(numbered(), keeps=keeps) as fake:
            return refusal(source_of(fake.uri)).removeprefix(f"{fake.uri}: ")

    with ThreadPoolExecutor(len(UNUSABLE)) as pool:
        assert list(pool.map(refused, *zip(*UNUSABLE, strict=True))) == [said for *_, said in UNUSABLE]


@pytest.mark.parametrize(
    ("keeps", "told"),
    [
        ({}, {CHANNELS: "done", "unit of its decoupling matrix": "MVPV", "DCKMD=SUM": "done"}),
        (
            {"SGDM": "$ERROR", "DCPCU": "$ERROR", "DCKMD": "$ERROR"},
            {
                CHANNELS: "refused by the box, so whether it sends N and N m is not known",
                "unit of its decoupling matrix": "not told",
                "DCKMD=SUM": "refused by the box",
            },
        ),
        (
            {"SGDM": "", "DCPCU": "", "DCKMD": ""},
            {
                CHANNELS: "not confirmed by the box, so whether it sends N and N m is not known",
                "unit of its decoupling matrix": "not told",
                "DCKMD=SUM": "not confirmed by the box",
            },
        ),
        (
            {"SGDM": "(A01, A02, A03, A04, A05, A06);E;1;(WMA:16)", "DCPCU": "mV"},
            {
                "unit of its decoupling matrix": "MV",
                CHANNELS: "the box has (A01,A02,A03,A04,A05,A06);E;1;(WMA:16)",
                "DCKMD=SUM": "done",
            },
        ),
    ],
    ids=["as told", "refuses", "silent", "otherwise"],
)
def test_what_a_box_says_of_its_settings_is_told(keeps: Mapping[str, str], told: Mapping[str, str]) -> None:
    """An answer of any kind was `done`."""
    with Sri(numbered(), keeps=keeps) as fake:
        source = source_of(fake.uri)
        settings = source.open().settings
        assert len(read(source, 0.1).samples) > 10
        source.close()
    assert {name: settings[name] for name in told} == told


def test_a_box_that_is_asked_how_it_is_set_says_counts() -> None:
    """It does not know the command by which it is set, and what it has is counts."""

    class Old(Sri):
        def _setting(self, name: str, value: str | None) -> str:
            asked = name == "SGDM"
            return (COUNTS if value == "?" else "$ERROR") if asked else super()._setting(name, value)

    with Old(Plain()) as fake:
        assert re.search(r"found AD counts \(.*;C;1;.*\), expected N and N m: ", refusal(source_of(fake.uri)))
