"""Readings that leave exactly what another one leaves: the tool that each would mean tells which of them can be."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..calibration.findings import Kind
from ..estimation.plausibility import oddity, strangeness
from ..geometry.arrays import Array, read_only
from ..geometry.wrench import STANDARD_GRAVITY
from .interpretations import WrenchUnits

REVERSED = "tx, ty and tz reversed"
USUAL = 1.5
"""Of the logarithm of a centre of mass: by so much torques in N mm are forgiven, as they are commoner than the rest."""


@dataclass(frozen=True, eq=False)
class Unseen:
    """Other units, or the torques reversed, by `label`, that make a tool of `weight` N with its `com` (3,) m; of what
    kind it is `odd`, None where a tool may be so.
    """

    label: str
    weight: float
    com: Array
    odd: Kind | None

    @property
    def mass(self) -> float:
        """kg, at standard gravity."""
        return self.weight / STANDARD_GRAVITY

    @property
    def rank(self) -> tuple[bool, float]:
        """The most plausible first: a tool, the density that tools have, and rather torques as they stand."""
        return self.odd is not None, strangeness(self.weight, self.com) + USUAL * (REVERSED in self.label)


def likelier(factor: float, units: Iterable[WrenchUnits], weight: float, com: Array) -> bool:
    """Whether torques by a `factor` make a tool of `weight` N likelier than its `com` (3,) m does as it stands, and no
    other `units` one that is likelier by far.
    """
    so = strangeness(weight, factor * com)
    least = min((strangeness(each.force * weight, each.torque / each.force * com) for each in units), default=so)
    return so < strangeness(weight, com) and so < least + USUAL


def unseen(
    units: Iterable[WrenchUnits], own: float, weight: float, com: Array, to_the_tool: float
) -> tuple[Unseen, ...]:
    """All `units`, each with the torques as they stand and reversed, but for those of the tool itself, whose torques
    are the stated ones by a factor `own`. It is of `weight` N, its `com` (3,) m `to_the_tool` m on the side of tools.
    """
    found = []
    for each in units:
        same = bool(np.isclose(each.force, 1.0) and np.isclose(each.torque, own))
        for sign, words in ((1.0, []), (-1.0, [REVERSED])):
            lever = sign * each.torque / own / each.force
            moved, label = read_only(lever * com), ", ".join([*([] if same else [each.label]), *words])
            odd = oddity(each.force * weight, moved, lever * to_the_tool)
            found += [Unseen(label, each.force * weight, moved, odd)] if label else []
    return tuple(sorted(found, key=lambda one: one.rank))
