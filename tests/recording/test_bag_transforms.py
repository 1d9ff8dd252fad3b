"""Chains of tf against homogeneous matrices that scipy and numpy multiply, at the stamps of what moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from contactwrench.errors import FileFormatError
from contactwrench.recording.bags.read import bag_batches
from contactwrench.recording.options import Options
from contactwrench.samples.samples import OrientationStream
from tests.support.bags import (
    KINDS,
    START,
    Message,
    any_rotations,
    bag_streams,
    tf,
    transform,
    wrench_stamped,
    write_bag,
    write_mcap,
)
from tests.support.world import Array

TIME = 5e-7


def _read(path: Path, base: str, flange: str) -> OrientationStream:
    return bag_streams(path, frames=(base, flange)).orientation


def _homogeneous(R: Array, position: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    return T


@pytest.mark.parametrize("kind", KINDS)
def test_a_chain_is_composed_with_what_is_static(tmp_path: Path, kind: str) -> None:
    """map -> base static, base -> a -> b moving in one message, b -> flange static; and from any frame to any other."""
    n = 40
    rng, R = np.random.default_rng(1), any_rotations(2 * n + 2, 2)
    p = rng.normal(size=(2 * n + 2, 3))
    static = [transform(0.0, "map", "base", R[-1], p[-1]), transform(0.0, "b", "flange", R[-2], p[-2])]
    messages = [tf(0.0, static, topic="/tf_static"), wrench_stamped(0.0, np.ones(6))]
    for k in range(n):
        moving = [transform(0.01 * k, "base", "a", R[k], p[k]), transform(0.01 * k, "a", "b", R[n + k], p[n + k])]
        messages.append(tf(0.01 * k, moving[:: (-1) ** k]))
    path = write_bag(tmp_path / f"run{kind}", messages)

    T = {"map": np.tile(np.eye(4), (n, 1, 1))}
    T["base"] = np.tile(_homogeneous(R[-1], p[-1]), (n, 1, 1))
    T["a"] = T["base"] @ np.array([_homogeneous(R[k], p[k]) for k in range(n)])
    T["b"] = T["a"] @ np.array([_homogeneous(R[n + k], p[n + k]) for k in range(n)])
    T["flange"] = T["b"] @ _homogeneous(R[-2], p[-2])
    for base, flange in [("map", "flange"), ("base", "flange"), ("flange", "map"), ("b", "base"), ("a", "flange")]:
        expected = np.linalg.inv(T[base]) @ T[flange]
        found = _read(path, base, flange)
        assert found.position is not None
        np.testing.assert_allclose(found.R_base_flange, expected[:, :3, :3], atol=1e-12)
        np.testing.assert_allclose(found.position, expected[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(found.t - 1e-9 * START, 0.01 * np.arange(n), atol=TIME)
        assert found.source == f"{path} {base} -> {flange}"


def test_frames_of_two_branches_meet_at_their_ancestor(tmp_path: Path) -> None:
    R, p = any_rotations(4, 3), np.random.default_rng(3).normal(size=(4, 3))
    messages = [wrench_stamped(0.0, np.ones(6))]
    for k in range(2):
        edges = [
            transform(0.1 * k, "world", "base", R[k], p[k]),
            transform(0.1 * k, "world", "hand", R[2 + k], p[2 + k]),
        ]
        messages.append(tf(0.1 * k, edges))
    found = _read(write_bag(tmp_path / "run.mcap", messages), "base", "hand")
    for k in range(2):
        base, hand = (RigidTransform.from_components(p[i], Rotation.from_matrix(R[i])) for i in (k, 2 + k))
        expected = (base.inv() * hand).as_matrix()
        np.testing.assert_allclose(found.R_base_flange[k], expected[:3, :3], atol=1e-12)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.integers(1, 300), min_size=2, max_size=12, unique=True),
    st.lists(st.integers(1, 300), min_size=2, max_size=12, unique=True),
    st.integers(0, 2**31),
)
def test_what_is_heard_at_other_times_is_interpolated(
    tmp_path_factory: pytest.TempPathFactory, first: list[int], second: list[int], seed: int
) -> None:
    """Joints that turn steadily about fixed axes: between two transforms of a joint the turn is known exactly."""
    rng = np.random.default_rng(seed)
    axes, rates = rng.normal(size=(2, 3)), rng.uniform(-1.0, 1.0, 2)  # less than half a turn in 3 s
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    mounts, arms = Rotation.random(2, random_state=seed), rng.normal(size=(2, 3))

    def at(k: int, t: float) -> Rotation:
        return mounts[k] * Rotation.from_rotvec(axes[k] * rates[k] * t)

    times = [sorted(0.01 * np.array(first)), sorted(0.01 * np.array(second))]
    links = [("base", "a"), ("a", "flange")]
    messages: list[Message] = [wrench_stamped(0.0, np.ones(6))]
    for k in range(2):
        messages += [tf(t, [transform(t, *links[k], at(k, t).as_matrix(), arms[k])]) for t in times[k]]
    messages.sort(key=lambda message: message.stamp)
    path = write_mcap(tmp_path_factory.mktemp("tf") / "run.mcap", messages, chunk_size=2000)
    start, end = max(t[0] for t in times), min(t[-1] for t in times)
    if start > end:
        with pytest.raises(FileFormatError, match="found no time at which all transforms of base -> flange are known"):
            _read(path, "base", "flange")
        return
    whole = _read(path, "base", "flange")
    t = whole.t - 1e-9 * START
    expected = [(at(0, s) * at(1, s)).as_matrix() for s in t]
    np.testing.assert_allclose(whole.R_base_flange, expected, atol=1e-5)
    every = np.concatenate(times)
    assert all(np.abs(every - s).min() < TIME for s in t)
    assert t[0] == pytest.approx(start, abs=TIME)
    for k in range(2):  # between two poses, each transform is heard anew
        between = np.searchsorted(times[k], t + TIME)
        assert (np.diff(between) > 0).all()
    piecewise = list(bag_batches(path, Options(frames=("base", "flange")), 1))
    np.testing.assert_array_equal(np.concatenate([one.orientation.t for one in piecewise]), whole.t)


def test_a_gap_of_one_transform_is_a_gap_of_the_chain(tmp_path: Path) -> None:
    R = any_rotations(200, 5)
    messages = [wrench_stamped(0.0, np.ones(6))]
    for k in range(100):
        edges = [transform(0.01 * k, "base", "a", R[k], np.zeros(3))]
        if not 30 < k < 60:
            edges.append(transform(0.01 * k, "a", "flange", R[100 + k], np.zeros(3)))
        messages.append(tf(0.01 * k, edges))
    t = _read(write_bag(tmp_path / "run.bag", messages), "base", "flange").t - 1e-9 * START
    np.testing.assert_allclose(t, [0.01 * k for k in range(100) if not 30 < k < 60], atol=TIME)


def test_batches_of_a_chain_are_the_whole(tmp_path: Path) -> None:
    """Two publishers out of step, in a bag of many chunks."""
    n = 400
    R = any_rotations(2 * n, 7)
    messages = [wrench_stamped(0.0, np.ones(6))]
    for k in range(n):
        messages.append(tf(0.01 * k, [transform(0.01 * k, "base", "a", R[k], np.zeros(3))]))
        messages.append(tf(0.01 * k + 0.003, [transform(0.01 * k + 0.003, "a", "flange", R[n + k], np.zeros(3))]))
    path = write_mcap(tmp_path / "run.mcap", messages, chunk_size=5000)
    parts = [part.orientation for part in bag_batches(path, Options(frames=("base", "flange")), 30)]
    assert len(parts) > 5
    t = np.concatenate([part.t for part in parts]) - 1e-9 * START
    np.testing.assert_allclose(t, 0.003 + 0.01 * np.arange(n - 1), atol=TIME)
    k, middle = n // 2, Rotation.from_matrix(R[n // 2])
    step = (middle.inv() * Rotation.from_matrix(R[k + 1])).as_rotvec()
    expected = middle * Rotation.from_rotvec(0.3 * step) * Rotation.from_matrix(R[n + k])
    found = np.concatenate([part.R_base_flange for part in parts])[k]
    np.testing.assert_allclose(found, expected.as_matrix(), atol=1e-3)


def test_an_arm_that_stands_still_has_a_chain(tmp_path: Path) -> None:
    R = any_rotations(1, 9)[0]
    messages = [wrench_stamped(0.0, np.ones(6))]
    messages += [tf(0.1 * k, [transform(0.1 * k, "base", "flange", R, np.ones(3))]) for k in range(3)]
    found = _read(write_bag(tmp_path / "run.mcap", messages), "base", "flange")
    np.testing.assert_allclose(found.R_base_flange, [R] * 3, atol=1e-14)


def test_slashes_of_the_first_tf_and_stragglers_are_passed_over(tmp_path: Path) -> None:
    R = any_rotations(4, 11)
    messages = [wrench_stamped(0.0, np.ones(6))]
    for k, t in enumerate([0.0, 0.1, 0.05, 0.1]):
        messages.append(tf(0.1 * k, [transform(t, "/base", "/flange", R[k], np.zeros(3))]))
    found = _read(write_bag(tmp_path / "run.bag", messages), "base", "flange")
    np.testing.assert_allclose(found.R_base_flange, R[:2], atol=1e-14)


EDGES = [("world", "base"), ("base", "a"), ("a", "tool"), ("camera", "marker")]


@pytest.mark.parametrize(
    ("edges", "frames", "message"),
    [
        (
            EDGES,
            ("bas", "tool"),
            "found no frame bas, expected one of those in the recording: a, base, camera, marker, tool, world",
        ),
        (EDGES, ("tool", "tool"), "found tool as base and as flange, expected two frames: BASE,FLANGE"),
        (
            EDGES,
            ("tool", "marker"),
            "found no chain from tool to marker, expected transforms that connect them: tool is "
            "under a, base, world, marker is under camera",
        ),
        (
            EDGES,
            ("world", "camera"),
            "found no chain from world to camera, expected transforms that connect them: world "
            "is under nothing, camera is under nothing",
        ),
        (
            [*EDGES, ("world", "tool")],
            ("base", "tool"),
            "found frame tool under a and under world, expected one parent: record one robot's transforms",
        ),
        ([("a", "b"), ("b", "a")], ("a", "b"), "found frames that go round in a circle (a, b), expected a tree"),
    ],
)
def test_frames_that_give_no_chain_are_named(
    tmp_path: Path, edges: list[tuple[str, str]], frames: tuple[str, str], message: str
) -> None:
    R = any_rotations(2 * len(edges), 1)
    messages = [wrench_stamped(0.0, np.ones(6))]
    for t in (0, 1):
        messages.append(tf(t, [transform(t, *e, R[2 * k + t], np.zeros(3)) for k, e in enumerate(edges)]))
    path = write_bag(tmp_path / "run.mcap", messages)
    with pytest.raises(FileFormatError) as caught:
        bag_streams(path, frames=frames)
    assert str(caught.value) == f"{path}: {message}"


def test_a_static_chain_is_refused(tmp_path: Path) -> None:
    static = tf(0.0, [transform(0.0, "base", "flange", np.eye(3), np.zeros(3))], topic="/tf_static")
    path = write_bag(tmp_path / "run.mcap", [wrench_stamped(0.0, np.ones(6)), static])
    with pytest.raises(FileFormatError) as caught:
        _read(path, "base", "flange")
    assert str(caught.value) == (
        f"{path}: found static transforms only from base to flange, expected some that the arm moves: name its base "
        "and its flange"
    )


def test_stamps_that_jump_back_are_named(tmp_path: Path) -> None:
    R = any_rotations(3, 1)
    messages = [wrench_stamped(0.0, np.ones(6))]
    for k, t in enumerate([0.0, 100.0, 50.0]):
        messages.append(tf(0.1 * k, [transform(t, "base", "flange", R[k], np.zeros(3))]))
    path = write_bag(tmp_path / "run.mcap", messages)
    with pytest.raises(FileFormatError) as caught:
        _read(path, "base", "flange")
    assert str(caught.value) == (
        f"{path}: transform base -> flange, at 50.000 s: found a stamp 50.000 s before an earlier one, expected stamps "
        "that go forwards: cut the recording there"
    )


def test_a_quaternion_that_is_none_is_named_with_its_transform(tmp_path: Path) -> None:
    edges = [transform(0.1 * k, "base", "flange", R, np.zeros(3)) for k, R in enumerate(any_rotations(2, 1))]
    edges[1]["transform"]["rotation"] = {}
    messages = [wrench_stamped(0.0, np.ones(6)), *(tf(0.1 * k, [one]) for k, one in enumerate(edges))]
    path = write_bag(tmp_path / "run.mcap", messages)
    with pytest.raises(FileFormatError) as caught:
        _read(path, "base", "flange")
    assert str(caught.value) == (
        f"{path}: transform base -> flange, at 0.100 s: found a quaternion of length 0, expected 1 within 1 %: check "
        "the order of its parts and that none is cut off"
    )
