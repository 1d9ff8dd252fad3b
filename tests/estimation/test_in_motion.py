"""Model `dynamic`: inertia and the sensor's place from a recording in motion, what is said of it, what is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")

import contactwrench as cw
from contactwrench.calibration.dynamics import can_exist, elements, nearest_possible, second_moments
from contactwrench.calibration.findings import Finding, Kind, Severity
from contactwrench.errors import ContactWrenchError, InputError, UnobservableError
from contactwrench.estimation.dynamic import Told
from contactwrench.estimation.findings_of_motion import of_weight
from contactwrench.estimation.in_motion import with_motion
from contactwrench.samples.flange_motion import FlangeMotion, flange_motion
from contactwrench.samples.limits import at_limit
from contactwrench.simulate.recording import record_motion
from contactwrench.simulate.settings import changed
from contactwrench.simulate.trajectory import Motion, Push
from tests.support.in_motion import Moving, at_stops, calibrated, fast, moving, pushed
from tests.support.rigs import example, noisy
from tests.support.world import Array

ALL = "inertia_xx, inertia_xy, inertia_xz, inertia_yy, inertia_yz, inertia_zz, offset_x, offset_y, offset_z"
OFTEN = 3.5
"""Standard deviations."""


def _of_kind(calibration: cw.Calibration, kind: Kind) -> list[Finding]:
    return [finding for finding in calibration.findings if finding.kind is kind]


def _off(calibration: cw.Calibration, truth: Moving) -> Array:
    """By how many std the nine are off."""
    d = calibration.dynamics
    assert d is not None
    off = np.r_[elements(d.inertia - truth.settings.inertia), d.sensor_offset - truth.offset]
    return np.asarray(off / d.std)


@cache
def _of_exact_poses() -> cw.Calibration:
    return cw.calibrate(pushed().samples(), "dynamic")


def test_inertia_and_offset_are_found_within_their_std_in_spite_of_a_push() -> None:
    found, truth = _of_exact_poses(), pushed()
    assert np.abs(_off(found, truth)).max() < OFTEN
    assert found.dynamics is not None
    largest = float(np.linalg.eigvalsh(truth.settings.inertia)[2])
    assert np.abs(found.dynamics.inertia - truth.settings.inertia).max() < 0.02 * largest
    assert np.abs(found.dynamics.sensor_offset - truth.offset).max() < 1.5e-3
    assert found.requested_model == "dynamic"
    assert np.array_equal(found.std["inertia"], found.dynamics.std[:6])
    assert np.array_equal(found.std["sensor_offset"], found.dynamics.std[6:])


def test_single_readings_that_jump_are_left_out_and_said() -> None:
    clean = pushed().samples()
    wrench = clean.wrench.copy()
    wrench[250::500] += 60.0
    found = cw.calibrate(replace(clean, wrench=wrench), "dynamic")
    assert np.abs(_off(found, pushed())).max() < OFTEN
    assert found.verdict == _of_exact_poses().verdict
    (said,) = _of_kind(found, Kind.SPIKES)
    assert said.severity is Severity.REFUSED
    assert said.text == (
        f"{len(wrench[250::500])} of {len(wrench)} readings that jump and are back in the next row were left out: look "
        "at the sensor's cable, shield and driver"
    )
    assert not _of_kind(calibrated(), Kind.SPIKES)


def test_noisy_poses_of_100_hz_tell_them_too() -> None:
    found = calibrated()
    assert np.abs(_off(found, pushed())).max() < OFTEN
    assert found.dynamics is not None
    assert 2.0 < found.dynamics.bandwidth < 30.0


def test_what_is_left_in_motion_is_less_than_without_inertia() -> None:
    """The push is in both."""
    dynamics = calibrated().dynamics
    assert dynamics is not None
    assert (dynamics.static_rms[:3] > 1.8 * dynamics.residual_rms[:3]).all()
    assert (dynamics.motion_noise >= 0.0).all()


def test_a_stated_offset_is_taken_and_leaves_the_verdict_good() -> None:
    found = calibrated(stated=True)
    assert np.abs(_off(found, pushed())).max() < OFTEN
    assert found.dynamics is not None
    assert found.dynamics.std[6:].max() <= 5e-4
    assert found.verdict == "good"
    assert not _of_kind(found, Kind.UNTOLD_BY_MOTION)


def test_a_stated_offset_that_the_motion_contradicts_is_said() -> None:
    found = with_motion(at_stops(), pushed().samples(), [0.0, 0.02, 0.05])
    (said,) = _of_kind(found, Kind.CONTRADICTS_PRIOR)
    assert said.severity is Severity.DOUBTFUL
    assert said.text == (
        "doubtful: the stated sensor offset is 20 mm or more off what the motion tells: it counts from the flange's "
        "origin to the sensor's, in flange axes; measure it again, or leave it out"
    )
    assert not _of_kind(calibrated(stated=True), Kind.CONTRADICTS_PRIOR)


def test_the_stops_alone_tell_what_they_tell_without_the_motion() -> None:
    samples = pushed().samples(100.0, 0.01, 2e-5)
    still, found = cw.calibrate(samples), calibrated()
    assert np.array_equal(still.B, found.B)
    assert np.array_equal(still.covariance, found.covariance)
    assert still.dynamics is None


def test_how_much_motion_was_used_is_noted() -> None:
    (noted,) = _of_kind(calibrated(), Kind.MOTION_USED)
    assert noted.severity is Severity.NOTE
    assert noted.text == "42 s of motion used, up to 2.5 Hz, where nearly all of its acceleration is"
    assert not _of_kind(at_stops(), Kind.MOTION_USED)


def test_a_short_push_is_no_finding_and_a_shaking_arm_is() -> None:
    assert not _of_kind(calibrated(), Kind.CONTACT_IN_MOTION)
    shaken = moving(6, "arm.vibration=[0.3,0.5]", stops=8, seconds=15.0, rate=500.0)
    found = cw.calibrate(shaken.samples(), "dynamic")
    (said,) = _of_kind(found, Kind.CONTACT_IN_MOTION)
    assert said.severity is Severity.WARNING
    assert said.text.endswith(
        "of the motion is far noisier than the rest and counts little: contact, cables, shaking, or another "
        "tool than at the stops"
    )
    assert np.abs(_off(found, shaken)).max() < OFTEN
    assert found.dynamics is not None
    assert (found.dynamics.motion_noise[0] > 0.1).all()


def _reading(change: Callable[[Array, Array], Array], delay: float = 0.0) -> cw.Samples:
    """The recording with other readings in motion: `change` of these (n, 6), less the bias, and of their place there,
    0 to 1 from its begin.
    """
    samples, whole = pushed().samples(), pushed()
    t, bias = np.asarray(samples.t), np.array(whole.settings.sensor.bias)
    grown = np.clip(t - whole.begin, 0.0, 1.0)[:, None]
    free = samples.wrench - bias
    wrench = bias + free + grown * (change(free, t) - free)
    return replace(samples, wrench=wrench, delay=delay or None, delay_std=1e-4 if delay else None)


def _leaning(free: Array, t: Array) -> Array:
    """A push of 1 N and more that never ends, and changes within a second or two."""
    from scipy.signal import butter, sosfilt

    force = sosfilt(butter(2, 0.5, fs=500.0, output="sos"), np.random.default_rng(8).normal(size=(len(t), 3)), axis=0)
    force *= 1.5 / force.std()
    return np.asarray(free + np.hstack([force, np.cross([0.0, 0.0, 0.15], force)]))


def test_contact_through_all_of_the_motion_is_said_and_counts_in_the_std() -> None:
    found = with_motion(at_stops(), _reading(_leaning), None)
    (said,) = _of_kind(found, Kind.CONTACT_IN_MOTION)
    assert said.severity is Severity.WARNING
    assert said.text == (
        "1.4 N RMS of the force below 2.5 Hz is left in motion, 14% of the weight: contact, cables, shaking, "
        "or another tool than at the stops; what is "
        "known of the inertia counts with it"
    )
    assert np.abs(_off(found, pushed())).max() < OFTEN
    free = calibrated().dynamics
    assert found.dynamics is not None
    assert free is not None
    assert (found.dynamics.std > free.std).all()
    assert found.dynamics.std.sum() > 2.0 * free.std.sum()


def test_something_picked_up_after_the_stops_is_said_and_counts_little() -> None:
    found = with_motion(at_stops(), _reading(lambda free, _: 1.1 * free), None)
    (said,) = _of_kind(found, Kind.CONTACT_IN_MOTION)
    assert said.text == (
        "35% of the motion is far noisier than the rest and counts little: contact, cables, shaking, or another "
        "tool than at the stops"
    )
    assert np.abs(_off(found, pushed())).max() < OFTEN


def test_a_tool_that_weighs_otherwise_in_motion_is_not_that_of_the_stops() -> None:
    """By 5 %, which leave too little to be seen as a contact."""
    assert not _of_kind(calibrated(), Kind.CONTRADICTS_PRIOR)
    samples, bias = pushed().samples(), np.array(pushed().settings.sensor.bias)
    found = with_motion(at_stops(), replace(samples, wrench=bias + 1.05 * (samples.wrench - bias)), None)
    (said,) = _of_kind(found, Kind.CONTRADICTS_PRIOR)
    assert said.severity is Severity.DOUBTFUL
    weights = r"doubtful: in motion the tool weighs (\S+) N, at the stops (\S+) \+- \S+ N: "
    told = re.fullmatch(
        weights + "another tool, or something gripped or lost in between: record stops and motion of one tool",
        said.text,
    )
    assert told is not None
    assert float(told[1]) == pytest.approx(1.05 * float(told[2]), rel=0.03)
    (near,) = of_weight(Told(19.83, 0.005), 19.81)
    assert "weighs 19.8300 N, at the stops 19.8100 +- 0.0050 N" in near.text


def test_a_slow_filter_in_the_sensor_is_said_and_moves_little() -> None:
    """Of first order at 8 Hz, whose 20 ms are known as a delay."""
    from scipy.signal import lfilter

    share = 1.0 - np.exp(-2.0 * np.pi * 8.0 / 500.0)
    slow = _reading(lambda free, _: lfilter([share], [1.0, share - 1.0], free, axis=0), 1.0 / (2.0 * np.pi * 8.0))
    found = with_motion(at_stops(), slow, None)
    (said,) = _of_kind(found, Kind.SLOW_SENSOR)
    assert said.severity is Severity.WARNING
    assert said.text == (
        "the readings follow the motion as behind a low-pass of first order at 7.8 Hz: set the sensor's filter faster, "
        "or state it where contact is judged (--sensor-filter)"
    )
    assert np.abs(_off(found, pushed())).max() < OFTEN
    assert not _of_kind(calibrated(), Kind.SLOW_SENSOR)


def test_poses_that_tell_less_than_the_arm_does_are_said() -> None:
    found = cw.calibrate(pushed().samples(12.5, 0.1, 1e-3), "dynamic")
    (said,) = _of_kind(found, Kind.MOTION_USED)
    assert said.severity is Severity.WARNING
    assert said.text == (
        "42 s of motion used, up to 2.1 Hz, beyond which the poses tell no acceleration: record them more often, or "
        "with more digits"
    )


def test_a_push_is_not_what_drives_and_links_shake() -> None:
    """For a third of the motion; the std of every contact wrench would be 1 N and more."""
    long = (Push(2.0, 7.0, np.array([3.0, 0.0, 4.0])),)
    found = cw.calibrate(moving(5, stops=8, seconds=15.0, rate=500.0, pushes=long).samples(), "dynamic").dynamics
    assert found is not None
    assert found.motion_noise[0].max() < 0.02
    assert found.motion_noise[1].max() < 0.001


def test_a_place_that_never_changes_makes_no_shaking_that_grows_with_it() -> None:
    """What is left over an acceleration that is none was a std of 10^8 N m in every other motion."""
    samples = pushed().samples()
    place = np.tile(np.asarray(samples.position)[:1], (len(samples), 1))
    found = with_motion(at_stops(), replace(samples, position=place), None).dynamics
    assert found is not None
    assert found.motion_noise.max() < 10.0


def _at_rest() -> cw.Samples:
    samples = pushed().samples()
    t = np.asarray(samples.t)
    return samples.select((t < pushed().begin) & (t % 3.5 > 0.2) & (t % 3.5 < 1.4))


def _poses() -> cw.Samples:
    """Sixty, a second apart, somewhere: a table, and no motion."""
    rig, R, rng = example(3, 60)
    readings = noisy(rig, R, rng)
    return replace(readings, t=np.arange(60.0), position=rng.uniform(-0.5, 0.5, (60, 3)), source="poses")


def _scaled(by: float) -> cw.Samples:
    samples = pushed().samples()
    return replace(samples, position=by * np.asarray(samples.position))


REFUSED: dict[str, tuple[Callable[[], object], type[ContactWrenchError], str]] = {
    "at rest": (
        lambda: cw.calibrate(_at_rest(), "dynamic"),
        UnobservableError,
        "virtual rig: found 0 s of motion, expected 4 s or more with turns about every axis, to tell "
        f"{ALL}: move the arm, or take model auto",
    ),
    "poses with times": (
        lambda: cw.calibrate(_poses(), "dynamic"),
        UnobservableError,
        "poses: found 0 s of motion, expected 4 s or more with turns about every axis, to tell "
        f"{ALL}: move the arm, or take model auto",
    ),
    "no positions": (
        lambda: with_motion(at_stops(), replace(pushed().samples(), position=None), None),
        InputError,
        "virtual rig: found no positions, expected t and all of the flange's x, y, z in each row, from which its "
        "acceleration is taken: record them, name an accelerometer with --imu, or calibrate without inertia",
    ),
    "no times": (
        lambda: cw.calibrate(replace(_at_rest(), t=None), "dynamic"),
        InputError,
        "virtual rig: found no times, expected t and all of the flange's x, y, z in each row, from which its "
        "acceleration is taken: record them, name an accelerometer with --imu, or calibrate without inertia",
    ),
    "positions in mm": (
        lambda: with_motion(at_stops(), _scaled(1000.0), None),
        InputError,
        "virtual rig: found the flange accelerating at 1.95e+03 m/s^2 RMS, expected positions in m: are they in mm? "
        "name the columns x_mm, y_mm, z_mm, or state the unit",
    ),
    "torques in N mm": (
        lambda: cw.calibrate(
            replace(pushed().samples(), wrench=pushed().samples().wrench * np.repeat([1.0, 1e3], 3)), "dynamic"
        ),
        InputError,
        "virtual rig: the centre of mass comes out 83 m from the sensor: are the torques in N mm? So far no tool of 1 "
        "kg reaches: or are the forces in kgf or lbf? Weigh the tool; contactwrench diagnose lists other units and "
        "signs; if it is so: --known com_mm=X,Y,Z+-STD",
    ),
    "offset in mm": (
        lambda: cw.calibrate(pushed().samples(), "dynamic", sensor_offset=[0.0, 0.0, 50.0]),
        InputError,
        "sensor offset is 50, expected -2 to 2 m (is it in mm?)",
    ),
    "offset of another model": (
        lambda: cw.calibrate(pushed().samples(), "auto", sensor_offset=[0.0, 0.0, 0.05]),
        InputError,
        "model auto has no sensor_offset: leave it out",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_tells_no_inertia_is_refused_word_for_word(what: str) -> None:
    asked, error, message = REFUSED[what]
    with pytest.raises(error) as refused:
        asked()
    assert str(refused.value) == message


def _about_one_joint(joint: int) -> cw.Samples:
    motion, only = fast(10.0, 500.0, np.random.default_rng(4)), np.eye(7)[joint]
    home = motion.joints[0]
    turning = Motion(motion.t, home + (motion.joints - home) * only, motion.velocity * only, motion.acceleration * only)
    return record_motion(changed(pushed().settings, []), turning, rng=np.random.default_rng(5)).samples


def test_a_turn_about_one_axis_leaves_parameters_untold_and_names_them() -> None:
    found = with_motion(at_stops(), _about_one_joint(6), None)
    (said,) = _of_kind(found, Kind.UNTOLD_BY_MOTION)
    assert said.severity is Severity.WEAK
    untold = "inertia_xx, inertia_xy, inertia_yy, offset_z"
    assert (
        said.text == f"weak: the motion tells nothing of {untold}: what stands there was assumed; turn about every axis"
    )
    assert found.verdict == "weak"
    assert np.abs(_off(found, pushed())).max() < OFTEN


def _of_no_body(too_much: float) -> cw.Samples:
    """Torques as of a tool whose moment about the sensor's z is larger by so many kg m^2, and no other."""
    samples, R = pushed().samples(), pushed().settings.R_flange_sensor
    motion = flange_motion(samples)
    alpha, omega = motion.angular_acceleration @ R, motion.angular_velocity @ R
    added = np.array([0.0, 0.0, too_much])
    torque = -added * alpha - np.cross(omega, added * omega)
    return replace(samples, wrench=samples.wrench + np.hstack([0.0 * torque, torque]))


