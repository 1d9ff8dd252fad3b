"""How the flange moves, from recorded poses or an accelerometer: velocities and accelerations, differentiated smoothly.

The path, rotation vectors from each orientation to the next, summed, and the position are differentiated by one filter
that delays nothing, flat up to a bandwidth: above it there is nothing but the noise of the poses.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.arrays import Array, Rows, column
from ..geometry.rotations import path_through
from ..geometry.wrench import cross_matrix
from .accelerometer import Accelerometer
from .motion import PRODUCTS
from .samples import Samples
from .timestamps import default_gap, spread_evenly

ROLL_OFF = 1.0
"""Of the bandwidth, above it: there the filter's gain falls to zero."""
LEAST_GAIN = 0.2
OCTAVE = 0.5
"""Of the bandwidth, from there on to it: a motion whose acceleration jumps has there as much as all above, one whose
jerk does seven times as much.
"""
HALF_WIDTH, SIDE_LOBES = 3.5, 6.0
"""Periods of the bandwidth, to each side, over which the filter reaches; and how softly it ends (Kaiser's beta)."""
SLOWEST, FASTEST, OF_POSES = 1.0, 100.0, 0.3
"""Hz; no arm is slower, or faster, in what it does with a tool; and of the rate of the poses."""
OCTAVE_PARTS, HALF_BAND = 4.0, 2.0
"""Bands that begin in an octave of the acceleration's spectrum, and how far each reaches to both sides: moves there and
back that are alike have only odd harmonics, and of three times a frequency to it there is nothing.
"""
AT_REST = 0.02
"""rad/s^2 and m/s^2, RMS: what turns or moves less says nothing of where noise takes over, as of a pure turn the place,
whose noise, and be it rounding, has the rising spectrum of noise from 0 Hz on."""
BEFORE_A_MOVE = 0.2
"""s, in which an arm that rests at an end of a recording turns and moves by less than `AT_REST`, rad/s and m/s."""
RINGING = 0.2
"""s: what shakes an arm goes on for so long in its links; 12 Hz at 5 % of critical damping falls by half of e."""
FEWEST = 8
"""Rows of a section between gaps."""


@dataclass(frozen=True, eq=False)
class FlangeMotion(Rows):
    """How the flange moves at n moments, (n, 3) each in its own axes: `angular_velocity` rad/s, `angular_acceleration`
    rad/s^2, and the `acceleration` of its origin, m/s^2, without gravity; below `bandwidth` Hz, but for an acceleration
    that an accelerometer told, which is that of its own place, whole. `R_base_flange`
    (n, 3, 3) is the orientation, the way between interpolated poses bent. `inside` (n,) is False where the filter
    reaches beyond the recording, or into a gap, and what is there was guessed. `stirring` (n, 2): the mean square of
    acceleration and angular speed over the last `RINGING` s, m^2/s^4 and rad^2/s^2; None: as at the moment. `untold`
    (n, 6): the variance of what lies above the bandwidth, of angular acceleration and acceleration; None: nothing does.
    `of_accelerometer`: whether one told the accelerations, which are then those of its place.
    """

    angular_velocity: Array = field(metadata=column(3))
    angular_acceleration: Array = field(metadata=column(3))
    acceleration: Array = field(metadata=column(3))
    R_base_flange: Array = field(metadata=column(3, 3))
    inside: NDArray[np.bool_] = field(metadata=column(kind=np.bool_))
    bandwidth: float = FASTEST
    stirring: Array | None = field(default=None, metadata=column(2))
    untold: Array | None = field(default=None, metadata=column(6))
    of_accelerometer: bool = False

    @property
    def stirred(self) -> Array:
        """What drives and links shake by (n, 2)."""
        return _squares(self.acceleration, self.angular_velocity) if self.stirring is None else self.stirring

    @property
    def terms(self) -> Array:
        """What the wrench of a moving tool is linear in (n, 12): angular acceleration, products of the angular velocity
        (xx xy xz yy yz zz), acceleration.
        """
        return self.terms_of(slice(None)).T

    def terms_of(self, rows: slice) -> Array:
        """Of some rows, term by term (12, m)."""
        omega = self.angular_velocity[rows].T
        terms = np.empty((12, omega.shape[1]))
        terms[:3], terms[9:] = self.angular_acceleration[rows].T, self.acceleration[rows].T
        for term, (i, j) in zip(terms[3:9], PRODUCTS, strict=True):
            np.multiply(omega[i], omega[j], out=term)
        return terms


