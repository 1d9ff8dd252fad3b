"""Poses by their stamps, and a tf chain composed: against scipy, matrices and elementary cases."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contactwrench.compensate.faults import Reason
from contactwrench.geometry.quaternions import Quat
from contactwrench_ros import chain as composing
from contactwrench_ros.chain import Chain, Transform
from contactwrench_ros.track import Pose, Track, filled_in
from tests.support.ros_motion import any_placements
from tests.support.world import Array


def quat(rotation: Rotation) -> Quat:
    x, y, z, w = rotation.as_quat().tolist()
    return x, y, z, w


def angle(a: Quat | Reason, b: Rotation) -> float:
    assert not isinstance(a, Reason), a
    return float((Rotation.from_quat(a).inv() * b).magnitude())


def test_what_does_not_turn_stays_to_the_last_bit() -> None:
    """Or a compensator could not tell an orientation that is frozen."""
    track, q = Track(), quat(Rotation.from_rotvec([0.4, -0.7, 0.2]))
    for k in range(10):
        track.hear(0.01 * k, q)
    assert track.at(0.0123, 0.1) == track.at(0.0456, 0.1) == track.at(0.12, 0.1)


@example(seed=0, t=0.5 + 0.05)  # where the last bit decides
@given(st.integers(0, 10_000), st.floats(0.0, 0.6))
def test_a_steady_turn_is_followed_between_and_a_little_after(seed: int, t: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    start = Rotation.random(random_state=seed)
    track = Track()
    for now in np.arange(0.0, 0.505, 0.01).tolist():
        track.hear(now, quat(Rotation.from_rotvec(axis * now) * start))
    found = track.at(t, 0.05)
    if t - track.times[-1] > 0.05:
        assert isinstance(found, Reason)
        assert found.kind == "stale orientation"
    elif t <= 0.52:
        assert angle(found, Rotation.from_rotvec(axis * t) * start) < 1e-6
    else:  # carried on no longer than it was seen
        assert angle(found, Rotation.from_rotvec(axis * 0.52) * start) < 1e-6


def test_an_orientation_that_is_not_known_is_none() -> None:
    track, q = Track(), quat(Rotation.identity())
    assert str(track.at(1.0, 0.1)) == "orientation: none was heard yet"
    track.hear(1.0, q)
    assert str(track.at(0.9, 0.1)) == "orientation: the oldest is 0.100 s after the reading"
    assert str(track.at(1.25, 0.1)) == "orientation: the last is 0.250 s old, expected at most 0.1 s"
    track.hear(2.0, q)
    assert str(track.at(1.5, 0.1)) == "orientation: none for 1.000 s, expected one every 0.1 s"


@pytest.mark.parametrize("bad", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.1), (float("nan"), 0.0, 0.0, 1.0)])
def test_what_is_no_orientation_is_passed_over(bad: Quat) -> None:
    assert not Track().hear(0.0, bad)


def test_late_ones_are_passed_over_and_a_clock_that_begins_anew_is_followed() -> None:
    track, q = Track(), quat(Rotation.identity())
    assert track.hear(100.0, q)
    assert not track.hear(99.91, q)
    assert not track.hear(100.0, q)
    assert track.back_by(99.75) == track.back_by(99.91, 0.1) == 0.0
    assert track.back_by(99.75, 0.1) == 0.25
    assert not track.hear(90.25, q)
    assert track.hear(89.75, q)
    assert track.times == [89.75]
    track.forget()
    assert str(track.at(89.75, 0.1)) == "orientation: none was heard since stamps went back"


def test_it_does_not_grow() -> None:
    track = Track()
    for k in range(20_000):
        track.hear(0.001 * k, (0.0, 0.0, 0.0, 1.0))
    assert len(track.times) <= 4000


# The tree: world -> base_link -> one -> two -> tool0, and world -> camera beside it.
LINKS = [("world", "base_link"), ("base_link", "one"), ("one", "two"), ("two", "tool0")]


def turns(t: float) -> list[Rotation]:
    held = Rotation.random(2, random_state=5)
    return [held[0], Rotation.from_rotvec([0.3 * t, 0.0, 0.0]), Rotation.from_rotvec([0.0, 0.8 * t, 0.1]), held[1]]


def heard(chain: Chain, t: float, which: slice, static: bool = False) -> Pose | None:
    links = list(zip(LINKS, turns(t), strict=True))[which]
    return chain.hear([Transform(*link, t, quat(turn), (0.0, 0.0, 0.1)) for link, turn in links], static, 0.1)


STATIC_ONES, MOVING = (slice(0, 1), slice(3, 4)), slice(1, 3)


def test_a_chain_is_composed_of_static_and_moving_ones() -> None:
    chain = Chain("base_link", "/tool0")
    assert "frames: none" in chain.trouble()
    for part in STATIC_ONES:
        assert heard(chain, 0.0, part, static=True) is None
    assert chain.trouble().startswith("found no tf chain from base_link to tool0")
    found = heard(chain, 3.0, MOVING)
    assert found is not None
    assert found[0] == 3.0
    assert angle(found[1], turns(3.0)[1] * turns(3.0)[2] * turns(3.0)[3]) < 1e-7
    assert heard(chain, 3.0, MOVING) is None


def test_a_chain_may_go_up_and_down() -> None:
    chain = Chain("tool0", "world")
    for part in STATIC_ONES:
        heard(chain, 0.0, part, static=True)
    found = heard(chain, 1.0, MOVING)
    assert found is not None
    assert angle(found[1], (turns(1.0)[0] * turns(1.0)[1] * turns(1.0)[2] * turns(1.0)[3]).inv()) < 1e-7


def test_links_that_come_at_different_times_are_interpolated_at_the_older() -> None:
    chain = Chain("base_link", "tool0")
    for part in STATIC_ONES:
        heard(chain, 0.0, part, static=True)
    found = []
    for k in range(100):
        found += [heard(chain, 0.01 * k, slice(1, 2)), heard(chain, 0.01 * k + 0.004, slice(2, 3))]
    poses = [pose for pose in found if pose is not None]
    assert len(poses) > 190
    assert all(b[0] > a[0] for a, b in pairwise(poses))
    for t, q, _ in poses:
        assert angle(q, turns(t)[1] * turns(t)[2] * turns(t)[3]) < 1e-6
    placed = [pose.t for pose in poses if pose.place is not None]
    assert np.diff(placed) == pytest.approx(0.01)


def composed(up: int, down: int, seed: int) -> tuple[Pose | None, Array]:
    """The pose by a chain that goes so many links up from the base and so many down to the flange, of which two move
    and the others are static, and by a product of matrices (4, 4).
    """
    rng, n = np.random.default_rng(seed), up + down
    placements, true = any_placements(n, rng), np.eye(4)
    for k, T in enumerate(placements):
        true = true @ (np.linalg.inv(T) if k < up else T)
    frames, links = ["base", *(f"frame_{k}" for k in range(1, n)), "tool0"], list[Transform]()
    for k, T in enumerate(placements):
        parent, child = (frames[k + 1], frames[k]) if k < up else (frames[k], frames[k + 1])
        x, y, z = T[:3, 3].tolist()
        links.append(Transform(parent, child, 5.0, quat(Rotation.from_matrix(T[:3, :3])), (x, y, z)))
    moving = set(rng.choice(n, 2, replace=False).tolist())
    chain = Chain("base", "tool0")
    assert chain.hear([each for k, each in enumerate(links) if k not in moving], True, 0.1) is None
    return chain.hear([links[k] for k in moving], False, 0.1), true


def off(found: Pose | None, true: Array) -> float:
    """By how much it is off, rad and m."""
    assert found is not None
    assert found.place is not None
    turn = angle(found.quat_xyzw, Rotation.from_matrix(true[:3, :3]))
    return max(turn, float(np.abs(np.array(found.place) - true[:3, 3]).max()))


@given(st.integers(0, 3), st.integers(0, 3), st.integers(0, 10_000))
def test_a_chain_composes_any_rotations_and_translations(up: int, down: int, seed: int) -> None:
    if up + down >= 2:
        assert off(*composed(up, down, seed)) < 1e-6


@pytest.mark.parametrize(
    ("name", "fault"), [("rotated", lambda q, v: v), ("inverse", lambda q: q), ("product", lambda p, q: q)]
)
def test_a_chain_that_composes_wrongly_is_found(name: str, fault: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(composing, name, fault)
    assert all(off(*composed(2, 2, seed)) > 1e-3 for seed in range(5))


@pytest.mark.parametrize(
    "place", [(0.0, 0.0, 0.0), (0.5, float("nan"), 0.0), (float("inf"), 0.0, 0.0), (2e3, 0.0, 0.0)]
)
def test_a_place_that_is_none(place: tuple[float, float, float]) -> None:
    assert filled_in(place) is None
    assert filled_in((0.0, 0.0, 0.3)) == (0.0, 0.0, 0.3)


def test_a_chain_of_rotations_alone_has_no_place() -> None:
    chain, q = Chain("base_link", "tool0"), quat(Rotation.random(random_state=1))
    found = chain.hear([Transform("base_link", "tool0", 1.0, q, (0.0, 0.0, 0.0))], False, 0.1)
    assert found == (1.0, q, None)


def test_a_static_one_that_is_no_orientation_is_named() -> None:
    chain, q = Chain("base_link", "tool0"), quat(Rotation.identity())
    chain.hear([Transform("arm", "tool0", 0.0, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.1))], True, 0.1)
    assert chain.hear([Transform("base_link", "arm", 1.0, q, (0.1, 0.0, 0.0))], False, 0.1) is None
    assert chain.trouble() == "tf arm -> tool0 is the one that is behind"


def test_a_clock_that_begins_anew_is_followed_by_the_chain() -> None:
    chain, q = Chain("base_link", "tool0"), quat(Rotation.identity())
    for t, back in ((100.0, 0.0), (100.01, 0.0), (1.0, 99.01), (1.01, 0.0)):
        transforms = [Transform("base_link", "tool0", t, q, (0.1, 0.0, 0.0))]
        assert chain.back_by(transforms, 10.0) == pytest.approx(back)
        if back:
            chain.forget()
        assert chain.hear(transforms, False, 0.1) == (t, q, (0.1, 0.0, 0.0))


def test_a_transform_beside_the_chain_sets_no_clock_back() -> None:
    chain, q = Chain("base_link", "tool0"), quat(Rotation.identity())
    for name in ("tool0", "camera"):
        chain.hear([Transform("base_link", name, 100.0, q, (0.1, 0.0, 0.0))], False, 0.1)
    assert chain.back_by([Transform("base_link", "camera", 1.0, q, (0.1, 0.0, 0.0))], 10.0) == 0.0
    assert chain.back_by([Transform("base_link", "tool0", 1.0, q, (0.1, 0.0, 0.0))], 10.0) == 99.0


def test_where_all_transforms_are_as_old_none_is_behind() -> None:
    chain = Chain("base_link", "tool0")
    for part in STATIC_ONES:
        heard(chain, 0.0, part, static=True)
    heard(chain, 1.0, slice(1, 2))
    heard(chain, 1.05, slice(2, 3))
    assert chain.trouble() == ""
    heard(chain, 1.15, slice(2, 3))
    assert chain.trouble() == "tf base_link -> one is the one that is behind"


def test_a_link_that_stops_stops_the_chain_and_is_named() -> None:
    chain = Chain("base_link", "tool0")
    for part in STATIC_ONES:
        heard(chain, 0.0, part, static=True)
    heard(chain, 1.0, MOVING)
    assert all(heard(chain, 1.0 + 0.01 * k, slice(1, 2)) is None for k in range(1, 20))
    assert chain.trouble() == "tf one -> two is the one that is behind"


def test_static_ones_alone_are_no_arm() -> None:
    chain = Chain("base_link", "tool0")
    assert heard(chain, 0.0, slice(0, 4), static=True) is None
    assert chain.trouble().startswith("found static transforms only from base_link to tool0")