def test_an_inertia_of_no_body_is_mended_and_said() -> None:
    found = with_motion(at_stops(), _of_no_body(0.01), None)
    (said,) = _of_kind(found, Kind.IMPLAUSIBLE_TOOL)
    assert said.severity is Severity.DOUBTFUL
    assert "no body has the inertia that the readings alone give, the nearest that one can have was taken" in said.text
    assert found.inertia is not None
    assert can_exist(found.inertia)
    assert not _of_kind(calibrated(), Kind.IMPLAUSIBLE_TOOL)
    (noted,) = _of_kind(with_motion(at_stops(), _scaled(0.6), None), Kind.IMPLAUSIBLE_TOOL)
    assert noted.severity is Severity.NOTE
    assert noted.text == (
        "no body has the inertia that the readings alone give, the nearest that one can have was taken, within its "
        "standard deviations"
    )


def _covariance(rng: np.random.Generator) -> Array:
    root = rng.normal(size=(6, 12)) * 1e-4
    return root @ root.T


@pytest.mark.parametrize("seed", range(2))
def test_the_nearest_body_can_exist_and_none_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = np.diag([0.001, 0.0012, 0.003]) + 2e-4 * (lambda a: a + a.T)(rng.normal(size=(3, 3)))
    assert not can_exist(wanted)
    covariance = _covariance(rng)
    information = np.linalg.inv(covariance)
    nearest, moved_by = nearest_possible(wanted, covariance, 1.0)

    def far(inertia: Array) -> float:
        off = elements(inertia - wanted)
        return float(off @ information @ off)

    assert can_exist(nearest)
    assert moved_by == pytest.approx(np.sqrt(far(nearest)), rel=1e-3)
    assert np.linalg.eigvalsh(second_moments(nearest))[0] > 0.0
    roots = rng.normal(size=(3000, 3, 3)) * np.exp(rng.uniform(-9.0, -1.0, size=(3000, 1, 1)))
    steps = second_moments(nearest) + roots @ roots.transpose(0, 2, 1) * 1e-3 * rng.choice([1.0, 1e-2], (3000, 1, 1))
    others = [np.trace(second) * np.eye(3) - second for second in steps]
    assert min(map(far, others)) > (1.0 - 1e-3) * far(nearest)
    between = [share * nearest + (1.0 - share) * wanted for share in (0.9, 0.5)]
    assert not any(can_exist(inertia) and far(inertia) < 0.98 * far(nearest) for inertia in between)


