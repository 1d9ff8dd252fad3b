"""Two pushes by hand, each in a known direction: what free air cannot tell, the sign of the readings, one push can.

Negated readings of a robot that stands are those of a robot that hangs from the ceiling: the poses tell the sensor's
axes up to that choice (method, "What free-air data cannot tell"). A push towards the flange's +x reads along the
sensor's image of that axis with one sign, and against it with the other; a push down, along the weight, checks frame
and orientation in both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Kind
from ..geometry.arrays import Array, Frozen
from ..geometry.orientation import rotation_matrices
from ..model import gravity_in_flange
from .history import EVERY, History, Stand
from .snapshot import PushStep

NEEDED = 5.0
"""N: far above noise and creep, and light for a hand."""
LONG_ENOUGH = 0.4
"""s of a push at its strength."""
LONGEST = 6.0
"""s of a push: a reading that stays away for longer is at rest there."""
RELEASED = 0.25
"""Of the push that is needed: below it the hand is off."""
OF_PEAK = 0.7
"""Of the largest force: what counts for the direction."""
STRAIGHT = np.cos(np.deg2rad(20.0))
AGREES = 60.0
"""deg between a push as it was asked for and as it was felt: hands are not further off, and another axis is at 90."""
MOMENT = 0.05
"""s of readings that are the force of now: less is noise, more makes a short push shorter."""

ASKS = {
    "down": "Press the tool straight down, towards the floor, with a hand; then let go.",
    "+x": "Press the tool towards the flange's +x, as the robot's pendant shows it; then let go.",
}
SPOKEN = {"down": "down", "+x": "towards the flange's +x"}


@dataclass(frozen=True, eq=False)
class Push(Frozen):
    """A push `towards` a direction of `ASKS`: the change (3,) of the reading's force, N, and the orientation (4,)."""

    towards: str
    force: Array
    orientation: Array

    @property
    def newtons(self) -> float:
        """Its strength, N."""
        return float(np.linalg.norm(self.force))


class PushTest:
    """Asks for one push after the other, and feels them while the arm stands."""

    def __init__(self) -> None:
        self.pushes: tuple[Push, ...] = ()
        self._rest: tuple[Array, Array] | None = None
        self._felt: list[Array] = []
        self._begun = self._now = 0.0
        self._said = ""

    @property
    def done(self) -> bool:
        """Whether all pushes were felt."""
        return len(self.pushes) == len(ASKS)

    def again(self) -> None:
        """Forget what was felt."""
        self.pushes, self._rest, self._felt, self._said = (), None, [], ""

    def look(self, history: History, stand: Stand, t: float) -> str:
        """Look at the newest readings, at `t` s; what there is to say of a push that ended, else nothing."""
        _, wrench, _ = history.last(MOMENT)
        if not len(wrench) or (stand.arm and not stand.still):
            self._rest, self._felt = None, []
            return ""
        force = wrench[:, :3].mean(axis=0)
        if self.done:
            changed = self._rest is not None and float(np.linalg.norm(force - self._rest[0])) > NEEDED
            return self._begin_anew() if changed and stand.still else ""
        if stand.still and (self._rest is None or not self._felt):
            _, rest, turned = history.last(0.5)
            self._rest = rest[:, :3].mean(axis=0), turned[-1].copy()
        if self._rest is None:
            return ""
        change = force - self._rest[0]
        self._now = float(np.linalg.norm(change))
        if self._now >= NEEDED:
            self._begun = self._begun if self._felt else t
            self._felt.append(change)
        if self._felt and self._now < RELEASED * NEEDED:
            return self._ended()
        return self._begin_anew() if self._felt and t - self._begun > LONGEST else ""

    def _begin_anew(self) -> str:
        """The reading at rest is another than before: a hand was at the tool then, and what was felt is its release."""
        self.again()
        self._said = "a hand was at the tool before, or is: take it away for a moment, then press from the start"
        return self._said

    def _ended(self) -> str:
        felt, self._felt = np.array(self._felt), []
        towards, turn = list(ASKS)[len(self.pushes)], self._rest[1] if self._rest else np.zeros(4)
        strength = np.linalg.norm(felt, axis=1)
        strong = felt[strength >= OF_PEAK * strength.max()]
        mean = strong.mean(axis=0)
        straight = (strong @ mean) / (np.linalg.norm(strong, axis=1) * np.linalg.norm(mean))
        if len(strong) < LONG_ENOUGH / EVERY:
            self._said = "that was too short: press for a second"
        elif straight.min() < STRAIGHT:
            self._said = "that push changed its direction: press again, the same way from beginning to end"
        else:
            self.pushes, self._said = (*self.pushes, Push(towards, mean, turn)), ""
            return f"felt {np.linalg.norm(mean):.1f} N for the push {SPOKEN[towards]}"
        return self._said

    def steps(self) -> tuple[PushStep, ...]:
        """What is asked for, for a person."""
        done = [
            PushStep(ASKS[each.towards], NEEDED, each.newtons, f"felt {each.newtons:.1f} N", each.towards)
            for each in self.pushes
        ]
        to_come = [PushStep(ask, NEEDED, 0.0, "", toward) for toward, ask in list(ASKS.items())[len(done) :]]
        if to_come:
            said = f"{to_come[0].ask} ({self._said})" if self._said else to_come[0].ask
            to_come[0] = PushStep(said, NEEDED, self._now, "", to_come[0].toward)
        return (*done, *to_come)


def _degrees_off(calibration: Calibration, push: Push, sign: float) -> float:
    """Between a push as the calibration would feel it, whose readings are those of the device times `sign`, and as it
    was felt. A push feels as the tool's weight along it does: so the calibration's `B` tells.
    """
    along = np.array([1.0, 0.0, 0.0])
    if push.towards == "down":
        along = gravity_in_flange(rotation_matrices(push.orientation)[0], calibration.gravity_direction)[0]
    felt, expected = sign * push.force, calibration.B[:3, :3] @ along
    cosine = expected @ felt / (np.linalg.norm(expected) * np.linalg.norm(felt))
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def contradiction(calibration: Calibration, pushes: tuple[Push, ...], sign: float) -> str:
    """Which push the calibration contradicts, in words; empty: it agrees with all."""
    for push in pushes:
        if (off := _degrees_off(calibration, push, sign)) > AGREES:
            return f"the push {SPOKEN[push.towards]} reads {off:.0f} deg away from where these poses put it"
    return ""


def as_tested(calibration: Calibration, pushes: tuple[Push, ...], sign: float) -> Calibration:
    """The calibration, with what the pushes settled: that goes into its provenance, and ends the doubt of the sign."""
    said = "; ".join(
        f"{push.newtons:.1f} N {SPOKEN[push.towards]}, felt {_degrees_off(calibration, push, sign):.0f} deg off"
        for push in pushes
    )
    return replace(
        calibration,
        findings=tuple(each for each in calibration.findings if each.kind is not Kind.SIGN_NOT_CONFIRMED),
        provenance={**calibration.provenance, "push_test": said},
    )
