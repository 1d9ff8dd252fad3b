"""The page in a browser for ten minutes at 30 snapshots and 100 rows of trace a second: frames, memory, what it costs
the worker, and rows that got lost on the way.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import msgspec
import numpy as np

from contactwrench.live.page import Hub, serve
from contactwrench.live.snapshot import Phase
from tests.support.live_session import snapshot, trace

from .table import Row

CHROMIUM = "/usr/bin/chromium"
SECONDS, QUICK_SECONDS = 600.0, 60.0
RATE = 30.0
WATCH_FRAMES = """() => {
    window.frames_ms = [];
    let last = performance.now();
    const frame = (at) => { window.frames_ms.push(at - last); last = at; requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
}"""


@dataclass
class _Seen:
    """What was measured: ms between frames, MB of heap at the start and the end, s of the browser's main thread, s of
    each publish, rows sent and rows that came.
    """

    frames: list[float]
    heap: tuple[float, float]
    busy: float
    publish: list[float]
    sent: int
    came: int


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """All tables; none where there is no browser."""
    if find_spec("playwright") is None or find_spec("uvicorn") is None or not os.path.exists(CHROMIUM):
        return
    seconds = QUICK_SECONDS if quick else SECONDS
    yield f"Page in chromium for {seconds:.0f} s, no graphics card", _rows(_watched(seconds), seconds)


def _rows(seen: _Seen, seconds: float) -> Iterator[Row]:
    usual, late = np.percentile(seen.frames, [95, 99]).tolist()
    yield Row("time between frames, p95", usual, "ms", most=33.0)
    yield Row("time between frames, p99", late, "ms", most=100.0)
    yield Row("main thread of the page busy", 100.0 * seen.busy / seconds, "%", most=50.0)
    yield Row("heap of the page at the end", seen.heap[1], "MB", most=20.0)
    yield Row("growth of the heap", seen.heap[1] - seen.heap[0], "MB", most=1.0)
    yield Row("publish, median", 1e3 * float(np.median(seen.publish)), "ms", most=0.1)
    yield Row("publish, p99", 1e3 * float(np.percentile(seen.publish, 99)), "ms", most=1.0)
    yield Row("rows that did not come", float(seen.sent - seen.came), "", most=0.0)


def _watched(seconds: float) -> _Seen:
    from playwright.sync_api import sync_playwright

    hub = Hub()
    server = serve(hub)
    try:
        with sync_playwright() as started:
            browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            came: set[float] = set()
            page.on("websocket", lambda ws: ws.on("framereceived", lambda data: came.update(_times(data))))
            page.goto(server.url)
            seen = _played(hub, page, seconds, came)
            browser.close()
            return seen
    finally:
        server.close()


def _played(hub: Hub, page: Any, seconds: float, came: set[float]) -> _Seen:
    devtools = page.context.new_cdp_session(page)
    devtools.send("Performance.enable")
    _publish(hub, page, 12.0)  # the ten seconds of the plot are full
    page.evaluate(WATCH_FRAMES)
    came.clear()
    before = _metrics(devtools)
    publish, sent = _publish(hub, page, seconds)
    after = _metrics(devtools)
    heap = before["JSHeapUsedSize"] / 1e6, after["JSHeapUsedSize"] / 1e6
    return _Seen(
        page.evaluate("window.frames_ms"),
        heap,
        after["TaskDuration"] - before["TaskDuration"],
        publish,
        sent,
        len(came),
    )


def _publish(hub: Hub, page: Any, seconds: float) -> tuple[list[float], int]:
    took, sent, began = [], 0, time.time()
    before = began
    while (now := time.time()) < began + seconds:
        rows = trace(now, now - before, push=18.0)
        data = msgspec.json.encode(snapshot(Phase.RUN, now, trace=rows))
        sent, before = sent + len(rows), before + len(rows) / 100
        start = time.perf_counter()
        hub.publish(data)
        took.append(time.perf_counter() - start)
        page.wait_for_timeout(max(0.0, 1e3 * (now + 1 / RATE - time.time())))
    page.wait_for_timeout(200)
    return took, sent


def _metrics(devtools: Any) -> dict[str, float]:
    devtools.send("HeapProfiler.collectGarbage")
    return {each["name"]: each["value"] for each in devtools.send("Performance.getMetrics")["metrics"]}


def _times(data: str | bytes) -> set[float]:
    message = msgspec.json.decode(data)
    parts = [*message.get("earlier", ()), message.get("snapshot", {}).get("trace", ())]
    return {row[0] for part in parts for row in part}
