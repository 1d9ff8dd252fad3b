"""Lines and points of action of forces that are put where they are, and their scatter when noise is drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from scipy.spatial.transform import Rotation

from contactwrench.compensate.line_of_action import LineOfAction, line_of_action, point_on_axis, point_on_plane
from contactwrench.errors import InputError
from tests.support.rigs import noise_of_a_design, seeds
from tests.support.world import Array

COVARIANCE = np.diag([0.05, 0.04, 0.06, 0.002, 0.003, 0.001]) ** 2


def _push(seed: int, least: float = 5.0) -> tuple[Array, Array, Array, np.random.Generator]:
    """A wrench (6,), its force and the point where it acts."""
    rng = np.random.default_rng(seed)
    force = rng.normal(size=3)
    force *= rng.uniform(least, 30.0) / np.linalg.norm(force)
    point = rng.uniform(-0.2, 0.2, 3)
    return np.r_[force, np.cross(point, force)], force, point, rng


@settings(deadline=None)
@given(seed=seeds)
def test_the_line_passes_where_the_force_acts(seed: int) -> None:
    wrench, force, point, _ = _push(seed)
    line = line_of_action(wrench, COVARIANCE)
    assert line.reason is None
    assert line.direction == pytest.approx(force / np.linalg.norm(force))
    assert np.cross(point - line.point, line.direction) == pytest.approx(np.zeros(3), abs=1e-12)
    assert line.point @ line.direction == pytest.approx(0.0, abs=1e-12)
    assert line.moment_along == pytest.approx(0.0, abs=1e-12)


@settings(deadline=None)
@given(seed=seeds)
@example(seed=536870912)
def test_known_surfaces_and_axes(seed: int) -> None:
    wrench, force, point, rng = _push(seed)
    normal = rng.normal(size=3)
    if abs(normal @ force) < 0.2 * np.linalg.norm(normal) * np.linalg.norm(force):
        normal = force
    across = np.cross(normal, rng.normal(size=3))
    on_plane = point_on_plane(wrench, COVARIANCE, point + across, normal)
    assert on_plane.point == pytest.approx(point, abs=1e-9)
    aside = np.cross(force, rng.normal(size=3))
    along = aside / np.linalg.norm(aside) + 0.3 * force / np.linalg.norm(force)  # never along the force
    on_axis = point_on_axis(wrench, COVARIANCE, point + 0.1 * along, along)
    assert on_axis.point == pytest.approx(point, abs=1e-9)
    assert on_axis.miss == pytest.approx(0.0, abs=1e-9)


def test_an_axis_that_the_line_passes_by() -> None:
    """A force along x through (0, 0.1, 0.3), beside the z axis."""
    wrench = np.r_[10.0, 0.0, 0.0, np.cross([0.0, 0.1, 0.3], [10.0, 0.0, 0.0])]
    found = point_on_axis(wrench, COVARIANCE, [0.0, 0.0, 0.0], [0.0, 0.0, 2.0])
    assert found.point == pytest.approx([0.0, 0.0, 0.3])
    assert found.miss == pytest.approx(0.1)


@pytest.mark.parametrize("seed", range(2))
def test_covariances_are_the_scatter_under_noise(seed: int) -> None:
    wrench, force, point, rng = _push(seed, least=15.0)
    root = Rotation.random(random_state=rng).as_matrix()
    mix = np.zeros((6, 6))
    mix[:3, :3] = mix[3:, 3:] = root
    covariance = mix @ COVARIANCE @ mix.T
    drawn = wrench + noise_of_a_design(150, 1, rng, np.sqrt(np.diag(COVARIANCE)))[:, 0] @ mix.T
    along, slant = np.cross(force, [0.1, 1.0, 0.3]), np.array([1.0, 0.0, 2.0])
    line, lines = line_of_action(wrench, covariance), [line_of_action(w, covariance) for w in drawn]
    for name, found, each in (
        ("line", line, lines),
        (
            "plane",
            point_on_plane(wrench, covariance, point, force + slant),
            [point_on_plane(w, covariance, point, force + slant) for w in drawn],
        ),
        (
            "axis",
            point_on_axis(wrench, covariance, point, along),
            [point_on_axis(w, covariance, point, along) for w in drawn],
        ),
    ):
        scatter = np.cov(np.array([one.point for one in each]).T)
        stated = found.point_covariance if isinstance(found, LineOfAction) else found.covariance
        assert np.abs(scatter - stated).max() < 0.15 * np.abs(stated).max(), name
    directions = np.cov(np.array([one.direction for one in lines]).T)
    assert np.abs(directions - line.direction_covariance).max() < 0.15 * np.abs(line.direction_covariance).max()
    assert np.std([one.moment_along for one in lines]) == pytest.approx(line.moment_along_std, rel=0.1)


def test_a_twist_is_told_from_a_push() -> None:
    wrench, force, _, _ = _push(1)
    twisted = wrench + np.r_[np.zeros(3), 0.5 * force / np.linalg.norm(force)]
    line = line_of_action(twisted, COVARIANCE)
    assert line.moment_along == pytest.approx(0.5)
    assert line.moment_along > 10.0 * line.moment_along_std
    assert line.point == pytest.approx(line_of_action(wrench, COVARIANCE).point)


def test_without_a_force_there_is_no_line() -> None:
    weak = np.r_[0.1, 0.0, 0.0, 0.3, 0.0, 0.0]
    reason = "the force is 0.1 N with a std of 0.05 N, expected more than 4 of those"
    line = line_of_action(weak, COVARIANCE)
    assert line.reason == reason
    assert np.isnan(line.point).all()
    assert line_of_action(np.r_[0.3, weak[1:]], COVARIANCE).reason is None
    assert point_on_plane(weak, COVARIANCE, np.zeros(3), [1.0, 0.0, 0.0]).reason == reason
    assert point_on_axis(weak, COVARIANCE, np.zeros(3), [0.0, 1.0, 0.0]).reason == reason
    assert line_of_action(np.zeros(6), COVARIANCE).reason is not None


def test_a_force_along_the_surface_or_the_axis_has_no_point() -> None:
    wrench = np.r_[10.0, 0.1, 0.0, 0.0, 0.0, 1.0]
    plane = point_on_plane(wrench, COVARIANCE, np.zeros(3), [0.0, 1.0, 0.0])
    assert plane.reason == "the force lies within 0.57 deg of the plane, expected more than 3"
    axis = point_on_axis(wrench, COVARIANCE, np.zeros(3), [1.0, 0.0, 0.0])
    assert axis.reason == "the force lies within 0.57 deg of the axis, expected more than 3"
    assert np.isnan(plane.point).all()
    assert np.isnan(axis.covariance).all()


def test_shapes_are_refused() -> None:
    with pytest.raises(InputError, match=r"have shapes \(3,\) and \(6, 6\), expected \(6,\) and \(6, 6\)"):
        line_of_action(np.zeros(3), COVARIANCE)
