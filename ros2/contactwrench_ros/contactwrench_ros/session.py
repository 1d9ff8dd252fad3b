"""What happens to a reading, and what a person may ask for; no ROS and no clock of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

import contactwrench as cw
from contactwrench.compensate.bias_tracking import SAME_SECONDS
from contactwrench.compensate.contact_wrenches import OUTPUT_FRAMES, require_frame
from contactwrench.compensate.faults import Reason
from contactwrench.errors import ContactWrenchError, InputError, refuse
from contactwrench.geometry.arrays import Array
from contactwrench.geometry.orientation import from_quat_xyzw
from contactwrench.geometry.quaternions import Quat
from contactwrench.model import AXES

from .capturing import Reading, calibrated, captured, described, require_still, samples_of
from .chain import Chain, Transform
from .monitoring import Status, Tally
from .motion import Motion
from .parameters import POSE_SOURCES, meant
from .provenance import in_base, of_another_sign, options_of, read_as
from .track import BEGUN_ANEW, NO_STAMP, Pose, Track

IN_CONTACT = (
    f"no new zero: found a contact, expected a free tool: let go of it; if nothing touches it, ask again once that has "
    f"stayed the same for {SAME_SECONDS:g} s"
)
DISORDER, STAYS_BEHIND = 0.1, 3
"""s by which a reading may be stamped before the last, as messages come in disorder; so many in a row that are earlier
by more are no late ones: their clock was set back, and they would be paired with poses that the arm had then.
"""
SETTLES = 1.0
"""s, in which the last messages of before a clock was set back have come."""
CLOCKS = ", though poses come: let the computers that stamp poses and readings agree on the time, by chrony or PTP"


@dataclass(frozen=True)
class Answer:
    """To a person's wish: whether it was done, and one line."""

    success: bool
    message: str


