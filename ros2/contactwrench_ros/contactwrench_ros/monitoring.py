"""What /diagnostics says: rates and faults of the last period, counts since the start."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from contactwrench.compensate.faults import Reason

OK, WARN, ERROR = 0, 1, 2
"""The levels of diagnostic_msgs/DiagnosticStatus."""


@dataclass(frozen=True)
class Status:
    """A level, one line, and figures by their names."""

    level: int
    message: str
    values: dict[str, str]


@dataclass
class Tally:
    """Readings, wrenches and faults, in this period and in all."""

    readings: int = 0
    published: int = 0
    lost: int = 0
    of_period: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    last: Reason | None = None
    doubt: str = ""
    backs: int = 0
    back: dict[str, float] = field(default_factory=dict)

    def reading(self) -> None:
        """One came in."""
        self.readings += 1
        self.of_period["readings"] += 1

    def publish(self) -> None:
        """One went out."""
        self.published += 1
        self.of_period["published"] += 1

    def fault(self, reason: Reason) -> None:
        """One did not."""
        self.faults[reason.kind] += 1
        self.of_period["faults"] += 1
        self.last = reason

    def went_back(self, what: str, by: float) -> None:
        """The clock of what is stamped, in words, was set back by so many s."""
        self.back[what] = by
        self.backs += 1

    def status(self, seconds: float, note: str, trouble: str, more: dict[str, str]) -> Status:
        """The period that ends now, of so many seconds; the next begins.

        Args:
            seconds: since the last call.
            note: what is to be known though no reading is at fault: why nothing is published, or what is not
                subtracted; empty: nothing.
            trouble: of the orientation's source, for when it is stale.
            more: further figures.
        """
        now, self.of_period = self.of_period, Counter()
        back, self.back = ", ".join(f"of {what} by {by:.3g} s" for what, by in self.back.items()), {}
        doubt, self.doubt = self.doubt, ""
        said = [f"stamps went back, {back}: poses of before are forgotten"] if back else []
        rate = now["readings"] / seconds
        values = {
            "rate in (Hz)": f"{rate:.1f}",
            "rate out (Hz)": f"{now['published'] / seconds:.1f}",
            "readings": str(self.readings),
            "published": str(self.published),
            "lost by the middleware": str(self.lost),
            "stamps went back": str(self.backs),
            **{f"not published, {kind}": str(count) for kind, count in sorted(self.faults.items())},
            **more,
        }
        why = f"{self.last}" + (f"; {trouble}" if trouble and self.last and self.last.kind.startswith("stale") else "")
        if not now["readings"]:
            return Status(ERROR, f"no reading in {seconds:.1f} s", values)
        if now["faults"]:
            level = WARN if now["published"] else ERROR
            lost = f"{now['faults']} of {now['readings']} readings not compensated: {why}"
            return Status(level, "; ".join([lost, *said]), values)
        if said := [*said, *filter(None, (doubt, note))]:
            return Status(WARN, "; ".join(said), values)
        return Status(OK, f"contact wrenches at {now['published'] / seconds:.0f} Hz", values)
