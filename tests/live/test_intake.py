"""What is said of a device from how its samples come."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise

import numpy as np
import pytest

from contactwrench.live.clock import LATE
from contactwrench.live.counter import Counter
from contactwrench.live.intake import NEVER_KNOWN, UNKNOWN, Intake
from contactwrench.live.snapshot import Event
from contactwrench.live.source import About, Batch, NoteKind, Sample


def said(asked: float, *spans: tuple[float, float], burst: float = 0.0) -> list[Event]:
    """Of a device that stated the rate `asked`, and comes at other ones, each for so many s; 0 Hz is silence. What
    comes within `burst` s comes together.
    """
    intake, events = Intake("sri://sensor", "sensor"), list[Event]()
    intake.opened(About("a sensor", wrench=True, orientation=False, rate=asked), 0.0)
    due, begin = list[float](), 0.0
    for rate, seconds in spans:
        due += [begin + (k + 1) / rate for k in range(round(rate * seconds))]
        begin += seconds
    came = [-(-each // burst) * burst if burst else each for each in sorted(due)]
    for before, t in pairwise(0.02 * look for look in range(round(begin / 0.02) + 1)):
        new = came[bisect_right(came, before) : bisect_right(came, t)]
        intake.take(Batch([Sample(each, each, wrench=(0.0,) * 6) for each in new]))
        events += intake.look(t)
    return events


def test_a_slow_device_is_not_silent_between_two_samples() -> None:
    assert said(3.0, (3.0, 60.0)) == []


def test_silence_is_said_once_and_soon() -> None:
    (event,) = said(500.0, (500.0, 5.0), (0.0, 3.0))
    assert event.kind == "silent"
    assert 5.2 < event.t < 5.4


@pytest.mark.parametrize("every", [0.02, 0.2, 0.5])
def test_a_computer_that_stalls_is_no_silence_of_the_device(every: float) -> None:
    """What came meanwhile is taken one look later; a program that looks seldom is told of true silence all the same."""
    intake = Intake("ur://robot", "robot")
    intake.opened(About("a robot", wrench=False, orientation=True, rate=100.0), 0.0)
    for k in range(300):
        if k % 50 < 20:
            t = 0.01 * k
            assert [event for event in intake.look(t) if event.kind == "silent"] == []
            intake.take(Batch([Sample(t, t, orientation=(0.0, 0.0, 0.0, 1.0))]))
    (silent,) = [event for look in range(1, 20) for event in intake.look(t + every * look)]
    assert silent.kind == "silent"
    assert silent.t < t + max(0.3, 4.0 * every)


def test_silence_in_a_recording_is_said_however_fast_it_is_played() -> None:
    """As fast as it goes, a look is two seconds of it behind the last one."""
    intake = Intake("run.csv", "robot")
    intake.opened(About("run.csv", wrench=True, orientation=True, rate=100.0, replay=True), 0.0)
    intake.take(Batch([Sample(0.01 * k, orientation=(0.0, 0.0, 0.0, 1.0)) for k in range(200)]))
    assert intake.look(2.0) == []
    assert [event.text for event in intake.look(4.0)] == ["nothing for 2.01 s"]


@pytest.mark.parametrize("asked", [83.3, 100.0, 1_000.0])
@pytest.mark.parametrize("share", [0.5, 2.0, 4.0])
def test_another_rate_is_said_soon_and_again_after_it_was_right(asked: float, share: float) -> None:
    """However long it was right: the second time is no part of the first."""
    for right in (0.5, 0.9, 3.0):
        other = share * asked
        events = said(asked, (asked, 2.3), (other, 1.0), (asked, right), (other, 1.0), (asked, 3.0))
        assert [event.kind for event in events] == ["rate", "rate"]
        assert 2.3 < events[0].t < 2.3 + 0.5
        assert 3.3 + right < events[1].t < 3.3 + right + 0.5


@pytest.mark.parametrize("asked", [83.3, 125.0, 1_000.0])
@pytest.mark.parametrize("share", [0.25, 0.5, 2.0, 4.0])
def test_another_rate_is_said_soon_and_as_it_is_whenever_it_begins(asked: float, share: float) -> None:
    """A window in which it began is no part of what is said."""
    for begin in (2.3 + 0.011 * k for k in range(20)):
        (event,) = said(asked, (asked, begin), (share * asked, 1.0))
        assert begin < event.t < begin + 0.5
        assert abs(float(event.text.partition(" ")[0]) / (share * asked) - 1.0) < 0.1


@pytest.mark.parametrize("rate", [85.0, 115.0])
def test_a_rate_that_is_a_little_off_is_said_surely(rate: float) -> None:
    (event,) = said(100.0, (100.0, 3.2), (rate, 10.0))
    assert abs(float(event.text.partition(" ")[0]) - rate) < 3.0
    assert 4.2 < event.t < 4.8


@pytest.mark.parametrize("percent", [*range(3, 8), *range(26, 34), *range(46, 54)])
def test_a_rate_at_the_limit_is_said_once_at_the_most(percent: int) -> None:
    events = said(100.0, (100.0, 3.0), (100.0 - percent, 30.0), burst=0.01)
    assert [event.kind for event in events] == ["rate"] * (percent > 10)


@pytest.mark.parametrize("stall", [0.05, 0.1, 0.15, 0.2])
def test_a_stall_is_no_rate(stall: float) -> None:
    """Wherever it begins; what waited comes behind it, all at once."""
    for begin in (3.0 + 0.01 * k for k in range(50)):
        assert said(100.0, (100.0, begin), (0.0, stall), (1e4 * stall, 0.01), (100.0, 2.0)) == []


@pytest.mark.parametrize("burst", [0.05, 0.1, 0.13, 0.16, 0.2, 0.24])
def test_bursts_at_the_right_rate_are_no_rate(burst: float) -> None:
    """As a TCP stack makes them that acknowledges late."""
    assert [event for event in said(1_000.0, (1_000.0, 20.0), burst=burst) if event.kind == "rate"] == []


def said_when_busy(asked: float, seed: int, *spans: tuple[float, float]) -> list[Event]:
    """As `said`, on a computer that stalls for 20 to 300 ms a third of the time, and takes 3 samples each half ms."""
    intake, events, rng = Intake("sri://sensor", "sensor"), list[Event](), np.random.default_rng(seed)
    intake.opened(About("a sensor", wrench=True, orientation=False, rate=asked), 0.0)
    due, begin = list[float](), 0.0
    for rate, seconds in spans:
        due += [begin + (k + 1) / rate for k in range(round(rate * seconds))]
        begin += seconds
    t, stalls = 0.0, rng.exponential(0.32)
    while due:
        if t >= stalls:
            t += rng.uniform(0.02, 0.3)
            stalls = t + rng.exponential(0.32)
        came = [each for each in due[:3] if each <= t]
        del due[: len(came)]
        intake.take(Batch([Sample(t, each, wrench=(0.0,) * 6) for each in came]))
        events += intake.look(t)
        t += 0.0005
    return events


@pytest.mark.parametrize("asked", [83.3, 125.0, 500.0])
def test_a_busy_computer_makes_no_rate_and_hides_none(asked: float) -> None:
    """A stall that ended within a burst counted as too few, and half the rate was then not said for seconds."""
    for seed in range(20):
        assert [each for each in said_when_busy(asked, seed, (asked, 8.0)) if each.kind == "rate"] == []
        (event,) = [each for each in said_when_busy(asked, seed, (asked, 3.0), (asked / 2, 4.0)) if each.kind == "rate"]
        assert 3.0 < event.t < 4.7


@pytest.mark.parametrize("replay", [True, False])
def test_a_recording_is_asked_for_no_rate_as_it_is_played_at_any(replay: bool) -> None:
    intake = Intake("run.csv", "sensor")
    intake.opened(About("run.csv", wrench=True, orientation=True, rate=500.0, replay=replay), 0.0)
    assert intake.shown(1.0).asked == (None if replay else 500.0)


@pytest.mark.parametrize("anew", [False, True])
@pytest.mark.parametrize("rate", [100.0, 20.0])
def test_behind_a_gap_what_has_no_time_of_its_own_may_be_old(rate: float, anew: bool) -> None:
    """Six are held up, by a network or in a device that is connected to again, and come at once."""
    intake, about = Intake("ft300://sensor", "sensor"), About("a sensor", wrench=True, orientation=False, rate=rate)
    intake.opened(about, 0.0)
    true = [k / rate for k in range(int(2.0 * rate))]
    old = true[-6:]
    flaws = dict[float, str]()
    for begin, came in ((0.0, true[:-6]), (2.0, [2.0] * 6), (2.0, [2.0 + t for t in true])):
        if begin and anew:
            intake.down("gone", 1.9)
            intake.opened(about, 1.95)
        for t in came:
            flaws |= {t: sample.flaw for t, sample in intake.take(Batch([Sample(t, wrench=(0.0,) * 6)]))}
            intake.look(t)
        anew = False
    late = [t for t, flaw in flaws.items() if flaw]
    assert len(old) < len(late)
    assert 2.0 <= min(late) <= max(late) < 2.01 + LATE
    assert {flaw.partition(" s ")[2] for t, flaw in flaws.items() if flaw} == {"before it, and no time of its own"}


def begun_anew(every: float, counts: bool) -> tuple[list[Event], list[str]]:
    """What is said in three seconds of a device of 250 Hz whose count, or clock, begins anew so often, and the flaws of
    its samples.
    """
    intake, counter, events, flaws = Intake("x://sensor", "sensor"), Counter(0.004), list[Event](), list[str]()
    intake.opened(About("a sensor", wrench=True, orientation=False), 0.0)
    for k in range(750):
        batch, row, t = Batch(), k % round(250 * every), 0.004 * k
        device = counter.take(row, t, batch) if counts else 0.004 * row
        if device is not None:
            batch.samples.append(Sample(t, device, wrench=(0.0,) * 6))
        flaws += [sample.flaw for _, sample in intake.take(batch)]
        events += intake.look(t)
    return events, flaws


@pytest.mark.parametrize("counts", [True, False])
def test_a_count_that_begins_anew_on_and_on_is_named(counts: bool) -> None:
    """No time of it is ever known, and so no sample of it used: it is to be said what to do."""
    events, flaws = begun_anew(0.04, counts)
    assert set(flaws) == {UNKNOWN, NEVER_KNOWN}
    assert set(flaws[60:]) == {NEVER_KNOWN}
    late = [event for event in events if event.kind == NoteKind.LATE]
    assert late
    assert late[0].t < 0.6
    assert all(event.text.startswith(NEVER_KNOWN) for event in late)
    assert NEVER_KNOWN == (
        "late: its count or clock begins anew on and on, no time of it is known: let it go on, or leave it out"
    )


@pytest.mark.parametrize("counts", [True, False])
def test_a_device_that_begins_anew_now_and_then_is_in_step_again(counts: bool) -> None:
    _, flaws = begun_anew(0.7, counts)
    assert set(flaws) == {"", UNKNOWN}
    assert flaws.count(UNKNOWN) < 80


def test_times_that_stand_are_said_for_what_they_are_and_seldom() -> None:
    """Lines that all have t = 5: number 5000000 came again, four times a second, and what that is, not."""
    intake, counter, said = Intake("udp://:9000", "sensor"), Counter(1e-6, step=None), list[str]()
    intake.opened(About("lines", wrench=True, orientation=False), 0.0)
    for k in range(1_000):
        arrival, batch = 0.01 * k, Batch()
        if counter.take(5_000_000, arrival, batch) is not None:
            batch.samples.append(Sample(arrival, 5.0, wrench=(0.0,) * 6))
        intake.take(batch)
        said += [event.text for event in intake.look(arrival) if event.kind == NoteKind.REPEATED]
    stands = "several in a row stamped alike: let their time or number go on, or leave it out"
    assert said[0].startswith("number 5000000 came again")
    assert len(said) == 3
    assert all(text.startswith(f"{stands} (and more: ") for text in said[1:])
    batch = Batch()
    new = [counter.take(5_000_000 + k, 10.0 + 0.01 * k, batch) is not None for k in (0, 10_000, 10_000, 20_000)]
    assert new == [False, True, False, True]
    assert [note.text for note in batch.notes] == [stands, "number 5010000 came again"]


def test_stamps_that_go_on_in_steps_are_not_said_to_stand() -> None:
    """A state of 125 Hz that is sent at 500: each stamp came four times, and they were said to be all alike."""
    intake, counter, said = Intake("udp://:9000", "sensor"), Counter(1e-6, step=None), list[str]()
    intake.opened(About("lines", wrench=True, orientation=False), 0.0)
    for k in range(2_000):
        batch = Batch()
        counter.take(k // 4 * 8_000, 0.002 * k, batch)
        intake.take(batch)
        said += [event.text for event in intake.look(0.002 * k) if event.kind == NoteKind.REPEATED]
    assert len(said) == 1
    assert said[0].startswith("several in a row stamped alike: ")
