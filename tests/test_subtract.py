"""The three ways to compensate, numpy, fused and sample by sample, against world-frame physics and each other."""

from __future__ import annotations

import importlib
import re
from contextlib import nullcontext
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.compensate.runner import compiled
from contactwrench.errors import InputError
from contactwrench.geometry.orientation import nearest_rotations
from tests.support.rigs import example, noise_free, seeds
from tests.support.world import Array, Rig, random_rotations, readings

kernel = importlib.import_module("contactwrench.subtract")

KERNELS = ["numpy", pytest.param("fused", marks=pytest.mark.skipif(find_spec("numba") is None, reason="no numba"))]


@pytest.fixture
def force_kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Take one kernel whatever the number of samples."""
    which: str = request.param
    monkeypatch.setattr(kernel, "FUSED_FROM", 1 if which == "fused" else 2**62)
    return which


both_kernels = pytest.mark.parametrize("force_kernel", KERNELS, indirect=True)


def _case(seed: int, n: int) -> tuple[cw.Calibration, Array, Array, Array]:
    """A calibration, orientations, a contact wrench, and what the sensor reads of it."""
    calibration, rig = _calibrated(seed)
    rng = np.random.default_rng((seed, 1))
    orientations, contact = random_rotations(n, rng), rng.normal(size=(n, 6))
    return calibration, orientations, contact, readings(rig, orientations) + contact


@cache
def _calibrated(seed: int) -> tuple[cw.Calibration, Rig]:
    rig, R, _ = example(seed)
    return cw.calibrate(noise_free(rig, R), "mount"), rig


@both_kernels
@pytest.mark.parametrize("n", [1, 2, 7, 8191, 8192, 8193, 20_001])
def test_the_contact_wrench_comes_back(force_kernel: str, n: int) -> None:
    calibration, R, contact, wrench = _case(1, n)
    assert np.abs(calibration.compensate(wrench, R) - contact).max() < 1e-8
    quat_xyzw = Rotation.from_matrix(R).as_quat()
    assert np.abs(calibration.compensate(wrench, quat_xyzw) - contact).max() < 1e-8
    assert np.abs(calibration.compensate(wrench, -quat_xyzw) - contact).max() < 1e-8
    assert np.abs(calibration.compensate(wrench, Rotation.from_matrix(R)) - contact).max() < 1e-8


@pytest.mark.slow
@settings(deadline=None, max_examples=8)
@given(seed=seeds, n=st.integers(1, 200))
def test_step_and_batch_agree(seed: int, n: int) -> None:
    calibration, R, _, wrench = _case(seed, n)
    quat_xyzw = Rotation.from_matrix(R).as_quat()
    step = calibration.stepper()
    one_by_one = [step(*row) for row in np.hstack([wrench, quat_xyzw]).tolist()]
    assert np.abs(one_by_one - calibration.compensate(wrench, quat_xyzw)).max() < 1e-10
    assert all(type(part) is float for part in one_by_one[0])
    assert isinstance(one_by_one[0], tuple)


@both_kernels
@pytest.mark.parametrize("leading", [(3, 4), (2, 3, 4), (1, 1), (2, 0)])
def test_a_batch_of_sequences_is_what_its_rows_are(force_kernel: str, leading: tuple[int, ...]) -> None:
    n = int(np.prod(leading))
    calibration, R, _, wrench = _case(5, n)
    quat_xyzw = Rotation.from_matrix(R).as_quat() if n else np.empty((0, 4))
    batch = wrench.reshape(*leading, 6)
    expected = calibration.compensate(wrench, R).reshape(*leading, 6)
    for turns in (R.reshape(*leading, 3, 3), quat_xyzw.reshape(*leading, 4)):
        assert calibration.compensate(batch, turns) == pytest.approx(expected, abs=1e-12)
        assert calibration.predict(turns) == pytest.approx(batch - expected, abs=1e-12)
        assert calibration.predict(turns).shape == calibration.wrench_std(turns).shape == (*leading, 6)
        rows = turns.reshape(n, *turns.shape[len(leading) :])
        assert np.array_equal(calibration.wrench_std(turns).reshape(n, 6), calibration.wrench_std(rows))
        assert calibration.wrench_covariance(turns).shape == (*leading, 6, 6)
        given, out = batch.copy(), np.empty_like(batch)
        assert calibration.compensate(given, turns, out=out) is out
        assert calibration.compensate(given, turns, out=given) is given
        assert np.array_equal(given, out)
        assert out == pytest.approx(expected, abs=1e-12)
    one = calibration.compensate(batch, np.eye(3))
    assert np.array_equal(one, calibration.compensate(wrench, np.eye(3)).reshape(*leading, 6))
    turned = np.swapaxes(batch, 0, -2)  # not one row after the other in memory
    assert calibration.compensate(turned, np.eye(3)) == pytest.approx(np.swapaxes(one, 0, -2), abs=1e-12)


def test_the_result_of_a_batch_has_its_shape() -> None:
    calibration, R, _, wrench = _case(5, 6)
    with pytest.raises(InputError) as raised:
        calibration.compensate(wrench.reshape(2, 3, 6), R.reshape(2, 3, 3, 3), out=np.empty((6, 6)))
    assert str(raised.value) == "out has shape (6, 6) and type float64, expected (2, 3, 6) float64, C order"


def test_poses_are_no_quaternions_in_fours() -> None:
    calibration, _ = _calibrated(5)
    poses = np.zeros((5, 4, 4))
    poses[:, :3, :3], poses[:, 3, 3] = np.eye(3), 1.0
    for each in (calibration.predict, calibration.wrench_std, calibration.wrench_covariance):
        with pytest.raises(InputError) as raised:
            each(poses)
        assert str(raised.value) == (
            "orientation has shape (5, 4, 4), expected (n, 3, 3) rotation matrices, (n, 4) quaternions x, y, z, w or a "
            "scipy Rotation"
        )
    fours = Rotation.from_matrix(random_rotations(20, np.random.default_rng(1))).as_quat().reshape(5, 4, 4)
    assert calibration.predict(fours).shape == (5, 4, 6)


def test_a_compensator_runs_one_sequence_at_a_time() -> None:
    calibration, R, _, wrench = _case(5, 6)
    with pytest.raises(InputError) as raised:
        cw.Compensator(calibration, noise=0.1, fast=False).run(wrench.reshape(2, 3, 6), R, np.arange(6.0))
    assert str(raised.value) == (
        "wrench has shape (2, 3, 6), expected (n, 6), one after the other in time: run each sequence by itself, after "
        "reset()"
    )


@pytest.mark.skipif(find_spec("numba") is None, reason="no numba")
def test_kernels_agree_to_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    calibration, R, _, wrench = _case(3, 60_000)
    for orientation in (R, Rotation.from_matrix(R).as_quat()):
        fused = calibration.compensate(wrench, orientation)
        with monkeypatch.context() as patched:
            patched.setattr(kernel, "FUSED_FROM", 2**62)
            chunked = calibration.compensate(wrench, orientation)
        assert np.abs(fused - chunked).max() < 1e-12


@both_kernels
def test_out_receives_the_result(force_kernel: str) -> None:
    calibration, R, contact, wrench = _case(4, 500)
    out = np.full((500, 6), 7.0)
    assert calibration.compensate(wrench, R, out=out) is out
    assert np.abs(out - contact).max() < 1e-8
    calibration.compensate(wrench, R, out=wrench)
    assert np.array_equal(wrench, out)


def test_inputs_are_left_alone() -> None:
    calibration, R, _, wrench = _case(5, 50)
    quat_xyzw = Rotation.from_matrix(R).as_quat()
    before = wrench.copy(), quat_xyzw.copy()
    calibration.compensate(wrench, quat_xyzw)
    assert np.array_equal(wrench, before[0])
    assert np.array_equal(quat_xyzw, before[1])


@both_kernels
def test_one_sample(force_kernel: str) -> None:
    calibration, R, contact, wrench = _case(6, 1)
    quaternion = Rotation.from_matrix(R[0])
    for orientation in (R[0], quaternion.as_quat(), quaternion, R, quaternion.as_quat()[None]):
        result = calibration.compensate(wrench[0], orientation)
        assert result.shape == (6,)
        assert np.abs(result - contact[0]).max() < 1e-8
    out = np.empty(6)
    assert calibration.compensate(wrench[0], R[0], out=out) is out
    assert np.abs(out - contact[0]).max() < 1e-8


@both_kernels
def test_one_orientation_for_all_readings(force_kernel: str) -> None:
    calibration, R, _, wrench = _case(7, 30)
    expected = calibration.compensate(wrench, np.repeat(R[:1], 30, axis=0))
    assert calibration.compensate(wrench, R[0]) == pytest.approx(expected)
    assert calibration.compensate(wrench, Rotation.from_matrix(R[0])) == pytest.approx(expected)


@both_kernels
def test_views_lists_and_other_types_are_taken(force_kernel: str) -> None:
    calibration, R, contact, wrench = _case(8, 40)
    quat_xyzw = Rotation.from_matrix(R).as_quat()
    wide = np.zeros((40, 12))
    wide[:, ::2] = wrench
    assert np.abs(calibration.compensate(wide[:, ::2], quat_xyzw) - contact).max() < 1e-8
    assert np.abs(calibration.compensate(wrench[::-1], R[::-1]) - contact[::-1]).max() < 1e-8
    assert (
        np.abs(calibration.compensate(np.asfortranarray(wrench), np.asfortranarray(quat_xyzw)) - contact).max() < 1e-8
    )
    assert np.abs(calibration.compensate(wrench.tolist(), quat_xyzw.tolist()) - contact).max() < 1e-8
    assert np.abs(calibration.compensate(wrench.astype(np.float32), R.astype(np.float32)) - contact).max() < 1e-3
    assert calibration.compensate(np.ones((40, 6), dtype=int), R).dtype == np.float64


@both_kernels
def test_quaternions_a_little_off_unit_length_are_normalised(force_kernel: str) -> None:
    calibration, R, contact, wrench = _case(9, 40)
    quat_xyzw = 1.008 * Rotation.from_matrix(R).as_quat()
    assert np.abs(calibration.compensate(wrench, quat_xyzw) - contact).max() < 1e-8


@both_kernels
@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0, 1.02, 0.98])
@pytest.mark.parametrize("matrices", [True, False])
def test_what_is_no_orientation_is_refused_and_its_row_named(force_kernel: str, bad: float, matrices: bool) -> None:
    calibration, R, _, wrench = _case(10, 60)
    orientation = R.copy() if matrices else Rotation.from_matrix(R).as_quat()
    orientation[37] *= bad
    with pytest.raises(InputError, match=r"orientation 37 is .*expected .* within 1 %") as refused:
        calibration.compensate(wrench, orientation)
    assert refused.value.row == 37


@pytest.fixture(params=KERNELS)
def as_given(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few matrices, too, are taken as they are."""
    monkeypatch.setattr(kernel, "FUSED_FROM", 1)
    if request.param == "numpy":
        monkeypatch.setattr(kernel, "has_compiler", lambda: False)


