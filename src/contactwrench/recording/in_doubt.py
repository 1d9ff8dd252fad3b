"""What a recording shows that no sample does: readings that stand still, contact that may be none, forces left over."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..calibration.calibration import Calibration
from ..calibration.dynamics import inertial_matrix
from ..compensate.bias_tracking import SAME_SECONDS
from ..compensate.contact_wrenches import FREE, NOT_GIVEN, NOT_JUDGED, TOUCHING, ContactWrenches, motion_of
from ..compensate.faults import Reason
from ..errors import InputError
from ..estimation.noise import PER_NEWTON, variance_of_means
from ..estimation.priors import tool_of
from ..geometry.arrays import Array
from ..model import AXES, weight_scale
from ..samples.flange_motion import flange_motion
from ..samples.limits import channels_at_limit
from ..samples.samples import Samples
from ..statistics import counted, two_digits

LONG, STEADY, MARGIN = 10.0, 0.05, 1.2
"""s for which no hand keeps as even: within this share of the force, and so many times the variance."""
MOST_OF_TIME = 0.75
"""Share of the samples in contact, from which on it is in doubt, however it goes."""
EXPLAINED, OFTEN = 0.25, 0.25
"""Of a force's square, what is left of it less a free tool's inertia; and the share of the samples in contact."""
BESIDE, OF_MASS = 0.05, 0.4
"""Of a torque's square, what is left of it beside noise where the force acts at the tool's own centre of mass, and the
share of the time in contact: a fifth or less of pushes half as far again from the sensor, half of mere inertia.
"""
SHORT, MANY, FAINT = 0.1, 10.0, 8.0
"""s, that no hand and no task touches for, and contacts in a minute: of so many so short ones; and standard deviations,
below which are the largest force and torque of what a bias gives that drifts, and of few hands' contacts.
"""
PART_OF_WEIGHT, NEARLY_ALL = 0.1, 0.9
"""Of the weight, and of the rows: orientations that have nothing to do with the readings leave less in few of them."""
LEFT = "N are left of the force", "N m are left of the torque"
FEWEST_ROWS = 100
"""Fewer may well be pushes alone."""
MEDIAN_STEP = 0.954
"""Of the absolute difference of two numbers with a normal distribution, in standard deviations of one."""
OTHERWISE = (
    "if nothing touches, the recording has another tool (calibrate it), another zero (--zero S), or is not "
    "read as the calibration was (sign, units, orientation)"
)
SATURATED = Reason("saturated: a channel stands at its limit")
STUCK, NOTHING_CHANGES = "stuck", "contact or bias"


class StuckReadings:
    """What a control loop learns only after a while is told here of each row, batch by batch: that a channel stands at
    its limit, which the batch before and this one show, and that a reading was stuck, back to where it began in it.
    """

    def __init__(self) -> None:
        self._before, self._at_limit = np.full((1, 6), np.nan), np.zeros(6, dtype=int)

    def marked(self, rows: ContactWrenches, samples: Samples) -> ContactWrenches:
        """The same rows, of the next samples; those that stand still are not valid, and not judged for contact."""
        wrench, valid, reasons, contact = samples.wrench, rows.valid.copy(), list(rows.reason), rows.contact.copy()
        saturated, moves = self._saturated(rows, samples), np.diff(wrench, axis=0, prepend=self._before[-1:]) != 0.0
        self._before = wrench if len(wrench) else self._before
        channels = {row: why.channel for row, why in enumerate(rows.reason) if why is not None and why.kind == STUCK}
        for row in np.flatnonzero(saturated & (valid | np.isin(np.arange(len(wrench)), list(channels)))).tolist():
            reasons[row], valid[row] = SATURATED, False
        of_each = zip((*range(6), -1), (*AXES, "the whole reading"), (*moves.T, moves.any(axis=1)), strict=True)
        for channel, what, moved in of_each:
            stretch = np.cumsum(moved)
            stuck = [stretch[row] for row, own in channels.items() if own == channel]
            for row in np.flatnonzero(valid & ~moved & np.isin(stretch, stuck)).tolist():
                reasons[row] = Reason(f"{STUCK}: {what} has begun to stand still", channel=channel)
                valid[row], contact[row] = False, NOT_JUDGED
        return replace(
            rows,
            valid=valid,
            reason=tuple(reasons),
            contact=contact,
            statistic=NOT_GIVEN,
            threshold=NOT_GIVEN,
            covariance_of=NOT_GIVEN,
            covariance=None,
        )

    def _saturated(self, rows: ContactWrenches, samples: Samples) -> NDArray[np.bool_]:
        """As the recording says; else, where rows were judged, as readings do that are not what a free tool gives: a
        coarse and quiet sensor at rest may stand at its least value too.
        """
        if samples.saturated is not None:
            return samples.saturated
        if rows.statistic is None:
            return np.zeros(len(rows), dtype=bool)
        limit = channels_at_limit(np.vstack([self._before, samples.wrench]))[len(self._before) :]
        limit &= ~(rows.statistic <= rows.threshold)[:, None]
        self._at_limit += limit.sum(axis=0)
        return np.asarray(limit.any(axis=1))

    def __str__(self) -> str:
        """How many rows of which channels stand at their limits; empty where none does."""
        of = [f"{axis} in {counted(int(n), 'row')}" for axis, n in zip(AXES, self._at_limit, strict=True) if n]
        return f"readings stand at the sensor's limit and show less than there was: {', '.join(of)}" if of else ""


class InDoubt:
    """Whether contact, batch by batch, may be another tool or a zero that moved: it lasts, by a force that a weight, a
    bias and a steady drift explain, as they do no hand's, or there is one for most of the time; or the inertia of a
    tool, which the calibration does not know, or its weight, with an orientation that is off; or noise that is larger
    than is known, which makes many short ones; or a zero that moved, and no contact changes so little.
    """

    def __init__(self, calibration: Calibration) -> None:
        self.calibration, self.rows, self.touching, self.inertial, self.largest = calibration, 0, 0, 0, 0.0
        self.contacts = self.short = self.faint = self.of_mass = 0
        self.lever, self.same = calibration.B[3:, :3] @ np.linalg.pinv(calibration.B[:3, :3]), np.nan
        self.start, self.last, self.lasts = np.nan, np.nan, np.empty((0, 8))

    def add(self, samples: Samples, batch: ContactWrenches) -> None:
        """The next n > 0 samples, which have times; ten a second of a contact that lasts are kept."""
        t, touching = np.asarray(samples.t), batch.contact == TOUCHING
        self.start, self.rows = np.fmin(self.start, t[0]), self.rows + len(t)
        self.touching += int(np.sum(touching))
        self.contacts += len(batch.contacts)
        self.short += sum(each.release is not None and each.release - each.onset < SHORT for each in batch.contacts)
        least_std = np.fmin.reduce(np.linalg.norm(batch.std.reshape(-1, 2, 3), axis=2)) / np.sqrt(3.0)
        peaks = np.reshape([each.peak for each in batch.contacts], (-1, 2, 3))
        self.faint += int(np.sum(np.all(np.linalg.norm(peaks, axis=2) < FAINT * least_std, axis=1)))
        same = [row for row, why in enumerate(batch.reason) if why is not None and why.kind == NOTHING_CHANGES]
        self.same = np.fmin.reduce(t[same] - SAME_SECONDS, initial=self.same)
        if touching.any():
            motion = motion_of(self.calibration, samples)
            felt = self.calibration.compensate(samples.wrench, samples.R_base_flange, motion=motion)  # sensor axes
            self.of_mass += int(np.sum(touching & batch.valid & self._of_mass(felt, batch.std)))
            if (inertial := self._inertial(samples)) is not None:
                left, of_sample = (np.sum(force[:, :3] ** 2, axis=1) for force in (felt - inertial, felt))
                explained = touching & (left < EXPLAINED * of_sample)
                self.inertial += int(np.sum(explained))
                self.largest = max(self.largest, float(np.sqrt(of_sample[explained].max(initial=0.0))))
        if (free := np.flatnonzero(batch.contact == FREE)).size:
            self.lasts, touching[: free[-1]] = self.lasts[:0], False
        read = self.calibration.predict(samples.R_base_flange)[:, :3]
        variance = np.sum(batch.std[:, :3] ** 2, axis=1)
        known = (t - self.start, read - self.calibration.bias[:3], samples.wrench[:, :3] - read, variance)
        kept = touching & np.isfinite(variance) & (np.diff(np.floor(10.0 * t), prepend=self.last) != 0.0)
        self.last = np.floor(10.0 * t[-1])
        self.lasts = np.vstack([self.lasts, np.column_stack(known)[kept]])

    def _of_mass(self, felt: Array, std: Array) -> NDArray[np.bool_]:
        """Whether the force of wrenches (n, 6) with a std (n, 6) acts at the tool's centre of mass, as torques tell."""
        torque, beside = felt[:, 3:], felt[:, 3:] - felt[:, :3] @ self.lever.T
        of_force, of_torque = np.sum(std.reshape(-1, 2, 3) ** 2, axis=2).T
        size, left = np.sum(torque**2, axis=1), np.sum(beside**2, axis=1)
        noise = of_torque + np.linalg.norm(self.lever, 2) ** 2 * of_force
        return np.asarray((size > 9.0 * of_torque) & (left < BESIDE * size + noise))

    def _inertial(self, samples: Samples) -> Array | None:
        """What a free tool exerts (n, 6) as its arm accelerates, its mass at the centre of mass and the sensor at the
        flange; None where the calibration counts it, or no position tells.
        """
        mass, motion = self.calibration.mass, None
        if mass is not None and self.calibration.dynamics is None and samples.position is not None:
            with suppress(InputError):  # too few rows
                motion = flange_motion(samples)
        if mass is None or motion is None:
            return None
        return motion.terms @ inertial_matrix(tool_of(self.calibration), mass, np.zeros((3, 3)), np.zeros(3)).T

    def __str__(self) -> str:
        """A sentence; empty where nothing is in doubt."""
        if self.inertial > OFTEN * self.touching:
            return (
                f"in {self.inertial / self.touching:.0%} of the time in contact the force, up to "
                f"{two_digits(self.largest)} N, is what the free tool exerts as the arm accelerates: calibrate it with "
                "--model dynamic, or state what it scatters by in motion (--noise)"
            )
        if self.short > max(MANY / 60.0 * (0.1 * self.last - self.start), MANY, 0.5 * self.contacts):
            return (
                f"{self.short} of {self.contacts} contacts last for less than {SHORT} s: if nothing touches, the noise "
                "is larger than is known, as of an arm that moves: state what a free tool scatters by there (--noise "
                "FREE); with an inertia, record poses more often and with steadier stamps"
            )
        t, load, force, variance = np.split(self.lasts, (1, 4, 7), axis=1)
        of_axis = np.tile(np.eye(3), (len(t), 1, 1))
        known = np.concatenate([load[..., None], of_axis, t[..., None] * of_axis], axis=2).reshape(-1, 7)
        left = force.ravel() - known @ np.linalg.lstsq(known, force.ravel(), rcond=None)[0]
        even = left @ left <= MARGIN * np.sum(variance) + STEADY**2 * np.sum(force**2)
        found = f"in contact for {self.touching / max(self.rows, 1):.0%} of the time"
        if even and len(t) and t[-1, 0] - t[0, 0] >= LONG:
            found += f", from {t[0, 0]:.4g} s on to the end by a force as of a weight or a bias"
        elif self.touching <= MOST_OF_TIME * self.rows:
            return self._besides()
        return f"{found}: {OTHERWISE}, or it drifted (--drift)"

    def _besides(self) -> str:
        if self.of_mass > OF_MASS * self.touching:
            return (
                f"in {self.of_mass / self.touching:.0%} of the time in contact the force acts at the tool's own centre "
                "of mass: if nothing touches, the orientation comes late (--delay) or is off, or it is the inertia as "
                "the arm accelerates: record positions for --model dynamic, or state what it scatters by in motion "
                "(--noise)"
            )
        if self.faint > max(MANY, 0.5 * self.contacts):
            return (
                f"{self.faint} of {self.contacts} contacts are hardly more than chance gives: if nothing touches, the "
                "bias drifted (--drift), or the noise is larger than is known (--noise)"
            )
        if self.same == self.same:
            return (
                f"from {self.same - self.start:.4g} s on a contact does not change for {SAME_SECONDS:g} s or more: if "
                "nothing touches, the zero was set anew or moved: cut the recording there, with --zero S for the rest"
            )
        return ""


