"""What the members of the tables say beside the numbers: probabilities, and what would be otherwise by a rival."""

from __future__ import annotations

from collections.abc import Set

import numpy as np
from numpy.typing import NDArray

from ..calibration.findings import BIAS_MOVED, Kind
from ..geometry.arrays import Array
from .bias_drift import Drift
from .estimate import EXCLUDED, IN_DOUBT, Beliefs, Rival
from .problem import Problem
from .tables import Table, each_with_place, explained

OF_TOOL = slice(0, 10)
"""Of the parameters: weight, com, bias."""


def beliefs_of(problem: Problem, tables: list[Table], weight: Array, off: Array, own_variance: Array) -> Beliefs:
    """Probabilities, read off the members of all tables, each of that `weight` (m,): how far `off` the mean (m, p) its
    parameters are, with what variance of its `own`.
    """
    squared = off**2 + own_variance
    std = np.sqrt(np.maximum(weight @ squared, 1e-300))
    judged = problem.question.model == "auto" and problem.question.earlier is None
    hypotheses = [table.hypotheses[h] for table in tables for h in table.members.hypothesis]
    tilts = np.array(
        [(*h.exact, judged and h.mount is None, judged and h.base is None, all(h.exact)) for h in hypotheses]
    )
    mounting_exact, base_exact, any_mounting, any_base, both_exact = (weight @ tilts).tolist()
    off_by_mounting, off_by_base = (_off_by_exactness(is_exact, weight, squared) for is_exact in tilts.T[:2])
    of_table = [float(weight[here].sum()) for _, here in each_with_place(tables)]
    kinds = np.concatenate([table.kinds for table in tables])
    of_kind = {kind: float(weight[kinds == kind].sum()) for kind in dict.fromkeys(kinds) if kind is not None}
    turn = np.concatenate([table.members.turn for table in tables])
    of_kind[Kind.ROBOT] = float(weight[turn > 0.0].sum())
    if (with_gain := np.concatenate([table.with_gain for table in tables])).any():
        of_kind[Kind.GAIN] = float(weight[with_gain].sum())  # beside another cause, too

    def likeliest(some: Set[Kind]) -> tuple[Drift | None, Array]:
        """The likeliest drift of these kinds, if they may well be, and what each pose's bias was off by it, (n, 6)."""
        of_drift: dict[int, list[tuple[float, Drift, Table, int]]] = {}
        if sum(of_kind.get(kind, 0.0) for kind in some) < IN_DOUBT:
            return None, np.zeros_like(problem.wrench)
        for table, here in each_with_place(tables):
            for k in np.flatnonzero([kind in some for kind in table.kinds]).tolist():
                drift = table.kernel_of(k)[0]
                of_drift.setdefault(id(drift.alone or drift), []).append((float(weight[here][k]), drift, table, k))
        if not of_drift:
            return None, np.zeros_like(problem.wrench)
        members = max(of_drift.values(), key=lambda each: sum(share for share, *_ in each))
        _, drift, table, k = max(members, key=lambda member: member[0])
        return drift, explained(problem, table, k)[1]

    drift, change = likeliest(BIAS_MOVED)
    return Beliefs(
        outlying=of_table @ np.array([~table.kept for table in tables]),
        moved={kind: share for kind, share in of_kind.items() if kind in BIAS_MOVED},
        drift=drift,
        change=change,
        with_orientation={kind: share for kind, share in of_kind.items() if kind not in BIAS_MOVED},
        backlash=likeliest({Kind.TWO_LEVELS})[1],
        turn=float(np.sqrt(weight @ turn**2 / max(of_kind[Kind.ROBOT], EXCLUDED))),
        mounting_exact=mounting_exact,
        base_exact=base_exact,
        both_exact=both_exact,
        off_by_mounting=off_by_mounting * judged,
        off_by_base=off_by_base * judged,
        furthest=_furthest_drift(tables, weight, off / std),
        any_mounting=any_mounting,
        any_base=any_base,
    )


def _off_by_exactness(is_exact: NDArray[np.bool_], weight: Array, squared: Array) -> float:
    """Of mounting or base: by how many std the weight, com or bias is off, RMS, where that one is exactly nominal and
    was mostly taken not to be, or the other way round; 0 where that is as good as excluded. At most the root of 1 over
    its probability, as the std counts it too. `squared` (m, p): how far the parameters of each member are off the mean.
    """
    rival = is_exact if weight[is_exact].sum() < 0.5 else ~is_exact
    total, share = weight @ squared[:, OF_TOOL], float(weight[rival].sum())
    of_rival = weight[rival] @ squared[rival, OF_TOOL] / max(share, EXCLUDED)
    return float(np.sqrt(np.max(of_rival / np.maximum(total, 1e-300)))) * (share > EXCLUDED)


def _furthest_drift(tables: list[Table], weight: Array, off: Array) -> Rival | None:
    """Of the drifts that are neither the likeliest cause nor excluded, the one that decides most; `off` (m, p), by how
    many std the answer of each member is off.
    """
    drifts = [table.kernel_of(k)[0] for table in tables for k in range(len(table.members.kernel))]
    of_cause: dict[tuple[Kind | None, int | None], list[int]] = {}
    for member, drift in enumerate(drifts):
        of_cause.setdefault((drift.kind, drift.first_after), []).append(member)
    likeliest = max(of_cause.values(), key=lambda members: float(weight[members].sum()))
    rivals = [
        Rival(drifts[members[0]], share, float(np.max(np.abs(weight[members] @ off[members][:, OF_TOOL]))) / share)
        for (kind, _), members in of_cause.items()
        if kind in BIAS_MOVED and members is not likeliest and (share := float(weight[members].sum())) > EXCLUDED
    ]
    return max(rivals, key=lambda rival: rival.decides, default=None)
