"""Model `dynamic` with an accelerometer in place of positions: how it sits is found, and what it tells of the tool."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco", reason="mujoco is not installed")

import contactwrench as cw
from contactwrench.calibration.dynamics import elements
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.compensate.contact_wrenches import contact_wrenches, motion_of
from contactwrench.compensate.filters import LowPass
from contactwrench.errors import ContactWrenchError, FileFormatError, InputError
from contactwrench.samples.accelerometer import (
    AccelerometerStream,
    delay_behind,
    mounted_accelerometer,
    with_accelerometer,
)
from contactwrench.samples.flange_motion import flange_motion
from tests.support.accelerometer import (
    LATE,
    NOISE,
    PLACE,
    Mounted,
    accelerometer,
    calibrated_by_accelerometer,
    calibrated_with,
    with_readings,
    without_positions,
)
from tests.support.in_motion import calibrated, pushed
from tests.support.recordings import run
from tests.support.world import Array

OFTEN = 3.5
"""Standard deviations."""
_DOWN = np.array([0.0, 0.0, -9.80665])


def _said(calibration: cw.Calibration) -> list[Finding]:
    return [finding for finding in calibration.findings if finding.kind is Kind.ACCELEROMETER]


def _off(calibration: cw.Calibration) -> Array:
    """By how many std inertia and offset are off; the latter counts from the accelerometer."""
    d = calibration.dynamics
    assert d is not None
    off = np.r_[elements(d.inertia - pushed().settings.inertia), d.sensor_offset - pushed().offset + PLACE]
    return np.asarray(off / d.std)


def test_the_stops_are_those_of_any_accelerometer() -> None:
    """What the tests below rest on, where they calibrate them once."""
    once, whole = calibrated_with(with_readings(Mounted())), calibrated_by_accelerometer()
    assert once.dynamics is not None
    assert whole.dynamics is not None
    np.testing.assert_array_equal(once.dynamics.covariance, whole.dynamics.covariance)
    np.testing.assert_array_equal(once.covariance, whole.covariance)
    assert once.findings == whole.findings


def test_inertia_and_offset_are_found_and_how_it_sits() -> None:
    found = calibrated_by_accelerometer()
    assert np.abs(_off(found)).max() < OFTEN
    assert found.dynamics is not None
    assert (found.dynamics.std[6:] < 2e-3).all()
    sits = found.dynamics.accelerometer
    assert sits is not None
    assert sits.matrix == pytest.approx(Mounted().unit * Mounted().axes, abs=0.003 * Mounted().unit)
    assert sits.bias == pytest.approx(Mounted().zero, abs=0.003)
    assert sits.delay == pytest.approx(LATE - 0.0015, abs=1e-3)
    assert sits.noise < 2.0 * NOISE
    (said,) = _said(found)
    assert said.severity is Severity.NOTE
    assert said.text.startswith("accelerations of an accelerometer in g, ")
    assert said.text.endswith(" m/s^2 at rest; the sensor's offset counts from it")
    assert "mm, sensor from accelerometer, flange axes" in str(found)


@pytest.mark.parametrize(("unit", "name"), [(1.0, "m/s^2"), (1e3 / 9.80665, "mg")])
def test_its_unit_shows(unit: float, name: str) -> None:
    found = calibrated_with(with_readings(Mounted(unit=unit)))
    assert found.dynamics is not None
    assert found.dynamics.accelerometer is not None
    assert found.dynamics.accelerometer.unit == name
    assert found.verdict == "good"


def test_a_unit_that_is_none_is_said() -> None:
    found = calibrated_with(with_readings(Mounted(unit=0.3)))
    (said, _) = _said(found)
    assert said.severity is Severity.DOUBTFUL
    assert said.text == (
        "doubtful: the accelerometer reads 0.3 for each m/s^2, expected 1, or 0.102 of one in g: taken as gravity "
        "turns in it"
    )
    assert np.abs(_off(found)).max() < OFTEN


def test_exchanged_axes_are_said_and_change_nothing() -> None:
    found = calibrated_with(with_readings(Mounted(axes=Mounted().axes[[1, 0, 2]])))
    (said, _) = _said(found)
    assert said.severity is Severity.WARNING
    assert said.text == (
        "the accelerometer mirrors: two axes are exchanged, or one or all reversed; taken as gravity turns in it"
    )
    assert found.inertia == pytest.approx(calibrated_by_accelerometer().inertia, abs=1e-9)


def test_poses_that_are_ahead_of_the_wrench_are_found_to_be() -> None:
    """No position tells their delay: what turns does, once gravity and acceleration are both the accelerometer's."""
    samples, late = with_readings(Mounted()), 0.030
    rows = round(late * pushed().settings.recording.rate)
    place = np.minimum(np.arange(len(samples)) + rows, len(samples) - 1)
    found = cw.calibrate(replace(samples, R_base_flange=samples.R_base_flange[place]), "dynamic")
    assert found.delay == pytest.approx(late + 0.0015, abs=0.002)
    assert np.abs(_off(found)).max() < OFTEN