@pytest.mark.usefixtures("as_given")
@pytest.mark.parametrize("place", [0, 8191, 8192, 20_000])
@pytest.mark.parametrize("bad", [np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 1.011, 1.0]), np.eye(3)[[1, 0, 2]]])
def test_a_matrix_that_is_no_rotation_is_refused_wherever_it_stands(bad: Array, place: int) -> None:
    calibration, R, _, wrench = _case(12, 20_001)
    R[place] = R[place] @ bad
    with pytest.raises(InputError, match=f"orientation {place} is a matrix that is no rotation"):
        calibration.compensate(wrench, R)


def test_matrices_a_little_off_are_taken_for_the_nearest_rotations() -> None:
    """Stretched by up to 0.4 % along any axes, as rounded digits do: the rotation nearest to R S is R."""
    calibration, R, contact, wrench = _case(11, 40)
    turn = random_rotations(40, np.random.default_rng(11))
    stretch = np.array([1.004, 0.997, 1.001])
    off = R @ (turn * stretch) @ turn.transpose(0, 2, 1)
    assert np.abs(off - R).max() > 2e-3
    assert np.abs(calibration.compensate(wrench, off) - contact).max() < 1e-8


@pytest.mark.usefixtures("as_given")
def test_matrices_as_given_are_held_to_what_those_made_exact_are() -> None:
    """The quick look lets nothing pass that is refused elsewhere, and refuses no more, near 1 % either way."""
    calibration, R, _, wrench = _case(13, 200)
    off = np.eye(3) + np.random.default_rng(13).normal(scale=0.006, size=R.shape)
    refused = 0
    for k, matrix in enumerate(R @ off):
        message = ""
        try:
            nearest_rotations(matrix[None])
        except InputError as error:
            message = str(error)
        with nullcontext() if not message else pytest.raises(InputError, match=re.escape(message)):
            calibration.compensate(wrench[k : k + 1], matrix[None])
        refused += bool(message)
    assert 40 < refused < 160


