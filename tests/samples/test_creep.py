"""Creep of a sensor is told from noise by what all stops have in common; it makes a calibration doubtful."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation, Slerp

import contactwrench as cw
from contactwrench.calibration.findings import Kind
from contactwrench.errors import InputError
from contactwrench.estimation.findings_of_recording import with_creep
from contactwrench.samples.creep import Creep, Stop, creep_of
from contactwrench.samples.recorded_poses import recorded_poses

Array = NDArray[np.float64]
WEIGHT, RATE = 9.0, 50.0
LOADS = 9.0 * Rotation.random(14, rng=np.random.default_rng(5)).apply([0.0, 0.0, 1.0])
TAUS = np.geomspace(0.05, 5e4, 60)
"""s: so many exponentials in even steps of the logarithm are a logarithm."""


@cache
def _forces(per_e_fold: float, stop: float, move: float) -> list[tuple[float, Array, Array]]:
    """Of each stop when the arm came, and times since then with the forces (n, 3) that such a sensor shows."""
    came = (stop + move) * np.arange(len(LOADS)) + 1.79e9
    found = []
    for k, at in enumerate(came):
        since = np.arange(0.3, stop, 1.0 / RATE)
        force = np.tile(LOADS[k], (len(since), 1)).astype(float)
        for j in range(1, k + 1):
            force += per_e_fold * np.log(at + since - came[j])[:, None] * (LOADS[j] - LOADS[j - 1])
        found.append((float(at), since, force))
    return found


def stops(per_e_fold: float, noise: float, seed: int, stop: float = 4.0, move: float = 2.0) -> list[Stop]:
    """Stops of a sensor that shows so much of each change of load late with each factor e of time."""
    rng = np.random.default_rng(seed)
    return [
        Stop(force + noise * rng.standard_normal(force.shape), at, float(at + since[0]), float(at + since[-1]), 0.0)
        for at, since, force in _forces(per_e_fold, stop, move)
    ]


def sure(some: list[Stop]) -> bool:
    found = creep_of(some)
    return found is not None and found.sure


@pytest.mark.parametrize("per_e_fold", [0.001, 0.01, -0.004])
@pytest.mark.parametrize("stop", [1.0, 4.0, 30.0])
def test_creep_by_the_logarithm_of_time_is_found_whatever_the_stops(per_e_fold: float, stop: float) -> None:
    """From the mean of a stop to a hundred times its length: ln 100, and ln of its end over the mean time."""
    found = creep_of(stops(per_e_fold, 1e-4, 1, stop))
    assert found is not None
    assert found.sure
    assert found.share / per_e_fold == pytest.approx(np.log(100.0) + 0.87, rel=0.12)
    changes = np.linalg.norm(np.diff(LOADS, axis=0), axis=1)
    assert found.change == pytest.approx(np.sqrt(np.mean(changes**2)), rel=0.05)


@pytest.mark.parametrize("number", [4, 6, 14])
def test_noise_is_no_creep_whatever_the_number_of_stops(number: int) -> None:
    """One in a hundred; of 300, 10 and more have a chance of 0.1 %."""
    assert sum(sure(stops(0.0, 0.05, seed, 1.0)[:number]) for seed in range(300)) < 10


@pytest.mark.parametrize(("share", "std", "not_excluded"), [(0.0, 0.0, 0.0), (0.02, 0.0, 0.02), (0.0, 9.0, 0.01)])
def test_what_is_not_excluded_is_what_the_stops_say_or_what_is_usual(
    share: float, std: float, not_excluded: float
) -> None:
    assert Creep(share, std, False, 1.0).not_excluded == pytest.approx(not_excluded, rel=1e-3)


def test_the_std_of_the_share_is_how_far_it_scatters() -> None:
    found = [creep_of(stops(0.002, 0.05, seed)) for seed in range(200)]
    off = [(each.share / 0.002 - np.log(100.0) - 0.87) / (each.std / 0.002) for each in found if each is not None]
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.15)


def test_an_arm_that_settles_is_no_creep() -> None:
    """What a turn that is recorded does to the reading is not the sensor's."""
    some = stops(0.0001, 1e-5, 1)
    assert sure(some)
    assert not sure([replace(each, turn=1e-3) for each in some])
    assert sure([replace(each, turn=1e-5) for each in some])


