"""An arm that moves, told to the node's session as ROS would: by tf or poses; and what is felt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfilt
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.filters import LowPass
from contactwrench.geometry.quaternions import Quat
from contactwrench.live.source import Three
from contactwrench.samples.flange_motion import flange_motion
from contactwrench_ros.chain import Transform
from contactwrench_ros.parameters import defaults
from contactwrench_ros.session import Session
from contactwrench_ros.track import Pose
from tests.support.in_motion import Moving
from tests.support.live_motion import T0, dynamic, swung
from tests.support.world import Array


def any_placements(n: int, rng: np.random.Generator) -> Array:
    """(n, 4, 4), any rotations, and translations of up to some metres."""
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(n, random_state=rng).as_matrix()
    T[:, :3, 3] = rng.normal(size=(n, 3))
    return T


MOVES = 2.0
"""s: from when on the arm moves fast."""
HELD = any_placements(3, np.random.default_rng(2))
"""The base in the world, an elbow in the world, from where it swings, and the flange in the wrist."""
NOTHING_MISSING = (np.inf, np.inf)


@dataclass(frozen=True)
class Arm:
    """How it tells its poses: `rate` in a second, by `tf` or as a topic's; `placed`: with positions; `late`: s by which
    readings are stamped later, and `apart`: ms, one transform of tf than the other; `lost`, `position_lost`: s in which
    poses, or their positions, do not come; from `anew` s on stamps begin anew; `scatter`: s, std of the poses' stamps.
    """

    rate: int = 500
    tf: bool = True
    placed: bool = True
    late: float = 0.0
    apart: int = 0
    lost: tuple[float, float] = NOTHING_MISSING
    position_lost: tuple[float, float] = NOTHING_MISSING
    anew: float = np.inf
    scatter: float = 0.0

    def stamp(self, t: float) -> float:
        """Of the recording's time, s."""
        return T0 + t if t < self.anew else 100.0 + t

    def told_to(self, session: Session, arm: Moving) -> Callable[[int], None]:
        """What tells the pose at a row, if it is one that the arm tells."""
        rec, every = arm.recorded, round(1000 / self.rate)
        scatter = self.scatter * np.random.default_rng(0).normal(size=len(rec.t))
        flange, elbow, wrist = placements(arm)

        def send(row: int) -> None:
            t = float(rec.t[row])
            stamp = self.stamp(t) + float(scatter[row])
            if self.lost[0] <= t < self.lost[1]:
                return
            if self.tf:
                links = [("world", "elbow", elbow, 0), ("elbow", "wrist", wrist, self.apart)]
                for parent, child, placed, apart in links:
                    if (row - apart) % every == 0:
                        session.transforms([Transform(parent, child, stamp, *placed[row])], False)
            elif row % every == 0:
                q, place = flange[row]
                has = self.placed and not self.position_lost[0] <= t < self.position_lost[1]
                session.pose(Pose(stamp, q, place if has else None))

        if self.tf:
            world, _, tool = taken_apart(HELD)
            held = [Transform("world", "base_link", 0.0, *world), Transform("wrist", "tool0", 0.0, *tool)]
            session.transforms(held, True)
        return send


def taken_apart(T: Array) -> list[tuple[Quat, Three]]:
    """The quaternion and the place of each of the matrices (n, 4, 4)."""
    quaternions, places = Rotation.from_matrix(T[:, :3, :3]).as_quat().tolist(), T[:, :3, 3].tolist()
    return [((x, y, z, w), (a, b, c)) for (x, y, z, w), (a, b, c) in zip(quaternions, places, strict=True)]


@lru_cache
def placements(arm: Moving) -> tuple[list[tuple[Quat, Three]], ...]:
    """At each row the flange in the base, the elbow in the world and the wrist in the elbow."""
    rec = arm.recorded
    flange = np.tile(np.eye(4), (len(rec.t), 1, 1))
    flange[:, :3, :3], flange[:, :3, 3] = rec.R_base_flange, rec.position
    elbow = HELD[1] @ swinging(rec.t)
    wrist = np.linalg.inv(elbow) @ HELD[0] @ flange @ np.linalg.inv(HELD[2])
    return taken_apart(flange), taken_apart(elbow), taken_apart(wrist)


def swinging(t: Array) -> Array:
    """An elbow's swing (n, 4, 4) to and fro."""
    T = np.tile(np.eye(4), (len(t), 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(np.outer(0.8 * np.sin(2.0 * t), [0.3, -0.5, 0.8])).as_matrix()
    T[:, :3, 3] = np.outer(0.2 * np.cos(3.0 * t), [0.5, 0.4, -0.7])
    return T


@dataclass(frozen=True, eq=False)
class Felt:
    """What a session made of each reading (n, 6), NaN where nothing was published; whether it felt a contact; why not
    published; and the session.
    """

    t: Array
    wrench: Array
    contact: NDArray[np.bool_]
    why: list[str]
    session: Session

    def between(self, begin: float, end: float = np.inf) -> NDArray[np.bool_]:
        """Rows of so many s of the recording."""
        rows: NDArray[np.bool_] = (self.t >= begin) & (self.t < end)
        return rows

    def rms(self, begin: float = MOVES) -> float:
        """Of the force that was published from so many s on, N."""
        return float(np.sqrt(np.nanmean(np.sum(self.wrench[self.between(begin), :3] ** 2, axis=1))))


def session_of(calibration: cw.Calibration, folder: Path, **changes: Any) -> Session:
    path = folder / "swing.json"
    calibration.save(path)
    return Session({**defaults(), "calibration": str(path), "lowpass": 20.0, **changes})


def felt(tells: Arm, folder: Path, arm: Moving | None = None) -> Felt:
    """The recording, reading by reading, with each the pose of its moment where there is one."""
    arm = arm or swung()
    delayed = replace(dynamic(), delay=(dynamic().delay or 0.0) + tells.late)
    session = session_of(delayed, folder, pose_source="tf" if tells.tf else "pose")
    rec, tell, late = arm.recorded, tells.told_to(session, arm), round(1000 * tells.late)
    wrench, contact, why = np.full((len(rec.t), 6), np.nan), np.zeros(len(rec.t), dtype=bool), list[str]()
    for row in range(len(rec.t)):
        tell(row)
        found = session.read(tells.stamp(float(rec.t[row])), rec.wrench[max(row - late, 0)])
        why.append("" if found is not None else str(session.tally.last))
        if found is not None:
            wrench[row], contact[row] = found, bool(session.contact)
    return Felt(rec.t, wrench, contact, why, session)


@lru_cache
def felt_once(tells: Arm, folder: Path) -> Felt:
    """`felt`, the same for each test that asks no more of it than what was felt, and what the session lacks."""
    return felt(tells, folder)


@lru_cache
def at_rest(folder: Path) -> Felt:
    """What it is where nothing tells the motion."""
    return felt(Arm(125, tf=False, placed=False), folder)


@lru_cache
def in_a_batch() -> float:
    """N RMS of the force that compensating the whole recording leaves, behind the same low-pass."""
    samples = swung().samples(1000.0, delay=dynamic().delay or 0.0)
    left = dynamic().compensate(samples.wrench, samples.R_base_flange, motion=flange_motion(samples))
    left = sosfilt(LowPass(20.0).sections(1000.0), left, axis=0)
    assert samples.t is not None
    return float(np.sqrt(np.mean(np.sum(left[samples.t >= MOVES, :3] ** 2, axis=1))))