def flange_motion(
    samples: Samples,
    bandwidth: float | None = None,
    accelerometer: Accelerometer | None = None,
    gravity: Array | None = None,
) -> FlangeMotion:
    """The motion at the times of samples.

    Args:
        samples: with times and positions, or with an accelerometer's readings.
        bandwidth: Hz; None: where the noise of the poses takes over.
        accelerometer: how it sits; None: accelerations are those of the positions.
        gravity: (3,) m/s^2, base axes, which an accelerometer reads too.

    Returns:
        Acceleration (n, 3) m/s^2, angular velocity and acceleration (n, 3), rad/s and rad/s^2, in the flange's axes.

    Raises:
        InputError: no times, no positions or accelerations, or too few rows to tell a motion.
    """
    if accelerometer is not None and gravity is None:
        raise InputError("found an accelerometer and no gravity, expected both: it reads gravity too")
    told = samples.position if accelerometer is None else samples.accelerometer
    position = np.full((len(samples), 3), np.nan) if told is None else told
    placed = np.asarray(np.isfinite(position).all(axis=1))
    if accelerometer is not None and not placed.any():
        raise InputError(
            f"{samples.source}: found no accelerometer's readings, expected them, as the calibration's inertia counts "
            "from one: name their source with --imu"
        )
    if samples.t is None or not placed.any():
        lacking = "times" if samples.t is None else "positions"
        raise InputError(
            f"{samples.source}: found no {lacking}, expected t and all of the flange's x, y, z in each row, from which "
            "its acceleration is taken: record them, name an accelerometer with --imu, or calibrate without inertia"
        )
    t = spread_evenly(samples.t)
    position, placed = _bridged(position, placed, t)
    if len(t) < FEWEST or not np.median(np.diff(t)) > 0.0:
        raise InputError(f"{samples.source}: found {len(t)} rows, expected a motion in the order of its times")
    period, node = float(np.median(np.diff(t))), samples.pose_period or 0.0
    steps = np.diff(t)
    cut = (steps > default_gap(t)) | (steps <= -period) | (np.diff(placed.astype(int)) != 0)
    sections = np.split(np.arange(len(t)), np.flatnonzero(cut) + 1)
    known = [rows for rows in sections if len(rows) >= FEWEST and placed[rows[0]]]
    place = np.zeros_like(position) if accelerometer is not None else position
    grids = [_on_a_grid(samples.R_base_flange, place, t, rows, period) for rows in known]
    if not grids:
        raise InputError(f"{samples.source}: found gaps everywhere, expected {FEWEST} rows in a row or more")
    if bandwidth is None:
        bandwidth = _bandwidth(max(grids, key=lambda grid: len(grid[1]))[1], period, node)
    motion = np.zeros((len(t), 19))
    for rows, signal in grids:
        motion[rows] = _differentiated(t[rows], signal, period, node, bandwidth)
    R = samples.R_base_flange @ (np.eye(3) + cross_matrix(motion[:, 9:12]))
    acceleration = np.einsum("nij,ni->nj", R, motion[:, 6:9])
    if accelerometer is not None and gravity is not None:
        acceleration = np.nan_to_num(accelerometer.acceleration(position, t, R, gravity))
    stirring = _remembered(_squares(acceleration, motion[:, :3]), period)
    return FlangeMotion(
        motion[:, :3],
        motion[:, 3:6],
        acceleration,
        R,
        motion[:, 12] == 1.0,
        bandwidth,
        stirring,
        _mean_squares(motion[:, 13:], R, round(1.0 / bandwidth / period)),
        accelerometer is not None,
    )


