"""The pose of one frame in another from a tree of transforms (ROS' tf): the chain between them, composed.

A transform that never changes in the recording holds throughout. A pose is stated as soon as each of the others has
been heard anew, at the latest of their stamps; the others are interpolated there, rotations along the shortest turn and
translations along the line (as tf2's `BufferCore` does: REP 105 leaves it open). So a gap in any moving transform is a
gap of the chain, and nothing is carried on past the last stamp.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...errors import FileFormatError, some_of
from ...geometry.arrays import Array
from ...samples.samples import OrientationStream
from .chunks import Topic
from .messages import NO_PLACEMENTS, Link, Placements, rotations, transforms
from .open import Bag, Messages, messages

STATIC = "tf_static"
FORGOTTEN = 10.0
"""s that tf2 keeps transforms for: one that is older than another before it by more is no straggler."""

SAME = 1e-6
"""m, and of a quaternion: what is printed and read again comes back so; an arm that stands trembles by more."""


@dataclass(frozen=True, eq=False)
class Edge:
    """A transform: how often it comes, whether it ever changes, the first of it, and whether it is said to stay."""

    count: int
    moves: bool
    first: Placements
    static: bool = False


def tree(bag: Bag, topics: Iterable[Topic]) -> dict[Link, Edge]:
    """Every transform of the topics, from one pass through the bag."""
    edges: dict[Link, Edge] = {}
    for part in messages(bag, topics):
        for topic, logged in part.items():
            note(edges, topic, transforms(bag, topic, logged))
    return edges


def note(edges: dict[Link, Edge], topic: Topic, news: dict[Link, Placements]) -> None:
    """Add what was heard to what is known of each transform."""
    for link, heard in news.items():
        edge = edges.get(link) or Edge(0, False, heard.select(slice(1)))
        first = edge.first.quat_xyzw
        turned = np.minimum(np.abs(heard.quat_xyzw - first), np.abs(heard.quat_xyzw + first))  # q and -q are one
        shifted = np.abs(heard.position - edge.first.position)
        moves = edge.moves or not max(turned.max(), shifted.max()) <= SAME
        edges[link] = Edge(edge.count + len(heard), moves, edge.first, edge.static or topic.name.endswith(STATIC))


def chain(
    bag: Bag, edges: dict[Link, Edge], base: str, flange: str
) -> tuple[list[tuple[Link, bool]], dict[Link, Placements]]:
    """The links from `base` to `flange`, each with whether it is passed from child to parent, and the placements of
    those that hold throughout; the others come again and again. Raises `FileFormatError` for a frame that is not there,
    frames that nothing connects, a frame under two parents, and a chain in which no transform comes more than once.
    """
    base, flange = base.removeprefix("/"), flange.removeprefix("/")
    known = sorted({frame for link in edges for frame in link})
    for frame in (base, flange):
        if frame not in known:
            raise FileFormatError(
                f"{bag.path}: found no frame {frame}, expected one of those in the recording: {some_of(known)}"
            )
    if base == flange:
        raise FileFormatError(f"{bag.path}: found {base} as base and as flange, expected two frames: BASE,FLANGE")
    above_base, above_flange = _ancestors(bag, edges, base), _ancestors(bag, edges, flange)
    common = next((frame for frame in above_base if frame in above_flange), None)
    if common is None:
        both = (f"{line[0]} is under {', '.join(line[1:]) or 'nothing'}" for line in (above_base, above_flange))
        raise FileFormatError(
            f"{bag.path}: found no chain from {base} to {flange}, expected transforms that connect them: "
            f"{', '.join(both)}"
        )
    up = above_base[: above_base.index(common) + 1]
    down = above_flange[: above_flange.index(common) + 1][::-1]
    path = [((parent, child), True) for child, parent in pairwise(up)]
    path += [((parent, child), False) for parent, child in pairwise(down)]
    links = [link for link, _ in path]
    for parent, child in links:
        if edges[parent, child].static and edges[parent, child].moves:
            raise FileFormatError(
                f"{bag.path}: found {parent} -> {child} in {STATIC} and another time at another place, expected it to "
                "stay: record one robot's transforms"
            )
    moving = [link for link in links if edges[link].moves]
    moving = moving or [link for link in links if edges[link].count > 1]  # an arm that stands still
    if not moving:
        raise FileFormatError(
            f"{bag.path}: found static transforms only from {base} to {flange}, expected some that the arm moves: name "
            "its base and its flange"
        )
    return path, {link: edges[link].first for link in links if link not in moving}


class ChainPoses:
    """The poses of a chain as a recording goes on; it holds what later poses need, and the time of the last."""

    def __init__(self, bag: Bag, topics: Sequence[Topic], base: str, flange: str) -> None:
        self.bag, self.topics, self.until = bag, topics, -np.inf
        self.path, self.held = chain(bag, tree(bag, topics), base, flange)
        self.heard = {link: NO_PLACEMENTS for link, _ in self.path if link not in self.held}

    def read(self, part: Messages) -> OrientationStream:
        """The poses of flange in base as far as all links that move are heard by the end of this part."""
        for topic in self.topics:
            news = transforms(self.bag, topic, part[topic]) if topic in part else {}
            for link in self.heard.keys() & news.keys():
                self.heard[link] = Placements.concatenate([self.heard[link], news[link]])
        self.heard = {link: _forwards(self.bag, link, placements) for link, placements in self.heard.items()}
        t = _times([placements.t for placements in self.heard.values()], self.until)
        R, position = np.broadcast_to(np.eye(3), (len(t), 3, 3)), np.zeros((len(t), 3))
        if not len(t):
            return OrientationStream(t, R, position)
        for link, upwards in self.path:
            R_link, position_link = self._placed(link, t)
            if upwards:
                R_link = R_link.transpose(0, 2, 1)
                position_link = -_rotated(R_link, position_link)
            R, position = R @ R_link, position + _rotated(R, position_link)
        self.until = float(t[-1])
        for link, heard in self.heard.items():
            self.heard[link] = heard.select(slice(int(np.searchsorted(heard.t, self.until, side="right")) - 1, None))
        return OrientationStream(t, R, position)

    def _placed(self, link: Link, t: Array) -> tuple[Array, Array]:
        """Rotations and positions of a link at times within those at which it was heard."""
        placements = self.held[link] if link in self.held else self.heard[link]
        R = rotations(self.bag, f"transform {link[0]} -> {link[1]}", placements)
        if link in self.held:
            return R, placements.position
        rows = np.minimum(np.searchsorted(placements.t, t), len(R) - 1)
        if np.array_equal(placements.t[rows], t):
            return R[rows], placements.position[rows]
        from scipy.spatial.transform import Rotation, Slerp

        position = np.stack([np.interp(t, placements.t, column) for column in placements.position.T], axis=1)
        between: Array = Slerp(placements.t, Rotation.from_matrix(R))(t).as_matrix()
        return between, position


def _ancestors(bag: Bag, edges: dict[Link, Edge], frame: str) -> list[str]:
    """The frame, its parent, and so on to the root."""
    line = [frame]
    while parents := sorted({parent for parent, child in edges if child == line[-1]}):
        if len(parents) > 1:
            raise FileFormatError(
                f"{bag.path}: found frame {line[-1]} under {' and under '.join(parents)}, expected one parent: record "
                "one robot's transforms"
            )
        if parents[0] in line:
            raise FileFormatError(
                f"{bag.path}: found frames that go round in a circle ({', '.join(line)}), expected a tree"
            )
        line.append(parents[0])
    return line


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
    return placements.select(np.r_[True, t[1:] > latest[:-1]])


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


def _rotated(R: Array, vectors: Array) -> Array:
    """The vectors (n, 3), each rotated (n, 3, 3); one of either counts for all."""
    return (R @ vectors[..., None])[..., 0]