def test_half_of_its_readings_tell_its_delay_too() -> None:
    stream = accelerometer(pushed(), Mounted())
    later = stream.t > 0.5 * pushed().begin
    half = with_accelerometer(without_positions(), stream.select(later))
    found = calibrated_with(half)
    assert found.dynamics is not None
    assert found.dynamics.accelerometer is not None
    assert found.dynamics.accelerometer.delay == pytest.approx(LATE - 0.0015, abs=1e-3)
    (said, _) = _said(found)
    assert said.severity is Severity.DOUBTFUL
    assert said.text == (
        "doubtful: the accelerometer read in 67% of the recording, so that fewer stops tell how it sits than the std "
        "says: record it from begin to end"
    )


def test_an_arm_that_is_carried_to_and_fro_has_a_good_one() -> None:
    """As fast as it can, without a turn: no mean of the accelerometer is gravity alone."""
    samples = with_readings(Mounted())
    t = np.asarray(samples.t)
    carried = 3.0 * np.sin(2.0 * np.pi * 0.8 * t)[:, None] * [0.6, 0.0, 0.8] * (t > 0.4 * t[-1])[:, None]
    felt = np.einsum("nji,nj->ni", samples.R_base_flange, carried) @ Mounted().axes.T * Mounted().unit
    shaken = replace(samples, accelerometer=np.asarray(samples.accelerometer) + felt)
    sits, _ = mounted_accelerometer(shaken, np.array([0.0, 0.0, -9.80665]))
    assert sits.matrix == pytest.approx(Mounted().unit * Mounted().axes, abs=0.03 * Mounted().unit)


@pytest.mark.parametrize("every", [25, 50])
def test_slow_readings_of_the_wrench_tell_no_delay(every: int) -> None:
    """20 and 10 Hz."""
    few = slice(None, None, every)
    samples = with_readings(Mounted()).select(few)
    angular = np.zeros((len(samples), 9))
    assert delay_behind(samples.wrench[:, :3], np.asarray(samples.accelerometer), angular, np.asarray(samples.t)) == 0.0


def test_a_motion_by_positions_is_refused() -> None:
    samples = pushed().samples()
    with pytest.raises(InputError) as refused:
        calibrated_by_accelerometer().compensate(samples.wrench, samples.R_base_flange, motion=flange_motion(samples))
    assert str(refused.value) == (
        "found a motion by positions, and a calibration by an accelerometer, expected both by one: take the motion "
        "that contactwrench.compensate.contact_wrenches.motion_of(calibration, samples) gives"
    )


def test_an_offset_from_it_is_compared_with_none_from_the_flange() -> None:
    told = calibrated().diff(calibrated_by_accelerometer())
    assert "inertia" in [group.name for group in told.groups]
    assert "offset" not in [group.name for group in told.groups]
    assert "offset_x" not in told.names


def test_another_base_that_is_stated_changes_no_contact(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Judged reading by reading."""
    found, samples = calibrated_by_accelerometer(), with_readings(Mounted()).select(slice(5000, 7000))
    found.save(tmp_path / "tool.json")
    turn = Rotation.from_euler("xyz", [20.0, -150.0, 70.0], degrees=True).as_matrix()
    names = "t,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,ax,ay,az"
    contact = []
    for name, base in (("here", np.eye(3)), ("turned", turn)):
        quaternions = Rotation.from_matrix(base @ samples.R_base_flange).as_quat()
        columns = [np.asarray(samples.t), samples.wrench, quaternions, np.asarray(samples.accelerometer)]
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack(columns), "%.12g", ",", header=names, comments="")
        down = ",".join(f"{part:.12f}" for part in base @ found.gravity_direction)
        how = ("--imu", "ax,ay,az", f"--gravity={down}", "--contact", "-o", tmp_path / f"{name}_out.csv")
        assert run(capsys, "compensate", tmp_path / f"{name}.csv", "-c", tmp_path / "tool.json", *how).status == 0
        rows = (tmp_path / f"{name}_out.csv").read_text().splitlines()[1:]
        contact.append([[float(part or "nan") for part in row.split(",")[1:7]] for row in rows])
    np.testing.assert_allclose(contact[1], contact[0], atol=1e-6)


def test_readings_too_slow_for_the_motion_are_in_doubt() -> None:
    every = round(pushed().settings.recording.rate / 10.0)
    stream = accelerometer(pushed(), Mounted(), every=every)
    found = calibrated_with(with_accelerometer(without_positions(), stream))
    (said,) = (finding.text for finding in found.findings if finding.kind is Kind.SLOW_POSES)
    assert said.startswith("doubtful: the accelerometer's readings came at 10 Hz, and the arm moved at up to ")
    known = calibrated_by_accelerometer().findings
    assert not any(finding.kind is Kind.SLOW_POSES for finding in known)


@cache
def _calibrated_with_noise() -> tuple[cw.Samples, cw.Calibration]:
    """Of 0.2 m/s^2."""
    samples = with_readings(Mounted(noise=0.2))
    return samples, calibrated_with(samples)


def test_its_own_noise_is_in_the_std_at_rest_too() -> None:
    """Readings that scatter by 0.2 m/s^2 shake a contact force of 1 kg by 0.2 N, four times the sensor's noise."""
    samples, found = _calibrated_with_noise()
    contact = contact_wrenches(found, samples)
    still = np.asarray(samples.t) < 1.0
    off = contact.wrench[still, :3] / np.hypot(contact.std[still, :3], 0.05)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=0.25)


