"""The session's times beside those at which the lab's devices took their samples, and the delay between both streams.

`python -m benchmarks.live_clocks [SECONDS]`: an SRI at 1 kHz whose clock is 50 ppm fast and a UR at 500 Hz whose clock
is 50 ppm slow, both up to 5 ms late, through sources, readers and pump. Each sample carries its true time in what it
reads. Then a calibration by a person's way in a lab whose sensor is 30 ms late.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from contactwrench.lab.sri import Sri
from contactwrench.lab.truth import FlangePose
from contactwrench.lab.ur import Ur
from contactwrench.live.sink import Turn
from contactwrench.live.source import now
from tests.support.chain import running

from .live_calibration import one_run

Array = NDArray[np.float64]
SETTLED, DELAY = 30.0, 0.03


class Telling:
    """A signal that tells when it was asked for: whole seconds in fx, the rest in fy, and both in x of the flange."""

    def __init__(self) -> None:
        self._begin = time.monotonic()

    def wrench_rows(self, t0: float, n: int, rate: float) -> Array:
        """As `Truth`."""
        rest, whole = np.modf(t0 - self._begin + np.arange(n) / rate)
        return np.column_stack([whole, rest, np.zeros((n, 4))])

    def pose_at(self, t: float) -> FlangePose:
        """As `Truth`."""
        return FlangePose(np.eye(3), np.array([0.0, 0.0, 0.0, 1.0]), np.array([t - self._begin, 0.0, 0.0]), np.zeros(6))

    def true_contact(self, t: float) -> Array:
        """None."""
        return np.zeros(6)


def errors(seconds: float) -> dict[str, tuple[Array, Array]]:
    """True times (n,) and how much later the session says, s, by device; the signal's begin is 0."""
    signal = Telling()
    begin = now() - (time.monotonic() - signal._begin)
    fakes: dict[str, Any] = {
        "sensor": Sri(signal, clock_drift=50.0, jitter=0.005),
        "robot": Ur(signal, clock_drift=-50.0, jitter=0.005),
    }
    with running(fakes, {"sensor": "?rate=1000"}, calibrated=False) as chain:
        time.sleep(seconds)
    turn = Turn.joined(chain.turns)
    true = turn.wrench[:, 0] + turn.wrench[:, 1]
    return {
        "SRI": (true, turn.t - begin - true),
        "UR": (turn.position[:, 0], turn.pose_t - begin - turn.position[:, 0]),
    }


def main() -> None:
    """Run for so many seconds, and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    for name, (true, late) in errors(seconds).items():
        settled = 1e3 * late[true > true[0] + SETTLED]
        constant = float(np.median(settled))
        apart = np.percentile(np.abs(settled - constant), [50.0, 99.0, 100.0])
        print(
            f"{name}: {len(true)} samples; after {SETTLED:g} s {constant:+.3f} ms, the smallest delay; beside it "
            f"50 % {apart[0]:.3f}, 99 % {apart[1]:.3f}, largest {apart[2]:.3f} ms (wanted 0.2)"
        )
    with tempfile.TemporaryDirectory() as folder:
        cal = one_run(1, Path(folder), settings=(f"sensor.delay={DELAY}",))[2]
    applied = cal.delay is not None and abs(cal.delay) > 3.0 * (cal.delay_std or 0.0)
    print(f"delay: {1e3 * (cal.delay or 0.0):.2f} +- {1e3 * (cal.delay_std or 0.0):.2f} ms of 30, applied: {applied}")


if __name__ == "__main__":
    main()
