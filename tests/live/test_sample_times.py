"""When samples were taken: clocks that drift, step and stand, networks that delay; and what is kept of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from contactwrench.live import history
from contactwrench.live.clock import LATE, Clock
from contactwrench.live.counter import Counter
from contactwrench.live.intake import Intake
from contactwrench.live.session import Session
from contactwrench.live.sink import Pose, Reading, Turn
from contactwrench.live.source import About, Batch, Note, NoteKind, Sample
from contactwrench.live.sources.lines import LinesDecoder
from contactwrench.recording.tables.columns import Naming
from tests.support.chain import NOISE, calibration
from tests.support.live_world import Array

BLOCK = 0.004


def arrivals(n: int, rate: float, rng: np.random.Generator) -> Array:
    """Of samples that leave in blocks, up to 5 ms late."""
    rows = round(BLOCK * rate)
    last = np.arange(n) // rows * rows + rows - 1
    came: Array = np.maximum.accumulate(last / rate + np.repeat(5e-3 * rng.random(n // rows), rows))
    return came


def timed(clock: Clock, came: Array, device: Array) -> Array:
    """The clock's times, of samples that are fed as they came."""
    borders = [0, *(np.flatnonzero(np.diff(came)) + 1).tolist(), len(came)]
    stamps = list(zip(came.tolist(), device.tolist(), strict=True))
    parts = [[t for t, _ in clock.times(stamps[a:b])] for a, b in pairwise(borders)]
    return np.concatenate(parts)


@pytest.mark.parametrize("ppm", [50.0, -50.0])
@pytest.mark.parametrize("rate", [1000.0, 500.0])
def test_times_are_those_of_sampling_but_for_the_smallest_delay(ppm: float, rate: float) -> None:
    true: Array = np.arange(60.0 * rate) / rate
    times = timed(Clock(), arrivals(len(true), rate, np.random.default_rng(1)), true * (1.0 + 1e-6 * ppm))
    late = (times - true)[true > 30.0]
    assert np.abs(late - np.median(late)).max() < 2e-4
    assert 0.0 <= np.median(late) < 1e-3


@pytest.mark.parametrize("step", [0.3, 3600.0, -0.3, -0.06])
def test_a_clock_that_steps_makes_no_wrong_time_that_is_not_late(step: float) -> None:
    """Forward it is right at once, back within a second; it stays right for the two minutes that it remembers."""
    true = np.arange(0.0, 90.0, 0.01)
    came = true + 1e-4
    times = timed(Clock(), came, true + np.where(true > 40.0, step, 0.0))
    used = came - times < LATE
    assert (np.abs(times - true)[used] < 5e-4).all()
    assert used[(true < 40.0) | (true > 41.1)].all()


@pytest.mark.parametrize("jitter", [0.0, 5e-3])
@pytest.mark.parametrize("step", [-0.012, -0.004])
def test_a_clock_that_stood_for_a_moment_is_followed_in_seconds(step: float, jitter: float) -> None:
    """By the drift of quartz alone 12 ms took half a minute: each contact wrench was told as so much older."""
    true: Array = np.arange(0.0, 60.0, 0.002)
    came = np.maximum.accumulate(true + jitter * np.random.default_rng(4).random(len(true)))
    late = timed(Clock(), came, true + np.where(true > 20.0, step, 0.0)) - true
    assert np.abs(late[((true > 2.0) & (true < 20.0)) | (true > 24.6)]).max() < 5e-4


@pytest.mark.parametrize(("by", "said"), [(0.006, ["6"]), (0.03, ["30"]), (-0.03, []), (0.001, []), (0.0, [])])
@pytest.mark.parametrize("stalls", [0.0, 0.2])
def test_a_network_that_stays_later_is_said_once(by: float, said: list[str], stalls: float) -> None:
    """It looks like a clock that stood: its times follow, and are so much too late."""
    rng, intake, true = np.random.default_rng(7), Intake("netft://x", "sensor"), np.arange(0.0, 40.0, 0.002)
    intake.opened(About("a sensor", wrench=True, orientation=False), 0.0)
    waits = 0.05 + np.where(true > 20.0, by, 0.0) + rng.exponential(5e-4, len(true))
    waits += stalls * (np.abs(true % 7.0 - 5.0) < 0.1)
    texts = list[str]()
    for t, arrival in zip(true.tolist(), np.maximum.accumulate(true + waits).tolist(), strict=True):
        intake.take(Batch([Sample(arrival, t, wrench=(0.0,) * 6)]))
        texts += [event.text for event in intake.look(arrival) if "later than before" in event.text]
    assert texts == [
        f"what it sends comes {ms} ms later than before, and stays so: its clock stood, or the network is slower and "
        "its times are told so much too late: check both"
        for ms in said
    ]


