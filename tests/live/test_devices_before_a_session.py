"""Whether a device sends as fast as it was asked to, before a session begins: by a source with a time of its own."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from threading import Event

import pytest

from contactwrench.cli.live_terminal import COMPILES, LOADS, Before
from contactwrench.errors import InputError
from contactwrench.lab.rsi import Rsi
from contactwrench.lab.sri import Sri
from contactwrench.lab.truth import Plain
from contactwrench.live import devices
from contactwrench.live.page import Hub
from contactwrench.live.pump import WAITING, Reader
from contactwrench.live.source import About, Batch, NobodyYetError, Sample
from tests.support.chain import calibration
from tests.support.devices import free_port
from tests.support.recordings import run


class Sends:
    """Samples that come at these times, s; those before 0 were kept while it was opened."""

    uri = "sri://x?rate=100"

    def __init__(self, times: Iterable[float]) -> None:
        self.t, self._left = 0.0, list(times)

    def open(self) -> About:
        """Asked for 100 Hz."""
        return About("a sensor", wrench=True, orientation=False, rate=100.0)

    def read(self, timeout: float) -> Batch:
        """What has come, or comes next."""
        due = min([self.t + timeout, *(max(each, self.t) for each in self._left[:1])])
        self.t = max(due, self.t)
        came = [each for each in self._left if each <= self.t]
        del self._left[: len(came)]
        return Batch([Sample(each, wrench=(0.0,) * 6) for each in came])

    def close(self) -> None:
        """Nothing to close."""


def at(rate: float, begin: float = 0.0, end: float = 5.0) -> list[float]:
    return [begin + (k + 1) / rate for k in range(round((end - begin) * rate))]


def after(source: Sends, monkeypatch: pytest.MonkeyPatch) -> float:
    """s until it is taken."""
    monkeypatch.setattr(devices, "now", lambda: source.t)
    devices.probed(source, wrench=True, orientation=False)
    return source.t


@pytest.mark.parametrize("rate", [95.0, 100.0, 105.0])
def test_the_right_rate_is_taken_at_once(rate: float, monkeypatch: pytest.MonkeyPatch) -> None:
    assert after(Sends(at(rate)), monkeypatch) < 0.75


@pytest.mark.parametrize("stalled", [[], at(2_000.0, 0.8, 0.82)], ids=["lost", "late"])
def test_a_stall_and_silence_are_no_rate(stalled: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    assert after(Sends([*at(100.0, 0.0, 0.4), *stalled, *at(100.0, 0.82)]), monkeypatch) < 1.6
    assert after(Sends([]), monkeypatch) < 1.7


def test_a_computer_that_is_busy_at_opening_makes_no_other_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of what comes is lost for a second and a half; then all of it is counted."""
    assert after(Sends([*at(55.0, 0.0, 1.45), *at(100.0, 1.45)]), monkeypatch) < 3.0


