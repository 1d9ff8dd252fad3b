"""A second of readings at rest, and a calibration from several: what a person is told of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import contactwrench as cw
from contactwrench.calibration.text import parameter_rows, verdict_sentences
from contactwrench.errors import InputError, refuse
from contactwrench.geometry.arrays import Array
from contactwrench.geometry.orientation import from_quat_xyzw
from contactwrench.geometry.quaternions import Quat
from contactwrench.geometry.rotations import rotation_angle
from contactwrench.samples.samples import ReadAs
from contactwrench.samples.still_segments import still_segments

SECONDS = 1.0
FEWEST = 20
COMPARED = 5
"""Captures before, against whose noise a new one is judged; the calibration judges all of them again."""


@dataclass(frozen=True)
class Reading:
    """A reading (6,), N and N m, with the orientation `R_base_flange` at its stamp `t`, s."""

    t: float
    wrench: Array
    quat_xyzw: Quat


def samples_of(readings: Sequence[Reading], source: str, read_as: ReadAs) -> cw.Samples:
    """The readings as samples, with how they were `read_as`. Raises `InputError` where they are too few."""
    found = f"{source}: found {len(readings)} readings with an orientation in {SECONDS:g} s"
    refuse((len(readings) < FEWEST, f"{found}, expected at least {FEWEST}: see /diagnostics"))
    R = from_quat_xyzw(np.array([reading.quat_xyzw for reading in readings]))
    wrench, t = np.array([reading.wrench for reading in readings]), np.array([reading.t for reading in readings])
    return cw.Samples(wrench, R, t, source=source, read_as=read_as)


def require_still(samples: cw.Samples, before: Sequence[cw.Samples]) -> None:
    """Raise `InputError` where the arm moves, or the reading, as far as the captures `before` tell its noise."""
    start = -np.inf if samples.t is None else float(samples.t.min())
    segments = still_segments(cw.Samples.concatenate([*before[-COMPARED:], samples]))
    if any(segment.t_end > start for segment in segments.accepted):
        return
    why = [segment.rejected for segment in segments.rejected if segment.t_end > start] or ["the arm moves"]
    raise InputError(f"{samples.source}: found that {why[0]}, expected arm and reading at rest: capture it again")


def captured(samples: cw.Samples, before: Sequence[cw.Samples]) -> str:
    """One line on a pose that was taken."""
    R, mean = samples.R_base_flange[0], samples.wrench.mean(axis=0)
    line = f"{samples.source}: {len(samples)} readings, mean force {np.round(mean[:3], 2).tolist()} N"
    if before:
        nearest = min(rotation_angle(R.T @ each.R_base_flange[0]) for each in before)
        line += f", {np.degrees(nearest):.0f} deg from the nearest pose before"
    return line


def calibrated(captures: Sequence[cw.Samples]) -> cw.Calibration:
    """The calibration of these poses. Raises `ContactWrenchError` where they cannot give it."""
    found = "found no poses, expected some: ~/start_calibration, then ~/capture at each of several orientations"
    refuse((not captures, found))
    return cw.calibrate(replace(cw.Samples.concatenate(captures), source=f"{len(captures)} captures on ROS"))


def described(calibration: cw.Calibration) -> str:
    """One line on a calibration: the verdict, the weight, the warnings."""
    rows = {name: f"{name} {value} +- {std} {unit}" for name, value, std, unit in parameter_rows(calibration)}
    first = [rows["weight"]] if "weight" in rows else []
    return "; ".join([*verdict_sentences(calibration), *first, *calibration.warnings])
