"""How the flange moves, from poses: against motions whose derivatives are known, with all that recordings have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.samples.flange_motion import RINGING, FlangeMotion, flange_motion
from contactwrench.samples.samples import OrientationStream, Streams, WrenchStream
from contactwrench.samples.synchronize import synchronize
from tests.support.world import Array, random_rotations

BANDWIDTH = 10.0
"""Hz."""
EXACT = 1e-3
"""Of the largest value, up to 0.75 of the bandwidth."""


@dataclass(frozen=True, eq=False)
class Analytic:
    """A flange that turns about the world's z by `a` and its own x by `b`, sines both, and goes to and fro."""

    t: Array
    frequency: float

    def _sines(self, amplitude: float, phase: float, ratio: float = 1.0) -> tuple[Array, Array, Array]:
        w = 2.0 * np.pi * self.frequency * ratio
        s, c = np.sin(w * self.t + phase), np.cos(w * self.t + phase)
        return amplitude * s, amplitude * w * c, -amplitude * w**2 * s

    @property
    def R_base_flange(self) -> Array:
        """(n, 3, 3)."""
        (a, _, _), (b, _, _) = self._sines(0.2, 0.3, 0.5), self._sines(0.1, 1.1, 0.5)
        return np.asarray((Rotation.from_euler("z", a[:, None]) * Rotation.from_euler("x", b[:, None])).as_matrix())

    @property
    def position(self) -> Array:
        """(n, 3)."""
        return np.array([0.5, 0.1, 0.4]) + np.column_stack([self._sines(0.05, phase)[0] for phase in (0.0, 1.0, 2.0)])

    @property
    def motion(self) -> tuple[Array, Array, Array]:
        """Angular velocity, angular acceleration, acceleration (n, 3) each, flange axes."""
        (_, da, dda), (b, db, ddb) = self._sines(0.2, 0.3, 0.5), self._sines(0.1, 1.1, 0.5)
        omega = np.column_stack([db, da * np.sin(b), da * np.cos(b)])
        alpha = np.column_stack(
            [ddb, dda * np.sin(b) + da * db * np.cos(b), dda * np.cos(b) - da * db * np.sin(b)],
        )
        in_base = np.column_stack([self._sines(0.05, phase)[2] for phase in (0.0, 1.0, 2.0)])
        return omega, alpha, np.einsum("nij,ni->nj", self.R_base_flange, in_base)

    @property
    def samples(self) -> cw.Samples:
        """A pose with each of the readings, which say nothing."""
        return cw.Samples(np.zeros((len(self.t), 6)), self.R_base_flange, self.t, self.position)


def _off(found: FlangeMotion, true: tuple[Array, Array, Array]) -> list[float]:
    """The largest errors where the motion is inside, over the largest values."""
    parts = found.angular_velocity, found.angular_acceleration, found.acceleration
    pairs = zip(parts, true, strict=True)
    return [float(np.abs(each - exact)[found.inside].max() / np.abs(exact).max()) for each, exact in pairs]


@pytest.mark.parametrize("part", [0.05, 0.25, 0.5, 0.75])
def test_a_motion_within_the_bandwidth_is_as_it_is_and_not_late(part: float) -> None:
    """A delay of 0.01 ms at 7.5 Hz would be off by 5e-4."""
    analytic = Analytic(np.arange(8000) / 1000.0, part * BANDWIDTH)
    found = flange_motion(analytic.samples, BANDWIDTH)
    assert found.inside.mean() > 0.8
    assert found.bandwidth == BANDWIDTH
    assert max(_off(found, analytic.motion)) < EXACT


def test_gain_and_delay_of_a_sine() -> None:
    """By its sine and cosine parts, which no error elsewhere hides."""
    frequency = 0.75 * BANDWIDTH
    analytic = Analytic(np.arange(10_000) / 1000.0, frequency)
    steady = np.broadcast_to(np.eye(3), (10_000, 3, 3))
    found = flange_motion(cw.Samples(np.zeros((10_000, 6)), steady, analytic.t, analytic.position), BANDWIDTH)
    t, seen = analytic.t[found.inside], found.acceleration[found.inside, 0]
    w = 2.0 * np.pi * frequency
    sine, cosine = np.linalg.lstsq(np.column_stack([np.sin(w * t), np.cos(w * t)]), seen, rcond=None)[0]
    assert np.hypot(sine, cosine) / (0.05 * w**2) == pytest.approx(1.0, abs=EXACT)
    assert abs(np.arctan2(cosine, -sine)) / w < 1e-6


