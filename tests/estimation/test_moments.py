"""The moments of poses and what is solved on them, against dense matrices over all readings."""

from __future__ import annotations

import numpy as np
import pytest

from contactwrench.calibration.findings import Kind
from contactwrench.estimation.bias_drift import Drift, Kernels, kernels_of, possible_drifts
from contactwrench.estimation.error_covariance import precision_diagonal, precision_times
from contactwrench.estimation.hypotheses import Hypothesis
from contactwrench.estimation.least_squares import Members, Priors, columns_of_axes, moments_of, solved
from contactwrench.estimation.noise import ALIKE, APART, NoiseModel, StatedNoise
from contactwrench.estimation.posterior import deleted_errors
from contactwrench.estimation.priors import PriorRows, Question
from contactwrench.estimation.problem import Problem
from contactwrench.estimation.settling import settled
from contactwrench.estimation.tables import Table
from contactwrench.model import PARAMETERS, RigidTool
from tests.support.rigs import NOISE, example
from tests.support.world import Array, Rig, derivatives, noisy_readings

NAMES = PARAMETERS["mount"]
TOOL = [0, 1, 2, 3, 10, 11, 12]
"""Weight, com and mounting, without the bias, in the order of world.derivatives."""


def _kernels(n: int, rng: np.random.Generator) -> Kernels:
    """Every motion of the bias at times of any spacing, and one of no shape at all."""
    drifts, log_prior = possible_drifts(np.cumsum(rng.uniform(1.0, 9.0, n)), n)
    return kernels_of(n, [*drifts, Drift(Kind.BIAS_WANDERED, rng.normal(size=(n, 3)))], [*log_prior, -4.0])


def _dense(kernels: Kernels, k: int, variance: Array) -> Array:
    """The covariance (n, n) across poses, in units of the noise."""
    L = kernels.strength[k] * kernels.drifts[kernels.drift[k]].columns
    covariance: Array = np.diag(variance) + L @ L.T
    return covariance


def _tool(rig: Rig) -> RigidTool:
    return RigidTool(rig.weight, rig.com, rig.bias, rig.R_flange_sensor, rig.down)


def _alone(kernels: Kernels, k: int) -> Kernels:
    return kernels.select(np.array([k]))


@pytest.mark.parametrize("n", [5, 12])
def test_moments_are_those_of_contrasts_that_no_constant_reaches(n: int) -> None:
    """Rows seen through a basis of contrasts C, which a bias does not reach: X^T C (C^T K C)^-1 C^T X."""
    rng = np.random.default_rng(n)
    X, variance, kernels = rng.normal(size=(n, 15)), rng.uniform(0.5, 3.0, n), _kernels(n, rng)
    moments = moments_of(X, variance, kernels, np.eye(15)[None], np.ones(n, dtype=bool))
    C = np.linalg.svd(np.ones((1, n)))[2][1:].T
    assert moments.n == n
    for k in range(len(kernels.drift)):
        of_contrasts = C.T @ _dense(kernels, k, variance) @ C
        expected = X.T @ C @ np.linalg.solve(of_contrasts, C.T @ X)
        assert moments.gram[k, 0] == pytest.approx(expected, rel=1e-6, abs=1e-7)
        log_determinant = np.linalg.slogdet(of_contrasts)[1] + np.log(n)
        assert moments.log_determinant[k] == pytest.approx(log_determinant, abs=1e-6)


def test_a_precision_times_columns_is_that_of_the_dense_covariance() -> None:
    rng = np.random.default_rng(1)
    variance, kernels, values = rng.uniform(0.5, 3.0, 9), _kernels(9, rng), rng.normal(size=(9, 4))
    for k in range(len(kernels.drift)):
        L = kernels.strength[k] * kernels.drifts[kernels.drift[k]].columns
        expected = np.linalg.solve(_dense(kernels, k, variance), values)
        assert precision_times(L, variance, values) == pytest.approx(expected, abs=1e-6)


