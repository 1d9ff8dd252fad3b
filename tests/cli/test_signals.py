"""Signals that ask the program to end, a terminal that is gone among them."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from contactwrench.cli.streams import caught

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

came_to: list[int] = []


@pytest.fixture(autouse=True)
def _own_handlers() -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda number, _: came_to.append(number)) for number in numbers}
    came_to.clear()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_was_begun_ends_in_order_and_then_the_program_by_that_signal(number: signal.Signals) -> None:
    with caught() as came:
        os.kill(os.getpid(), number)
        assert came == [number]
        assert came_to == []
    assert came_to == [number]


def test_a_terminal_that_is_gone_is_ignored_under_nohup() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with caught() as came:
        os.kill(os.getpid(), signal.SIGHUP)
        assert came == []
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN


def test_without_a_signal_all_is_as_before() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with caught() as came:
        assert came == []
    assert signal.getsignal(signal.SIGTERM) is before
    assert came_to == []
