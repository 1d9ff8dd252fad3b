"""Section 4: the same identification from six planned poses, and so what the paper's choice of postures costs."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from functools import cache, partial

import numpy as np

from contactwrench.assess.plan import plan
from contactwrench.assess.robot_arms import flange_orientation, known_arm, reach
from contactwrench.geometry.arrays import Array, read_only

from .charts import dots_by_group
from .methods import METHODS, Learn, calibrated
from .part import Measured, Part, Picture, Table
from .trials import (
    DEFAULT,
    Squared,
    free_readings,
    in_batches,
    in_words,
    joints_of_paper,
    learned,
    left_by,
    number_of_trials,
    ratio_of_rms,
    recordings,
    rms_force,
    rms_torque,
    times,
    unseen_joints,
)

TRIALS = 20
ESTIMATORS: dict[str, Learn] = {
    "paper": METHODS["paper"],
    "yaw": calibrated("yaw", "yaw"),
    "ours": METHODS["ours"],
    "tare": METHODS["tare"],
}


@cache
def planned_joints(n: int) -> Array:
    """Joints (n, 7), rad, of the poses that the package's planner chooses for the iiwa 7 before anything is known."""
    planned = plan(n, reach=reach(known_arm("iiwa7")))
    if planned.joints is None:
        raise TypeError("a plan for an arm has joints")
    return read_only(planned.joints)


def part(pool: Executor, scale: float, seed: int) -> Part:
    """The paper's poses against as many planned ones, for each estimator."""
    n = number_of_trials(TRIALS, scale)
    unseen = unseen_joints()
    paper, planned = (
        in_batches(pool, partial(_run, poses, unseen, seed), n) for poses in (joints_of_paper(), planned_joints(6))
    )
    return Part(
        key="planned",
        title="Six planned poses",
        paragraphs=_said(paper, planned),
        tables=(_table(paper, planned),),
        pictures=(_picture(paper, planned),),
    )


def _run(poses: Array, unseen: Array, seed: int, numbers: range) -> list[dict[str, Squared]]:
    """The trials of those numbers, on joints (6, 7) and judged at joints (m, 7), rad."""
    free = free_readings(DEFAULT, unseen)
    rngs = [np.random.default_rng((seed, 4, number)) for number in numbers]
    trials = []
    for samples in recordings(DEFAULT, poses, rngs):
        methods = {name: learned(learn, samples) for name, learn in ESTIMATORS.items()}
        trials.append({name: left_by(method, free) for name, method in methods.items() if method is not None})
    return trials


def _table(paper: Sequence[dict[str, Squared]], planned: Sequence[dict[str, Squared]]) -> Table:
    rows: list[tuple[str, tuple[Measured | str | None, ...]]] = []
    for name in ESTIMATORS:
        cells: list[Measured | str | None] = []
        for trials in (paper, planned):
            of = [trial.get(name) for trial in trials]
            cells += [rms_force(of), times(rms_torque(of), 1e3)]
        rows.append((name, tuple(cells)))
    refused = sum(name not in trial for trials in (paper, planned) for trial in trials for name in ESTIMATORS)
    return Table(
        key="poses",
        title="Contact wrench left at orientations that were not recorded",
        columns=(
            "paper's six: force, N",
            "paper's six: torque, mN m",
            "six planned: force, N",
            "six planned: torque, mN m",
        ),
        rows=tuple(rows),
        note=f"Root mean square over {len(paper)} data sets with each set of poses and {len(unseen_joints())} "
        f"orientations spread at random over all rotations. Data sets refused by an estimator: {refused}.",
    )


def _picture(paper: Sequence[dict[str, Squared]], planned: Sequence[dict[str, Squared]]) -> Picture:
    groups = {
        name: {
            label: None if isinstance(force := rms_force([trial.get(name) for trial in trials]), str) else force
            for label, trials in (("paper's six poses", paper), ("six planned poses", planned))
        }
        for name in ESTIMATORS
    }
    return Picture(
        name="experiment_planned",
        html=dots_by_group(groups, "force error at orientations that were not recorded, N"),
        caption=f"What six well chosen poses are worth: RMS over {len(paper)} data sets with each set of poses, bars "
        "of one standard error.",
    )


def _said(paper: Sequence[dict[str, Squared]], planned: Sequence[dict[str, Squared]]) -> tuple[str, ...]:
    def ratio(name: str) -> str:
        both = [(a[name].force, b[name].force) for a, b in zip(paper, planned, strict=True) if name in a and name in b]
        if not both:
            return f"{name}: refused"
        refused = "" if len(both) == len(paper) else f" (over the {len(both)} of {len(paper)} that it solved on both)"
        return f"{name} {in_words(ratio_of_rms(*zip(*both, strict=True)))} times{refused}"

    cost = ", ".join(ratio(name) for name in ("paper", "yaw", "ours"))
    tilts = [
        np.rad2deg(np.arccos(np.clip(-R[:, 2, 2], -1.0, 1.0))) for R in (_orientations(joints_of_paper()), _planned())
    ]
    return (
        f"The paper's six poses tilt the tool by {tilts[0].min():.0f} to {tilts[0].max():.0f} deg from tool down; the "
        f"six planned ones, all within the iiwa's wrist, by {tilts[1].min():.0f} to {tilts[1].max():.0f} deg. The "
        f"force error with the paper's poses against that with the planned ones: {cost}.",
    )


def _planned() -> Array:
    return _orientations(planned_joints(6))


def _orientations(joints: Array) -> Array:
    return flange_orientation(known_arm("iiwa7"), joints)
