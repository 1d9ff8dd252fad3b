"""Pushes by a hand: forces on the tool's hook that come and go while the arm follows its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array, Frozen

LEAST_FORCE, LARGEST_FORCE = 1.0, 10.0
"""N."""
SHORTEST, LONGEST = 0.2, 2.0
"""s."""
RISE = 0.03
"""s: from nothing to the whole force, and back; a hand that taps is about as quick."""
APART = 1.0
"""s: least time between pushes, and before the first and after the last."""


@dataclass(frozen=True, eq=False)
class Push(Frozen):
    """A force (3,), N, base axes, on the hook from `t_start` to `t_end`, s, rising and falling over `RISE`."""

    t_start: float
    t_end: float
    force: Array


def random_pushes(n: int, duration: float, rng: np.random.Generator) -> tuple[Push, ...]:
    """`n` pushes with random force, direction and length, spread over `duration` s. Raises `InputError` where they do
    not fit.
    """
    lasting = rng.uniform(SHORTEST, LONGEST, n)
    free = duration - float(lasting.sum()) - APART * (n + 1)
    if free < 0.0:
        needed = (LONGEST + APART) * n + APART
        raise InputError(f"{n} pushes do not fit into {duration:g} s, expected {needed:g} s or more, or fewer pushes")
    gaps = np.diff(np.sort(np.r_[0.0, rng.uniform(0.0, free, n)]), prepend=0.0)[1:] + APART
    starts = np.cumsum(gaps + np.r_[0.0, lasting[:-1]])
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    force = rng.uniform(LEAST_FORCE, LARGEST_FORCE, (n, 1)) * direction
    return tuple(
        Push(float(start), float(start + length), f) for start, length, f in zip(starts, lasting, force, strict=True)
    )


def force_on_hook(pushes: tuple[Push, ...], t: Array) -> Array:
    """The force (n, 3), N, base axes, at times (n,), s."""
    force = np.zeros((len(t), 3))
    for push in pushes:
        inside = np.minimum(t - push.t_start, push.t_end - t) / RISE
        smooth = np.clip(inside, 0.0, 1.0)
        force += (smooth**2 * (3.0 - 2.0 * smooth))[:, None] * push.force
    return force
