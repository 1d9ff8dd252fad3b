"""The pose of one frame in another from tf: the chain of transforms between them, composed.

tf2's own buffer is not in every ROS for Python, and answers for any two frames at any time; here it is two frames, and
a composed pose as soon as every moving transform of the chain has been heard anew.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf

from contactwrench.compensate.faults import Reason
from contactwrench.geometry.quaternions import Quat, inverse, product, rotated, unit
from contactwrench.live.source import Three

from .track import ORIGIN, Pose, Track, filled_in

TOGETHER = 0.1
"""s: transforms whose last stamps are no further apart are as old as each other."""


@dataclass(frozen=True)
class Transform:
    """What tf says of `child` in `parent` at `t` s: how it is turned, and its `place`, m, in the axes of `parent`."""

    parent: str
    child: str
    t: float
    quat_xyzw: Quat
    place: Three


@dataclass
class Link:
    """A child's parent and its poses in it; of a static one (`fixed`) the last counts at any time."""

    parent: str
    track: Track = field(default_factory=Track)
    fixed: tuple[Quat, Three] | None = None

    def at(self, t: float, stale_after: float) -> tuple[Quat, Three] | None:
        """The child's orientation and place in its parent, m, at a time, s; None: they are not known."""
        if self.fixed is not None:
            return self.fixed
        turn = self.track.at(t, stale_after)
        return None if isinstance(turn, Reason) else (turn, self.track.place(t))


class Chain:
    """From `base` to `flange`, as far as it was heard."""

    def __init__(self, base: str, flange: str) -> None:
        self.base, self.flange = base.removeprefix("/"), flange.removeprefix("/")
        self.links: dict[str, Link] = {}
        self.path: list[tuple[Link, bool]] = []
        self.until = self.placed = -inf

    def back_by(self, transforms: Iterable[Transform], most: float) -> float:
        """By how much, s, those transforms that the chain is of are behind what was heard, if by more than `most`, else
        0.
        """
        stamped = {each.child.removeprefix("/"): each.t for each in transforms}
        heard = ((link, stamped[child]) for child, link in self.links.items() if child in stamped)
        moving = {id(link) for link in self._moving()}
        return max((link.track.back_by(t, most) for link, t in heard if id(link) in moving), default=0.0)

    def forget(self) -> None:
        """Stamps went back: the moving transforms are forgotten, all of them, as one clock stamps them."""
        for link in self.links.values():
            link.track.forget()
        self.until = self.placed = -inf

    def hear(self, transforms: Iterable[Transform], static: bool, stale_after: float) -> Pose | None:
        """Take transforms in; the newest pose of the flange in the base that all of them give, if it is a new one. It
        has a place where every moving transform was heard anew since the last that had one: between two stamps a
        transform is interpolated along a straight line, whose ends are no acceleration of the arm's.

        Args:
            transforms: of a message.
            static: whether they hold at any time.
            stale_after: s, over which no transform is interpolated.
        """
        for each in transforms:
            parent, child = each.parent.removeprefix("/"), each.child.removeprefix("/")
            link = self.links.get(child)
            if link is None or link.parent != parent:
                link = self.links[child] = Link(parent)
                self.path = []
            turn = unit(each.quat_xyzw)
            link.fixed = (turn, each.place) if static and turn is not None else None
            if not static:
                link.track.hear(each.t, each.quat_xyzw, each.place)
        self.path = self.path or self._path()
        return self._composed(stale_after)

    def trouble(self) -> str:
        """Why there is no pose, or which transform is behind; empty: nothing is known to be wrong."""
        if not self.path:
            connected = f"found no tf chain from {self.base} to {self.flange}"
            known = ", ".join(sorted({*self.links, *(link.parent for link in self.links.values())})[:12])
            return f"{connected}, expected transforms that connect them; frames: {known or 'none'}"
        moving = self._moving()
        if not moving:
            return f"found static transforms only from {self.base} to {self.flange}, expected some that the arm moves"
        oldest = min(moving, key=lambda link: link.track.newest(inf))
        if max(link.track.newest(inf) for link in moving) <= oldest.track.newest(inf) + TOGETHER:
            return ""  # all are as old, and none of them is to blame
        child = next(name for name, link in self.links.items() if link is oldest)
        return f"tf {oldest.parent} -> {child} is the one that is behind"

    def _moving(self) -> list[Link]:
        return [link for link, _ in self.path if link.fixed is None]

    def _path(self) -> list[tuple[Link, bool]]:
        """The links from base to flange, each with whether it is passed from child to parent; empty: not connected."""
        up, down = self._line(self.base), self._line(self.flange)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            return []
        rising = [(self.links[frame], True) for frame in up[: up.index(common)]]
        return rising + [(self.links[frame], False) for frame in down[: down.index(common)][::-1]]

    def _line(self, frame: str) -> list[str]:
        """The frame, its parent, and so on to the root."""
        line = [frame]
        while (link := self.links.get(line[-1])) is not None and link.parent not in line:
            line.append(link.parent)
        return line

    def _composed(self, stale_after: float) -> Pose | None:
        moving = self._moving()
        if not moving or not all(link.track.times for link in moving):
            return None
        newest = min(link.track.times[-1] for link in moving)
        if newest <= self.until:
            return None
        R: Quat = (0.0, 0.0, 0.0, 1.0)
        x, y, z = ORIGIN
        for link, upwards in self.path:
            if (found := link.at(newest, stale_after)) is None:
                return None
            turn, (a, b, c) = found
            if upwards:
                turn = inverse(turn)
                a, b, c = rotated(turn, (-a, -b, -c))
            a, b, c = rotated(R, (a, b, c))
            x, y, z, R = x + a, y + b, z + c, product(R, turn)
        self.until = newest
        if not all(link.track.newest(newest) > self.placed for link in moving):
            return Pose(newest, R, None)
        self.placed = newest
        return Pose(newest, R, filled_in((x, y, z)))