def test_beyond_twice_the_bandwidth_nothing_is_left() -> None:
    analytic = Analytic(np.arange(6000) / 1000.0, 2.5 * BANDWIDTH)
    found = flange_motion(analytic.samples, BANDWIDTH)
    assert np.abs(found.acceleration[found.inside]).max() < 5e-3 * np.abs(analytic.motion[2]).max()


def test_a_turn_right_round_and_again_is_one() -> None:
    """At 3 rad/s for ten seconds: five times round."""
    t = np.arange(10_000) / 1000.0
    R = Rotation.from_euler("z", 3.0 * t[:, None]).as_matrix()
    centre = np.column_stack([0.4 * np.cos(3.0 * t), 0.4 * np.sin(3.0 * t), np.zeros_like(t)])
    found = flange_motion(cw.Samples(np.zeros((len(t), 6)), R, t, centre), BANDWIDTH)
    inside = found.inside
    assert np.allclose(found.angular_velocity[inside], np.tile([0.0, 0.0, 3.0], (inside.sum(), 1)), rtol=0.0, atol=1e-6)
    assert np.allclose(found.acceleration[inside], np.tile([-3.6, 0.0, 0.0], (inside.sum(), 1)), rtol=0.0, atol=4e-3)


@pytest.mark.parametrize("pose_rate", [50.0, 100.0, 250.0])
def test_lines_between_poses_are_made_up_for(pose_rate: float) -> None:
    """Poses come more slowly than readings and are interpolated, which weakens what is fast; corners stay."""
    bandwidth = 0.1 * pose_rate
    analytic = Analytic(np.arange(12_000) / 1000.0, 0.75 * bandwidth)
    every = slice(None, None, round(1000.0 / pose_rate))
    poses = OrientationStream(analytic.t[every], analytic.R_base_flange[every], analytic.position[every])
    samples = synchronize(Streams(WrenchStream(analytic.t, np.zeros((12_000, 6))), poses), 0.0).samples
    assert samples.pose_period == pytest.approx(1.0 / pose_rate)
    exact = Analytic(np.asarray(samples.t), analytic.frequency)
    found = flange_motion(samples, bandwidth)
    assert max(_off(found, exact.motion)) < 2e-3
    truth = exact.R_base_flange
    off, straight = (np.std((each - truth)[found.inside]) for each in (found.R_base_flange, samples.R_base_flange))
    assert off < 0.6 * straight


def test_a_gap_is_not_guessed() -> None:
    t = np.r_[np.arange(0.0, 5.0, 1e-3), np.arange(5.5, 11.0, 1e-3)]
    analytic = Analytic(t, 2.0)
    found = flange_motion(analytic.samples, BANDWIDTH)
    assert max(_off(found, analytic.motion)) < EXACT
    near = (t > 4.9) & (t < 5.6)
    assert not found.inside[near].any()
    assert found.inside[(t > 1.0) & (t < 4.0)].all()
    assert found.inside[(t > 6.5) & (t < 10.0)].all()


def test_stamps_that_jitter_and_rows_that_are_lost() -> None:
    """A tenth of a period of jitter of the stamps, and every 50th row lost: a little worse, and nothing breaks."""
    rng = np.random.default_rng(1)
    even = np.arange(8000) / 1000.0
    kept = np.delete(np.arange(8000), np.arange(50, 8000, 50))
    analytic = Analytic(even[kept], 2.0)
    lost = flange_motion(analytic.samples, BANDWIDTH)
    assert max(_off(lost, analytic.motion)) < 5e-3
    shaken = Analytic(even + 1e-4 * rng.uniform(-1.0, 1.0, 8000), 2.0)
    found = flange_motion(shaken.samples, BANDWIDTH)
    assert max(_off(found, shaken.motion)) < 0.02


def test_the_bandwidth_is_where_the_noise_of_the_poses_takes_over() -> None:
    t, rng = np.arange(20_000) / 1000.0, np.random.default_rng(2)
    tones = [Analytic(t, frequency).position / frequency for frequency in np.geomspace(0.3, 5.0, 12)]
    position = 0.1 * np.sum(tones, axis=0)
    still = np.broadcast_to(np.eye(3), (20_000, 3, 3))
    found = [
        flange_motion(cw.Samples(np.zeros((20_000, 6)), still, t, position + noise * rng.normal(size=(20_000, 3))))
        for noise in (0.0, 1e-5, 1e-4)
    ]
    bandwidths = [motion.bandwidth for motion in found]
    assert bandwidths[0] > 50.0
    assert bandwidths[0] > bandwidths[1] > 5.0
    assert bandwidths[1] >= bandwidths[2] > 4.0
    exact, inside = found[0].acceleration, found[1].inside
    assert np.std(found[1].acceleration[inside] - exact[inside]) < 0.02 * np.std(exact)


