"""The noise that the calibration itself does not explain: of means over any number of samples, and so of one sample,
and behind a filter. Noise that is not white falls more slowly than with their number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..estimation.noise import variance_of_digits, variance_of_means, with_torques
from ..geometry.arrays import Array
from ..geometry.ranges import NOISE_OR_NONE, READING, Range
from ..samples.poses import Pose
from ..samples.still_noise import StillNoise
from .faults import FINE, LEARNED, LEARNING
from .filters import LowPass
from .state import NOISE_LEARNED, OCTAVES, Sample, State, kernel

LEAST_STD = np.array([1e-6, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7])
"""N and N m: less noise than this no sensor has, and rounding begins to count."""
LEAST_ROWS = 10
LEAST_PAIRS = 8
"""Of means, whose differences tell an Allan variance."""
LEARNED_STD, CHANCE = 0.16, 2.0
"""Std of the logarithm of a variance that is learned from the first samples; and how many standard deviations of such
logarithms two noises are apart that may be one. More hides errors between poses, less costs clean tables sensitivity.
"""
LEARN_SAMPLES = 50.0
"""Free ones, at the least, from which the noise is learned."""
BLOCK_SECONDS = 0.1
USUAL_RATE, FAR = 1000.0, 1e6
"""Hz, of samples, until their rate is known; samples, over which a noise counts as noise unless said."""


@dataclass(frozen=True, eq=False)
class SampleNoise:
    """Allan variances `allan` (k, 6), half the mean square of how far a mean differs from the next, of means over
    `rows` (k,) samples. White noise is shorter ones and longer ones, down to the `floor` (6,). It counts as noise over
    `horizon` samples; what is slower is drift.
    """

    rows: Array
    allan: Array
    floor: Array
    horizon: float = FAR

    def allan_of(self, rows: Array) -> Array:
        """Allan variances (m, 6) of means over so many samples (m,)."""
        at, known = np.log(rows), np.log(self.rows)
        near = np.exp([np.interp(at, known, np.log(of_axis)) for of_axis in self.allan.T]).T
        beyond = np.maximum(self.rows[0] / rows, 1.0) * np.minimum(self.rows[-1] / rows, 1.0)
        return np.asarray(np.maximum(near * beyond[:, None], self.floor))

    def of_mean(self, rows: float) -> Array:
        """The variance (6,) of the mean of so many samples about the level of the horizon: half the Allan variances of
        all octaves between (Haar's wavelets), white noise beyond.
        """
        octaves = rows * 2.0 ** np.arange(max(np.ceil(np.log2(self.horizon / rows)), 1.0))
        allan = self.allan_of(octaves)
        return np.asarray(0.5 * (allan.sum(axis=0) + allan[-1]))

    def over(self, seconds: float, rate: float | None) -> SampleNoise:
        """The same where what is slower than that is drift."""
        return replace(self, horizon=max(seconds * (rate or USUAL_RATE), 2.0))

    def told_to(self, s: State, low_pass: LowPass | None, rate: float | None) -> None:
        """Let a state have it, as it is behind a low-pass at a rate; None: not known, and nothing is filtered."""
        s.noise_filtered[:] = self.behind(low_pass, rate or USUAL_RATE).tolist()
        s.noise_variance[:], s.flicker[:] = self.of_sample.tolist(), self.flicker.tolist()
        s.block_noise[:] = self.of_mean(1.0 if rate is None else max(BLOCK_SECONDS * rate, 1.0)).tolist()
        s.stale = True

    @property
    def of_sample(self) -> Array:
        """The variance (6,) of a sample."""
        return self.of_mean(1.0)

    @property
    def white(self) -> Array:
        """The variance (6,) of a sample about its neighbours."""
        return np.asarray(self.allan_of(np.ones(1))[0])

    @property
    def flicker(self) -> Array:
        """What the variance (6,) of a level grows by when the time grows e-fold, beyond the horizon."""
        return np.asarray(self.allan_of(np.array([self.horizon]))[0] / np.log(4.0))

    def behind(self, low_pass: LowPass | None, rate: float) -> Array:
        """The variance (6,) behind a filter, which stands for the mean over as many samples as leaves as much of white
        noise.
        """
        gain = 1.0 if low_pass is None else low_pass.noise_gain(rate)
        return np.asarray(np.maximum(gain * self.white, self.of_mean(1.0 / gain)))


def stated_noise(noise: ArrayLike) -> SampleNoise:
    """From standard deviations (6,) of a sample, one number for all, or a recording (n, 6) at rest or, compensated, of
    free motion, at the rate of the samples. Raises `InputError` for any other shape, a negative number or a NaN.
    """
    values = with_torques(noise)
    is_recording = values.ndim == 2 and values.shape[1] == 6 and len(values) >= LEAST_ROWS
    if not (is_recording or values.shape == (6,)):
        raise InputError(
            f"noise has shape {values.shape}, expected (6,) standard deviations of a sample, or a recording at rest of "
            f"at least {LEAST_ROWS} rows (n, 6), all finite"
        )
    (READING if is_recording else NOISE_OR_NONE).require(values, "noise", values.shape)
    if not is_recording:
        return of_variances(np.ones(1), np.square(values)[None])
    pairs: list[float] = []
    squares: list[Array] = []
    while len(values) >= 2:
        first, second = values[: len(values) // 2 * 2].reshape(-1, 2, 6).swapaxes(0, 1)
        pairs.append(len(first))
        squares.append(np.sum((second - first) ** 2, axis=0))
        values = 0.5 * (first + second)
    return of_pairs(np.array(pairs), np.array(squares))


def known_noise(calibration: Calibration, stated: SampleNoise | None, rate: float | None) -> SampleNoise:
    """What was `stated`, or what the calibration's recording showed at rest; else, until it is learned, the noise of a
    pose.
    """
    if stated is not None:
        return stated
    if calibration.still_noise is not None:
        return of_still_segments(calibration.still_noise, rate or USUAL_RATE)
    return of_variances(np.ones(1), calibration.noise[None] ** 2)


def of_pairs(pairs: Array, squares: Array) -> SampleNoise:
    """From sums of the squared differences (k, 6) within pairs of means over 1, 2, 4, ... samples, so many `pairs`
    (k,). Longer means are taken to be no better than the longest that are known.
    """
    enough = max(int(np.sum(pairs >= LEAST_PAIRS)), 1)
    pairs, allan = pairs[:enough], 0.5 * squares[:enough] / pairs[:enough, None]
    return of_variances(2.0 ** np.arange(enough, dtype=np.float64), allan, allan[-1])


def of_still_segments(still: StillNoise, rate: float) -> SampleNoise:
    """From what a calibration's recording showed at rest, for samples at a rate (Hz). Where they come more rarely than
    its rows they may be some of these, as loggers write them, and no means over the time between.
    """
    tell = (np.arange(len(still.duration)) == len(still.duration) - 1) | (still.duration * rate > 0.5)
    rows, allan = still.duration[tell] * rate, still.std[tell] ** 2
    floor = np.zeros(6)
    if len(rows) > 1:  # what is left of the longest mean's beside white noise, of which the two have a / rows
        floor = np.maximum(rows[-1] * allan[-1] - rows[-2] * allan[-2], 0.0) / (rows[-1] - rows[-2])
    of_means = of_variances(rows, allan, floor)
    if still.row_std is None:
        return of_means
    return of_variances(rows, allan + np.maximum(still.row_std**2 - of_means.white, 0.0) / rows[:, None], floor)


def of_variances(rows: Array, allan: Array, floor: Array | float = 0.0) -> SampleNoise:
    """With no less than any sensor has."""
    return SampleNoise(rows, np.maximum(allan, LEAST_STD**2 / rows[:, None]), np.zeros(6) + floor)


def between_poses(calibration: Calibration, of_row: Array) -> Array:
    """The variance (6,) of what the calibration's poses differ by beyond the noise of their means, as these themselves
    show it. Single rows may be samples, with the variance `of_row` (6,), or means of many: they are samples where they
    differ as samples do in forces and in torques alike, as far as chance goes, and the robot's orientations are not
    known to be off. Else nothing of it averages away.
    """
    all_of_it = calibration.noise**2
    shares = np.mean((all_of_it / np.maximum(of_row, LEAST_STD**2)).reshape(2, 3), axis=1)
    of_poses = 2.0 / (3.0 * calibration.dof) if calibration.dof > 0.0 else 0.0
    by_chance = CHANCE * np.sqrt(of_poses + LEARNED_STD**2)
    are_samples = calibration.orientation_std is None and np.abs(np.log(shares)).max() < by_chance
    of_single = all_of_it / np.repeat(shares, 3) * are_samples  # a single axis' variance is learned to a sixth only
    known = [pose.wrench_cov.diagonal() if pose.n > 1 else of_single for pose in calibration.fitted_poses]
    return np.asarray(np.maximum(all_of_it - (np.mean(known, axis=0) if known else of_single), 0.0))


def six_numbers(values: ArrayLike | None, what: str, within: Range, default: float = 0.0) -> list[float]:
    """Six numbers of that range, or the default. Raises `InputError` that names `what`."""
    return [default] * 6 if values is None else list(within.require(values, what, (6,)).tolist())


def reading_variance(calibration: Calibration, poses: tuple[Pose, ...], rows: float | None = None) -> Array:
    """Variance (n, 6) of the poses' mean readings: what poses of the calibration differed by, and the scatter of a
    sample over the rows that each of these has (where the calibration saw no repeated rows, its noise has both); and
    the digits that these are rounded to, by as much as they are coarser. `rows`: of each, where it is known otherwise.
    """
    n = np.array([rows or pose.n for pose in poses], dtype=np.float64)
    readings = (np.array([pose.wrench for pose in each]).reshape(-1, 6) for each in (poses, calibration.fitted_poses))
    coarse, fine = map(variance_of_digits, readings)
    return variance_of_means(calibration.noise, calibration.fitted_poses, n) + np.maximum(coarse - fine, 0.0)


@kernel
def learn_noise(s: State, sample: Sample) -> tuple[int, float]:
    """The sample's part in the Allan variances: whenever two means over as many samples have come, how far they differ,
    and their mean, which is one over twice as many. It begins anew whenever it has learned, so that a touch in the
    first second, which made the noise too large for any contact, does not stay in it. What is to be said of the sample,
    with a figure.
    """
    if s.learn_anew:
        s.learn_anew = False
        for octave in range(OCTAVES):
            s.means[octave] = 0.0
            for k in range(6):
                s.squares[octave][k] = 0.0
    mean = s.column
    for octave in range(OCTAVES):
        s.means[octave] += 1.0
        first, squares = s.first_mean[octave], s.squares[octave]
        if s.means[octave] % 2.0 == 1.0:
            for k in range(6):
                first[k] = mean[k]
            break
        for k in range(6):
            apart = mean[k] - first[k]
            squares[k] += apart * apart
            mean[k] = 0.5 * (mean[k] + first[k])
    seconds = s.means[0] * s.interval
    if s.means[0] < LEARN_SAMPLES or s.learned_from + seconds < s.learn_next:
        return FINE if s.knows_noise else LEARNING, seconds
    s.learned_from += seconds
    s.learn_next, s.learn_anew = 2.0 * s.learned_from, True
    sample.events |= NOISE_LEARNED
    return LEARNED, seconds
