"""Turns of the robot's orientation beside noise and a drift, against dense matrices over all readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.calibration.findings import Kind
from contactwrench.estimation.bias_drift import STRENGTHS, Drift
from contactwrench.estimation.error_covariance import AlikeOnAxes, Turned
from contactwrench.estimation.least_squares import Priors
from contactwrench.estimation.noise import ALIKE, NoiseModel
from contactwrench.estimation.priors import PriorRows
from contactwrench.estimation.robot_errors import turns_across_gravity, turns_of_robot
from contactwrench.estimation.variance_components import Linear, at_optimum, log_spread, look_at, members_of
from contactwrench.model import PARAMETERS, RigidTool, wrench_jacobian
from tests.support.rigs import NOISE as TYPICAL
from tests.support.rigs import example
from tests.support.world import Array, Rig, readings

NOISE = 0.1 * TYPICAL
NAMES = PARAMETERS["mount"]
COLUMNS = [0, 1, 2, 3, 10, 11, 12]
TURN = 0.01


def _tool(rig: Rig) -> RigidTool:
    return RigidTool(rig.weight, rig.com, rig.bias, rig.R_flange_sensor, rig.down)


def _turns_in_the_world(rig: Rig, R: Array, alike: Array) -> Array:
    """Covariance (6 n, 6 n) of what small turns about the flange's axes read, by differences of the world."""
    step = 1e-4
    turns = [[Rotation.from_rotvec(by * axis).as_matrix() for by in (step, -step)] for axis in np.eye(3)]
    moved = [(readings(rig, R @ there) - readings(rig, R @ back)) / (2.0 * step) for there, back in turns]
    each = np.stack(moved, axis=2)
    n = len(R)
    blocks = np.einsum("iak,jbk,ij->iajb", each, each, alike)
    covariance: Array = blocks.reshape(6 * n, 6 * n)
    return covariance


CASES = {
    "alone": (False, 0.0, 0),
    "in order": (True, 0.0, 0),
    "in order, drift": (True, 3.0, 2),
    "drift": (False, 3.0, 2),
    "drift of more columns than turns": (False, 3.0, 4),
}


@pytest.fixture(scope="module", params=list(CASES.values()), ids=list(CASES))
def case(request: pytest.FixtureRequest) -> tuple[Rig, Array, Turned, Array]:
    """A rig, orientations, the covariance, and the same dense for the poses kept; one pose is left out."""
    in_order, strength, q = request.param
    rig, R, rng = example(4, poses=9)
    kept = np.arange(9) != 3
    alike = turns_of_robot(9)[-1 if in_order else 0]
    columns, relative = rng.normal(size=(9, q)), rng.uniform(0.5, 3.0, 9)
    base = AlikeOnAxes(kept, relative, NOISE**2, columns, strength)
    V = Turned(base, turns_across_gravity(_tool(rig), R, alike, kept), TURN)
    drift = np.diag(relative) + strength**2 * columns @ columns.T
    dense = np.kron(drift, np.diag(NOISE**2)) + TURN**2 * _turns_in_the_world(
        rig, R, np.eye(9) if alike is None else alike
    )
    return rig, R, V, dense


def _of_kept(V: Turned, dense: Array) -> Array:
    kept = np.repeat(V.base.kept, 6)
    return dense[np.ix_(kept, kept)]


def _of_axis(V: Turned, axis: int, across_poses: Array) -> Array:
    return _of_kept(V, np.asarray(np.kron(across_poses, np.diag(NOISE**2 * (np.arange(6) == axis)))))


def _parts(V: Turned, dense: Array) -> list[Array]:
    """What each axis' noise and drift, and what turns, contribute to the covariance of the poses kept."""
    drift = np.diag(V.base.relative) + V.base.strength**2 * V.base.columns @ V.base.columns.T
    parts = [_of_axis(V, axis, drift) for axis in range(6)]
    return [*parts, _of_kept(V, dense) - sum(parts)]