class Session:
    """One sensor on one arm; `settings` are the node's parameters by their names.

    Raises:
        ContactWrenchError: a calibration that cannot be read or used, settings that cannot be meant.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = settings = {name: meant(name, value) for name, value in settings.items()}
        source, known = settings["pose_source"], ", ".join(POSE_SOURCES)
        refuse((source not in POSE_SOURCES, f"pose_source is {source!r}, expected {known}"))
        self.last_reading = self.reading_at_pose = -inf
        self.behind, self.settled_from = 0, -inf
        self.orientations, self.tally = Track(), Tally()
        self.chain = Chain(settings["base_frame"], settings["flange_frame"])
        self.gathered: list[Reading] | None = None
        self.captures: list[cw.Samples] | None = None
        self.calibration: cw.Calibration | None = None
        self.compensator: cw.Compensator | None = None
        self.motion: Motion | None = None
        self.contact: bool | None = None
        self.note: str | None = None
        self.file = settings["calibration"]
        loaded = cw.Calibration.load(self.file) if self.file else None
        self.options = options_of(settings, loaded)
        if loaded is not None:
            self.calibration, of_base = in_base(loaded, settings["base_frame"])
            self.note = "; ".join(filter(None, (of_another_sign(self.options, loaded), of_base))) or None
        self.set({})

    def set(self, changes: dict[str, Any]) -> None:
        """Take other settings. Raises `ContactWrenchError`, and changes nothing, where they cannot be meant."""
        settings = {**self.settings, **{name: meant(name, value) for name, value in changes.items()}}
        if self.calibration is None:
            frame = settings["output_frame"]
            refuse((frame not in OUTPUT_FRAMES, f"output frame is {frame!r}, expected {', '.join(OUTPUT_FRAMES)}"))
            self.settings = settings
            return
        compensator = self.compensator
        if compensator is None or changes.keys() & {"lowpass", "drift", "noise"}:
            compensator = compensator_of(self.calibration, settings)
        require_frame(self.calibration, settings["output_frame"])
        self.settings = settings
        if compensator is not self.compensator:
            self._compensate(self.calibration, compensator)

    def _compensate(self, calibration: cw.Calibration, compensator: cw.Compensator) -> None:
        """From now on, with these."""
        self.calibration, self.compensator = calibration, compensator
        self.motion = None if calibration.dynamics is None else Motion(compensator, calibration.dynamics)

    def transforms(self, transforms: Sequence[Transform], static: bool) -> None:
        """Take what tf says."""
        if not static and (by := self.chain.back_by(transforms, self._late)):
            self._begin_anew("tf", by, max(each.t for each in transforms))
        if (found := self.chain.hear(transforms, static, self.settings["stale_after"])) is not None:
            self.pose(found)

    def pose(self, pose: Pose) -> None:
        """Take a pose of the flange in the base; one that is no newer than the last is passed over."""
        if by := self.orientations.back_by(pose.t, self._late):
            self._begin_anew("poses", by, pose.t)
        self.reading_at_pose = self.last_reading
        if self.orientations.hear(pose.t, pose.quat_xyzw) and self.motion is not None:
            self.motion.hear(pose)

    def read(self, t: float, wrench: Sequence[float] | Array) -> Array | None:
        """The contact wrench (6,), N and N m, in the axes asked for, of a reading at `t` s; None: there is no valid
        one, and the tally knows why.
        """
        self.tally.reading()
        quat = self._orientation(t)
        if isinstance(quat, Reason):
            self.tally.fault(quat)
            return None
        reading = self.options.pull(np.array(wrench))
        if self.gathered is not None:
            self.gathered.append(Reading(t, reading, quat))
        if self.compensator is None:
            return None
        if self.motion and (unknown := self.motion.doubt(t, self.settings["stale_after"])) is not None:
            self.tally.fault(unknown)
            return None
        try:
            now = self.compensator(reading, quat, t)
        except InputError as error:  # a cut-off too high for the rate that was found
            self.tally.fault(Reason(str(error), "settings"))
            return None
        if not now.valid and now.reason is not None:
            self.tally.fault(now.reason)
            return None
        if now.reason is not None and now.reason.kind == "contact or bias":
            self.tally.doubt = now.reason.replace("zero()", "~/zero")
        self.contact = now.contact
        self.tally.publish()
        return self._in_output_axes(now.wrench, quat)

    def _orientation(self, t: float) -> Quat | Reason:
        """At a reading of `t` s, or why it is not known."""
        stale_after = self.settings["stale_after"]
        if t == 0.0 and self.orientations.apart(t) > stale_after:
            return Reason(f"reading: {NO_STAMP}", "no stamp")
        if (by := self.last_reading - t) > DISORDER:
            self.behind += 1
            if self.behind < STAYS_BEHIND:
                return Reason(f"reading: stamped {by:.3f} s before the last, expected them in order", "late reading")
            self._begin_anew("readings", by, t)
        self.last_reading, self.behind = t, 0
        found = self.orientations.at(t, stale_after)
        if isinstance(found, Reason) and t - self.reading_at_pose <= stale_after < self.orientations.apart(t):
            return Reason(f"{found}{CLOCKS}", found.kind)
        return found

    @property
    def _late(self) -> float:
        """By how much, s, poses are late at most; where the clock was just set back, those of before come on for a
        while, and what is behind them is of the new time.
        """
        return DISORDER if self.last_reading < self.settled_from else BEGUN_ANEW

    def _begin_anew(self, what: str, by: float, t: float) -> None:
        """Stamps went back by so many s, to `t`: of times that come again the poses of before say nothing."""
        self.orientations.forget()
        self.chain.forget()
        self.last_reading = self.reading_at_pose = -inf
        self.settled_from = t + SETTLES
        self.gathered = None if self.gathered is None else []
        self.tally.went_back(what, by)

    def gather(self) -> Answer | None:
        """Begin to keep readings for `zero` or `capture`; an answer where that cannot be."""
        if self.gathered is not None:
            return Answer(False, "found another capture or zero under way, expected one at a time")
        self.gathered = []
        return None

    def zero(self) -> Answer:
        """Take what was gathered for a free tool at rest."""
        readings = self._taken()
        if self.compensator is None:
            return Answer(False, "found no calibration, expected one to zero against: ~/start_calibration")
        try:
            zero = self.compensator.zero(samples_of(readings, "zero", read_as(self.settings, self.options)))
        except ContactWrenchError as error:
            return Answer(False, IN_CONTACT if "reset() first" in str(error) else str(error))
        force, torque = np.round(zero.shift[:3], 3).tolist(), np.round(1e3 * zero.shift[3:], 2).tolist()
        return Answer(True, f"zeroed: the bias had moved by {force} N and {torque} mN m")

    def start(self) -> Answer:
        """Forget the poses captured so far."""
        self.captures = []
        return Answer(True, "move to a pose, hold still, ~/capture; at several orientations; then ~/finish_calibration")

    def capture(self) -> Answer:
        """Keep what was gathered as a pose."""
        readings = self._taken()
        if self.captures is None:
            return Answer(False, "found no calibration begun, expected ~/start_calibration first")
        try:
            samples = samples_of(readings, f"pose {len(self.captures) + 1}", read_as(self.settings, self.options))
            require_still(samples, self.captures)
        except ContactWrenchError as error:
            return Answer(False, str(error))
        line = captured(samples, self.captures)
        self.captures.append(samples)
        return Answer(True, line)

    def finish(self) -> Answer:
        """Calibrate, save, and compensate from now on; where that cannot be, the poses are kept and nothing changes."""
        path = self.settings["save_to"]
        try:
            calibration = calibrated(self.captures or [])
            compensator = compensator_of(calibration, self.settings)
            require_frame(calibration, self.settings["output_frame"])
            if path:
                calibration.save(path)
        except ContactWrenchError as error:
            return Answer(False, str(error))
        self._compensate(calibration, compensator)
        self.captures, self.file = None, path or "of ~/finish_calibration, not saved"
        saved = f"saved to {path}" if path else "not saved, as the parameter save_to is empty"
        return Answer(True, f"{described(calibration)}; {saved}")

    def status(self, seconds: float) -> Status:
        """For /diagnostics, of the last so many seconds."""
        more = {"contact": str(self.contact), "calibration": self.file or "none"}
        if self.calibration is not None:
            more["inertia subtracted"] = self.motion.subtracted if self.motion else "no, the calibration knows none"
        if self.captures is not None:
            more["poses captured"] = str(len(self.captures))
        if self.compensator is not None:
            drift = zip(AXES, self.compensator.drift.tolist(), strict=True)
            more |= {f"drift {axis}": f"{value:.4g}" for axis, value in drift}
        none = "" if self.compensator else "no calibration: ~/start_calibration, ~/capture, ~/finish_calibration"
        trouble = self.chain.trouble() if self.settings["pose_source"] == "tf" else ""
        return self.tally.status(seconds, none or self.lacking, trouble, more)

    @property
    def lacking(self) -> str:
        """Why the tool's inertia is not subtracted although the calibration knows it; empty: it is."""
        return self.motion.lacking if self.motion else ""

    def _taken(self) -> list[Reading]:
        readings, self.gathered = self.gathered or [], None
        return readings

    def _in_output_axes(self, wrench: Array, quat: Quat) -> Array:
        frame = self.settings["output_frame"]
        if frame == "sensor" or self.calibration is None or self.calibration.R_flange_sensor is None:
            return wrench
        axes = self.calibration.R_flange_sensor
        if frame == "base":
            axes = from_quat_xyzw(np.array([quat]))[0] @ axes
        turned: Array = (axes @ wrench.reshape(2, 3).T).T.ravel()
        return turned


def compensator_of(calibration: cw.Calibration, settings: dict[str, Any]) -> cw.Compensator:
    """A compensator with these settings, 0 for none. Raises `ContactWrenchError`."""
    lowpass, drift, noise = (settings[name] or None for name in ("lowpass", "drift", "noise"))
    return cw.Compensator(calibration, lowpass=lowpass, drift=drift, noise=noise)