@pytest.mark.parametrize("touched", [1, 3])
@pytest.mark.parametrize("per_e_fold", [0.0, 0.01])
def test_a_touch_is_no_creep_and_hides_none(touched: int, per_e_fold: float) -> None:
    """Of 0.1 s in some of fourteen stops; by least squares one made the share 35 times as uncertain."""
    said = 0
    for seed in range(40):
        some, rng = stops(per_e_fold, 0.05, seed), np.random.default_rng(seed)
        alone, pushed = creep_of(some), list(some)
        for k in rng.choice(len(some), touched, replace=False):
            force, at = some[k].force.copy(), rng.integers(len(some[k].force) - 5)
            force[at : at + 5] += 20.0 * rng.standard_normal(3)
            pushed[k] = replace(some[k], force=force)
        found = creep_of(pushed)
        assert found is not None
        assert alone is not None
        assert abs(found.share - alone.share) < 4.0 * alone.std
        assert found.std < 2.0 * alone.std
        said += found.sure
    assert said == 40 if per_e_fold else said <= 2


def test_one_load_tells_nothing() -> None:
    assert creep_of([replace(each, force=each.force - each.force.mean(axis=0)) for each in stops(0.01, 0.0, 0)]) is None


def test_too_few_stops_or_rows_tell_nothing() -> None:
    some = stops(0.01, 1e-4, 0)
    assert creep_of(some[:3]) is None
    assert creep_of(some[:4]) is not None
    assert creep_of([replace(each, force=each.force[:9]) for each in some]) is None


def recording(seed: int, share: float, tau: float, stop: float, cone: float = 180.0) -> cw.Samples:
    """A stream of an arm that stops at twelve orientations, from a sensor with one time constant, on one clock; `cone`:
    deg that the flange leans at most.
    """
    rng, R = np.random.default_rng(seed), Rotation.random(12, rng=np.random.default_rng(seed + 50))
    if cone < 180.0:
        R = Rotation.from_rotvec(np.deg2rad(cone) / np.pi * R.as_rotvec())
    edges = (np.arange(12)[:, None] * (stop + 2.0) + [0.0, stop]).ravel()
    t = np.arange(0.0, edges[-1], 1.0 / RATE)
    turn = Slerp(edges, R[np.repeat(np.arange(12), 2)])(t)
    mounting = Rotation.from_euler("zxy", [20.0, 0.5, -0.3], degrees=True)
    force = (turn * mounting).inv().apply([0.0, 0.0, -WEIGHT])
    true = np.hstack([force, np.cross([0.01, -0.005, 0.06], force)])
    share_of_new = 1.0 / (RATE * tau)
    settled = (1.0 - share_of_new) * true[:1]
    late = lfilter([share_of_new], [1.0, share_of_new - 1.0], true, axis=0, zi=settled)[0]
    noise = rng.standard_normal(true.shape) * np.repeat([0.02, 0.001], 3)
    bias = np.array([3.0, -2.0, 5.0, 0.1, 0.2, -0.1])
    wrench = (1.0 - share) * true + share * late + bias + noise
    return cw.Samples(wrench, turn.as_matrix(), t, delay=0.0, delay_std=1e-4)


@pytest.mark.parametrize(("share", "tau", "stop"), [(0.02, 5.0, 3.0), (0.05, 15.0, 3.0), (0.02, 15.0, 8.0)])
def test_a_recording_of_a_creeping_sensor_is_doubtful(share: float, tau: float, stop: float) -> None:
    calibration = cw.calibrate(recording(2, share, tau, stop), "auto" if tau < 15.0 else "mount")
    assert calibration.weight is not None
    assert WEIGHT - 4.0 * calibration.std["weight"] < calibration.weight < WEIGHT
    assert calibration.verdict != "good"
    (text,) = [each.text for each in calibration.findings if each.kind is Kind.CREEP]
    assert text.startswith("doubtful: the sensor creeps after each change of its load: ")
    assert len(text) < 300


def test_what_changes_within_stops_as_from_stop_to_stop_is_no_creep() -> None:
    calibration = cw.calibrate(recording(2, 0.0, 5.0, 3.0), "mount")
    R = np.array([pose.R_base_flange for pose in calibration.poses])
    texts = [
        with_creep(calibration, Creep(share, 0.01, True, 5.0), R).findings[-1].text.partition(":")[2]
        for share in (0.1, 0.8)
    ]
    assert texts[0].startswith(" the sensor creeps after each change of its load: 10 % ")
    assert texts[1].startswith(
        " within stops the reading changes by 80 % of what it does from stop to stop, 4 N, as no"
    )


@pytest.mark.parametrize("model", ["paper", "yaw", "mount+base", "affine"])
def test_creep_is_said_of_every_model(model: str) -> None:
    calibration = cw.calibrate(recording(2, 0.05, 5.0, 3.0), model)
    assert Kind.CREEP in [finding.kind for finding in calibration.findings]


