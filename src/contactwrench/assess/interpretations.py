"""Interpretations of a file: one of its orientation times one of its wrench, and what each of them takes.

Those of the orientation's columns are made where files are read (recording/interpretations.py); all are judged in
diagnose.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..estimation.estimate import negated
from ..geometry.arrays import Array
from ..geometry.orientation import LONGEST_ROTATION_VECTOR

DOWN = (0.0, 0.0, -1.0)

COST_OF_CHANGE = 2.0 * float(np.log(20.0))
"""-2 log of the prior probability of one change from what was stated."""

REVERSED_SIGN, INVERSE, FRAME, TORQUE_UNIT = 1.0, 1.0, 1.0, 1.5
REVERSED_GRAVITY, SHIFTED, BOTH_KINDS, ONE_KIND, TORQUE_REVERSED = 1.2, 2.0, 2.0, 3.0, 2.5
"""What a change costs, in changes as likely as a wrong flag: the rarer the mistake, the more."""

SHIFTS: dict[int, tuple[str, ...]] = {
    0: (),
    1: ("each orientation belonging to the next row's wrench",),
    -1: ("each orientation belonging to the previous row's wrench",),
}

MOST_ROWS = 20_000
"""A longer recording is thinned."""
STILL = float(np.deg2rad(0.2))

LEANING_FLAG = "--model mount+base"

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
    """An interpretation of the orientation: `R_base_flange` (m, 3, 3), belonging to the file's readings in `rows` (m).

    `flags` make it so on the command line; `mends` is what else to change in the file, in words; `cost` is 0 for what
    was stated, about 1 for each change.
    """

    flags: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    R_base_flange: Array
    rows: slice


@dataclass(frozen=True, eq=False)
class WrenchInterpretation:
    """An interpretation of the wrench, but for its sign: `matrix` (6, 6) turns the file's columns into fx..tz,
    `in_base` axes or the sensor's; the rest as in `OrientationInterpretation`.
    """

    flags: tuple[str, ...]
    mends: tuple[str, ...]
    cost: float
    matrix: Array
    in_base: bool


@dataclass(frozen=True)
class TorqueUnit:
    """Another unit of the torque, in the unit that was stated: only the centre of mass can tell."""

    factor: float
    mend: str
    cost: float


@dataclass(frozen=True, eq=False)
class Interpretations:
    """A file's readings (n, 6), N and N m as stated, and all their interpretations.

    `given` is the index of the stated one of `orientations`, None where it cannot be read (`complaint` says why); the
    stated one of `wrenches` is the first. `sign` pull or reaction, as stated; `gravity` direction (3,) in base axes, as
    stated, or None.
    """

    source: str
    wrench: Array
    orientations: tuple[OrientationInterpretation, ...]
    wrenches: tuple[WrenchInterpretation, ...]
    given: int | None
    sign: str
    gravity: Array | None
    torque_units: tuple[TorqueUnit, ...] = ()
    complaint: str | None = None

    @property
    def down(self) -> Array:
        """The direction of gravity (3,) in base axes, as stated."""
        return np.array(DOWN) if self.gravity is None else np.asarray(self.gravity)

    def interpretation(
        self, orientation: int, wrench: int, negative: int, *, by_gravity: bool = False, unit: TorqueUnit | None = None
    ) -> Interpretation:
        """One interpretation of the file: of `orientations` and `wrenches` by their indices, the sign reversed where
        `negative`, or `by_gravity` the direction of gravity in its stead.
        """
        o, w = self.orientations[orientation], self.wrenches[wrench]
        reaction = bool(negative) != by_gravity
        flags = (*o.flags, *w.flags, *(["--sign reaction"] if reaction else []))
        if by_gravity:
            flags = (*flags, f"--gravity {negated(self.down)}")
        elif self.gravity is not None:
            flags = (*flags, f"--gravity {negated(-self.down)}")
        cost = o.cost + w.cost + REVERSED_SIGN * (reaction != (self.sign == "reaction"))
        cost += REVERSED_GRAVITY * by_gravity + (unit.cost if unit else 0.0)
        mends = (*o.mends, *w.mends, *([unit.mend] if unit else []))
        factor = unit.factor if unit else 1.0
        return Interpretation(flags, mends, cost, orientation, wrench, reaction, by_gravity, factor)

    def observations(self, best: Interpretation, others: Sequence[Interpretation]) -> tuple[str, ...]:
        """What would tell the best from the others."""

        def forces(interpretation: Interpretation) -> Array:
            return self.wrenches[interpretation.wrench].matrix[:3] * (-1.0 if interpretation.negated else 1.0)

        decisive = {
            PUSH: any(not np.array_equal(forces(other), forces(best)) for other in others),
            SEE_COM: any(other.wrench != best.wrench or other.torque_factor != best.torque_factor for other in others),
            SEE_POSE: any(other.orientation != best.orientation for other in others),
            SEE_BASE: any(LEANING_FLAG in other.flags or other.reversed_gravity for other in (best, *others)),
        }
        return tuple(observation for observation, decides in decisive.items() if decides)


@dataclass(frozen=True)
class Interpretation:
    """One interpretation of a file: the `flags` that make it so, all of them, and the `mends` that no flag makes.

    `orientation`, `wrench` are indices into `Interpretations`; `negated`: the readings as they stand in the file;
    `reversed_gravity`: the stated direction; `torque_factor` turns the stated unit of the torque into N m. `cost`: of
    its changes from what was stated.
    """

    flags: tuple[str, ...]
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


def as_read(file: Interpretations, interpretation: Interpretation) -> tuple[Array, Array]:
    """`R_base_flange` (m, 3, 3) and the wrench (m, 6), N and N m, sensor axes, pull sign, by an interpretation."""
    o, w = file.orientations[interpretation.orientation], file.wrenches[interpretation.wrench]
    in_si = np.repeat([1.0, interpretation.torque_factor], 3)[:, None] * w.matrix
    R = o.R_base_flange
    return R, _read_wrench(file.wrench[o.rows], -in_si if interpretation.negated else in_si, R if w.in_base else None)


def _read_wrench(wrench: Array, matrix: Array, R_base_flange: Array | None) -> Array:
    """The wrench (n, 6) in sensor axes, read by `matrix` (6, 6), which turns columns of the file into fx..tz; given
    in base axes where `R_base_flange` (n, 3, 3) is given, and then turned back.
    """
    read: Array = wrench @ matrix.T
    if R_base_flange is None:
        return read
    return np.concatenate([np.einsum("nij,ni->nj", R_base_flange, part) for part in (read[:, :3], read[:, 3:])], axis=1)


def still_poses(
    wrench: Array, orientations: Sequence[Array], load_mass: Array | None
) -> tuple[NDArray[np.intp], Array]:
    """What a file's rows at one orientation, free of a load, have in common.

    Args:
        wrench: (n, 6) of each row.
        orientations: (n, k) numbers of each row in every set of columns that could be an orientation.
        load_mass: (n,) of each row, None: none.

    Returns:
        The middle row (m,) of all rows in turn at one orientation, and their mean wrench (m, 6).
    """
    free = np.arange(len(wrench)) if load_mass is None else np.flatnonzero(load_mass == 0.0)
    free = free[:: 1 + len(free) // MOST_ROWS]
    sets = [numbers[free] for numbers in orientations]
    in_deg = [one.shape[1] == 3 and np.abs(one).max(initial=0.0) > LONGEST_ROTATION_VECTOR for one in sets]
    rows = np.hstack([np.rad2deg(1.0) ** -float(deg) * one for one, deg in zip(sets, in_deg, strict=True)]).tolist()
    first: list[int] = []
    for k, row in enumerate(rows):
        if not first or any(abs(a - b) > STILL for a, b in zip(row, rows[first[-1]], strict=True)):
            first.append(k)
    ends = list(pairwise([*first, len(rows)]))
    middle = free[np.array([(a + b) // 2 for a, b in ends], dtype=np.intp)]
    return middle, np.array([wrench[free[a:b]].mean(axis=0) for a, b in ends]).reshape(-1, 6)


def turned_and_shifted(
    candidates: Iterable[OrientationInterpretation], inverse: bool, picked: NDArray[np.intp]
) -> Iterator[OrientationInterpretation]:
    """Each of `candidates`, of all rows, and its inverse, also where each row has its neighbour's orientation: of the
    rows that are `picked`. `inverse`: the stated interpretation is one.
    """
    for one in candidates:
        for is_inverse in (inverse, not inverse):
            R = one.R_base_flange.transpose(0, 2, 1) if is_inverse else one.R_base_flange
            flags = (*one.flags, *(["--inverse-orientation"] if is_inverse else []))
            cost = one.cost + INVERSE * (is_inverse != inverse)
            for shift, mends in SHIFTS.items():
                there = (picked >= shift) & (picked - shift < len(R))
                rows = slice(int(np.argmax(there)), int(np.argmax(there)) + int(there.sum()))
                own = R[picked[there] - shift]
                yield OrientationInterpretation(flags, (*one.mends, *mends), cost + SHIFTED * bool(shift), own, rows)


def wrench_interpretations(stated_frame: str) -> Iterator[WrenchInterpretation]:
    """Every interpretation of the wrench but for its sign, the stated one first."""
    for frame in (stated_frame, "base" if stated_frame == "sensor" else "sensor"):
        flags = ("--wrench-frame base",) if frame == "base" else ()
        for mends, cost, matrix in _axes(frame):
            yield WrenchInterpretation(flags, mends, cost + FRAME * (frame != stated_frame), matrix, frame == "base")


def _axes(frame: str) -> Iterator[tuple[tuple[str, ...], float, Array]]:
    """Axes exchanged, reversed or renamed: of force and torque alike, or of one of them."""
    same = np.eye(3)
    yield (), 0.0, _blocks(same, same)
    for words, R in _axis_changes():
        yield (words.format("fx", "fy", "fz"),), ONE_KIND, _blocks(R, same)
    for words, R in _axis_changes():
        force, torque = (words.format(*(kind + axis for axis in "xyz")) for kind in "ft")
        yield (torque,), ONE_KIND, _blocks(same, R)
        if frame == "base" or np.linalg.det(R) < 0.0:  # in the sensor's axes a rotation of all is another mounting
            yield (force, torque), BOTH_KINDS, _blocks(R, R)
    yield ("tx, ty and tz reversed",), TORQUE_REVERSED, _blocks(same, -same)
    yield ("force and torque exchanged",), BOTH_KINDS, np.roll(np.eye(6), 3, axis=0)


def _axis_changes() -> Iterator[tuple[str, Array]]:
    for i, j in ((0, 1), (1, 2), (2, 0)):
        order = [0, 1, 2]
        order[i], order[j] = j, i
        yield f"{{{i}}} and {{{j}}} exchanged", np.eye(3)[order]
    for i in range(3):
        yield f"{{{i}}} reversed", np.diag([-1.0 if k == i else 1.0 for k in range(3)])
    yield "{0}, {1}, {2} written as {2}, {0}, {1}", np.eye(3)[[1, 2, 0]]
    yield "{0}, {1}, {2} written as {1}, {2}, {0}", np.eye(3)[[2, 0, 1]]


def _blocks(of_force: Array, of_torque: Array) -> Array:
    matrix = np.zeros((6, 6))
    matrix[:3, :3], matrix[3:, 3:] = of_force, of_torque
    return matrix


def torque_units(wrench_columns: tuple[str, ...]) -> tuple[TorqueUnit, ...]:
    """N mm where the file states N m, and the other way round."""
    in_nmm = wrench_columns[3].endswith("_nmm")
    factor, unit = (1e3, "N m") if in_nmm else (1e-3, "N mm")
    new = ", ".join(name if in_nmm else f"{name}_nmm" for name in ("tx", "ty", "tz"))
    mend = f"the torque in {unit} (rename {', '.join(wrench_columns[3:])} to {new})"
    return (TorqueUnit(factor, mend, TORQUE_UNIT),)
