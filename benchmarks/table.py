"""Rows of figures with their targets, printed as plain text."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Row:
    """A figure in `unit`, with its standard error where it was drawn, and the range that it should lie in (None: no
    limit on that side).
    """

    what: str
    value: float
    unit: str = ""
    least: float | None = None
    most: float | None = None
    remark: str = ""
    standard_error: float | None = None

    @property
    def has_target(self) -> bool:
        """Whether a range was set."""
        return self.least is not None or self.most is not None

    @property
    def met(self) -> bool:
        """Whether the figure lies in its range; False for a NaN."""
        return (self.least is None or self.value >= self.least) and (self.most is None or self.value <= self.most)

    @property
    def judgement(self) -> str:
        """In a word, whether the target is met; `missed?` where two standard errors more or less would meet it; a
        single case is too many where none is allowed.
        """
        if not self.has_target or self.met:
            return "ok" if self.has_target else ""
        error = 2.0 * (self.standard_error or 0.0)
        eased = (None if self.least is None else self.least - error), (self.most + error if self.most else self.most)
        return "missed?" if replace(self, least=eased[0], most=eased[1]).met else "MISSED"

    @property
    def spread(self) -> str:
        """The standard error in words."""
        return "" if self.standard_error is None else f"+- {self.standard_error:.2g}"

    @property
    def target(self) -> str:
        """The range in words."""
        if self.least is None:
            return "" if self.most is None else f"at most {self.most:g}"
        return f"at least {self.least:g}" if self.most is None else f"{self.least:g} to {self.most:g}"


def print_table(title: str, rows: Iterable[Row]) -> None:
    """Print one figure a line: what, value, unit, target, whether it was missed."""
    rows = list(rows)
    width = max(len(row.what) for row in rows)
    unit = max(len(row.unit) for row in rows)
    target = max(len(row.target) for row in rows)
    spread = max(len(row.spread) for row in rows)
    print(f"\n{title}\n{'-' * len(title)}")
    for row in rows:
        figure = f"{row.value:>9.4g} {row.spread:<{spread}} {row.unit:<{unit}}"
        print(
            f"  {row.what:<{width}}  {figure}  {row.target:<{target}}  {row.judgement:<7}  {row.remark}".rstrip(),
            flush=True,
        )
