"""The wizard in a terminal: what is asked for, line by line; Enter goes on, a word is a command."""

from __future__ import annotations

import sys
from threading import Thread
from typing import TYPE_CHECKING

import msgspec

from ..live.snapshot import Command, Phase, Snapshot
from . import options

if TYPE_CHECKING:
    from ..live.page import Hub

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