def test_a_place_that_stays_does_not_end_the_bandwidth_of_a_turn() -> None:
    """About the flange's own z, so that the place is nothing but noise, from 0 Hz on."""
    analytic, rng = Analytic(np.arange(20_000) / 1000.0, 1.0), np.random.default_rng(4)
    angle = np.sum([np.sin(2.0 * np.pi * f * analytic.t + f) / f for f in np.geomspace(0.3, 5.0, 12)], axis=0)
    R = Rotation.from_euler("z", 0.1 * angle[:, None]).as_matrix()
    for noise in (0.0, 1e-16, 1e-6):
        place = np.array([0.5, 0.1, 0.4]) + noise * rng.normal(size=(20_000, 3))
        assert flange_motion(cw.Samples(np.zeros((20_000, 6)), R, analytic.t, place)).bandwidth > 5.0
    still = np.broadcast_to(np.eye(3), R.shape)
    place = 1e-5 * rng.normal(size=(20_000, 3))
    at_rest = flange_motion(cw.Samples(np.zeros((20_000, 6)), still, analytic.t, place))
    assert at_rest.bandwidth == 1.0
    assert np.abs(at_rest.acceleration).max() < 1e-3


def test_another_base_is_the_same_motion() -> None:
    analytic = Analytic(np.arange(4000) / 1000.0, 2.0)
    turn = random_rotations(1, np.random.default_rng(3))[0]
    turned = cw.Samples(np.zeros((4000, 6)), turn @ analytic.R_base_flange, analytic.t, analytic.position @ turn.T)
    here, there = (flange_motion(samples, BANDWIDTH) for samples in (analytic.samples, turned))
    assert np.allclose(there.terms, here.terms, rtol=0.0, atol=1e-8)


def test_terms_are_what_the_wrench_is_linear_in() -> None:
    omega, alpha, change = np.array([[1.0, 2.0, 3.0]]), np.array([[4.0, 5.0, 6.0]]), np.array([[7.0, 8.0, 9.0]])
    motion = FlangeMotion(omega, alpha, change, np.eye(3)[None], np.ones(1, np.bool_))
    assert motion.terms.tolist() == [[4.0, 5.0, 6.0, 1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 7.0, 8.0, 9.0]]


def test_what_shakes_an_arm_goes_on_when_it_has_stopped() -> None:
    """By a moment of motion it falls by e in `RINGING` s; of moments that nobody put in order it is what they are."""
    t = np.arange(3000) / 1000.0
    turning = np.where(t < 1.0, 0.3 * np.sin(2.0 * np.pi * 2.0 * np.minimum(t, 1.0)), 0.0)
    R = Rotation.from_rotvec(np.outer(turning, [0.0, 0.6, 0.8])).as_matrix()
    motion = flange_motion(cw.Samples(np.zeros((3000, 6)), R, t, np.zeros((3000, 3))), 20.0)
    stirred = motion.stirred[:, 1]
    assert stirred[1300] / stirred[1300 + round(1000 * RINGING)] == pytest.approx(np.e, rel=0.01)
    assert motion.angular_velocity[1300] == pytest.approx(np.zeros(3), abs=1e-3)
    assert stirred.max() < np.sum(motion.angular_velocity**2, axis=1).max()
    moment = np.array([[1.0, 2.0, 2.0]])
    alone = FlangeMotion(moment, moment, moment, np.eye(3)[None], np.ones(1, np.bool_))
    assert alone.stirred.tolist() == [[9.0, 9.0]]