@pytest.mark.parametrize("share", [0.0, 0.05])
def test_a_tool_from_a_creeping_sensor_is_no_better_known_later(share: float) -> None:
    prior = cw.calibrate(recording(2, share, 5.0, 3.0), "mount")
    assert prior.fitted_poses
    one = prior.fitted_poses[0]
    later = cw.calibrate(cw.Samples(one.wrench[None], one.R_base_flange[None]), prior=prior)
    assert (Kind.CREEP in [finding.kind for finding in later.findings]) == (share > 0.0)


def test_creep_that_hides_in_noise_is_in_the_standard_deviations() -> None:
    """Of weight, of the force at any orientation, and in what is saved."""
    noisy = recording(2, 0.01, 5.0, 3.0)
    walk = np.cumsum(np.random.default_rng(3).standard_normal((len(noisy), 6)) * np.repeat([0.01, 0.0005], 3), axis=0)
    calibration = cw.calibrate(replace(noisy, wrench=noisy.wrench + walk))
    assert Kind.CREEP not in [finding.kind for finding in calibration.findings]
    assert calibration.weight is not None
    assert abs(calibration.weight - WEIGHT) < 3.0 * calibration.std["weight"]
    of_B = np.sqrt(np.diag(calibration.B_covariance)).reshape(6, 4)
    assert np.linalg.norm(of_B[:3, :3]) > calibration.std["weight"]


@pytest.mark.parametrize("cone", [40.0, 180.0])
@pytest.mark.parametrize("model", ["auto", "affine"])
def test_creep_is_in_the_bias_too(model: str, cone: float, tmp_path: Path) -> None:
    """What poses have in common is shown in full: near it weight and bias are wrong against each other."""
    calibration = cw.calibrate(recording(4, 0.02, 5.0, 3.0, cone), model)
    std = np.sqrt(np.diag(calibration.B_covariance)).reshape(6, 4)[:3, 3]
    assert (np.abs(calibration.bias[:3] - [3.0, -2.0, 5.0]) < 4.0 * std).all()
    calibration.save(tmp_path / "tool.json")
    again = cw.Calibration.load(tmp_path / "tool.json")
    np.testing.assert_array_equal(again.covariance, calibration.covariance)


def test_a_table_with_bursts_of_rows_is_no_creep() -> None:
    """Two at each orientation, a minute apart, of a sensor whose noise is small."""
    rng, R = np.random.default_rng(0), Rotation.random(12, rng=np.random.default_rng(50)).as_matrix()
    since = np.r_[np.arange(0.3, 2.3, 0.02), np.arange(60.0, 62.0, 0.02)]
    t = (70.0 * np.arange(12)[:, None] + since).ravel()
    turn = np.repeat(R, len(since), axis=0)
    force = np.einsum("nji,j->ni", turn, [0.0, 0.0, -WEIGHT])
    late = np.zeros_like(force)
    for k in range(1, 12):
        change = force[k * len(since)] - force[(k - 1) * len(since)]
        rows = slice(k * len(since), None)
        late[rows] += 0.002 * np.log(t[rows] - 70.0 * k)[:, None] * change
    wrench = np.hstack([force + late, np.zeros_like(force)]) + 1e-4 * rng.standard_normal((len(t), 6))
    creep = recorded_poses(cw.Samples(wrench, turn, t, came=70.0 * ((t / 70.0) // 1.0)), 0, stream=False).creep
    assert creep is not None
    assert 4.0 < creep.share / 0.002 < 9.0


@pytest.mark.parametrize("timed", [True, False])
def test_an_arm_comes_before_it_is_there(timed: bool) -> None:
    some = recording(2, 0.0, 1.0, 3.0)
    assert some.t is not None
    message = "^came is later than t, or there is no t, expected when the arm had come to rest: before t$"
    with pytest.raises(InputError, match=message):
        replace(some, came=some.t + 1.0, t=some.t if timed else None)


def test_one_that_does_not_is_not() -> None:
    calibration = cw.calibrate(recording(2, 0.0, 1.0, 3.0))
    assert (calibration.verdict, calibration.findings) == ("good", ())


def test_rows_of_a_table_tell_creep_too() -> None:
    """Rows of each stop alone, one after the other: when the arm came there is not known."""
    whole = recording(3, 0.05, 5.0, 3.0)
    assert whole.t is not None
    at_rest = (whole.t % 5.0 > 0.4) & (whole.t % 5.0 < 2.9)
    calibration = cw.calibrate(whole.select(at_rest), "mount")
    assert Kind.CREEP in [finding.kind for finding in calibration.findings]