@both_kernels
def test_a_single_nan_in_an_orientation_is_refused(force_kernel: str) -> None:
    calibration, R, _, wrench = _case(11, 60)
    quat_xyzw = Rotation.from_matrix(R).as_quat()
    for row in (0, 30, 59):
        broken = quat_xyzw.copy()
        broken[row, 2] = np.nan
        with pytest.raises(InputError, match=f"orientation {row} "):
            calibration.compensate(wrench, broken)


@both_kernels
def test_a_nan_in_a_reading_stays_in_its_row(force_kernel: str) -> None:
    calibration, R, contact, wrench = _case(12, 60)
    wrench[20, 3] = np.nan
    result = calibration.compensate(wrench, R)
    assert np.isnan(result[20, 3])
    result[20, 3] = contact[20, 3]
    assert np.abs(result - contact).max() < 1e-8


@pytest.mark.parametrize(
    ("wrench", "orientation", "message"),
    [
        (np.ones((5, 5)), np.ones((5, 4)) / 2, r"wrench has shape \(5, 5\), expected \(n, 6\) or \(6,\)"),
        (np.ones(5), np.ones((5, 4)) / 2, r"wrench has shape \(5,\)"),
        (np.ones((5, 6)), np.ones((4, 4)) / 2, r"orientation has shape \(4, 4\).*for 5 readings"),
        (np.ones((5, 6)), np.ones((5, 3)), r"orientation has shape \(5, 3\)"),
        (
            np.ones((2, 5, 6)),
            np.ones((10, 4)) / 2,
            r"shape \(10, 4\), expected \(2, 5, 3, 3\) .* \(2, 5, 4\) .* 10 read",
        ),
        (np.ones((2, 5, 6)), np.ones((5, 4)) / 2, r"orientation has shape \(5, 4\)"),
        (np.ones((2, 5)), np.ones((2, 4)) / 2, r"wrench has shape \(2, 5\)"),
    ],
)
def test_shapes_that_do_not_pair(wrench: Array, orientation: Array, message: str) -> None:
    with pytest.raises(InputError, match=message):
        _case(13, 1)[0].compensate(wrench, orientation)