@pytest.mark.parametrize("kept", [0, 20])
@pytest.mark.parametrize("rate", [50.0, 75.0, 125.0, 1_000.0])
def test_another_rate_is_refused(rate: float, kept: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where what it had kept makes it look right at first."""
    with pytest.raises(InputError) as refused:
        after(Sends([*[-0.01] * kept, *at(rate)]), monkeypatch)
    begin, _, end = str(refused.value).partition(" samples a second, expected 100: set that rate in the device, or ")
    found = float(begin.removeprefix("sri://x?rate=100: found "))
    assert abs(found - rate) < 0.03 * rate
    assert end == f"ask for it, as in sri://x?rate={found:.0f}"


def compiling(monkeypatch: pytest.MonkeyPatch) -> Event:
    """A compiler that is at it until the event is set."""
    done = Event()

    def compile_now(before: Before) -> None:
        before.events_of_compiler.append("begins")
        done.wait()

    monkeypatch.setattr("contactwrench.cli.live_terminal.compile_now", compile_now)
    return done


@pytest.mark.skipif(find_spec("numba") is None, reason="numba is not installed")
@pytest.mark.parametrize(("kept", "said"), [(False, [LOADS, COMPILES]), (True, [LOADS])], ids=["new", "kept"])
def test_what_is_loaded_is_not_said_to_be_compiled(
    kept: bool, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine it took more than two seconds, and a person waited for two minutes that never came."""
    import numba

    def compiled(_: bool) -> None:
        time.sleep(0.2)
        if not kept:
            numba.njit(lambda x: x + 1).compile((numba.types.int64,))
        time.sleep(0.3)

    monkeypatch.setattr("contactwrench.compensate.runner.compiled", compiled)
    monkeypatch.setattr("contactwrench.cli.live_terminal.EVERY", 0.02)
    before = Before((False, False), {}, Hub(), None, None, inertia=False)
    before.compile(0.1)
    before.wait_until_compiled()
    assert [each.text for each in before._told] == said


def test_what_is_not_there_is_said_while_the_step_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """That takes ten seconds the first time."""
    compiled = compiling(monkeypatch)
    monkeypatch.setattr("contactwrench.cli.live_terminal.LOADED", 0.01)
    calibration().save(tmp_path / "cal.json")
    uri = f"tcp://127.0.0.1:{free_port()}"
    done = run(capsys, "live", "--sensor", uri, "-c", tmp_path / "cal.json", "--no-page")
    compiled.set()
    assert done.status == 2
    said, refused, _ = done.err.split("\n")
    assert said.endswith(f"  {COMPILES}")
    assert refused.startswith(f"contactwrench: {uri}: found nobody listening at 127.0.0.1 port ")


def advice(uri: str, form: str, monkeypatch: pytest.MonkeyPatch) -> str:
    source = Sends(at(50.0))
    monkeypatch.setattr(source, "uri", uri)
    monkeypatch.setattr(Sends, "FORM", form, raising=False)
    with pytest.raises(InputError) as refused:
        after(source, monkeypatch)
    return str(refused.value).partition("expected 100: ")[2]


def test_another_rate_is_asked_for_beside_all_else_that_was(monkeypatch: pytest.MonkeyPatch) -> None:
    said = advice("sri://x?zero=1&rate=100", "sri://HOST[?rate=HZ][&zero=1]", monkeypatch)
    assert said == "set that rate in the device, or ask for it, as in sri://x?zero=1&rate=50"


def test_no_rate_is_asked_of_what_takes_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert advice("netft://x", "netft://HOST[?http=80]", monkeypatch) == "set that rate in the device"


def test_compiling_and_waiting_are_events_and_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before the session: else a service, which has no terminal, looks hung; and nobody starts the robot's program."""
    step, shown = compiling(monkeypatch), []

    def seen(hub: Hub, snapshot: bytes) -> None:
        shown.append(json.loads(snapshot))

    monkeypatch.setattr("contactwrench.cli.live_terminal.LOADED", 0.01)
    monkeypatch.setattr("contactwrench.cli.live_terminal.EVERY", 0.02)
    monkeypatch.setattr("contactwrench.live.sources.rsi.LISTENS", 0.3)
    monkeypatch.setattr("contactwrench.cli.live._until_a_signal", lambda *_: None)
    monkeypatch.setattr(Hub, "publish", seen)
    calibration().save(tmp_path / "cal.json")
    port = free_port()
    with Sri(Plain()) as box, Rsi(Plain(), ("127.0.0.1", port)) as robot:
        robot.silence(4.0)
        threading.Timer(5.0, step.set).start()
        arguments = ("--sensor", box.uri, "--robot", robot.uri, "-c", tmp_path / "cal.json", "--events")
        done = run(capsys, "live", *arguments)
    assert (done.status, done.err) == (0, "")
    *events, page = sorted(done.out.splitlines(), key=lambda line: not line.startswith("{"))
    assert page.startswith("Open http://127.0.0.1:")
    said = [json.loads(line) for line in events]
    assert [(each["kind"], each["severity"], each["device"], each["text"]) for each in said] == [
        ("compiling", "note", "", COMPILES),
        (
            "waiting",
            "note",
            robot.uri,
            f"{robot.uri}: found port {port} open and nobody who sends yet, expected the robot's RSI datagrams: start "
            "the program with RSI_MOVECORR on the robot",
        ),
    ]
    assert {each["phase"] for each in shown} == {"connect"}
    assert [each["state"] for each in shown[-1]["devices"]] == ["connecting", "connecting"]
    assert shown[-1]["events"] == said
    assert shown[-1]["commands"] == []
    assert shown[-1]["t"] - said[0]["t"] > 1.5


@pytest.mark.parametrize("came", [5, WAITING])
def test_more_than_can_be_taken_while_something_else_was_waited_for_is_let_go(came: int) -> None:
    """It is old, and of a minute at 1 kHz two thirds cannot be kept: they were said to be lost. What fits, is kept."""
    source = Sends([])
    early = Batch([Sample(0.0, wrench=(0.0,) * 6)] * came)
    reader = Reader(source, source.open(), early)
    reader.stop()
    reader.join()
    reader.put(Batch(early.samples[:3]))
    reader.forget()
    assert reader.news() == [source.open(), *([early, Batch(early.samples[:3])] if came == 5 else [])]
    reader.put(early)
    assert reader.news() == [early]


def test_a_source_that_is_waited_for_is_closed_before_it_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A topic that nobody publishes yet left a node at each attempt."""
    source, said, opened = Sends(at(100.0)), list[str](), list[int]()
    answers = [NobodyYetError("first"), NobodyYetError("second"), None]

    def opens() -> About:
        opened.append(1)
        if (error := answers.pop(0)) is not None:
            raise error
        return About("a sensor", wrench=True, orientation=False)

    monkeypatch.setattr(source, "open", opens)
    monkeypatch.setattr(source, "close", lambda: opened.append(-1))
    devices.probed(source, wrench=True, orientation=False, say=said.append)
    assert (opened, said) == ([1, -1, 1, -1, 1], ["first"])
    answers.append(NobodyYetError("third"))
    with pytest.raises(NobodyYetError, match="third"):
        devices.probed(source, wrench=True, orientation=False)


def test_nothing_is_said_where_all_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("contactwrench.cli.live._until_a_signal", lambda *_: None)
    monkeypatch.setattr("contactwrench.cli.live_terminal.compile_now", lambda _: None)
    calibration().save(tmp_path / "cal.json")
    with Sri(Plain()) as box, Rsi(Plain(), ("127.0.0.1", free_port())) as robot:
        arguments = ("--sensor", box.uri, "--robot", robot.uri, "-c", tmp_path / "cal.json", "--events", "--no-page")
        done = run(capsys, "live", *arguments)
    assert (done.status, done.out, done.err) == (0, "", "")
