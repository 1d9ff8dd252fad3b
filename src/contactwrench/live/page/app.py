"""What the page's server answers: its few files, and one WebSocket a browser."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from importlib.resources import files
from typing import Any, Literal

import msgspec

from .guard import Guard
from .hub import Ask, Hub

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Lab = Callable[[dict[str, str]], object]

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