def test_the_precision_is_that_of_the_dense_covariance(case: tuple[Rig, Array, Turned, Array]) -> None:
    _, _, V, dense = case
    values = np.random.default_rng(1).normal(size=(8, 6, 4))
    inverse = np.linalg.inv(_of_kept(V, dense))
    unit = np.sqrt(np.diag(inverse))
    expected = inverse @ values.reshape(48, 4)
    assert V.precision_times(values).reshape(48, 4) / unit[:, None] == pytest.approx(expected / unit[:, None], abs=1e-3)
    for pose, block in enumerate(V.precision_blocks):
        own = slice(6 * pose, 6 * pose + 6)
        scale = np.outer(unit[own], unit[own])
        assert block / scale == pytest.approx(inverse[own, own] / scale, abs=1e-4)
    assert V.log_determinant == pytest.approx(np.linalg.slogdet(_of_kept(V, dense))[1], abs=1e-3)
    *of_axes, _ = (np.trace(inverse @ part) for part in _parts(V, dense))
    relative = np.array([np.trace(inverse @ _of_axis(V, axis, np.diag(V.base.relative))) for axis in range(6)])
    assert V.dof_of_drift == pytest.approx(np.array(of_axes) - relative, abs=1e-4)
    assert V.precision_diagonal.ravel() == pytest.approx(np.diag(inverse) * np.tile(NOISE**2, 8), rel=1e-3)
    of_all = V.parts_times(values[:, :, 0]).sum(axis=2) * NOISE  # of values in units of the noise
    assert of_all.ravel() == pytest.approx(_of_kept(V, dense) @ (values[:, :, 0] / NOISE).ravel(), rel=1e-3, abs=1e-3)


def test_a_constant_is_that_of_generalised_least_squares(case: tuple[Rig, Array, Turned, Array]) -> None:
    _, _, V, dense = case
    values = NOISE[:, None] * np.random.default_rng(2).normal(size=(8, 6, 1))
    one, inverse = np.tile(np.eye(6), (8, 1)), np.linalg.inv(_of_kept(V, dense))
    covariance = np.linalg.inv(one.T @ inverse @ one)
    constant, own = V.constant(values)
    unit = np.sqrt(np.diag(covariance))
    assert own / np.outer(unit, unit) == pytest.approx(covariance / np.outer(unit, unit), abs=1e-4)
    expected = covariance @ one.T @ inverse @ values.reshape(48, 1)
    assert constant[:, 0] / unit == pytest.approx(expected[:, 0] / unit, abs=1e-4)


def test_what_is_known_of_turns_and_drift_is_their_regression_on_the_readings(
    case: tuple[Rig, Array, Turned, Array],
) -> None:
    """Of the pose left out, too."""
    *_, V, dense = case
    errors = np.random.default_rng(3).multivariate_normal(np.zeros(48), _of_kept(V, dense)).reshape(8, 6)
    weighted = V.precision_times(errors[:, :, None])[:, :, 0]
    of_turns, of_drift = V.by_turns(weighted), V.base.in_common(weighted, slice(None))
    of_noise = np.kron(np.diag(V.base.relative), np.diag(NOISE**2))
    expected = (dense - of_noise)[:, np.repeat(V.base.kept, 6)] @ weighted.ravel()
    assert (of_turns + of_drift) / NOISE == pytest.approx(expected.reshape(9, 6) / NOISE, abs=1e-3)


def _linear(rig: Rig, R: Array, errors: Array) -> Linear:
    """Nothing known beforehand, no axis better than another."""
    J = wrench_jacobian(_tool(rig), R, NAMES)
    p = len(COLUMNS)
    rows = PriorRows(np.zeros(0), np.zeros((0, p)), np.zeros(0))
    nothing = Priors(rows, np.zeros((1, 0)), np.zeros((1, p, p)), np.zeros(1), np.array([ALIKE]))
    return Linear(J, errors, COLUMNS, rig.weight, nothing, NoiseModel(np.full(6, 1e-20), None, NOISE**2))


@pytest.mark.parametrize("size", [0.1, 3.0])
def test_how_large_a_drift_usually_is_pulls_at_its_strength(size: float) -> None:
    """The half-normal's slope, by differences: of a size x in its usual ones, minus its logarithm x^2 / 2 - log x."""
    rig, R, rng = example(6, poses=16)
    columns, every = rng.normal(size=(16, 1)), np.ones(16, dtype=bool)
    turns = turns_across_gravity(_tool(rig), R, None, every)
    V = Turned(AlikeOnAxes(every, np.ones(16), NOISE**2, columns, 5.0), turns, TURN)
    share = 5.0 * float(np.sqrt(np.mean(NOISE[:3] ** 2))) / rig.weight / size
    linear = _linear(rig, R, NOISE * rng.normal(size=(16, 6)))
    with_it, without = (look_at(linear, V, usual).slope[6] for usual in (share, None))
    by = 1e-4
    low, high = (0.5 * x**2 - np.log(x) for x in (size * np.exp(-by), size * np.exp(by)))
    assert with_it - without == pytest.approx((high - low) / (4.0 * by), rel=1e-5)


