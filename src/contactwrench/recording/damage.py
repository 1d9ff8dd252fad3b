"""What a recording says of itself and does not hold: refused, or, where that is accepted, left out and said."""

from __future__ import annotations

from ..errors import FileFormatError
from .options import ACCEPT_FLAG


class Damage:
    """What was found damaged in a recording while it is read. `accepted`: what is left of it is wanted."""

    def __init__(self, source: str, accepted: bool = False) -> None:
        self.source, self.accepted = source, accepted
        self._found: dict[str, None] = {}

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

    @property
    def first(self) -> str:
        """What was found first, without its reason and what was expected; empty: nothing."""
        return next(iter(self._found), "").partition(", expected")[0].partition(" (")[0]

    @property
    def said(self) -> str:
        """What was found so far, one sentence; of many findings the first and the last, which count; empty: nothing."""
        found = list(self._found)
        found[4:-4] = [f"{len(found) - 8} more"] if len(found) > 9 else found[4:-4]
        return f"{self.source} is damaged: {'; '.join(found)}; what was left of it was read" if found else ""