@pytest.mark.parametrize("jumps", ["jerk", "acceleration", "blocks"])
@pytest.mark.parametrize("rate", [30.0, 60.0])
def test_what_poses_do_not_tell_of_a_move_is_known_by_its_size(rate: float, jumps: str) -> None:
    """Moves in 0.5 s each, between which the jerk or the acceleration jumps, or that begin and end in 0.05 s with one
    acceleration, and have nothing of some frequencies: what it is against what is found.
    """
    rng, period = np.random.default_rng(8), 0.002
    t = np.arange(0.0, 20.0, period)
    move, s = (t // 0.5).astype(int), t % 0.5 / 0.5
    way = np.vstack([np.zeros(4), np.cumsum(0.1 * rng.normal(size=(41, 4)), axis=0)])
    step = way[move + 1] - way[move]
    along, bend = s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / 0.5**2
    if jumps == "acceleration":
        along, bend = s**2 * (3.0 - 2.0 * s), (6.0 - 12.0 * s) / 0.5**2
    elif jumps == "blocks":
        ends, lasts = np.minimum(s, 1.0 - s), 0.1
        begun = np.where(ends < lasts, ends**2 / (2.0 * lasts), ends - lasts / 2.0) / (1.0 - lasts)
        along = np.where(s < 0.5, begun, 1.0 - begun)
        bend = np.where(ends < lasts, np.sign(0.5 - s), 0.0) / (lasts * (1.0 - lasts)) / 0.5**2
    place, true = way[move] + along[:, None] * step, bend[:, None] * step
    axis = np.array([0.36, 0.48, 0.8])
    R = Rotation.from_rotvec(place[:, 3:] * axis).as_matrix()
    told = np.arange(0, len(t), round(1.0 / rate / period))
    poses = OrientationStream(t[told], R[told], place[told, :3])
    samples = synchronize(Streams(WrenchStream(t, np.zeros((len(t), 6))), poses)).samples
    motion, rows = flange_motion(samples), np.searchsorted(t, np.asarray(samples.t))
    assert motion.untold is not None
    spun = motion.angular_acceleration - true[rows, 3:] * axis
    moved = motion.acceleration - np.einsum("nij,ni->nj", R[rows], true[rows, :3])
    assert motion.untold.min() >= 0.0
    z = np.hstack([spun, moved])[motion.inside] / np.sqrt(motion.untold[motion.inside])
    assert 0.2 < np.sqrt(np.mean(z**2)) < 1.0
    assert np.abs(z).max() < 5.0


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("lasts", [0.4, 0.5, 0.8, 1.0, 1.4])
def test_moves_there_and_back_that_are_alike_do_not_end_the_bandwidth(lasts: float, noise: float) -> None:
    """A shuttle without a stop has odd harmonics only, and nothing between them; places of 0.01 mm."""
    t = np.arange(0.0, 30.0, 0.002)
    s, back = t % lasts / lasts, (t // lasts).astype(int) % 2 == 1
    along = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    place = 0.3 * np.where(back, 1.0 - along, along)
    true = 0.3 * np.where(back, -1.0, 1.0) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / lasts**2
    axis = np.array([0.6, 0.0, 0.8])
    told = place[:, None] * axis + noise * np.random.default_rng(5).normal(size=(len(t), 3))
    still = np.broadcast_to(np.eye(3), (len(t), 3, 3))
    found = flange_motion(cw.Samples(np.zeros((len(t), 6)), still, t, told))
    assert found.bandwidth > 4.0 / lasts
    off = (found.acceleration - true[:, None] * axis)[found.inside]
    assert np.sqrt(np.mean(off**2)) < 0.03 * np.sqrt(np.mean(true**2))


def test_of_a_motion_far_below_the_bandwidth_next_to_nothing_is_untold() -> None:
    analytic = Analytic(np.arange(4000) / 1000.0, 1.0)
    motion = flange_motion(analytic.samples, BANDWIDTH)
    assert motion.untold is not None
    found = np.column_stack([motion.angular_acceleration, motion.acceleration])
    inside = motion.inside
    assert np.sqrt(motion.untold[inside].max()) < 0.02 * np.abs(found[inside]).max()


def test_what_tells_no_motion_is_refused_word_for_word() -> None:
    analytic = Analytic(np.arange(100) / 100.0, 1.0)
    whole = analytic.samples
    lack = (
        ", expected t and all of the flange's x, y, z in each row, from which its acceleration is taken: record them, "
    )
    for samples, message in (
        (cw.Samples(whole.wrench, whole.R_base_flange, None, whole.position), "arrays: found no times" + lack),
        (cw.Samples(whole.wrench, whole.R_base_flange, whole.t), "arrays: found no positions" + lack),
        (whole.select(slice(0, 7)), "arrays: found 7 rows, expected a motion in the order of its times"),
    ):
        with pytest.raises(InputError) as refused:
            flange_motion(samples)
        assert str(refused.value).startswith(message)