def test_compensation_leaves_little_in_motion() -> None:
    found, samples = calibrated_by_accelerometer(), with_readings(Mounted())
    t = np.asarray(samples.t) - pushed().begin
    free = (t > 6.0) & (t < 14.0)
    left = contact_wrenches(found, samples)
    still = found.compensate(samples.wrench, samples.R_base_flange)
    rms = np.sqrt(np.mean(left.wrench[free] ** 2, axis=0))
    assert (np.sqrt(np.mean(still[free] ** 2, axis=0))[:3] > 8.0 * rms[:3]).all()
    noise = np.r_[np.full(3, 0.05), np.full(3, 0.002)]
    assert rms == pytest.approx(np.sqrt(np.mean(left.std[free] ** 2, axis=0) + noise**2), rel=0.35)


def test_it_is_saved_and_an_edited_one_refused(tmp_path: Path) -> None:
    path = tmp_path / "tool.json"
    calibrated_by_accelerometer().save(path)
    again = cw.Calibration.load(path)
    assert again.dynamics is not None
    assert again.dynamics.accelerometer is not None
    assert calibrated_by_accelerometer().dynamics is not None
    written = path.read_text()
    path.write_text(written.replace(f'"noise":{again.dynamics.accelerometer.noise!r}', '"noise":-1.0'))
    with pytest.raises(FileFormatError) as refused:
        cw.Calibration.load(path)
    assert str(refused.value) == (
        f"{path}: dynamics.accelerometer has numbers that none has, expected a matrix with an inverse: calibrate again "
        "or restore the file"
    )


def _read(change: Callable[[AccelerometerStream], Array]) -> cw.Calibration:
    stream = accelerometer(pushed(), Mounted())
    return calibrated_with(with_accelerometer(without_positions(), replace(stream, reading=change(stream))))


def _later() -> AccelerometerStream:
    stream = accelerometer(pushed(), Mounted())
    return replace(stream, t=stream.t + 1e6)


def _compensated() -> object:
    """Of samples without the accelerometer."""
    return contact_wrenches(calibrated_by_accelerometer(), pushed().samples())


