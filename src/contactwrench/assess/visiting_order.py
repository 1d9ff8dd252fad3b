"""In which order to visit places so that the way between them is short."""

from __future__ import annotations

import numpy as np

from ..geometry.arrays import Array


def short_order(between: Array, from_start: Array | None = None) -> list[int]:
    """An order (n) of the places 0 .. n-1 whose open way is short: `between` (n, n) the distances, the same both ways;
    `from_start` (n,) those from where the way begins, None to begin at any place.

    From every first place on always the nearest one left, then the piece whose reversal shortens the way most is
    reversed until none does (2-opt; Croes 1958); the shortest of these ways is kept. It is the shortest there is, or
    within a few per cent.
    """
    n = len(between)
    # The start is one more place, number n: at no distance from anywhere where the way may begin anywhere.
    distance = np.zeros((n + 1, n + 1))
    distance[:n, :n] = between
    if from_start is not None:
        distance[n, :n] = distance[:n, n] = from_start
    ways = [_without_crossings(_always_the_nearest(first, distance), distance) for first in range(n)]
    return min(ways, key=lambda way: float(distance[way[:-1], way[1:]].sum()))[1:]


def _always_the_nearest(first: int, distance: Array) -> list[int]:
    start = len(distance) - 1
    way, left = [start, first], set(range(start)) - {first}
    while left:
        way.append(min(left, key=lambda place: (distance[way[-1], place], place)))
        left.remove(way[-1])
    return way


def _without_crossings(way: list[int], distance: Array) -> list[int]:
    n = len(way) - 1
    while True:
        d = distance[np.ix_(way, way)]
        step = np.append(d.diagonal(1), 0.0)  # from each place to the next; the way ends after the last
        # Reversing places a..b replaces the steps a-1 -> a and b -> b+1 by a-1 -> b and a -> b+1.
        onward = np.hstack([d[1:, 2:], np.zeros((n, 1))])
        gain = np.triu(step[:-1, None] + step[None, 1:] - d[:-1, 1:] - onward, 1)
        a, b = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[a, b] <= 1e-9:
            return way
        way = way[: a + 1] + way[a + 1 : b + 2][::-1] + way[b + 2 :]
