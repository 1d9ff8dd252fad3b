"""The orientation of one frame in another from tf: the chain of transforms between them, composed.

tf2's own buffer is not in every ROS for Python, and answers for any two frames at any time; here it is two frames, and
a composed orientation as soon as every moving transform of the chain has been heard anew.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf

from contactwrench.compensate.faults import Reason
from contactwrench.geometry.quaternions import Quat, inverse, product

from .track import BEGUN_ANEW, Track


@dataclass(frozen=True)
class Transform:
    """What tf says: how `child` stands in `parent` at `t` s."""

    parent: str
    child: str
    t: float
    quat_xyzw: Quat


@dataclass
class Link:
    """A child's parent and its orientations in it; of a static one (`fixed`) the last counts at any time."""

    parent: str
    track: Track = field(default_factory=Track)
    fixed: Quat | None = None


class Chain:
    """From `base` to `flange`, as far as it was heard."""

    def __init__(self, base: str, flange: str) -> None:
        self.base, self.flange = base.removeprefix("/"), flange.removeprefix("/")
        self.links: dict[str, Link] = {}
        self.path: list[tuple[Link, bool]] = []
        self.until = -inf

    def hear(self, transforms: Iterable[Transform], static: bool, stale_after: float) -> tuple[float, Quat] | None:
        """Take transforms in; the newest orientation (t s, `R_base_flange`) that all of them give, if it is a new one.

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
            link.fixed = each.quat_xyzw if static else None
            if not static:
                link.track.hear(each.t, each.quat_xyzw)
        self.path = self.path or self._path()
        return self._composed(stale_after)

    def trouble(self) -> str:
        """Why there is no orientation, or which transform is behind; empty: nothing is known to be wrong."""
        if not self.path:
            connected = f"found no tf chain from {self.base} to {self.flange}"
            known = ", ".join(sorted({*self.links, *(link.parent for link in self.links.values())})[:12])
            return f"{connected}, expected transforms that connect them; frames: {known or 'none'}"
        moving = self._moving()
        if not moving:
            return f"found static transforms only from {self.base} to {self.flange}, expected some that the arm moves"
        oldest = min(moving, key=lambda link: link.track.times[-1] if link.track.times else -inf)
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

    def _composed(self, stale_after: float) -> tuple[float, Quat] | None:
        moving = self._moving()
        if not moving or not all(link.track.times for link in moving):
            return None
        newest = min(link.track.times[-1] for link in moving)
        if newest <= self.until and newest > self.until - BEGUN_ANEW:
            return None
        R: Quat = (0.0, 0.0, 0.0, 1.0)
        for link, upwards in self.path:
            turn = link.track.at(newest, stale_after) if link.fixed is None else link.fixed
            if isinstance(turn, Reason):
                return None
            R = product(R, inverse(turn) if upwards else turn)
        self.until = newest
        return newest, R
