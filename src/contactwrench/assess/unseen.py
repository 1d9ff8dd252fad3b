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
    """Other units, or the torques reversed, by `label`, that make a tool of `mass` kg with its `com` (3,) m; of what
    kind it is `odd`, None where a tool may be so.
    """

    label: str
    mass: float
    com: Array
    odd: Kind | None


def likelier(factor: float, units: Iterable[WrenchUnits], weight: float, com: Array) -> bool:
    """Whether torques by a `factor` make a tool of `weight` N likelier than its `com` (3,) m does as it stands, and no
    other `units` one that is likelier by far.
    """
    so = strangeness(weight, factor * com)
    least = min((strangeness(force * weight, torque / force * com) for _, force, torque in units), default=so)
    return so < strangeness(weight, com) and so < least + USUAL


def unseen(
    units: Iterable[WrenchUnits], own: float, weight: float, com: Array, to_the_tool: float
) -> tuple[Unseen, ...]:
    """All `units`, each with the torques as they stand and reversed, but for those of the tool itself, whose torques
    are the stated ones by a factor `own`. It is of `weight` N, its `com` (3,) m `to_the_tool` m on the side of tools.
    """
    found = []
    for label, force, torque in units:
        same = bool(np.isclose(force, 1.0) and np.isclose(torque, own))
        for sign, words in ((1.0, []), (-1.0, [REVERSED])):
            lever, all_words = sign * torque / own / force, [*([] if same else [label]), *words]
            made = Unseen(
                ", ".join(all_words),
                force * weight / STANDARD_GRAVITY,
                read_only(lever * com),
                oddity(force * weight, lever * com, lever * to_the_tool),
            )
            rank = made.odd is not None, strangeness(force * weight, made.com) + USUAL * len(words)
            found += [(rank, made)] if all_words else []
    return tuple(made for _, made in sorted(found, key=lambda ranked: ranked[0]))
