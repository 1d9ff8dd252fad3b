"""A live session on a terminal: what it waits for before it begins, as a program that only waits looks hung, and the
wizard, line by line; Enter goes on, a word is a command.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Self

import msgspec
import typer

from ..errors import has_compiler
from ..live.snapshot import Command, Phase, Snapshot
from ..live.snapshot import Event as Said
from ..live.source import now
from . import options

if TYPE_CHECKING:
    from ..live.page import Hub, Server
    from ..live.pump import Reader
    from ..live.source import Source

COMPILES = "the step is compiled, once on this machine, which takes up to two minutes; the session begins then"
LOADS = "the step that was compiled before is loaded; the session begins then"
LOADED = 2.0
"""s in which a step that was compiled before is there: where that takes longer the devices are looked at meanwhile, as
what is wrong with them is to be said at once.
"""
EVERY = 1.0
"""s from one snapshot, or look at the compiler, to the next: a page says after 1.5 s that the program says nothing."""


def say(as_json: bool, in_words: bool, said: Said) -> None:
    """Print an event, as a line of JSON and in words on stderr."""
    if as_json:
        typer.echo(options.visible_lines(msgspec.json.encode(said).decode()))
        sys.stdout.flush()
    if in_words:
        where = f"{said.device}: " if said.device and not said.text.startswith(said.device) else ""
        when = time.strftime("%H:%M:%S", time.localtime(said.t))
        options.say(f"{when}  {'' if said.severity == 'note' else said.severity + ': '}{where}{said.text}", err=True)


def compile_now(before: Before) -> None:
    """Compile the step that a session needs, where there is a compiler, aside."""
    from ..compensate.runner import compiled

    if before.aside is not None:
        before.aside()
    if has_compiler():
        from numba.core.event import install_recorder

        with install_recorder("numba:compile") as compiler:  # which has no events where the step is in numba's cache
            before.events_of_compiler = compiler.buffer
            for inertia in (False, True) if before.inertia is None else (before.inertia,):
                compiled(inertia)
        settle()


def settle() -> None:
    """Leave what was imported alone: looking it through for garbage stops all threads for a tenth of a second."""
    gc.collect()
    gc.freeze()


class Before:
    """Until the session begins, in a `with` block that ends with it: whether events are `printed`, as JSON, in words;
    `devices` by role; the page's `hub`, and what serves it, if any; what lets a thread run behind others, if anything;
    whether the tool's `inertia` is known, None: the fit will tell.
    """

    def __init__(
        self,
        printed: tuple[bool, bool],
        devices: Mapping[str, Source],
        hub: Hub,
        serve: Callable[[], Server] | None,
        aside: Callable[[], None] | None,
        inertia: bool | None,
    ) -> None:
        self._printed, self._devices, self._hub, self._served_by = printed, devices, hub, serve
        self.aside, self.inertia = aside, inertia
        self.events_of_compiler: list[Any] = []
        self._told: list[Said] = []
        self._server: Server | None = None
        self._is_told, self._begun = False, Event()
        self._compiles = Thread(target=lambda: compile_now(self), name="compiles", daemon=True)
        self._snapshots = Thread(target=self._publish, name="before a session", daemon=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_publishing()
        if self._server is not None:
            self._server.close()

    def compile(self, seconds: float) -> None:
        """Begin to compile the step, or to load it; so many s are waited for, behind which that is said."""
        self._compiles.start()
        self._compiles.join(seconds)
        if seconds:
            self._tell_step()

    def wait_until_compiled(self) -> None:
        """Wait until the step is compiled, where that was begun."""
        while self._compiles.ident is not None and self._compiles.is_alive():
            self._tell_step()
            self._compiles.join(EVERY)

    def _tell_step(self) -> None:
        """Say what becomes of the step, where that is another thing than what was said of it."""
        text = COMPILES if self.events_of_compiler else LOADS
        if self._compiles.is_alive() and text not in [said.text for said in self._told]:
            self.tell("compiling", text, on_terminal=False)

    def tell(self, kind: str, text: str, device: str = "", *, on_terminal: bool = True) -> None:
        """Say what is waited for; `on_terminal`: there too, as nobody else says it."""
        as_json, in_words = self._printed
        self._told.append(said := Said(now(), kind, "note", text, device))
        say(as_json, in_words and (on_terminal or not sys.stderr.isatty()), said)
        self.serve()
        self._tell_place()
        if self._server is not None and not self._snapshots.is_alive():
            self._snapshots.start()

    def serve(self) -> None:
        """Serve the page, where there is one."""
        if self._served_by is not None and self._server is None:
            self._server = self._served_by()

    def _tell_place(self) -> None:
        """Say where the page is, once."""
        if self._server is not None and not self._is_told:
            self._is_told = True
            options.say(f"Open {self._server.url}")
            sys.stdout.flush()

    def end(self, readers: Iterable[Reader]) -> None:
        """The session begins, and is what is shown; what its readers took while something was said is old."""
        self._stop_publishing()
        self._tell_place()
        for reader in readers if self._told else ():
            reader.forget()

    def _stop_publishing(self) -> None:
        self._begun.set()
        if self._snapshots.ident is not None:
            self._snapshots.join()

    def _publish(self) -> None:
        from ..live.session import Session

        named: dict[str, Any] = {"robot": None, **{role: source.uri for role, source in self._devices.items()}}
        session = Session(**named)
        while not self._begun.is_set():
            shown = msgspec.structs.replace(session.snapshot(now()), commands=(), events=tuple(self._told))
            self._hub.publish(msgspec.json.encode(shown))
            self._begun.wait(EVERY)


WORDS = {Command.NEXT: "Enter: go on"}
INERTIA = {None: "", True: " The tool's inertia is subtracted.", False: " The tool's inertia is not subtracted."}


class Terminal:
    """Shows what a snapshot asks of a person, once, and takes lines from standard input."""

    def __init__(self, hub: Hub) -> None:
        self._hub, self._said, self._seen = hub, "", 0
        Thread(target=self._listen, name="terminal", daemon=True).start()

    def show(self) -> None:
        """Say what is new."""
        newest = self._hub.after(self._seen)
        if newest is None:
            return
        self._seen, text = newest
        snapshot = msgspec.convert(msgspec.json.decode(text)["snapshot"], Snapshot)
        asked = instruction(snapshot)
        if asked != self._said:
            self._said = asked
            can = ", ".join(WORDS.get(each, each.value) for each in snapshot.commands)
            options.say(f"{asked}\n  [{can}]" if can else asked, err=True)

    def _listen(self) -> None:
        from ..live.page.app import Ask

        for line in sys.stdin or ():
            word, _, number = line.strip().partition(" ")
            try:
                ask = Ask(Command(word or Command.NEXT), int(number) - 1 if number else None)
            except ValueError:
                options.say(f"found {line.strip()!r}, expected one of {', '.join(Command)}", err=True)
                continue
            if not self._hub.ask(ask):
                options.say("The program is busy. Enter it again.", err=True)


def instruction(snapshot: Snapshot) -> str:
    """What a person is to do now."""
    match snapshot.phase:
        case Phase.CONNECT:
            return "Connect: leave arm and tool alone until both devices stream."
        case Phase.PUSH:
            step = next((step for step in snapshot.push if not step.seen), None)
            return "Push test done." if step is None else f"Push test: {step.ask}"
        case Phase.POSES if snapshot.poses is not None:
            poses = snapshot.poses
            std = "" if poses.std_force is None else f", contact force known to {poses.std_force:.2g} N"
            return f"Poses: {len(poses.taken)} taken{std}. Turn the tool to another orientation and stand still."
        case Phase.FIT if snapshot.fit is not None:
            fit = snapshot.fit
            return f"Fit: {fit.refusal}" if fit.refusal else f"Fit: verdict {fit.verdict}; sign {fit.sign}."
        case Phase.VERIFY:
            return f"Verify: {snapshot.verified or f'{len(snapshot.checks)} of 2 new poses taken'}."
    return f"Running.{INERTIA[None if snapshot.running is None else snapshot.running.inertia]}"
