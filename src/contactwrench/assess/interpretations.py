"""Ways to read a file: one of its orientation times one of its wrench, and what each of them takes.

They are made where files are read (recording/interpretations.py), and judged in diagnose.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..estimation.sign_ambiguity import negated
from ..geometry.arrays import Array

DOWN = (0.0, 0.0, -1.0)

COST_OF_CHANGE = 2.0 * float(np.log(20.0))
"""-2 log of the prior probability of one change from what was stated."""

REVERSED_SIGN = 1.0
REVERSED_GRAVITY = 1.2
"""What a change costs, in changes as likely as a wrong option."""

PUSH = (
    "push the tool by hand along +x, +y and +z of the sensor: if fx, fy and fz rise, each in its turn, sign and axes "
    "are as the file names them; if all fall, --sign reaction; if one falls, it is reversed; if another one moves, the "
    "two are exchanged"
)
SEE_COM = "see where the tool's centre of mass really lies: on which side of the sensor, and how far away"
SEE_POSE = "bring the arm to a pose whose axes you can see, tilted about two of them, and try the conventions on it"
SEE_BASE = "see how the robot's base stands: upright, leaning, on a wall or on the ceiling"
"""Observations that tell apart what free air cannot."""


@dataclass(frozen=True, eq=False)
class OrientationInterpretation:
    """Of the orientation: `R_base_flange` (m, 3, 3), belonging to the file's readings in `rows` (m).

    `options` make it so on the command line, with `units` of angles where these are not empty; `mends` is what else to
    change in the file, in words; `cost` is 0 for what was stated, about 1 for each change.
    """

    options: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    R_base_flange: Array
    rows: slice | NDArray[np.bool_] = field(default_factory=lambda: slice(None))
    units: str = ""


@dataclass(frozen=True, eq=False)
class WrenchInterpretation:
    """Of the wrench, but for its sign: `matrix` (6, 6) turns the file's columns into fx..tz, `in_base` axes or the
    sensor's; the rest as in `OrientationInterpretation`.
    """

    options: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    matrix: Array
    in_base: bool


@dataclass(frozen=True)
class TorqueUnit:
    """Another unit of the torque, in the unit that was stated: only the centre of mass can tell. `units` make it so on
    the command line; where they are empty, as the file states its unit, what `mend` says.
    """

    factor: float
    units: str
    mend: str
    cost: float


@dataclass(frozen=True)
class Interpretation:
    """One way to read a file: the `options` that make it so, all of them, and the `mends` that no option makes.

    `orientation`, `wrench` are indices into `Interpretations`; `negated`: the readings as they stand in the file;
    `reversed_gravity`: the stated direction; `torque_factor` turns the stated unit of the torque into N m. `cost`: of
    its changes from what was stated.
    """

    options: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    orientation: int
    wrench: int
    negated: bool
    reversed_gravity: bool
    torque_factor: float = 1.0

    @property
    def place(self) -> tuple[int, int, int]:
        """Its indices in what screening makes of all interpretations: orientation, wrench, sign."""
        return self.orientation, self.wrench, int(self.negated != self.reversed_gravity)


@dataclass(frozen=True, eq=False)
class Interpretations:
    """A file's readings `wrench` (n, 6), N and N m as stated, and all ways to read them, the stated ones first.

    `sign` pull or reaction, as stated; `gravity` direction (3,) in base axes, as stated, or None; `units` as stated,
    `torque_unit` the other one that com tells, `wrench_units` all that sensors have, the option or words that say so
    and the factors of force and torque; `complaint` why the stated orientation cannot be read, which is then none of
    `orientations`.
    """

    source: str
    wrench: Array
    orientations: tuple[OrientationInterpretation, ...]
    wrenches: tuple[WrenchInterpretation, ...]
    sign: str
    gravity: Array | None
    units: tuple[str, ...]
    torque_unit: TorqueUnit
    wrench_units: tuple[tuple[str, float, float], ...]
    complaint: str | None

    @property
    def down(self) -> Array:
        """The direction of gravity (3,) in base axes, as stated."""
        return np.array(DOWN) if self.gravity is None else self.gravity

    @property
    def stated(self) -> Interpretation | None:
        """The stated interpretation; None where it cannot be read."""
        return None if self.complaint is not None else self.interpretation(0, 0, int(self.sign == "reaction"))

    def interpretation(
        self, orientation: int, wrench: int, negative: int, *, by_gravity: bool = False, other_unit: bool = False
    ) -> Interpretation:
        """One way to read the file: of `orientations` and `wrenches` by their indices, the sign reversed where
        `negative`, or `by_gravity` the direction of gravity in its stead; the torque in the `other_unit`.
        """
        o, w = self.orientations[orientation], self.wrenches[wrench]
        reaction = bool(negative) != by_gravity
        options = (*o.options, *w.options, *(["--sign reaction"] if reaction else []))
        if by_gravity or self.gravity is not None:
            options = (*options, f"--gravity {negated(self.down if by_gravity else -self.down)}")
        of_torque = self.torque_unit.units if other_unit else ""
        units = {pair.partition("=")[0]: pair for pair in (*self.units, o.units, of_torque) if pair}
        options = (*options, *([f"--units {','.join(units.values())}"] if units else []))
        cost = o.cost + w.cost + REVERSED_SIGN * (reaction != (self.sign == "reaction"))
        cost += REVERSED_GRAVITY * by_gravity + self.torque_unit.cost * other_unit
        mends = (*o.mends, *w.mends, *([self.torque_unit.mend] if other_unit and not of_torque else []))
        factor = self.torque_unit.factor if other_unit else 1.0
        return Interpretation(options, mends, cost, orientation, wrench, reaction, by_gravity, factor)

    def observations(self, best: Interpretation, others: Sequence[Interpretation], leans: bool) -> tuple[str, ...]:
        """What would tell the best from the others, by one of which the base `leans`."""

        def forces(interpretation: Interpretation) -> Array:
            return self.wrenches[interpretation.wrench].matrix[:3] * (-1.0 if interpretation.negated else 1.0)

        decisive = {
            PUSH: any(not np.array_equal(forces(other), forces(best)) for other in others),
            SEE_COM: any(other.wrench != best.wrench or other.torque_factor != best.torque_factor for other in others),
            SEE_POSE: any(other.orientation != best.orientation for other in others),
            SEE_BASE: leans or any(other.reversed_gravity for other in (best, *others)),
        }
        return tuple(observation for observation, decides in decisive.items() if decides)


def as_read(file: Interpretations, interpretation: Interpretation) -> tuple[Array, Array]:
    """`R_base_flange` (m, 3, 3) and the wrench (m, 6), N and N m, sensor axes, pull sign, by an interpretation."""
    o, w = file.orientations[interpretation.orientation], file.wrenches[interpretation.wrench]
    in_si = np.repeat([1.0, interpretation.torque_factor], 3) * (-1.0 if interpretation.negated else 1.0)
    wrench = file.wrench[o.rows] @ (in_si[:, None] * w.matrix).T
    if w.in_base:
        wrench = np.hstack([np.einsum("nij,ni->nj", o.R_base_flange, part) for part in np.split(wrench, 2, axis=1)])
    return o.R_base_flange, wrench
