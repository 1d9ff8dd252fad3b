"""How long something takes."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np


def median_seconds(action: Callable[[], object], times: int) -> float:
    """Median duration of `times` runs, after one that is not counted."""
    action()
    durations = []
    for _ in range(times):
        start = time.perf_counter()
        action()
        durations.append(time.perf_counter() - start)
    return float(np.median(durations))
