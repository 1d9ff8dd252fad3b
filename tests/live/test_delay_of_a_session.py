"""What a calibration does not know of its delay counts in a session, too, while the arm turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.live.running import Options, Runner
from contactwrench.live.sink import Reading
from tests.support.live import RATE, calibrated, free, swinging
from tests.support.world import Array


def stds(calibration: cw.Calibration, wrench: Array, R: Array) -> Array:
    """Of the force (n, 3), of readings that come one by one."""
    runner = Runner(calibration, 1.0, Options(), None)
    made = []
    for k, (reading, quat) in enumerate(zip(wrench.tolist(), Rotation.from_matrix(R).as_quat().tolist(), strict=True)):
        t = 100.0 + k / RATE
        made.append(runner.step(Reading(t, t, tuple(reading), tuple(quat), ""), tuple(quat), "", 0.1).std[:3])
    return np.array(made)


def test_it_counts_while_the_arm_turns() -> None:
    calibration, rig, rng = calibrated(4)
    R = swinging(rng, 2500)
    wrench = free(rig, R, rng)
    known, late = (stds(replace(calibration, delay=0.0, delay_std=std), wrench, R)[-500:] for std in (1e-6, 0.04))
    assert np.linalg.norm(late, axis=1).max() > 2.0 * np.linalg.norm(known, axis=1).max()