def test_a_stall_moves_no_time() -> None:
    """What a network held up for a second comes at once, with its own times."""
    true = np.arange(0.0, 20.0, 0.002)
    came = np.where((true > 10.0) & (true < 11.0), 11.0, true) + 1e-4
    assert np.abs(timed(Clock(), came, true) - true).max() < 5e-4


@pytest.mark.parametrize("joined", [1, 5, 15])
def test_a_restart_within_a_batch_moves_no_time_before_it(joined: int) -> None:
    """Of 300 samples in fifteen batches, some of them joined; the first after the restart is held up by 30 ms."""
    true = 0.001 * np.arange(300)
    came = np.maximum.accumulate(true + np.where(np.arange(300) == 102, 0.030, 0.0)) + 0.001
    counter, intake, whole = Counter(0.001, 1 << 16), Intake("sri://x", "sensor"), Batch()
    intake.opened(About("a sensor", wrench=True, orientation=False), 0.0)
    late = dict[int, float]()
    for number, rows in enumerate(np.arange(300).reshape(15, 20).tolist(), 1):
        batch = Batch()
        for k in rows:
            device = counter.take(k if k < 100 else k - 100, came[k], batch)
            if device is not None:
                batch.samples.append(Sample(came[k], device, wrench=(k, 0.0, 0.0, 0.0, 0.0, 0.0)))
        whole.add(batch)
        if number % joined == 0:
            taken = intake.take(whole)
            late |= {int(each.wrench[0]): t - true[int(each.wrench[0])] for t, each in taken if each.wrench}
            whole = Batch()
    assert late.keys() == {*range(300)} - {100, 101}  # two that seem to be late ones tell a restart
    assert [late[k] for k in range(100)] == pytest.approx([0.001] * 100, abs=1e-5)
    assert [late[k] for k in range(140, 300)] == pytest.approx([0.001] * 160, abs=1e-5)


def test_lines_of_two_kinds_have_one_clock() -> None:
    decoder, batch = LinesDecoder(Naming(), None, whole=True), Batch()
    for k in range(20):
        t = 5.0 + 0.01 * k
        decoder.feed(b'{"t": %f, "fx": 1, "fy": 0, "fz": 0, "tx": 0, "ty": 0, "tz": 0}' % t, t, batch)
        if k >= 10:
            decoder.feed(b'{"t": %f, "qx": 0, "qy": 0, "qz": 0, "qw": 1}' % t, t, batch)
    assert len(batch.samples) == 30
    assert [each.arrival - each.device for each in batch.samples] == pytest.approx([0.0] * 30, abs=1e-9)


def test_what_waited_when_it_began_makes_no_other_rate() -> None:
    """The first readings come together, without a time of their own: by these the second from which the noise is
    learned would last a thousand times as long.
    """
    session, rng = Session(calibration()), np.random.default_rng(0)
    session.opened("sensor", About("a sensor", wrench=True, orientation=False, rate=1000.0), 0.0)
    session.opened("robot", About("a robot", wrench=False, orientation=True, rate=100.0), 0.0)
    for k in range(150):
        t = 0.01 * (k + 1)
        came = np.linspace(t - 0.009, t, 10).tolist() if k > 3 else [t] * 40 * (k == 3)
        readings = [Sample(each, wrench=tuple(NOISE * rng.standard_normal(6))) for each in came]
        turn = session.feed(Batch(readings), Batch([Sample(t - 0.009, t, orientation=(0.0, 0.0, 0.0, 1.0))]), t=t)
    assert turn.contact is not None
    assert turn.contact.valid[-1]
    assert turn.contact.contact[-1] >= 0


