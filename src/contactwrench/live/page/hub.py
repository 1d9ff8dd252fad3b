"""Where the worker of a session and the browsers meet: snapshots one way, what people ask for the other."""

from __future__ import annotations

from queue import Full, Queue
from typing import Annotated

import msgspec

from ..snapshot import Command, Phase

MERGED = 60
"""Snapshots whose traces a browser that was slow still gets, 2 s of them; beyond these its plot has a gap."""
MOST_COMMANDS = 32


class Ask(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ask"):
    """What a person asked for; `pose` is the number of the pose, from 0, of `Command.RETAKE`."""

    do: Command
    pose: Annotated[int, msgspec.Meta(ge=0, lt=100_000)] | None = None


class _Traced(msgspec.Struct):
    phase: Phase
    trace: msgspec.Raw


class Hub:
    """Takes snapshots from one worker and gives every browser the newest; nothing here waits for a browser.

    `commands` is what people asked for, oldest first: the worker takes from it by `get_nowait`.
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
