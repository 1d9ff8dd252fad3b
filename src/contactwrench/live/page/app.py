"""Where the worker of a session and the browsers meet, snapshots one way, what people ask for the other; and what the
page's server answers: its few files, and one WebSocket a browser.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from importlib.resources import files
from queue import Full, Queue
from typing import Annotated, Any, Literal

import msgspec

from ..snapshot import Command, Phase
from .guard import Guard

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Lab = Callable[[dict[str, str]], object]

MERGED = 60
"""Snapshots whose traces a browser that was slow still gets, 2 s of them; beyond these its plot has a gap."""
MOST_COMMANDS = 32
MOST_CLIENTS = 20
LOOK_AGAIN = 0.01
"""s between looks for a new snapshot: what it is late by at most, for a worker that need not wake anybody."""
TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
HEADERS = {
    "content-security-policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Ask(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ask"):
    """What a person asked for; `pose` is the number of the pose, from 0, of `Command.RETAKE`."""

    do: Command
    pose: Annotated[int, msgspec.Meta(ge=0, lt=100_000)] | None = None


class _Traced(msgspec.Struct):
    phase: Phase
    trace: msgspec.Raw


class Hub:
    """Takes snapshots from one worker and gives every browser the newest; nothing here waits for a browser. `commands`
    is what people asked for, oldest first: the worker takes from it by `get_nowait`.
    """

    def __init__(self) -> None:
        self.commands: Queue[Ask] = Queue(MOST_COMMANDS)
        self._recent: tuple[tuple[int, bytes], ...] = ()

    def publish(self, snapshot: bytes) -> None:
        """Show a `Snapshot`, encoded as JSON, at most 30 times a second; returns at once.

        A tuple is put in place of another, and nobody is woken: a lock or a system call would let other threads in.
        """
        number = self._recent[-1][0] + 1 if self._recent else 1
        self._recent = (*self._recent[1 - MERGED :], (number, snapshot))

    def ask(self, ask: Ask) -> bool:
        """Hand the worker what a person asked for; False: it has not taken the last ones yet."""
        try:
            self.commands.put_nowait(ask)
        except Full:
            return False
        return True

    def after(self, seen: int) -> tuple[int, bytes] | None:
        """The newest snapshot and its number, if it is newer than number `seen`, as a browser gets it: with the traces,
        of the same phase, of the snapshots that the browser skipped. One that has seen none (0) skips none.
        """
        recent = self._recent
        if not recent or recent[-1][0] <= seen:
            return None
        number, newest = recent[-1]
        skipped = [msgspec.json.decode(data, type=_Traced) for n, data in recent[:-1] if 0 < seen < n]
        phase = msgspec.json.decode(newest, type=_Traced).phase
        earlier = b",".join(bytes(each.trace) for each in skipped if each.phase is phase)
        return number, b'{"earlier":[' + earlier + b'],"snapshot":' + newest + b"}"


class InLab(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="lab"):
    """What the person in front of the virtual arm does; a push lasts until `release`."""

    do: Literal["press_down", "press_x", "push_tool", "release", "next_pose"]


class Ready(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ready"):
    """The browser has the last snapshot and takes the next: so none waits in a buffer on the way and grows old."""


_decoder = msgspec.json.Decoder(Ask | InLab | Ready)


class Application:
    """An ASGI application. `lab` is given what is done to the virtual arm, as `{"do": "press_down"}`."""

    def __init__(self, hub: Hub, guard: Guard, lab: Lab | None) -> None:
        self._hub, self._guard, self._lab = hub, guard, lab
        self._clients = 0
        static = files(__package__).joinpath("static").iterdir()
        self._files = {f"/{path.name}": path.read_bytes() for path in static if path.name.rpartition(".")[2] in TYPES}

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request, or serve a browser until it leaves."""
        refusal = self._guard.refusal(scope)
        if scope["type"] == "http":
            await self._answer(scope, send, refusal)
        elif refusal or scope["path"] != "/live":
            await send({"type": "websocket.close"})  # before it is accepted: status 403
        else:
            await self._serve(receive, send)

    async def _answer(self, scope: Message, send: Send, refusal: tuple[int, str] | None) -> None:
        path: str = "/index.html" if scope["path"] == "/" else scope["path"]
        if refusal is None and path not in self._files:
            refusal = 404, "found another path, expected /"
        status, body = (refusal[0], refusal[1].encode()) if refusal else (200, self._files[path])
        kind = "text/plain" if refusal else TYPES[path.rpartition(".")[2]]
        headers = {**HEADERS, "content-type": f"{kind}; charset=utf-8", "content-length": str(len(body))}
        if not refusal and self._guard.has_token(scope):
            headers["set-cookie"] = f"{self._guard.cookie}; Path=/; HttpOnly; SameSite=Strict"
        raw = [(name.encode(), value.encode()) for name, value in headers.items()]
        await send({"type": "http.response.start", "status": status, "headers": raw})
        await send({"type": "http.response.body", "body": body})

    async def _serve(self, receive: Receive, send: Send) -> None:
        await receive()  # websocket.connect
        await send({"type": "websocket.accept"})
        if self._clients >= MOST_CLIENTS:
            await _close(send, 1013, f"{MOST_CLIENTS} pages are open already. Close one.")
            return
        self._clients += 1
        ready = asyncio.Event()
        sender = asyncio.create_task(self._send_newest(ready, send))
        try:
            await self._take(receive, send, ready)
        finally:
            self._clients -= 1
            sender.cancel()
            with suppress(asyncio.CancelledError, OSError, RuntimeError):  # it was just sending
                await sender

    async def _send_newest(self, ready: asyncio.Event, send: Send) -> None:
        await send({"type": "websocket.send", "text": f'{{"lab":{"true" if self._lab else "false"}}}'})
        seen = 0
        while await ready.wait():
            while (newest := self._hub.after(seen)) is None:
                await asyncio.sleep(LOOK_AGAIN)
            ready.clear()
            seen, text = newest
            await send({"type": "websocket.send", "text": text.decode()})

    async def _take(self, receive: Receive, send: Send, ready: asyncio.Event) -> None:
        pressed = False
        while (message := await receive())["type"] == "websocket.receive":
            try:
                asked = _decoder.decode(message.get("text") or message.get("bytes") or b"")
            except msgspec.MsgspecError:
                await _close(send, 1008, "message not understood")
                break
            if isinstance(asked, Ready):
                ready.set()
            elif isinstance(asked, InLab):
                pressed = asked.do not in {"release", "next_pose"}
                await self._do_in_lab(asked.do)
            elif not self._hub.ask(asked):
                await send({"type": "websocket.send", "text": '{"notice":"The program is busy. Press again."}'})
        if pressed:  # the hand goes with the browser
            await self._do_in_lab("release")

    async def _do_in_lab(self, action: str) -> None:
        if self._lab:
            await asyncio.to_thread(self._lab, {"do": action})


async def _close(send: Send, code: int, reason: str) -> None:
    await send({"type": "websocket.close", "code": code, "reason": reason})
