"""The pose at the wrench's moment, and filters one sample at a time. Part of the kernel: see kernel.py."""

from __future__ import annotations

from collections.abc import Sequence

from . import state as slot
from .state import Numbers


def as_the_wrench_is_stamped(
    tool: Numbers,
    memory: Numbers,
    ring: Sequence[Numbers],
    fresh: bool,
    now: float,
    x: float,
    y: float,
    z: float,
) -> tuple[float, float, float]:
    """Down in the flange as it was when the wrench was measured.

    A wrench that lags belongs to an orientation of before, between two that are kept. For one that leads, the pose
    being late, the turn of the last moments is carried on; that is wrong by half the angular acceleration times
    delay times (delay + the time looked back).
    """
    size = len(ring)
    if fresh:
        memory[slot.RING_NEXT] = memory[slot.RING_FILLED] = memory[slot.RING_AT] = 0.0
    newest = int(memory[slot.RING_NEXT])
    entry = ring[newest]
    entry[0], entry[1], entry[2], entry[3] = now, x, y, z
    memory[slot.RING_NEXT] = (newest + 1) % size
    memory[slot.RING_FILLED] = min(memory[slot.RING_FILLED] + 1.0, size)
    at = int(memory[slot.RING_AT])
    if memory[slot.RING_FILLED] == size and at == newest:
        at = (newest + 1) % size
    wanted = now - tool[slot.LOOK_BACK]
    while at != newest and ring[(at + 1) % size][0] <= wanted:
        at = (at + 1) % size
    memory[slot.RING_AT] = at
    older = ring[at]
    later = older if at == newest else ring[(at + 1) % size]
    share = (wanted - older[0]) / (later[0] - older[0]) if later[0] > older[0] else 0.0
    share = max(share, 0.0)
    xb = older[1] + share * (later[1] - older[1])
    yb = older[2] + share * (later[2] - older[2])
    zb = older[3] + share * (later[3] - older[3])
    if tool[slot.DELAY] > 0.0:
        return xb, yb, zb
    past = min(tool[slot.LOOK_BACK], now - older[0])
    ahead = -tool[slot.DELAY] / past if past > 0.0 else 0.0
    return x + ahead * (x - xb), y + ahead * (y - yb), z + ahead * (z - zb)


def settle(filters: Numbers, at: int, memory: Numbers, state: int, values: int, count: int) -> None:
    """Start a filter as if these values had been there for ever."""
    for k in range(count):
        x = memory[values + k]
        for section in range(int(filters[at])):
            c = at + 1 + 5 * section
            y = x * (filters[c] + filters[c + 1] + filters[c + 2]) / (1.0 + filters[c + 3] + filters[c + 4])
            j = state + 2 * (section * count + k)
            memory[j] = y - filters[c] * x
            memory[j + 1] = filters[c + 2] * x - filters[c + 4] * y
            x = y


def low_pass(filters: Numbers, at: int, memory: Numbers, state: int, values: int, count: int, fresh: bool) -> None:
    """Filter `count` values in place: second-order sections, transposed direct form II."""
    if fresh:
        settle(filters, at, memory, state, values, count)
    j = state
    for section in range(int(filters[at])):
        c = at + 1 + 5 * section
        b0, b1, b2, a1, a2 = filters[c], filters[c + 1], filters[c + 2], filters[c + 3], filters[c + 4]
        for k in range(values, values + count):
            x = memory[k]
            y = b0 * x + memory[j]
            memory[j] = b1 * x - a1 * y + memory[j + 1]
            memory[j + 1] = b2 * x - a2 * y
            memory[k] = y
            j += 2