@pytest.mark.parametrize(
    "out", [np.empty((4, 6)), np.empty((5, 6), dtype=np.float32), np.empty((6, 5)).T, np.empty((10, 6))[::2]]
)
def test_an_out_that_cannot_take_the_result(out: Any) -> None:
    calibration, R, _, wrench = _case(14, 5)
    with pytest.raises(InputError, match=r"expected \(5, 6\) float64, C order"):
        calibration.compensate(wrench, R, out=out)


def test_nothing_in_nothing_out() -> None:
    calibration = _case(15, 1)[0]
    assert calibration.compensate(np.empty((0, 6)), np.empty((0, 4))).shape == (0, 6)
    assert calibration.compensate(np.empty((0, 6)), np.empty((0, 3, 3))).shape == (0, 6)


@pytest.mark.skipif(find_spec("numba") is None, reason="no numba")
def test_the_fused_kernel_may_run_in_several_threads_at_once() -> None:
    from concurrent.futures import ThreadPoolExecutor

    calibration, R, contact, wrench = _case(16, 60_000)
    quat_xyzw = Rotation.from_matrix(R).as_quat()
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda _: calibration.compensate(wrench, quat_xyzw), range(8)))
    assert all(np.abs(result - contact).max() < 1e-8 for result in results)


class Full:
    """In place of numba's files: a disk without space."""

    def __init__(self, *_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")


def _add(a, b):  # type: ignore[no-untyped-def]
    return a + b


@pytest.mark.skipif(find_spec("numba") is None, reason="no numba")
@pytest.mark.parametrize("full", ["tempfile.TemporaryFile", "numba.core.caching.IndexDataCacheFile"])
def test_where_nothing_can_be_kept_it_is_compiled_all_the_same(full: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A read-only installation without a home, where numba finds no folder; and a full disk."""
    from numba import int64, njit

    monkeypatch.setattr(full, Full)
    with pytest.raises((RuntimeError, OSError), match=r"no locator available|No space left"):
        njit(cache=True)(_add)
    assert kernel.compiled_by_numba(_add, (int64, int64))(1, 2) == 3


def test_numba_that_is_switched_off_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """NUMBA_DISABLE_JIT made an AttributeError of each batch and of each `Compensator`."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    monkeypatch.setattr(kernel, "FUSED_FROM", 1)
    monkeypatch.setattr(kernel, "_compensate_fused", None)
    calibration, R, _, wrench = _case(12, 20)
    assert np.isfinite(calibration.compensate(wrench, R)).all()
    compensated = cw.Compensator(calibration)(wrench[0], R[0], 0.0)
    assert np.isfinite(compensated.wrench).all()
    if find_spec("numba") is None:
        return
    compiled.cache_clear()
    with pytest.raises(InputError) as refused:
        cw.Compensator(calibration, fast=True)
    assert str(refused.value) == "NUMBA_DISABLE_JIT is set, expected not with fast=True: unset it, or leave fast out"