def _bridged(place: Array, known: NDArray[np.bool_], t: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Places (n, 3) with those in between where only a few rows in a row have none, and which are known then."""
    rows = np.flatnonzero(known)
    if known.all() or len(rows) < 2:
        return place, known
    after = np.clip(np.searchsorted(rows, np.arange(len(t))), 1, len(rows) - 1)
    inside = (np.arange(len(t)) > rows[0]) & (np.arange(len(t)) < rows[-1])
    few = inside & (t[rows[after]] - t[rows[after - 1]] <= default_gap(t))
    between = np.stack([np.interp(t, t[rows], values) for values in place[rows].T], axis=1)
    return np.where((known | few)[:, None], np.where(known[:, None], place, between), np.nan), known | few


def _squares(acceleration: Array, angular_velocity: Array) -> Array:
    return np.stack([np.sum(each**2, axis=1) for each in (acceleration, angular_velocity)], axis=1)


def _mean_squares(upper: Array, R_base_flange: Array, rows: int) -> Array:
    """Of angular acceleration, and acceleration in base axes, the mean squares (n, 6) in flange axes over so many rows
    around each.
    """
    from scipy.ndimage import uniform_filter1d

    own = np.hstack([upper[:, :3], np.einsum("nij,ni->nj", R_base_flange, upper[:, 3:])])
    return np.asarray(np.maximum(uniform_filter1d(own**2, max(rows, 1), axis=0, mode="nearest"), 0.0))


def _remembered(squares: Array, period: float) -> Array:
    """Means over the last moments, fading."""
    from scipy.signal import lfilter

    newest = -np.expm1(-period / RINGING)
    return np.asarray(lfilter([newest], [1.0, newest - 1.0], squares, axis=0))


def _on_a_grid(
    R_base_flange: Array, position: Array, t: Array, rows: NDArray[np.intp], period: float
) -> tuple[NDArray[np.intp], Array]:
    """The rows of a section, and path and position (m, 6) on an even grid from the first of them."""
    signal, at = np.column_stack([path_through(R_base_flange[rows]), position[rows]]), t[rows]
    grid = at[0] + period * np.arange(max(round((at[-1] - at[0]) / period) + 1, 2))
    return rows, np.stack([np.interp(grid, at, values) for values in signal.T], axis=1)


def _bandwidth(signal: Array, period: float, node: float) -> float:
    """Where the spectrum of the accelerations is least: below it the arm moves, above it noise grows. Hz."""
    most = min(FASTEST, OF_POSES / max(period, node))
    n = len(signal)
    frequency = np.fft.rfftfreq(n, period)
    centres = np.exp2(np.arange(np.log2(SLOWEST), np.log2(max(most, SLOWEST)) + 1e-9, 1.0 / OCTAVE_PARTS))
    line = np.linspace(0.0, 1.0, n)[:, None]
    level = signal - (signal[:1] + line * (signal[-1:] - signal[:1]))
    window = np.hanning(n)[:, None]
    change = (2.0 * np.pi * frequency[:, None]) ** 2 * np.fft.rfft(level * window, axis=0)
    power = 2.0 * np.abs(change) ** 2 / (n * np.sum(window**2))
    chosen = []
    for group in (power[:, :3].sum(axis=1), power[:, 3:].sum(axis=1)):
        bands = [group[(frequency >= f / HALF_BAND) & (frequency < f * HALF_BAND)] for f in centres]
        means = np.array([band.mean() if len(band) else np.inf for band in bands])
        if group.any():
            peak = int(np.argmax(np.where(np.isfinite(means), means, 0.0)[: int(np.argmin(means)) + 1]))
            least = centres[peak + int(np.argmin(means[peak:]))]
            if group[frequency < least].sum() > AT_REST**2:
                chosen.append(float(least))
    return max(min([most, *chosen]), SLOWEST) if chosen else SLOWEST


def _differentiated(t: Array, signal: Array, period: float, straight: float, bandwidth: float) -> Array:
    """At times (k,) of a section the first derivative of its path, the second of path and position, by how much the
    path is off straight lines between the poses, whether the filter stays inside, and what the upper octave of the
    bandwidth has of the second derivatives (k, 19).
    """
    from scipy.signal import fftconvolve, oaconvolve

    curved, first = (_taps(order, period, straight, bandwidth) for order in (0, 1))
    second = fftconvolve(first, _taps(1, period, 0.0, bandwidth))
    half = len(second) // 2
    bent, first = (np.pad(taps, half // 2) for taps in (curved - _taps(0, period, 0.0, bandwidth), first))
    n = len(signal)
    reach = np.minimum(np.arange(1, half + 1), n - 1)
    before, after = 2.0 * signal[0] - signal[reach[::-1]], 2.0 * signal[-1] - signal[-1 - reach]
    wide = np.concatenate([before, signal, after])
    velocity = oaconvolve(wide[:, :3], first[:, None], mode="valid", axes=0)
    acceleration = oaconvolve(wide, second[:, None], mode="valid", axes=0)
    off = oaconvolve(wide[:, :3], bent[:, None], mode="valid", axes=0)
    below = _taps(0, period, 0.0, OCTAVE * bandwidth)
    longer = np.pad(acceleration, ((len(below) // 2, len(below) // 2), (0, 0)), mode="edge")
    upper = acceleration - oaconvolve(longer, below[:, None], mode="valid", axes=0)
    place = np.arange(n)
    began, ended = (_rests(end, period) for end in (signal, signal[::-1]))
    inside = (began | (place >= half // 2)) & (ended | (place < n - half // 2))  # its outer taps are next to nothing
    known = np.column_stack([velocity, acceleration, off, inside.astype(np.float64), upper])
    grid = t[0] + period * place
    return np.stack([np.interp(t, grid, values) for values in known.T], axis=1)


def _rests(signal: Array, period: float) -> bool:
    """Whether the arm rests where a section begins: then it did so before, as the filter takes it to have done."""
    rows = max(round(BEFORE_A_MOVE / period), 2)
    return bool(np.abs(signal[min(rows, len(signal) - 1)] - signal[0]).max() < AT_REST * BEFORE_A_MOVE)


def _taps(order: int, period: float, straight: float, bandwidth: float) -> Array:
    """The filter that takes the value (order 0) or the derivative (1), exact for straight lines, flat up to the
    bandwidth. Lines that are `straight` for so many s weaken a frequency f by sinc^2(f straight): that is made up for.
    """
    half = max(int(np.ceil(HALF_WIDTH / bandwidth / period)), 2)
    n = 8 * (2 * half + 1)
    frequency = np.fft.rfftfreq(n, period)
    falls = np.clip((frequency - bandwidth) / (ROLL_OFF * bandwidth), 0.0, 1.0)
    gain = 0.5 * (1.0 + np.cos(np.pi * falls)) / np.maximum(np.sinc(frequency * straight) ** 2, LEAST_GAIN)
    response = np.roll(np.fft.irfft((2j * np.pi * frequency) ** order * gain, n), half)
    taps = response[: 2 * half + 1] * np.kaiser(2 * half + 1, SIDE_LOBES)
    ago = -period * np.arange(-half, half + 1)
    return np.asarray(taps / float(taps @ ago**order))
