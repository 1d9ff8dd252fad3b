"""The pose of one frame in another from a tree of transforms (ROS' tf): the chain between them, composed.

A transform that never changes in the recording, static or not, holds throughout. The others move. A pose of the chain
is stated as soon as each of them has been heard anew, at the latest of their stamps; the others are interpolated there,
rotations along the shortest turn and translations along the line (as tf2 does: REP 105 and tf2's documentation leave
it open, its `BufferCore` interpolates so). So a gap in any moving transform is a gap of the chain, and nothing is
carried on past the last stamp.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...errors import FileFormatError
from ...geometry.arrays import Array
from .chunks import messages
from .messages import NO_PLACEMENTS, Placements, joined_placements, rotations, transforms
from .open import Bag, Topic

STATIC = "tf_static"
FORGOTTEN = 10.0
"""s that tf2 keeps transforms for: one that is older than another before it by more is no straggler."""

Link = tuple[str, str]
"""Parent and child."""


@dataclass(frozen=True, eq=False)
class Edge:
    """What a recording says of one transform: how often it comes, whether it ever changes, and the first of it."""

    count: int
    moves: bool
    first: Placements


@dataclass(frozen=True, eq=False)
class Chain:
    """The way from `base` to `flange`: links, each with whether it is gone from child to parent. `moving` are those
    that are heard again and again, `held` the placements of the others.
    """

    base: str
    flange: str
    way: tuple[tuple[Link, bool], ...]
    moving: tuple[Link, ...]
    held: dict[Link, Placements]


@dataclass(frozen=True, eq=False)
class Heard:
    """Transforms of the links that move which are not used up, and the time of the last pose."""

    placements: dict[Link, Placements]
    until: float = -np.inf


@dataclass(frozen=True, eq=False)
class Poses:
    """Of a flange in its base, at `t` (n,) s: `R_base_flange` (n, 3, 3) and `position` (n, 3) m, None: not known."""

    t: Array
    R_base_flange: Array
    position: Array | None


def tree(bag: Bag, topics: Iterable[Topic]) -> dict[Link, Edge]:
    """Every transform of the topics, from one pass through the bag."""
    edges: dict[Link, Edge] = {}
    for found in messages(bag, topics):
        for topic, logged in found.items():
            note(edges, transforms(bag, topic, logged))
    return edges


def note(edges: dict[Link, Edge], found: dict[Link, Placements]) -> None:
    """Add what was found to what is known of each transform."""
    for link, part in found.items():
        edge = edges.get(link) or Edge(0, False, part[:1])
        changed = (part.quat_xyzw != edge.first.quat_xyzw).any() or (part.position != edge.first.position).any()
        edges[link] = Edge(edge.count + len(part.t), edge.moves or bool(changed), edge.first)


def chain(bag: Bag, edges: dict[Link, Edge], base: str, flange: str) -> Chain:
    """The chain from `base` to `flange`. Raises `FileFormatError` for a frame that is not there, frames that nothing
    connects, a frame under two parents, and a chain in which no transform comes more than once.
    """
    base, flange = base.removeprefix("/"), flange.removeprefix("/")
    known = sorted({frame for link in edges for frame in link})
    for frame in (base, flange):
        if frame not in known:
            raise FileFormatError(
                f"{bag.path}: found no frame {frame}, expected one of those in the recording: {shortened(known)}"
            )
    if base == flange:
        raise FileFormatError(f"{bag.path}: found {base} as base and as flange, expected two frames: BASE,FLANGE")
    above_base, above_flange = _ancestors(bag, edges, base), _ancestors(bag, edges, flange)
    common = next((frame for frame in above_base if frame in above_flange), None)
    if common is None:
        raise FileFormatError(
            f"{bag.path}: found no chain from {base} to {flange}, expected transforms that connect them: "
            f"{_under(base, above_base)}, {_under(flange, above_flange)}"
        )
    up = above_base[: above_base.index(common) + 1]
    down = above_flange[: above_flange.index(common) + 1][::-1]
    way = (
        *(((parent, child), True) for child, parent in pairwise(up)),
        *(((parent, child), False) for parent, child in pairwise(down)),
    )
    links = [link for link, _ in way]
    moving = tuple(link for link in links if edges[link].moves)
    moving = moving or tuple(link for link in links if edges[link].count > 1)  # an arm that stands still
    if not moving:
        raise FileFormatError(
            f"{bag.path}: found static transforms only from {base} to {flange}, expected some that the arm moves: name "
            "its base and its flange"
        )
    return Chain(base, flange, way, moving, {link: edges[link].first for link in links if link not in moving})


def hear(heard: Heard, found: dict[Link, Placements], moving: Iterable[Link]) -> Heard:
    """`heard` and what was found of the links that move."""
    placements = {
        link: joined_placements([heard.placements.get(link, NO_PLACEMENTS), found.get(link, NO_PLACEMENTS)])
        for link in moving
    }
    return Heard(placements, heard.until)


def composed(bag: Bag, chain: Chain, heard: Heard) -> tuple[Poses, Heard]:
    """The poses of flange in base as far as all links that move are heard, and what later ones need of `heard`."""
    heard = Heard({link: _forwards(bag, link, one) for link, one in heard.placements.items()}, heard.until)
    t = _times([heard.placements[link].t for link in chain.moving], heard.until)
    R, position = np.broadcast_to(np.eye(3), (len(t), 3, 3)), np.zeros((len(t), 3))
    if not len(t):
        return Poses(t, R, position), heard
    for link, upwards in chain.way:
        what = f"transform {link[0]} -> {link[1]}"
        if link in chain.held:
            R_link, position_link = rotations(bag, what, chain.held[link]), chain.held[link].position
        else:
            R_link, position_link = _between(bag, what, heard.placements[link], t)
        if upwards:
            R_link = R_link.transpose(0, 2, 1)
            position_link = -_turned(R_link, position_link)
        R, position = R @ R_link, position + _turned(R, position_link)
    until = float(t[-1])
    rest = {}
    for link, one in heard.placements.items():
        rest[link] = one[int(np.searchsorted(one.t, until, side="right")) - 1 :]
    return Poses(t, R, position), Heard(rest, until)


def shortened(names: Iterable[str]) -> str:
    """Names for a message."""
    some = list(names)
    return ", ".join(some[:12]) + (", ..." if len(some) > 12 else "")


def _ancestors(bag: Bag, edges: dict[Link, Edge], frame: str) -> list[str]:
    """The frame, its parent, and so on to the root."""
    found = [frame]
    while parents := sorted({parent for parent, child in edges if child == found[-1]}):
        if len(parents) > 1:
            raise FileFormatError(
                f"{bag.path}: found frame {found[-1]} under {' and under '.join(parents)}, expected one parent: record "
                "one robot's transforms"
            )
        if parents[0] in found:
            raise FileFormatError(
                f"{bag.path}: found frames that go round in a circle ({', '.join(found)}), expected a tree"
            )
        found.append(parents[0])
    return found


def _under(frame: str, above: list[str]) -> str:
    return f"{frame} is under {', '.join(above[1:])}" if len(above) > 1 else f"{frame} is under nothing"


def _forwards(bag: Bag, link: Link, placements: Placements) -> Placements:
    """Those that are later than all before them: tf2 too passes over what is old or repeated."""
    t = placements.t
    if (np.diff(t) > 0.0).all():
        return placements
    latest = np.maximum.accumulate(t)
    back = latest - t
    if back.max() > FORGOTTEN:
        row = int(np.argmax(back > FORGOTTEN))
        raise FileFormatError(
            f"{bag.path}: transform {link[0]} -> {link[1]}, at {t[row] - bag.start:.3f} s: found a stamp "
            f"{back[row]:.3f} s before an earlier one, expected stamps that go forwards: cut the recording there"
        )
    return placements[np.r_[True, t[1:] > latest[:-1]]]


def _times(stamps: list[Array], after: float) -> Array:
    """When each of them has been heard anew, again and again, as long as all of them are known there."""
    if all(np.array_equal(stamps[0], other) for other in stamps[1:]):
        return stamps[0][stamps[0] > after]
    each = [t.tolist() for t in stamps]
    times: list[float] = []
    while True:
        following = [bisect_right(t, after) for t in each]
        if any(place == len(t) for place, t in zip(following, each, strict=True)):
            return np.array(times)
        after = max(t[place] for place, t in zip(following, each, strict=True))
        if any(t[-1] < after for t in each):
            return np.array(times)
        times.append(after)


def _between(bag: Bag, what: str, placements: Placements, t: Array) -> tuple[Array, Array]:
    """Rotations and positions at times within those of the placements."""
    R = rotations(bag, what, placements)
    rows = np.minimum(np.searchsorted(placements.t, t), len(R) - 1)
    if np.array_equal(placements.t[rows], t):
        return R[rows], placements.position[rows]
    from scipy.spatial.transform import Rotation, Slerp

    position = np.stack([np.interp(t, placements.t, column) for column in placements.position.T], axis=1)
    between: Array = Slerp(placements.t, Rotation.from_matrix(R))(t).as_matrix()
    return between, position


def _turned(R: Array, vectors: Array) -> Array:
    """The vectors (n, 3), each turned by its rotation (n, 3, 3); one of either counts for all."""
    turned: Array = (R @ vectors[..., None])[..., 0]
    return turned
