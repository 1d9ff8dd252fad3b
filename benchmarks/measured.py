"""Measured recordings: what `auto` makes of them, and whether `diagnose` finds the true reading of one read wrongly.

Expected figures are of an independent least-squares fit of a rigid tool, its mounting free. Tools and bases of measured
sets are not known better than that, so only the diagnosis has a target: the true reading comes first.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

import contactwrench as cw
from contactwrench.assess.interpretations import as_read
from tests.support.measured_sets import measured_sets

from .diagnose import diagnosed, likeness
from .mistakes import File
from .table import Row

INDEPENDENT = {
    "Panda, Mini45": (7.728, (3.8, 6.6, -50.1)),
    "KUKA, Gamma": (9.156, (0.3, 0.1, 43.9)),
    "Axia80": (10.804, (-0.1, -0.4, 51.9)),
}
"""Weight, N, and centre of mass, mm, by an independent fit."""


def calibrated(name: str, samples: cw.Samples) -> Iterator[Row]:
    """Tool, residuals, and what there was to say, by `auto`."""
    calibration = cw.calibrate(samples, "auto")
    std, com = calibration.std, calibration.com
    if calibration.weight is None or com is None:
        raise TypeError("auto gives a rigid tool")
    weight, centre = INDEPENDENT[name]
    yield Row("weight", calibration.weight, "N", remark=f"+- {std['weight']:.2g}; independent fit {weight:g}")
    for k, axis in enumerate("xyz"):
        remark = f"+- {1e3 * std['com'][k]:.2g}; independent fit {centre[k]:g}"
        yield Row(f"centre of mass {axis}", 1e3 * com[k], "mm", remark=remark)
    for what, by_axis in (("residual", calibration.residual_rms), ("held-out", calibration.held_out_rms)):
        if by_axis is not None:
            yield Row(f"{what} RMS, force", float(np.linalg.norm(by_axis[:3])), "N")
            yield Row(f"{what} RMS, torque", 1e3 * float(np.linalg.norm(by_axis[3:])), "mN m")
    left_out = [k + 1 for k, pose in enumerate(calibration.poses) if pose.rejected is not None]
    which = f"of {len(calibration.poses)}" + (f": pose {', '.join(map(str, left_out))}" if left_out else "")
    yield Row("poses left out", float(len(left_out)), which)
    kinds = "; ".join(finding.kind.replace("_", " ") for finding in calibration.findings)
    yield Row("findings", float(len(calibration.findings)), remark=kinds)


def read_wrongly(samples: cw.Samples) -> dict[str, File]:
    """Files of a set that say one thing and hold another, by the mistake."""
    R, wrench = samples.R_base_flange, samples.wrench
    return {
        "the inverse rotations": File(R, wrench, "matrix", "matrix", inverse=True),
        "quaternions w, x, y, z as x, y, z, w": File(R, wrench, "quat_wxyz", "quat_xyzw"),
        "the reaction's sign": File(R, wrench, "quat_xyzw", "quat_xyzw", sign=-1.0),
        "KUKA's A, B, C as W, P, R": File(R, wrench, "kuka_abc", "fanuc_wpr", "deg", "deg"),
        "degrees as radians": File(R, wrench, "rpy", "rpy", "deg", "rad"),
        "wrenches in base axes": File(R, wrench, "quat_xyzw", "quat_xyzw", in_base=True),
        "torques in N mm": File(R, wrench, "quat_xyzw", "quat_xyzw", torque_factor=1e3),
        "wrenches a row late": File(R, wrench, "matrix", "matrix", shift=1),
        "inverse rotations, reaction's sign": File(R, wrench, "matrix", "matrix", inverse=True, sign=-1.0),
    }


def ranks(samples: cw.Samples) -> Iterator[Row]:
    """The place of the true reading, or of its class, among those that `diagnose` ranks; 0 where it is not there."""
    with tempfile.TemporaryDirectory() as folder:
        for mistake, file in read_wrongly(samples).items():
            found, diagnosis = diagnosed(file, Path(folder))
            ranked = [likeness(file, *as_read(found, one.interpretation)) for one in diagnosis.ranked]
            rank = next((k for k, like in enumerate(ranked, start=1) if like != "wrong"), 0)
            tied = rank and ranked[rank - 1] == "class"
            remark = f"tied with {len(diagnosis.alike)} that free air cannot tell from it" if tied else ""
            yield Row(mistake, float(rank), "place", 1.0, 1.0, remark)


def tables(quick: bool) -> Iterator[tuple[str, Iterable[Row]]]:
    """Two tables a set; `quick` makes no difference."""
    for name, samples in measured_sets().items():
        yield f"{name}, {len(samples)} rows, by auto", calibrated(name, samples)
        yield f"{name}, read wrongly: place of the true reading by diagnose", ranks(samples)
