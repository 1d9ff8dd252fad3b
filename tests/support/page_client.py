"""A browser without a browser: what the page's script sends and gets, for tests and benchmarks."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import msgspec
from websockets.sync.client import connect
from websockets.typing import Origin


class PageClient:
    """Talks to the page at `url` as its own script does."""

    def __init__(self, url: str) -> None:
        place = urlsplit(url)
        self._socket = connect(f"ws://{place.netloc}/live", origin=Origin(f"http://{place.netloc}"), max_size=None)
        self._socket.recv(5.0)
        self.snapshot: dict[str, Any] = {}
        self.events: list[dict[str, Any]] = []

    def close(self) -> None:
        """Close the page."""
        self._socket.close()

    def next(self) -> dict[str, Any]:
        """The next snapshot."""
        self._socket.send('{"kind":"ready"}')
        while "snapshot" not in (message := msgspec.json.decode(self._socket.recv(10.0))):
            pass
        self.snapshot = message["snapshot"]
        self.events += [each for each in self.snapshot["events"] if each not in self.events]
        return self.snapshot

    def ask(self, command: str, pose: int | None = None) -> None:
        """Press a button."""
        more = "" if pose is None else f',"pose":{pose}'
        self._socket.send(f'{{"kind":"ask","do":"{command}"{more}}}')

    def lab(self, action: str) -> None:
        """Use a hand of the virtual arm."""
        self._socket.send(f'{{"kind":"lab","do":"{action}"}}')

    def until(self, holds: Callable[[dict[str, Any]], Any], seconds: float = 20.0) -> dict[str, Any]:
        """Snapshots until one holds."""
        end = time.monotonic() + seconds
        while not holds(snapshot := self.next()):
            if time.monotonic() > end:
                shown = {name: snapshot[name] for name in ("phase", "still", "moving", "push", "poses", "events")}
                raise TimeoutError(f"not within {seconds:g} s: {shown}")
        return snapshot


def felt(k: int) -> Callable[[dict[str, Any]], bool]:
    """Whether push `k` was felt."""
    return lambda s: bool(s["push"] and s["push"][k]["seen"])


def more_than(k: int, what: Callable[[dict[str, Any]], Any]) -> Callable[[dict[str, Any]], bool]:
    """Whether there are more than `k` of something."""
    return lambda s: len(what(s)) > k


def push(page: PageClient, hand: str, k: int, meanwhile: Callable[[], None] = lambda: None) -> None:
    """A push of the push test."""
    page.until(lambda s: s["phase"] == "push" and s["still"])
    time.sleep(0.6)
    page.lab(hand)
    time.sleep(1.2)
    meanwhile()
    page.lab("release")
    page.until(felt(k))


def touch(page: PageClient) -> None:
    """Touch the tool while a pose is being taken."""
    page.until(lambda s: s["poses"]["progress"] > 0.3)
    page.lab("push_tool")
    time.sleep(0.5)
    page.lab("release")
