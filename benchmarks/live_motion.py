"""A live session while the arm moves fast: what is left of a free tool's readings, and pushes that are found.

`python -m benchmarks.live_motion`: three motions of the virtual rig, 1 kg at up to 100 deg/s and 500 deg/s^2 of each
joint, as two devices send them over a network that is late by up to 5 ms; behind 20 Hz.
"""

from __future__ import annotations

import numpy as np

from tests.support.live_motion import T0, Devices, Felt, felt, swung

SEEDS = (31, 32, 33)
MOVES = 2.0
"""s: from when on the arm moves fast."""
WAYS = {
    "no position": Devices(500, 0.005, position=False),
    "poses at 500 Hz": Devices(500, 0.005),
    "poses at 125 Hz": Devices(125, 0.005),
    "poses at 500 Hz, 0.01 mm and 0.001 deg of noise": Devices(500, 0.005, noise=1e-5),
    "poses at 125 Hz, 0.01 mm and 0.001 deg of noise": Devices(125, 0.005, noise=1e-5),
}


def onset(found: Felt, begin: float) -> float:
    """ms after a push began at which it is felt first; NaN: it is not felt, or was felt before it began."""
    t = [row.onset - T0 for row in found.rows.contacts]
    return 1e3 * (t[0] - begin) if t and t[0] > begin else np.nan


def main() -> None:
    """Measure, and print."""
    for name, devices in WAYS.items():
        free = [felt(swung(0.0, seed), devices) for seed in SEEDS]
        left = ", ".join(f"{each.rms(MOVES):.3f}" for each in free)
        contact = 100.0 * float(np.mean([(each.between(MOVES, np.inf).contact == 1).mean() for each in free]))
        std = np.mean([np.nanmean(each.between(MOVES, np.inf).std[:, :3]) for each in free])
        print(f"{name}: {left} N left, std {std:.3f} N an axis, {contact:.2f} % in contact")
        for force in (5.0, 10.0):
            late = [onset(felt(swung(force, seed), devices), swung(force, seed).begin + 1.2) for seed in SEEDS]
            print(f"  a push of {force:g} N begins after {', '.join(f'{each:.0f}' for each in late)} ms")


if __name__ == "__main__":
    main()
