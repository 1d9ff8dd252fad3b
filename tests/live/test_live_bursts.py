"""Samples that come many at a time: said once, spread evenly where they have no time of their own, and over again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import nan
from typing import Any

import numpy as np
import pytest

from contactwrench.lab.device import Packets
from contactwrench.lab.lines import TcpLines
from contactwrench.live.intake import Intake
from contactwrench.live.snapshot import Event
from contactwrench.live.source import About, Batch, Sample
from tests.support.chain import Swinging, running
from tests.support.live_world import Array

RATE, END, LASTS = 1_000.0, 4.0, 6.0
"""Hz; s after which samples come one by one, and s in all."""
TOLD = "each contact wrench is told up to so much later: let the device send each sample at once"
SPREAD = "they have no time of their own and are spread evenly, "


def taken(came: Array, own: bool) -> tuple[Array, list[bool], list[tuple[str, str]]]:
    """Of samples each ms, as they come: the times that they are given, which can be used, and what is said."""
    intake, events = Intake("tcp://x", "sensor"), list[Event]()
    intake.opened(About("a sensor", wrench=True, orientation=False, rate=RATE), 0.0)
    times, fine, looked = list[float](), list[bool](), 0.0
    for arrival in np.unique(came).tolist():
        while looked < arrival:
            looked = min(looked + 0.02, arrival)
            events += intake.look(looked)
        due = np.flatnonzero(came == arrival) / RATE
        batch = Batch([Sample(arrival, each if own else nan, (0.0,) * 6) for each in due.tolist()])
        for t, sample in intake.take(batch):
            times.append(t)
            fine.append(not sample.flaw)
    return np.array(times), fine, [(event.kind, event.text) for event in events]


def in_bursts(period: float, held_up: Sequence[int] = (), parts: int = 1) -> Array:
    """Arrivals (n,) of samples each ms, in bursts until `END`, in some parts each; some half a period late."""
    due = np.arange(1, LASTS * RATE + 1) / RATE
    burst = np.ceil(due / period - 1e-9)
    late = 0.5 * period * np.isin(burst, held_up)
    within = np.floor((due - (burst - 1) * period) / period * parts * 0.999) * 5e-4
    return np.where(due > END + 1e-9, due + 0.002, np.round(burst * period + late + within, 6))


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("own", [False, True], ids=["no time", "its own time"])
@pytest.mark.parametrize("ms", [40, 100, 200])
def test_steady_bursts_are_said_once_and_can_be_used(ms: int, own: bool, parts: int) -> None:
    period = 1e-3 * ms
    times, fine, said = taken(in_bursts(period, parts=parts), own)
    known = round(8.0 * ms)
    assert all(fine[known : round(END * RATE)])
    assert all(fine[-round(0.5 * RATE) :])
    late = times[known:-500] - np.arange(known + 1, len(times) - 499) / RATE
    assert np.ptp(late) < 0.1 * period + 2e-3
    assert [text for kind, text in said if kind == "bursts"] == [
        f"samples come in bursts, {ms} ms from one to the next: {'' if own else SPREAD}{TOLD}",
        "samples come evenly again",
    ]
    assert {kind for kind, _ in said} <= {"bursts", "late"}
    assert [kind for kind, _ in said].count("late") <= 2


def test_a_burst_that_is_held_up_is_not_used_and_ends_nothing() -> None:
    fine, said = taken(in_bursts(0.1, held_up=[20]), own=False)[1:]
    assert all(fine[800:1900])
    assert not any(fine[1900:2000])
    assert all(fine[2100:4000])
    assert [kind for kind, _ in said].count("bursts") == 2


def test_stops_as_they_come_are_no_bursts_and_are_said_every_five_seconds() -> None:
    rng = np.random.default_rng(0)
    borders = np.cumsum(rng.uniform(0.06, 0.24, 60))
    due = np.arange(1, LASTS * RATE + 1) / RATE
    came = np.round(borders[np.searchsorted(borders, due)], 6)
    said = taken(came, own=False)[2]
    assert [kind for kind, _ in said] == ["late", "late"]
    assert all(text.startswith("late: nothing for ") for _, text in said)
    assert said[1][1].endswith("samples were not used")


class Untimed(TcpLines):
    """Lines without `t`, ten times a second."""

    def __init__(self, signal: Swinging) -> None:
        super().__init__(signal, 250.0)
        self.clock._block = 25

    def _packets(self, *given: Any) -> Packets:
        return [b'{"fx"' + line.partition(b'"fx"')[2] for line in super()._packets(*given)]


def test_a_sensor_without_a_time_in_bursts_becomes_valid() -> None:
    """On an arm that swings, nothing that is valid is wrong."""
    fake = Untimed(Swinging())
    with running({"sensor": fake}, {"sensor": "?rate=250"}) as chain:
        assert chain.wait(lambda: chain.said(0, ("bursts",), chain.uris["sensor"]), 3.0) < 3.0
        since = chain.turns[-1].arrival[-1]
        assert chain.wait(lambda: chain.valid_since(since)) < 1.0
        assert chain.wait(lambda: len(chain.turns) > 60) < 10.0
        assert chain.wrong(0) == []
    said = [event.text for event in chain.events if event.kind == "bursts"]
    assert re.fullmatch(rf"samples come in bursts, \d+ ms from one to the next: {SPREAD}{TOLD}", said[0])


def behind_a_gap(came: list[float], true: list[float], rate: float) -> list[tuple[float, float]]:
    """Of samples without a time of their own that are used: when each was taken, and the time that it was given, s."""
    intake = Intake("tcp://sensor", "sensor")
    intake.opened(About("a sensor", wrench=True, orientation=False), 0.0)
    used = list[tuple[float, float]]()
    for arrival, taken in zip(came, true, strict=True):
        batch = Batch([Sample(arrival, wrench=(taken, 0.0, 0.0, 0.0, 0.0, 0.0))])
        used += [(sample.wrench[0], t) for t, sample in intake.take(batch) if sample.wrench and not sample.flaw]
        intake.look(arrival)
    return [each for each in used if each[0] > 100.0 / rate]


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("pace", [1.25, 1.5, 2.0, 5.0, 50.0])
def test_a_queue_that_comes_slowly_behind_a_gap_is_not_of_now(pace: float, rate: float) -> None:
    """What was held up for half a second, and then comes at some times its pace, is half a second old at first."""
    true, came, free = [k / rate for k in range(int(10.0 * rate))], [], 0.0
    for t in true:
        free = max(t, free, 4.5 if t > 4.0 else 0.0) + 1.0 / (pace * rate)
        came.append(free)
    used = behind_a_gap(came, true, rate)
    assert max(t - taken for taken, t in used) < 0.02 + 1.0 / rate
    assert sum(taken > 7.2 for taken, _ in used) == sum(taken > 7.2 for taken in true)


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_behind_a_gap_in_which_all_was_lost_samples_are_soon_used(rate: float) -> None:
    rng = np.random.default_rng(1)
    true = [k / rate for k in range(int(10.0 * rate)) if not 4.0 < k / rate < 4.5]
    came = np.maximum.accumulate(np.array(true) + 0.3 / rate * rng.random(len(true))).tolist()
    used = [taken for taken, _ in behind_a_gap(came, true, rate)]
    wait = max(0.05, 10.0 / rate) + 2.0 / rate
    assert min(taken for taken in used if taken > 4.4) < 4.5 + wait
    assert sum(taken > 4.5 + wait for taken in used) == sum(taken > 4.5 + wait for taken in true)


@pytest.mark.parametrize("pace", [1.25, 2.0])
@pytest.mark.parametrize("gap", [6.0, 600.0])
def test_a_stream_that_comes_faster_than_before_is_used_within_seconds(pace: float, gap: float) -> None:
    """A program that was restarted at another rate was refused for as long as it had been away, and longer."""
    begins = 4.0 + gap
    true = [k / 100.0 for k in range(400)] + [begins + k / (100.0 * pace) for k in range(int(1500 * pace))]
    used = [taken for taken, _ in behind_a_gap(true, true, 100.0)]
    assert min(taken for taken in used if taken >= begins) < begins + 5.1
    assert sum(taken > begins + 5.1 for taken in used) == sum(taken > begins + 5.1 for taken in true)


def test_a_device_that_is_connected_to_again_holds_nothing_back() -> None:
    intake = Intake("tcp://sensor", "sensor")
    about = About("a sensor", wrench=True, orientation=False)
    flaws = list[str]()
    for begins, rate in ((0.0, 100.0), (60.0, 200.0)):
        intake.opened(about, begins)
        for k in range(300):
            batch = Batch([Sample(begins + k / rate, wrench=(0.0,) * 6)])
            flaws += [sample.flaw for _, sample in intake.take(batch)]
    assert not any(flaws[-200:])
