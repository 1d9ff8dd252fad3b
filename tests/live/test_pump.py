"""Which thread reads the sensor: the worker while it waits, the reader while that is busy, and one alone by default."""

from __future__ import annotations

from threading import current_thread
from time import sleep

import pytest

from contactwrench.live.pump import Pump, Reader
from contactwrench.live.session import Session
from contactwrench.live.source import About, Batch, DeviceError, Sample, now
from tests.support.chain import NOISE

ABOUT = About("counting", wrench=True, orientation=True, rate=500.0)
NOT_TURNED = (0.0, 0.0, 0.0, 1.0)
BUSY = 0.4


class Counting:
    """A device that counts its samples; `read_by` are the threads that read it, by the sample's number."""

    uri = "counting:"

    def __init__(self, any_thread: bool) -> None:
        self.any_thread, self.read_by, self.opened, self.fails = any_thread, list[str](), list[str](), False

    def open(self) -> About:
        """Note the thread."""
        self.opened.append(current_thread().name)
        return ABOUT

    def read(self, timeout: float) -> Batch:
        """A sample, or what it is to fail with."""
        sleep(min(timeout, 0.002))
        if self.fails:
            self.fails = False
            raise DeviceError("counting: found the cable pulled out, expected samples: plug it in")
        self.read_by.append(current_thread().name)
        reading = (*NOISE.tolist(),)
        return Batch([Sample(now(), 0.002 * len(self.read_by), reading, NOT_TURNED)])

    def close(self) -> None:
        """Nothing to close."""


def ran(source: Counting, fails: bool = False, later: float = BUSY + 0.4) -> tuple[list[str], list[str]]:
    """The threads that read `source` before the worker is busy and until it is closed `later`, s, all of which was
    taken; and what the session said.
    """
    busy = [0.0]

    def publish(_: bytes) -> None:
        seconds, busy[0] = busy[0], 0.0
        sleep(seconds)

    session = Session(None, sensor="counting:", robot=None)
    pump = Pump(session, {"sensor": Reader(source, source.open(), Batch())}, publish=publish)
    pump.start()
    sleep(0.3)
    source.fails = fails
    busy[0] = BUSY
    sleep(later)
    pump.close()
    assert pump.failure is None
    assert session.snapshot(now()).devices[0].samples == len(source.read_by)
    return source.read_by, [event.kind for event in session.snapshot(now()).events]


def test_the_worker_reads_what_it_waits_for_and_the_reader_while_it_is_busy() -> None:
    read_by, said = ran(Counting(any_thread=True))
    assert read_by[-1] == "worker"
    assert read_by.count("reads counting:") > 20
    assert said == ["connected"]


def test_what_came_until_it_is_closed_is_taken_though_the_worker_is_busy() -> None:
    read_by, _ = ran(Counting(any_thread=True), later=0.5 * BUSY)
    assert read_by.count("reads counting:") > 20


@pytest.mark.parametrize("any_thread", [True, False])
def test_what_fails_in_either_thread_is_connected_to_again_by_the_reader(any_thread: bool) -> None:
    source = Counting(any_thread)
    _, said = ran(source, fails=True, later=BUSY + 1.3)
    assert [kind for kind in said if kind in ("down", "back")] == ["down", "back"]
    assert source.opened == ["MainThread", "reads counting:"]


def test_a_source_that_does_not_say_so_is_read_by_one_thread() -> None:
    read_by, _ = ran(Counting(any_thread=False))
    assert set(read_by) == {"reads counting:"}
