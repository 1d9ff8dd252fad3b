"""What the page's server answers: its few files, and one WebSocket a browser."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, MutableMapping
from contextlib import contextmanager, suppress
from enum import StrEnum
from importlib.resources import files
from typing import Any

import msgspec

from .guard import Guard, Refusal
from .hub import Ask, Hub

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]

MOST_CLIENTS = 20
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
TRY_LATER, NOT_UNDERSTOOD = 1013, 1008
"""Codes of a WebSocket that is closed."""


class LabAction(StrEnum):
    """What the person in front of the virtual arm does; a push lasts until `release`."""

    PRESS_DOWN = "press_down"
    PRESS_X = "press_x"
    PUSH_TOOL = "push_tool"
    RELEASE = "release"
    NEXT_POSE = "next_pose"


class InLab(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="lab"):
    """A button of the virtual arm."""

    do: LabAction


class Ready(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ready"):
    """The browser has shown the last snapshot and takes the next: so none ever waits in a buffer on the way."""


_decoder = msgspec.json.Decoder(Ask | InLab | Ready)


class Application:
    """An ASGI application. `lab` is given what is done to the virtual arm, as `{"do": "press_down"}`."""

    def __init__(self, hub: Hub, guard: Guard, lab: Callable[[dict[str, str]], object] | None) -> None:
        self._hub, self._guard, self._lab = hub, guard, lab
        self._clients = 0
        self._files = {
            f"/{path.name}": path.read_bytes()
            for path in files(__package__).joinpath("static").iterdir()
            if path.name.rpartition(".")[2] in TYPES
        }

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer a request, or serve a browser until it leaves."""
        refusal = self._guard.refusal(scope)
        if scope["type"] == "http":
            await self._answer(scope, send, refusal)
        elif refusal or scope["path"] != "/live":
            await send({"type": "websocket.close"})  # before it is accepted: status 403
        else:
            await self._serve(receive, send)

    async def _answer(self, scope: Message, send: Send, refusal: Refusal | None) -> None:
        path: str = "/index.html" if scope["path"] == "/" else scope["path"]
        if refusal is None and path not in self._files:
            refusal = Refusal(404, "found another path, expected /")
        status, body = (refusal.status, refusal.text.encode()) if refusal else (200, self._files[path])
        kind = "text/plain" if refusal else TYPES[path.rpartition(".")[2]]
        headers = {**HEADERS, "content-type": f"{kind}; charset=utf-8", "content-length": str(len(body))}
        if not refusal and self._guard.token_in_query(scope):
            headers["set-cookie"] = f"{self._guard.cookie}={self._guard.token}; Path=/; HttpOnly; SameSite=Strict"
        raw = [(name.encode(), value.encode()) for name, value in headers.items()]
        await send({"type": "http.response.start", "status": status, "headers": raw})
        await send({"type": "http.response.body", "body": b"" if scope["method"] == "HEAD" else body})

    async def _serve(self, receive: Receive, send: Send) -> None:
        await receive()  # websocket.connect
        await send({"type": "websocket.accept"})
        if self._clients >= MOST_CLIENTS:
            reason = f"{MOST_CLIENTS} pages are open already: close one"
            await send({"type": "websocket.close", "code": TRY_LATER, "reason": reason})
            return
        ready = asyncio.Event()
        with self._one_client():
            await send({"type": "websocket.send", "text": f'{{"lab":{"true" if self._lab else "false"}}}'})
            sender = asyncio.create_task(self._send_newest(ready, send))
            try:
                await self._take(receive, send, ready)
            finally:
                sender.cancel()
                with suppress(asyncio.CancelledError, OSError):
                    await sender

    @contextmanager
    def _one_client(self) -> Iterator[None]:
        self._clients += 1
        try:
            yield
        finally:
            self._clients -= 1

    async def _send_newest(self, ready: asyncio.Event, send: Send) -> None:
        news, loop, seen = asyncio.Event(), asyncio.get_running_loop(), 0

        def wake() -> None:
            with suppress(RuntimeError):  # the loop ended between two lines of the worker
                loop.call_soon_threadsafe(news.set)

        unlisten = self._hub.listen(wake)
        try:
            while await ready.wait():
                while (newest := self._hub.after(seen)) is None:
                    news.clear()
                    await news.wait()
                ready.clear()
                seen, text = newest
                await send({"type": "websocket.send", "text": text.decode()})
        finally:
            unlisten()

    async def _take(self, receive: Receive, send: Send, ready: asyncio.Event) -> None:
        pressed = False
        while (message := await receive())["type"] == "websocket.receive":
            try:
                asked = _decoder.decode(message.get("text") or message.get("bytes") or b"")
            except msgspec.MsgspecError:
                await send({"type": "websocket.close", "code": NOT_UNDERSTOOD, "reason": "message not understood"})
                break
            if isinstance(asked, Ready):
                ready.set()
            elif isinstance(asked, InLab):
                pressed = asked.do not in {LabAction.RELEASE, LabAction.NEXT_POSE}
                await self._do_in_lab(asked.do)
            elif not self._hub.ask(asked):
                await send({"type": "websocket.send", "text": '{"notice":"The program is busy. Press again."}'})
        if pressed:  # the hand goes with the browser
            await self._do_in_lab(LabAction.RELEASE)

    async def _do_in_lab(self, action: LabAction) -> None:
        if self._lab:
            await asyncio.to_thread(self._lab, {"do": action.value})