def _solved(rig: Rig, R: Array, wrench: Array, kernels: Kernels) -> Members:
    """The members of all kernels where nothing is known beforehand, linearised at the truth, noise up to a scale."""
    n, p = len(R), len(TOOL)
    tool = _tool(rig)
    problem = Problem(R, wrench, np.ones(n), kernels, NAMES, Question("mount", rig.down), _noise())
    X, W = np.concatenate([R.reshape(n, 9), problem.errors(tool)], axis=1), columns_of_axes(tool, NAMES)
    moments = moments_of(X, np.ones(n), kernels, W, np.ones(n, dtype=bool))
    nothing_known = PriorRows(np.zeros(0), np.zeros((0, p)), np.zeros(0))
    nothing = Priors(nothing_known, np.zeros((1, 0)), np.zeros((1, p, p)), np.zeros(1), np.ones(1))
    pairs = np.arange(len(kernels.drift)), np.zeros(len(kernels.drift), dtype=int)
    return solved(moments, kernels, nothing, pairs, _noise())


def _noise() -> NoiseModel:
    return NoiseModel(np.full(6, 1e-20), StatedNoise(NOISE), NOISE**2)


@pytest.mark.parametrize("seed", range(3))
def test_the_members_of_a_stack_are_what_each_is_alone(seed: int) -> None:
    """Though they come to rest after unequally many passes."""
    rig, R, rng = example(seed, poses=9)
    kernels, wrench = _kernels(9, rng), noisy_readings(rig, R, NOISE * rng.uniform(0.3, 3.0, 6), rng)
    wrench[:3] += 20.0 * NOISE * rng.normal(size=(3, 6))
    n, tool, noise = 9, _tool(rig), NoiseModel(np.full(6, 1e-20), None, NOISE**2)
    problem = Problem(R, wrench, np.ones(n), kernels, NAMES, Question("mount", rig.down), noise)
    X, W = np.concatenate([R.reshape(n, 9), problem.errors(tool)], axis=1), columns_of_axes(tool, NAMES)
    moments = moments_of(X, np.ones(n), kernels, W, np.ones(n, dtype=bool))
    p = len(TOOL)
    rows = PriorRows(np.zeros(0), np.zeros((0, p)), np.zeros(0))
    apart = Priors(rows, np.zeros((2, 0)), np.zeros((2, p, p)), np.zeros(2), np.array([APART, ALIKE]))
    k, h = np.indices((len(kernels.drift), 2)).reshape(2, -1)
    given = moments, kernels, apart
    stack = solved(*given, (k, h), noise)
    alone = [solved(*given, (k[i : i + 1], h[i : i + 1]), noise) for i in range(len(k))]
    assert np.abs(stack.log_evidence - [one.log_evidence[0] for one in alone]).max() < 0.05
    std = np.sqrt(np.einsum("mpp->mp", stack.covariance))
    assert np.abs((stack.step - [one.step[0] for one in alone]) / std).max() < 0.1
    assert np.abs(np.log(std / np.sqrt([np.diag(one.covariance[0]) for one in alone]))).max() < 0.02