class OffThroughout:
    """Whether forces, or torques, that are not judged for contact are a part of the weight's, and beyond the noise, in
    nearly all of many rows, batch by batch: no arm touches something all the time.
    """

    def __init__(self, calibration: Calibration) -> None:
        of_row = variance_of_means(calibration.noise, calibration.fitted_poses, np.ones(1))[0]
        own_torque = np.r_[0.0, np.linalg.norm(calibration.B[3:, :3], 2)]
        self.part = PART_OF_WEIGHT * np.maximum(weight_scale(calibration.B) * PER_NEWTON[::3], own_torque)
        self.variance, self.least = np.sum(of_row.reshape(2, 3), axis=1), np.zeros(2)
        self.rows, self.off = 0, np.zeros(2, dtype=int)

    def add(self, batch: ContactWrenches) -> None:
        """The next rows, as noisy as those of the calibration or as from row to row; NaN does not count."""
        wrench = batch.wrench[np.isfinite(batch.wrench).all(axis=1)].reshape(-1, 2, 3)
        if len(wrench) > 1:
            own = np.median(np.abs(np.diff(wrench, axis=0)), axis=0) / MEDIAN_STEP
            noise = np.sqrt(np.maximum(self.variance, np.sum(own**2, axis=1)))
            self.least = np.maximum(self.least, self.part + 3.0 * noise)
        self.rows += len(wrench)
        self.off += np.sum(np.linalg.norm(wrench, axis=2) > self.least, axis=0)

    def __str__(self) -> str:
        """A sentence; empty where nothing is in doubt."""
        for least, off, left in zip(self.least, self.off, LEFT, strict=True):
            if self.rows >= FEWEST_ROWS and off >= NEARLY_ALL * self.rows:
                found = f"more than {two_digits(least)} {left} in {off / self.rows:.0%} of the rows"
                return f"{found}: {OTHERWISE}, something is held, or the arm moves fast"
        return ""