def test_compensation_in_motion_leaves_the_push_and_its_std_covers_the_rest() -> None:
    """Where nothing pushes the mean is none, and the RMS is the sensor's noise and what the std says."""
    found, recorded = calibrated(), pushed()
    assert found.delay is not None
    samples = recorded.samples(100.0, 0.01, 2e-5, found.delay)
    motion: FlangeMotion = flange_motion(samples)
    contact = found.compensate(samples.wrench, samples.R_base_flange, motion=motion)
    t = np.asarray(samples.t) - recorded.begin
    pushing, free = (t > 4.1) & (t < 5.4), (t > 6.0) & motion.inside
    in_base = np.einsum("nij,nj->ni", samples.R_base_flange @ recorded.settings.R_flange_sensor, contact[:, :3])
    assert in_base[pushing].mean(axis=0) == pytest.approx([3.0, 0.0, 4.0], abs=0.05)
    noise = np.r_[np.full(3, 0.05), np.full(3, 0.002)]
    std = np.hypot(noise, found.wrench_std(samples.R_base_flange, motion))
    assert np.sqrt(np.mean((contact[free] / std[free]) ** 2, axis=0)) == pytest.approx(np.ones(6), abs=0.35)


def test_saturation_during_the_motion_is_left_out_and_named() -> None:
    """A channel that stands at its limit in the fastest 1.5 % of it, as a file's reader marks it."""
    samples, wrench = pushed().samples(), pushed().samples().wrench.copy()
    wrench[:, 0] = np.minimum(wrench[:, 0], np.quantile(wrench[:, 0], 0.985))
    clipped = replace(samples, wrench=wrench, saturated=at_limit(wrench))
    found = cw.calibrate(clipped, "dynamic")
    (said,) = _of_kind(found, Kind.SATURATED_ROWS)
    assert re.fullmatch(r"\d{3} of 22250 rows with a saturated channel \(fx\) were left out", said.text)
    assert np.abs(_off(found, pushed())).max() < OFTEN
    assert found.dynamics is not None
    assert found.dynamics.seconds > 30.0