@pytest.mark.parametrize("robot", [True, False], ids=["both", "robot gone"])
def test_the_motion_that_is_kept_is_bounded(robot: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a sensor four times as fast as what is kept, which is 20 s here in place of minutes."""
    seconds = 20
    monkeypatch.setattr(history, "SECONDS", seconds)
    motion, step, period = history.Motion(), 0.1, 0.25 / history.RATE
    for k in range(round(1.5 * seconds / step)):
        t = [100.0 + step * k + period * i for i in range(round(step / period))]
        readings = [Reading(each, each, (0.0,) * 6, (0.0,) * 4, "") for each in t]
        poses = [Pose(t[0], (0.0, 0.0, 0.0, 1.0), (0.0,) * 3)] if robot else []
        motion.add(Turn(readings, poses), t[-1])
    streams = motion.streams(-1.0)
    assert streams is not None
    assert seconds * history.RATE <= len(streams.wrench) < 2.1 * seconds * history.RATE
    assert len(streams.orientation) == (len(streams.orientation) if robot else 0)
    assert streams.wrench.t[-1] - streams.wrench.t[0] < seconds + 3.0


def test_the_last_readings_are_kept_whatever_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of the last half second but for one that is flawed, and none that is older."""
    monkeypatch.setattr(history, "ROOM", 600)
    kept, turn = history.History(), (0.0, 0.0, 0.0, 1.0)
    for k in range(0, 3000, 30):
        numbers = range(k, k + 30)
        kept.add(Turn([Reading(n / 1024, 0.0, (float(n),) * 6, turn, "late" * (n == 2800)) for n in numbers], []))
        t, wrench, orientation = kept.last(0.5)
        assert wrench[:, 5].tolist() == [n for n in range(max(k + 30 - 512, 0), k + 30) if n != 2800]
        assert (t == wrench[:, 0] / 1024).all()
        assert (orientation == turn).all()
    assert not len(kept.last(0.5, now=4.5)[0])


def test_a_contact_costs_nothing_while_samples_cannot_be_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the contact has been so far takes a millisecond to compute: for each sample that came late it would have all
    that follow come late too.
    """
    summed = list[float]()
    monkeypatch.setattr("contactwrench.compensate.compensator.contact_so_far", lambda *_: summed.append(0.0))
    session, rng = Session(calibration()), np.random.default_rng(0)
    session.opened("sensor", About("a sensor", wrench=True, orientation=False, rate=1000.0), 0.0)
    session.opened("robot", About("a robot", wrench=False, orientation=True, rate=100.0), 0.0)
    for k in range(200):
        t, push = 0.01 * (k + 1), 20.0 * (k > 150)
        readings = [
            Sample(each, each, tuple(NOISE * rng.standard_normal(6) + push), flaw="saturated" * (k > 180))
            for each in np.linspace(t - 0.009, t, 10).tolist()
        ]
        session.feed(Batch(readings), Batch([Sample(t - 0.009, t, orientation=(0.0, 0.0, 0.0, 1.0))]), t=t)
    assert [event.kind for event in session.events()] == ["connected", "connected", "inertia", "contact", "saturated"]
    assert summed == []


@pytest.mark.parametrize("again", [False, True], ids=["opening", "restart"])
@pytest.mark.parametrize("pieces", [1, 2, 8, 20])
@pytest.mark.parametrize("queue", [0.06, 0.2, 1.0])
def test_what_waited_when_a_clock_begins_is_not_used_and_an_ordinary_start_is_quick(
    queue: float, pieces: int, again: bool
) -> None:
    """A queue is read in pieces 2 ms apart; then samples come as they are taken, and bring no event."""
    intake, begin = Intake("netft://x", "sensor"), 10.0 if again else 0.0
    intake.opened(About("a sensor", wrench=True, orientation=False, rate=1000.0), 0.0 if again else queue)
    events, late, unknown = list[str](), list[float](), list[float]()
    flaw = "late: its clock is not known yet, what waited may still come"
    for k in range(round(1000.0 * (begin + queue + 1.5))):
        t = 0.001 * k
        piece = min((t - begin) // (queue / pieces), pieces - 1)
        came = t if t < begin else max(t, begin + queue + 0.002 * piece)
        notes = [Note(NoteKind.RESTARTED, "the counter began anew at 1 after 2")] if again and t == begin else []
        ((told, sample),) = intake.take(Batch([Sample(came, t, wrench=(0.0,) * 6)], notes))
        late += [told - t] * (not sample.flaw)
        unknown += [came] * (sample.flaw == flaw)
        events += [each.kind for each in intake.look(came)]
    assert max(late) < 1e-3
    assert unknown
    assert max(unknown) < begin + queue + 0.002 * pieces + 0.06
    assert set(events) == ({"restarted"} if again else set())


@pytest.mark.parametrize("share", [1.0, 0.96])
def test_a_clock_is_known_that_runs_behind_a_busy_network(share: float) -> None:
    """And while bursts come, each as long as the time to the next."""
    true = 0.001 * np.arange(2000)
    for came in (arrivals(2000, 1000.0, np.random.default_rng(3)), np.ceil(share * true / 0.1) * 0.1 / share):
        clock = Clock()
        known = [clock.times([pair])[0][1] for pair in zip(came.tolist(), true.tolist(), strict=True)]
        assert not known[0]
        assert all(known[250:])


@pytest.mark.parametrize("jitter", [0.0, 2e-3])
@pytest.mark.parametrize("rate", [998.0, 990.0, 950.0, 905.0, 1050.0])
def test_a_count_at_another_rate_than_is_said_is_told_as_it_passes(rate: float, jitter: float) -> None:
    """A box that says 1000 Hz: too slow, its samples are late at first, then used again, and that is said once."""
    rng, intake, counter = np.random.default_rng(5), Intake("sri://x", "sensor"), Counter(1e-3, 1 << 16)
    intake.opened(About("a box", wrench=True, orientation=False, rate=1000.0), 0.0)
    true: Array = np.arange(1, round(60.0 * rate)) / rate
    came = np.maximum.accumulate(true + jitter * rng.random(len(true)))
    unused, off, events = list[float](), list[float](), list[tuple[float, str, str]]()
    for k, (t, arrival) in enumerate(zip(true.tolist(), came.tolist(), strict=True), start=1):
        batch = Batch()
        device = counter.take(k & 65535, arrival, batch)
        assert device is not None
        batch.samples.append(Sample(arrival, device, wrench=(0.0,) * 6))
        ((told, sample),) = intake.take(batch)
        if sample.flaw:
            unused.append(t)
        else:
            off.append(abs(told - t))
        events += [(event.t, event.kind, event.text) for event in intake.look(arrival)]
    slow = rate < 1000.0
    assert max(off) < LATE + 2e-3
    assert max(off[-round(15.0 * rate) :]) < 2.5e-3
    assert len(unused) < 0.07 * len(true)
    assert not unused or max(unused) < 40.0
    said = [text for _, kind, text in events if kind == "rate" and "slow" in text]
    goes = f"its time goes {100.0 * (1.0 - rate / 1000.0):.2g} % slow, or what it sends waits ever longer"
    assert said[:1] == [f"{goes}: check its rate, or let it stamp by a clock"] * slow
    assert len(said) <= 2


@pytest.mark.parametrize(("grows", "most"), [(0.05, 0.5), (0.05, 2.0), (0.01, 0.3)])
def test_a_queue_that_grew_is_no_slow_clock_once_it_is_empty(grows: float, most: float) -> None:
    true: Array = np.arange(0.0, 90.0, 0.002)
    waits = np.where(true < 60.0, np.clip(grows * (true - 5.0), 0.0, most), 0.0)
    came, intake = np.maximum.accumulate(true + waits), Intake("netft://x", "sensor")
    intake.opened(About("a sensor", wrench=True, orientation=False), 0.0)
    off, said = list[float](), list[tuple[str, str]]()
    for t, arrival in zip(true.tolist(), came.tolist(), strict=True):
        ((told, sample),) = intake.take(Batch([Sample(arrival, t, wrench=(0.0,) * 6)]))
        if not sample.flaw and t > 63.0:
            off.append(abs(told - t))
        said += [(event.severity, event.text) for event in intake.look(arrival) if event.kind == "rate"]
    assert max(off) < 1e-3
    assert len(off) > 13_000
    assert intake.clock.pace == 1.0
    assert said[-1] == ("note", "its time is told as it says it: what was slow had waited")
    assert "or what it sends waits ever longer" in said[0][1]


def test_samples_that_go_on_to_be_late_are_said_again_with_their_part() -> None:
    """Behind a network that holds most of them up, one longer than the other."""
    intake, true = Intake("udp://:1", "sensor"), 0.005 * np.arange(4_000)
    intake.opened(About("lines", wrench=True, orientation=False), 0.0)
    came = np.maximum.accumulate(true + np.random.default_rng(2).exponential(0.02, len(true)))
    said = list[str]()
    for t, arrival in zip(true.tolist(), came.tolist(), strict=True):
        intake.take(Batch([Sample(arrival, t, wrench=(0.0,) * 6)]))
        said += [event.text for event in intake.look(arrival) if event.kind == NoteKind.LATE]
    assert said[0] == "late: came 0.05 s after it was taken"
    assert "late: came 0.06 s after it was taken; 283 of the last 1024 samples were not used" in said
    assert len(said) < 15
