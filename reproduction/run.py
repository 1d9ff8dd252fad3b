"""The whole experiment, part after part, over a pool of processes."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass

from .identification import part as identification
from .joint_torques import part as joint_torques
from .part import Part
from .planned import part as planned
from .prior_work import part as prior_work
from .sources_of_error import part as sources_of_error
from .summary import summary
from .tasks import parts as tasks
from .weighing import part as weighing


@dataclass(frozen=True)
class Step:
    """A step of the experiment: what it is called, and what makes its parts of a pool, a scale of the
    numbers of trials (1: all) and a seed.
    """

    name: str
    make: Callable[[Executor, float, int], tuple[Part, ...]]


def _alone(make: Callable[[Executor, float, int], Part]) -> Callable[[Executor, float, int], tuple[Part, ...]]:
    def parts(pool: Executor, scale: float, seed: int) -> tuple[Part, ...]:
        return (make(pool, scale, seed),)

    return parts


STEPS = (
    Step("six postures", _alone(identification)),
    Step("weighing", _alone(weighing)),
    Step("planned postures", _alone(planned)),
    Step("joint torques", _alone(joint_torques)),
    Step("prior work", _alone(prior_work)),
    Step("sources of error", _alone(sources_of_error)),
    Step("tasks with contact", tasks),
)


def run(
    pool: Executor, scale: float = 1.0, seed: int = 0, done: Callable[[str], None] = lambda name: None
) -> tuple[Part, ...]:
    """A summary, and every part of the experiment; `done` is told the name of each step that is.

    Same seed, same figures. A failure or an interruption shuts the pool down.
    All steps feed the pool at once, so that none of its processes waits for the end of a step. Raises
    `MissingExtraError` without mujoco or matplotlib.
    """
    with ThreadPoolExecutor(len(STEPS)) as threads:
        names = {threads.submit(step.make, pool, scale, seed + number): step.name for number, step in enumerate(STEPS)}
        try:
            for future in as_completed(names):
                future.result()
                done(names[future])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    parts = tuple(part for future in names for part in future.result())
    return (summary(parts), *parts)
