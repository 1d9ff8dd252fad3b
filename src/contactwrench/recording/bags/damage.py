"""What a bag says of itself and does not hold: refused, or, where that is accepted, left out and said."""

from __future__ import annotations

from ...errors import FileFormatError
from ..options import ACCEPT_FLAG


class Damage:
    """What was found damaged in a bag while it is read. `accepted`: what is left of it is wanted."""

    def __init__(self, source: str, accepted: bool = False) -> None:
        self.source, self.accepted = source, accepted
        self._found: dict[str, None] = {}
        self._doubts: dict[str, None] = {}
        self.left_open = ""
        """One sentence where the recording was not closed and lacks nothing but its end; empty: it was closed."""

    def found(self, what: str, expected: str) -> None:
        """Note what was found, as "164 of 950 messages of /wrench", and what the file says of itself.

        Raises `FileFormatError` unless damage is accepted.
        """
        if not self.accepted:
            raise FileFormatError(
                f"{self.source}: found {what}, expected {expected}: the file is damaged; record or copy it again, or "
                f"read what is left of it with {ACCEPT_FLAG}"
            )
        self._found[f"found {what}, expected {expected}"] = None

    def doubt(self, sentence: str) -> None:
        """Note what was read though it may be meant otherwise."""
        self._doubts[f"{self.source}: {sentence}"] = None

    def end_missing(self) -> None:
        """Note that the program that recorded it was ended from outside, and that all that it wrote is there."""
        self.left_open = f"{self.source} was not closed, as when its program is killed: what it had written was read"

    @property
    def first(self) -> str:
        """What was found first, without its reason and what was expected; empty: nothing."""
        return next(iter(self._found), "").partition(", expected")[0].partition(" (")[0]

    @property
    def said(self) -> str:
        """What was found so far, one sentence; of many findings the first and the last, which count; else whether it
        was left open; and what is in doubt. Empty: nothing.
        """
        found = list(self._found)
        found[4:-4] = [f"{len(found) - 8} more"] if len(found) > 9 else found[4:-4]
        damaged = f"{self.source} is damaged: {'; '.join(found)}; what was left of it was read" if found else ""
        return "; ".join(filter(None, [damaged or self.left_open, *self._doubts]))