@pytest.mark.parametrize("drifts", [False, True])
def test_variances_are_where_the_restricted_likelihood_is_largest(drifts: bool) -> None:
    """Dense, priors of turns and of axes alike counted; and the parameters are of generalised least squares there."""
    rig, R, rng = example(6, poses=16)
    L = Drift(Kind.BIAS_DRIFTED, np.linspace(1.0, 0.0, 16)[:, None]).columns if drifts else np.zeros((16, 0))
    turned = readings(rig, R @ Rotation.from_rotvec(TURN * rng.normal(size=(16, 3))).as_matrix())
    errors = turned + NOISE * rng.normal(size=(16, 6)) - readings(rig, R)
    errors = errors + (L @ (20.0 * NOISE * rng.normal(size=(1, 6))) if drifts else 0.0)
    linear = _linear(rig, R, errors)
    turns = turns_across_gravity(_tool(rig), R, None, np.ones(16, dtype=bool))
    base = AlikeOnAxes(np.ones(16, dtype=bool), np.ones(16), 2.0 * NOISE**2, L, 10.0 * drifts)
    found = at_optimum(linear, Turned(base, turns, 0.5 * TURN))
    D = linear.J.reshape(96, -1)

    def log_likelihood(V: Turned) -> float:
        of_drift = np.eye(16) + V.base.strength**2 * L @ L.T
        dense = np.kron(of_drift, np.diag(V.base.variance)) + V.sd**2 * _turns_in_the_world(rig, R, np.eye(16))
        weighted = np.linalg.solve(dense, np.column_stack([D, errors.ravel()]))
        information = D.T @ weighted[:, :-1]
        left = errors.ravel() @ weighted[:, -1] - D.T @ weighted[:, -1] @ np.linalg.solve(
            information, D.T @ weighted[:, -1]
        )
        usual = (V.sd / 0.01) ** 2
        off = np.log(V.base.variance).reshape(2, 3)
        alike = np.sum((off - off.mean(axis=1, keepdims=True)) ** 2) / ALIKE**2
        logs = np.linalg.slogdet(dense)[1] + np.linalg.slogdet(information)[1]
        return float(-0.5 * (logs + left + usual - np.log(usual) + alike))

    best = log_likelihood(found.V)
    assert best > log_likelihood(Turned(base, turns, 0.5 * TURN)) + 1.0
    for factor in (0.7, 1.4):
        others = [replace(found.V, sd=factor * found.V.sd)]
        for axis in range(6):
            variance = found.V.base.variance * np.where(np.arange(6) == axis, factor, 1.0)
            others.append(replace(found.V, base=replace(found.V.base, variance=variance)))
        if drifts:
            others.append(replace(found.V, base=replace(found.V.base, strength=factor * found.V.base.strength)))
        for other in others:
            assert log_likelihood(other) < best + 0.02
    members = members_of(linear, found, 0, STRENGTHS, 0.0, 0)
    at = look_at(linear, found.V)
    assert members.covariance[0] == pytest.approx(at.covariance[np.ix_(COLUMNS, COLUMNS)], rel=1e-6)
    assert members.turn[0] == pytest.approx(TURN, rel=0.4)


def test_noise_and_turns_are_known_less_well_together_than_alone(case: tuple[Rig, Array, Turned, Array]) -> None:
    """As Fisher's information has it (dense): half the trace of the products of P and each part of the covariance."""
    rig, R, V, dense = case
    parts = _parts(V, dense)
    J = wrench_jacobian(_tool(rig), R[V.base.kept], NAMES)
    D = J.reshape(48, -1)
    inverse = np.linalg.inv(_of_kept(V, dense))
    information = D.T @ inverse @ D
    P = inverse - inverse @ D @ np.linalg.inv(information) @ D.T @ inverse
    fisher = np.array([[0.5 * np.trace(P @ a @ P @ b) for a in parts] for b in parts])
    fisher[6, 6] += 0.5 * (TURN / 0.01) ** 2
    fisher[:6, :6] += (np.eye(6) - np.kron(np.eye(2), np.ones((3, 3))) / 3.0) / ALIKE**2
    fisher += 0.05 * np.eye(7)  # never nothing
    assert log_spread(V, J, information) == pytest.approx(np.linalg.inv(fisher), rel=1e-5, abs=1e-7)
