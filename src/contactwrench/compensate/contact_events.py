"""When a contact begins and ends, and what it was. Part of the kernel: see kernel.py."""

from __future__ import annotations

from math import nan

from . import state as slot
from .state import Numbers


def detect(tool: Numbers, live: Numbers, memory: Numbers, statistic: float, now: float) -> None:
    """The contact, with hysteresis: it begins with the first of a run of samples above one threshold, and ends with the
    first of a run below another; a run lasts the minimum duration, and two samples.
    """
    if memory[slot.TOUCHING] == 0.0:
        if not statistic > live[slot.FIRE]:
            memory[slot.RUN] = 0.0
            if memory[slot.FREE_TIME] != memory[slot.FREE_TIME]:
                memory[slot.FREE_TIME] = now
            elif now - memory[slot.FREE_TIME] >= tool[slot.MINIMUM]:
                memory[slot.KNOWN_FREE] = 1.0
            return
        memory[slot.SPOILED] = 1.0
        memory[slot.FREE_TIME] = nan
        if memory[slot.RUN] == 0.0:
            memory[slot.RUN_TIME] = now
            memory[slot.SUM_ROWS] = 0.0
            memory[slot.PEAK_STATISTIC] = -1.0
            for k in range(6):
                memory[slot.SUM + k] = 0.0
        memory[slot.RUN] += 1.0
        gather(memory, statistic)
        if memory[slot.RUN] >= 2.0 and now - memory[slot.RUN_TIME] >= tool[slot.MINIMUM]:
            memory[slot.TOUCHING] = 1.0
            memory[slot.ONSET] = memory[slot.RUN_TIME]
            memory[slot.ONSET_SEEN] = memory[slot.KNOWN_FREE]
            memory[slot.QUIET] = 0.0
        return
    memory[slot.SPOILED] = 1.0
    if statistic > live[slot.QUIET_BELOW]:
        memory[slot.QUIET] = 0.0
        gather(memory, statistic)
        return
    if memory[slot.QUIET] == 0.0:
        memory[slot.QUIET_TIME] = now
    memory[slot.QUIET] += 1.0
    if memory[slot.QUIET] >= 2.0 and now - memory[slot.QUIET_TIME] >= tool[slot.MINIMUM]:
        memory[slot.TOUCHING] = 0.0
        memory[slot.RUN] = 0.0
        memory[slot.RELEASE] = memory[slot.QUIET_TIME]
        memory[slot.FREE_TIME] = memory[slot.QUIET_TIME]
        memory[slot.KNOWN_FREE] = 1.0
        memory[slot.ASK] += slot.RELEASED


def gather(memory: Numbers, statistic: float) -> None:
    """Add a sample to the contact's mean, and keep the one that stands out most."""
    memory[slot.SUM_ROWS] += 1.0
    stands_out = statistic > memory[slot.PEAK_STATISTIC]
    if stands_out:
        memory[slot.PEAK_STATISTIC] = statistic
    for k in range(6):
        memory[slot.SUM + k] += memory[slot.WRENCH + k]
        if stands_out:
            memory[slot.PEAK + k] = memory[slot.WRENCH + k]