REFUSED: dict[str, tuple[Callable[[], object], type[ContactWrenchError], str]] = {
    "of something else": (
        lambda: _read(lambda stream: np.random.default_rng(1).normal(size=stream.reading.shape)),
        InputError,
        "run.csv: found accelerations that do not turn with gravity",
    ),
    "dead": (
        lambda: _read(lambda stream: np.full(stream.reading.shape, np.nan)),
        InputError,
        "imu.csv: found no accelerations at the times of the wrench, expected both on one clock: record them together",
    ),
    "another clock": (
        lambda: with_accelerometer(without_positions(), _later()),
        InputError,
        "imu.csv: found no accelerations at the times of the wrench, expected both on one clock: record them together",
    ),
    "not there when compensating": (
        _compensated,
        InputError,
        "virtual rig: found no accelerometer's readings, expected them, as the calibration's inertia counts from one: "
        "name their source with --imu",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_tells_no_acceleration_is_refused(what: str) -> None:
    asked, error, message = REFUSED[what]
    with pytest.raises(error) as refused:
        asked()
    assert str(refused.value).startswith(message)


def _warned(calibration: cw.Calibration) -> list[str]:
    return [said.text for said in _said(calibration) if said.severity is Severity.WARNING]


def _behind(order: int, corner: float) -> Callable[[AccelerometerStream], Array]:
    """A Butterworth filter of so many Hz, which has been at rest."""

    def filtered(stream: AccelerometerStream) -> Array:
        sections = butter(order, corner, fs=1.0 / float(stream.t[1] - stream.t[0]), output="sos")
        begin = sosfilt_zi(sections)[:, :, None] * stream.reading[0]
        return np.asarray(sosfilt(sections, stream.reading, axis=0, zi=begin)[0])

    return filtered


@pytest.mark.parametrize(("order", "corner"), [(1, 8.0), (1, 30.0), (2, 15.0)])
def test_its_own_slow_filter_is_told_from_inertia(order: int, corner: float) -> None:
    """What it delays and weakens shows beside the wrench, which feels the same; one of second order delays alone."""
    found = _read(_behind(order, corner))
    assert np.abs(_off(found)).max() < OFTEN
    assert found.verdict == "good"
    slow = [text for text in _warned(found) if text.startswith("the accelerometer follows what the sensor feels as ")]
    assert len(slow) == (order == 1 and corner < 16.0)
    if slow:
        said = float(slow[0].partition("of first order at ")[2].partition(" Hz: ")[0])
        assert said == pytest.approx(corner, rel=0.1)
        assert slow[0].endswith("contact in motion is not: set its filter faster")
    assert not any(text.startswith("the accelerometer follows") for text in _warned(calibrated_by_accelerometer()))


def test_a_zero_that_drifts_is_found_and_said() -> None:
    drift = np.array([0.2, -0.1, 0.1]) * Mounted().unit
    found = _read(lambda stream: stream.reading + np.outer(stream.t / stream.t[-1], drift))
    assert np.abs(_off(found)).max() < OFTEN
    assert found.dynamics is not None
    assert found.dynamics.accelerometer is not None
    assert found.dynamics.accelerometer.drift == pytest.approx(drift / Mounted().unit, abs=0.02)
    (said,) = _warned(found)
    assert said.startswith("the accelerometer's zero drifted by 0.2")
    assert said.endswith("not where contact is read: let it warm up, and calibrate again")
    assert _warned(calibrated_by_accelerometer()) == []


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_what_is_not_known_of_how_it_sits_is_its_scatter(noise: float) -> None:
    """Of scale and axes over 10 recordings: a quarter off in their std, of which nine agree."""
    off = []
    for seed in range(10):
        stream = accelerometer(pushed(), Mounted(noise=noise), seed)
        sits, covariance = mounted_accelerometer(with_accelerometer(without_positions(), stream), _DOWN)
        misread = np.linalg.solve(Mounted().unit * Mounted().axes, sits.matrix) - np.eye(3)
        off.append(misread / np.sqrt(np.diag(covariance)[:3]))
    assert np.sqrt(np.mean(np.var(off, axis=0))) == pytest.approx(1.0, abs=0.3)


def test_its_noise_is_in_what_the_motion_tells() -> None:
    """In all six axes at once; and it is no motion, up to whose frequencies readings are used."""
    _, found = _calibrated_with_noise()
    assert np.abs(_off(found)).max() < OFTEN
    assert found.verdict == "good"


def test_an_arm_that_did_not_tilt_it_is_refused() -> None:
    samples = with_readings(Mounted())
    level = replace(samples, R_base_flange=np.tile(samples.R_base_flange[0], (len(samples), 1, 1)))
    with pytest.raises(InputError) as refused:
        mounted_accelerometer(level, np.array([0.0, 0.0, -9.81]))
    assert str(refused.value) == (
        "run.csv: found gravity turning too little in the accelerometer, expected stops that tilt it by 10 deg and "
        "more, both ways: add some"
    )


def test_a_sensor_filter_that_is_stated_does_not_move_its_accelerations() -> None:
    """Of first order at 20 Hz, 8 ms: then it is ahead of the wrench, and behind what the wrench was of. Four times as
    much had been left.
    """
    share, samples = 1.0 - np.exp(-2.0 * np.pi * 20.0 / 500.0), with_readings(Mounted())
    bias = np.array(pushed().settings.sensor.bias)
    slow = replace(samples, wrench=bias + lfilter([share], [1.0, share - 1.0], samples.wrench - bias, axis=0))
    found, low_pass = cw.calibrate(slow, "dynamic"), LowPass(20.0, 1)
    ahead = r"accelerations of an accelerometer in g, 3\.\d ms before the wrench, off by .*"
    assert any(re.fullmatch(ahead, finding.text) for finding in _said(found))
    t = np.asarray(slow.t)
    free = (t > pushed().begin + 6.0) & (t < pushed().begin + 14.0)
    for given in (
        {"motion": motion_of(found, slow, low_pass.lag)},
        {"acceleration": slow.accelerometer},
    ):
        compensator = cw.Compensator(found, rate=500.0, sensor_filter=low_pass)
        left = compensator.run(slow.wrench, slow.R_base_flange, t, **given).wrench[free, :3]
        assert float(np.sqrt(np.mean(left**2))) < 0.045
