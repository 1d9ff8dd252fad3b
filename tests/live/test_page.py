"""The page in a browser: the wizard by clicks and by keys, what it shows of ugly sessions, and who can use it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.live.page import Ask, Hub, Server, serve
from contactwrench.live.snapshot import Command, Device, Event, Phase, Snapshot
from tests.support.live_session import T0, UGLY, Played, played, quaternions, snapshot

CHROMIUM = "/usr/bin/chromium"
PATIENCE = 20_000
"""ms."""
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
pytest.importorskip("uvicorn", reason="uvicorn is not installed")
pytestmark = [
    pytest.mark.skipif(not os.path.exists(CHROMIUM), reason=f"there is no {CHROMIUM}"),
    pytest.mark.slow,
]
MOMENTS = {**{phase.value: snapshot(phase) for phase in Phase}, **UGLY}
SIZES = {"wide": {"width": 1280, "height": 900}, "narrow": {"width": 400, "height": 800}}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def opened(browser: Any, url: str, size: str = "wide", **options: Any) -> Iterator[Any]:
    """A page that must have no fault in its console and ask no other address; it fails late, when it is closed."""
    faults: list[str] = []
    context = browser.new_context(viewport=SIZES[size], **options)
    page = context.new_page()
    own = url.partition("?")[0]
    page.on("console", lambda message: faults.append(message.text) if message.type in {"error", "warning"} else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda asked: None if asked.url.startswith(own) else faults.append(asked.url))
    page.on("websocket", lambda ws: None if ws.url.startswith(own.replace("http", "ws")) else faults.append(ws.url))
    page.goto(url)
    try:
        yield page
    finally:
        context.close()
    assert faults == []


@contextmanager
def showing(*moments: Snapshot, lab: Callable[[dict[str, str]], object] | None = None) -> Iterator[tuple[Hub, Server]]:
    hub = Hub()
    server = serve(hub, lab=lab)
    for moment in moments:
        hub.publish(msgspec.json.encode(moment))
    try:
        yield hub, server
    finally:
        server.close()


def seen(page: Any, selector: str, text: str = "") -> Any:
    """The element, once it is visible and has the text."""
    found = page.locator(selector).filter(has_text=text).first
    found.wait_for(timeout=PATIENCE)
    return found


class Clicks:
    def press(self, page: Any, what: str) -> None:
        page.locator(f"[data-do={what}][aria-disabled=false]").click(timeout=PATIENCE)


class Keys:
    """From where the focus is, by Tab alone."""

    def press(self, page: Any, what: str) -> None:
        seen(page, f"[data-do={what}][aria-disabled=false]")
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.dataset.do") == what:
                assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
                page.keyboard.press("Enter" if what == "next" else "Space")
                return
        raise AssertionError(f"{what} cannot be reached by Tab")


@pytest.mark.parametrize(
    ("hand", "size", "scheme"), [(Clicks(), "wide", "light"), (Keys(), "narrow", "dark")], ids=["clicks", "keys"]
)
def test_the_whole_wizard(browser: Any, hand: Clicks | Keys, size: str, scheme: str) -> None:
    hub = Hub()
    server = serve(hub)
    with played(hub, Played(speed=20.0)) as session, opened(browser, server.url, size, color_scheme=scheme) as page:
        seen(page, "#instruction", "The devices send.")
        hand.press(page, "next")
        seen(page, "#instruction", "The push test is done.")
        hand.press(page, "next")
        seen(page, "#capture-text", "8 poses are taken.")
        page.get_by_role("button", name="Take pose 3 again").press("Enter")
        hand.press(page, "next")
        seen(page, "#verdict", "good")
        hand.press(page, "save")
        seen(page, "#saved", "Saved as gripper.json.")
        hand.press(page, "next")
        seen(page, "#instruction", "The check passed.")
        hand.press(page, "next")
        seen(page, "#instruction", "No contact.")
        hand.press(page, "zero")
        hand.press(page, "record")
        seen(page, "[data-do=record]", "Stop recording")
        asked = [ask.do.value for ask in session.asked]
    server.close()
    assert Ask(Command.RETAKE, 2) in session.asked
    assert asked == ["next", "next", "retake", "next", "save", "next", "next", "zero", "record"]


@pytest.mark.parametrize(("size", "scheme"), [("wide", "light"), ("narrow", "dark")])
def test_every_moment_fits_and_can_be_used_by_all(browser: Any, size: str, scheme: str) -> None:
    with showing(lab=print) as (hub, server), opened(browser, server.url, size, color_scheme=scheme) as page:
        page.evaluate(axe.Axe().axe_script)  # once: by `Axe.run` at each moment anew
        for name, moment in MOMENTS.items():
            named = Event(T0, "note", "note", f"This is {name}.")
            hub.publish(msgspec.json.encode(msgspec.structs.replace(moment, events=(*moment.events[1:], named))))
            seen(page, "#events li", named.text)
            wide = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
            assert wide <= 0, name
            found = page.evaluate("axe.run({ resultTypes: ['violations'] }).then((all) => all.violations)")
            assert [(each["id"], each["nodes"][0]["html"]) for each in found] == [], name


def test_a_silent_sensor_looks_invalid(browser: Any) -> None:
    with showing(UGLY["sensor silent"]) as (_, server), opened(browser, server.url) as page:
        seen(page, "#instruction", "The sensor is silent.")
        assert "Check its power and its cable." in page.inner_text("#detail")
        assert page.locator("#numbers .invalid").count() == 6
        style = "getComputedStyle(document.querySelector('#numbers .value'))"
        assert "line-through" in page.evaluate(f"{style}.textDecorationLine")
        assert page.inner_text("#invalid") == "The sensor is silent."


def test_what_is_not_valid_says_why_and_shows_no_number(browser: Any) -> None:
    moment = msgspec.structs.replace(UGLY["all faults"], devices=snapshot(Phase.RUN).devices)
    with showing(moment) as (_, server), opened(browser, server.url) as page:
        seen(page, "#instruction", "Not valid.")
        assert "saturated: fx" in page.inner_text("#invalid")
        assert set(page.locator("#numbers .value").all_inner_texts()) == {"–"}


def test_it_says_whether_inertia_is_subtracted(browser: Any) -> None:
    moment = snapshot(Phase.RUN)
    assert moment.running is not None
    missing = "The tool's inertia is not subtracted: while the arm accelerates, it reads as contact."
    with showing(moment) as (hub, server), opened(browser, server.url) as page:
        for inertia, text in ((None, ""), (True, " The tool's inertia is subtracted."), (False, "")):
            running = msgspec.structs.replace(moment.running, inertia=inertia)
            hub.publish(msgspec.json.encode(msgspec.structs.replace(moment, running=running)))
            seen(page, "#run-text", f"Calibration gripper.json.{text} 12 readings were not valid.")
            assert (page.inner_text("#detail") == missing) == (inertia is not True)


def test_news_that_stop_are_marked_and_come_back(browser: Any) -> None:
    with showing(snapshot(Phase.RUN)) as (hub, server), opened(browser, server.url) as page:
        seen(page, "#link", "● live")
        seen(page, "#banner", "The program says nothing. What you see below is old.")
        assert page.evaluate("document.body.classList.contains('old')")
        hub.publish(msgspec.json.encode(snapshot(Phase.RUN, T0 + 5.0)))
        seen(page, "#link", "● live")
        assert page.locator("#banner").is_hidden()


def test_a_program_that_ended_is_said(browser: Any) -> None:
    with showing(snapshot(Phase.RUN)) as (_, server), opened(browser, server.url) as page:
        seen(page, "#link", "● live")
        page.evaluate("() => { window.WebSocket = class { constructor() { setTimeout(() => this.onclose({})); } }; }")
        server.close()
        seen(page, "#banner", "The program has ended, or does not answer.")


def test_one_page_too_many_says_so(browser: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactwrench.live.page.app.MOST_CLIENTS", 0)
    with showing(snapshot(Phase.RUN)) as (_, server), opened(browser, server.url) as page:
        seen(page, "#banner", "0 pages are open already. Close one.")
        assert "old" not in page.inner_text("#banner")


def test_texts_of_devices_are_shown_and_not_obeyed(browser: Any) -> None:
    with showing(UGLY["long names"]) as (_, server), opened(browser, server.url) as page:
        assert "<img src=x>" in seen(page, "#devices .name", "<img").inner_text()
        assert page.locator("img").count() == 0


def test_the_hand_of_the_lab_presses_while_a_button_is_held(browser: Any) -> None:
    done: list[str] = []
    with (
        showing(snapshot(Phase.PUSH), lab=lambda action: done.append(action["do"])) as (_, server),
        opened(browser, server.url) as page,
    ):
        seen(page, "#lab")
        page.get_by_role("button", name="Press down (hold)").hover()
        page.mouse.down()
        page.mouse.move(5, 5)
        page.mouse.up()
        page.get_by_role("button", name="Push the tool (hold)").focus()
        page.keyboard.down("Space")
        page.keyboard.down("Space")
        page.keyboard.press("Tab")
        page.keyboard.up("Space")
        page.get_by_role("button", name="Next pose").click()
        until = time.monotonic() + 5.0
        while len(done) < 5 and time.monotonic() < until:
            page.wait_for_timeout(20)
    assert done == ["press_down", "release", "push_tool", "release", "next_pose"]


def test_without_a_lab_there_is_no_virtual_arm(browser: Any) -> None:
    with showing(snapshot(Phase.PUSH)) as (_, server), opened(browser, server.url) as page:
        seen(page, "#pushes")
        assert page.locator("#lab").is_hidden()


def test_the_address_bar_drops_the_token(browser: Any) -> None:
    server = serve(hub := Hub(), token="a-token-of-this-test")
    hub.publish(msgspec.json.encode(snapshot(Phase.RUN)))
    try:
        with opened(browser, server.url) as page:
            seen(page, "#link", "● live")
            assert page.url == server.url.partition("?")[0]
            page.reload()
            seen(page, "#link", "● live")
    finally:
        server.close()


def test_rows_come_once_and_phases_apart(browser: Any) -> None:
    play = """async () => {
        const { Trace } = await import("/draw.js");
        const trace = new Trace(10);
        const row = (t) => [t, 0, 0, 0, 0, 0, 0, 1, 0];
        const take = (phase, t, rows, earlier = []) => {
            trace.take({ phase, t, trace: rows }, earlier);
            return trace.rows.map((r) => r[0]);
        };
        return [
            take("connect", 1, [row(0.5), row(1)]),
            take("connect", 2, [row(2)], [[row(0.5), row(1), row(1.5)]]),
            take("push", 12.2, [row(12)]),
            take("run", 13, [row(13)]),
            take("run", 3, [row(3)]),
        ];
    }"""
    with showing() as (_, server), opened(browser, server.url) as page:
        assert page.evaluate(play) == [[0.5, 1], [0.5, 1, 1.5, 2], [12], [13], [3]]


def test_directions_of_gravity_are_those_of_scipy(browser: Any) -> None:
    given = quaternions(20)
    with showing() as (_, server), opened(browser, server.url) as page:
        drawn = page.evaluate("async (qs) => qs.map((await import('/draw.js')).gravityIn)", given)
    assert np.allclose(drawn, Rotation.from_quat(given).inv().apply([0.0, 0.0, -1.0]), atol=1e-12)


def test_who_wants_no_motion_gets_two_frames_a_second(browser: Any) -> None:
    count = """() => { window.seen = 0; new MutationObserver(() => window.seen++).observe(
        document.getElementById("detail"), { childList: true }); }"""
    server = serve(hub := Hub())
    with played(hub, Played(Phase.PUSH)), opened(browser, server.url, reduced_motion="reduce") as page:
        seen(page, "#detail", "N so far")
        page.evaluate(count)
        page.wait_for_timeout(1000)
        assert 1 <= page.evaluate("window.seen") <= 3
    server.close()


@pytest.mark.parametrize(
    ("kind", "instruction"), [("compiling", "The session begins soon."), ("waiting", "Nobody sends yet.")]
)
def test_what_is_waited_for_before_a_session_is_the_instruction(browser: Any, kind: str, instruction: str) -> None:
    connecting = Device("udp://:9000", "sensor and robot", "", "connecting", "", None, None, 0, 0, 0, 0, None, None)
    before = Event(T0, kind, "note", "what is waited for")
    now = msgspec.structs.replace(snapshot(Phase.CONNECT), devices=(connecting,), commands=(), events=(before,))
    with showing(now) as (_, server), opened(browser, server.url) as page:
        assert seen(page, "#instruction", instruction)
        assert seen(page, "main", "what is waited for")


def test_the_run_says_whose_axes_it_shows(browser: Any) -> None:
    text = "What is exerted on the tool, in the sensor's axes, the torque about the sensor's origin."
    with showing(snapshot(Phase.RUN)) as (hub, server), opened(browser, server.url) as page:
        assert seen(page, "#axes").inner_text() == text
        hub.publish(msgspec.json.encode(snapshot(Phase.CONNECT, T0 + 1.0)))
        seen(page, "#wrench-title", "Readings")
        assert page.locator("#axes").is_hidden()


def test_events_that_say_the_same_are_one_line(browser: Any) -> None:
    """And what is counted beside the lost and the repeated is not used, late or wrong."""
    said = [Event(T0 + k, "late", "warning", ("a", "b")[k == 2], "udp://:9000") for k in range(4)]
    with showing(snapshot(Phase.RUN, events=tuple(said))) as (_, server), opened(browser, server.url) as page:
        seen(page, "#events li", "a (udp://:9000) (3 times, this was the last)")
        lines = page.locator("#events .what").all_inner_texts()
        assert lines == ["a (udp://:9000) (3 times, this was the last)", "b (udp://:9000)"]
        last = page.evaluate("t => new Date(1000 * t).toLocaleTimeString([], { hour12: false })", T0 + 3)
        assert page.locator("#events .time").first.inner_text() == last
        assert page.locator("#devices .counts").first.inner_text().endswith(" not used")


def test_nothing_that_sends_is_nothing_to_go_on_with(browser: Any) -> None:
    quiet = tuple(msgspec.structs.replace(each, state="silent") for each in snapshot(Phase.CONNECT).devices)
    with showing(snapshot(Phase.CONNECT, devices=quiet)) as (hub, server), opened(browser, server.url) as page:
        seen(page, "[data-do=next][aria-disabled=true]")
        hub.publish(msgspec.json.encode(snapshot(Phase.CONNECT, T0 + 1.0)))
        seen(page, "[data-do=next][aria-disabled=false]")


def test_a_unit_stays_with_its_number_on_a_phone(browser: Any) -> None:
    with showing(snapshot(Phase.FIT)) as (_, server), opened(browser, server.url, "narrow") as page:
        seen(page, "#parameters tr")
        tops = page.evaluate(
            "[...document.querySelectorAll('#parameters tr')].map((row) => "
            "[...row.querySelectorAll('td')].map((cell) => cell.getBoundingClientRect().top))"
        )
    assert all(max(row) - min(row) < 2.0 for row in tops)