def _in_one(rig: Rig, R: Array, wrench: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Of all readings in one: the design (6n, 7 + 6) of tool and bias, the errors (6n,), the covariance (6n, 6n)."""
    J = derivatives(rig, "mount", R)
    D = np.concatenate([J[:, :, TOOL], np.tile(np.eye(6), (len(R), 1, 1))], axis=2).reshape(6 * len(R), -1)
    truth = Rig(rig.weight, rig.com, rig.bias, rig.R_flange_sensor, rig.down)
    errors = (wrench - noisy_readings(truth, R, np.zeros(6), np.random.default_rng(0))).ravel()
    return D, errors, np.asarray(np.kron(covariance, np.diag(NOISE**2)), dtype=np.float64)


def test_steps_and_covariances_are_those_of_generalised_least_squares_on_all_readings() -> None:
    rig, R, rng = example(3, poses=9)
    kernels, wrench = _kernels(9, rng), noisy_readings(rig, R, NOISE, rng)
    members = _solved(rig, R, wrench, kernels)
    for k in range(0, len(kernels.drift), 5):
        D, errors, N = _in_one(rig, R, wrench, _dense(kernels, k, np.ones(9)))
        weighted = np.linalg.solve(N, D)
        covariance = np.linalg.inv(D.T @ weighted)
        step = covariance @ (weighted.T @ errors)
        left = errors - D @ step
        scale = float(left @ np.linalg.solve(N, left)) / (6 * 9 - 13)
        unit = np.sqrt(scale * np.diag(covariance))[:7]
        assert members.step[k] / unit == pytest.approx(step[:7] / unit, abs=1e-4)
        assert members.variance[k] == pytest.approx(scale * NOISE**2, rel=1e-4)
        off = (members.covariance[k] - scale * covariance[:7, :7]) / np.outer(unit, unit)
        assert np.abs(off).max() < 1e-3


def test_the_evidence_of_a_motion_against_a_steady_bias_is_the_ratio_of_marginal_likelihoods() -> None:
    """Parameters and bias integrated over all values, the noise's scale over all scales (dense, in closed form)."""
    rig, R, rng = example(4, poses=9)
    kernels, wrench = _kernels(9, rng), noisy_readings(rig, R, NOISE, rng)
    wrench[:4] += 5.0 * NOISE
    found = _solved(rig, R, wrench, kernels).log_evidence - kernels.log_prior

    def log_marginal(k: int) -> float:
        D, errors, N = _in_one(rig, R, wrench, _dense(kernels, k, np.ones(9)))
        information = D.T @ np.linalg.solve(N, D)
        left = errors - D @ np.linalg.solve(information, D.T @ np.linalg.solve(N, errors))
        misfit = float(left @ np.linalg.solve(N, left))
        logs = np.linalg.slogdet(N)[1] + np.linalg.slogdet(information)[1] + (6 * 9 - 13) * np.log(misfit)
        return -0.5 * float(logs)

    steady = log_marginal(0)
    for k in range(1, len(kernels.drift), 4):
        assert found[k] - found[0] == pytest.approx(log_marginal(k) - steady, abs=1e-2), kernels.drifts[k // 7].kind


@pytest.mark.parametrize("kind", [None, Kind.BIAS_STEPPED, Kind.BIAS_WANDERED, Kind.BIAS_DRIFTED])
def test_held_out_errors_are_off_what_the_other_poses_predict(kind: Kind | None) -> None:
    """A refit to the others (dense), and under a moving bias the regression on what is left in them."""
    rig, R, rng = example(5, poses=9)
    wrench, every = noisy_readings(rig, R, NOISE, rng), _kernels(9, rng)
    wanted = [every.drifts[drift].kind is kind for drift in every.drift]
    k = int(np.flatnonzero(wanted & np.isin(every.strength, (0.0, 10.0)))[0])
    kernels = _alone(every, k)
    problem = Problem(R, wrench, np.ones(9), kernels, NAMES, Question("mount", rig.down), _noise())
    free = (Hypothesis(None, None, (False, False), 0.0),)
    table: Table = settled(problem, _tool(rig), np.ones(9, dtype=bool), free)
    found = deleted_errors(problem, table)
    assert found is not None
    at = Rig(table.tool.weight, table.tool.com, rig.bias, table.tool.R_flange_sensor, rig.down)
    D, errors, N = _in_one(at, R, wrench, _dense(kernels, 0, np.ones(9)))
    for pose in range(9):
        own = np.arange(6 * pose, 6 * pose + 6)
        others = np.setdiff1d(np.arange(54), own)
        inverse = np.linalg.inv(N[np.ix_(others, others)])
        step = np.linalg.solve(D[others].T @ inverse @ D[others], D[others].T @ inverse @ errors[others])
        left = errors - D @ step
        predicted = N[np.ix_(own, others)] @ inverse @ left[others]
        assert found[pose] / NOISE == pytest.approx((left[own] - predicted) / NOISE, abs=0.02)


def test_the_precision_s_diagonal_is_that_of_the_dense_inverse() -> None:
    rng = np.random.default_rng(77)
    columns, variance = rng.normal(size=(500, 3)), rng.uniform(0.5, 2.0, 500)
    dense = np.linalg.inv(np.diag(variance) + 9.0 * columns @ columns.T)
    assert precision_diagonal(3.0 * columns, variance) == pytest.approx(np.diag(dense), rel=1e-9)
