"""What calibrating found beside the numbers: by kind and severity, and why a verdict is doubtful."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

WEAK_SHARE = 0.1
"""Of the weight: a calibration whose error in the contact force is larger somewhere is weak."""


class Severity(StrEnum):
    """What a finding means for the result: nothing is wrong; something is to be looked at, the numbers hold; they hold
    only if something holds that the readings do not show (`Doubt` says what); a number, or its std, is not to be
    trusted; readings took no part in the fit.
    """

    NOTE = "note"
    WARNING = "warning"
    DOUBTFUL = "doubtful"
    WEAK = "weak"
    REFUSED = "refused"


class Kind(StrEnum):
    """What a finding is of."""

    DAMAGED_RECORDING = "damaged_recording"
    ANGLES_IN_DOUBT = "angles_in_doubt"
    TIMES_IN_DOUBT = "times_in_doubt"
    SATURATED_ROWS = "saturated_rows"
    SPIKES = "spikes"
    LOADED_ROWS = "loaded_rows"
    ROWS_APART = "rows_apart"
    ROWS_OF_MEANS = "rows_of_means"
    STILL_SEGMENTS_LEFT_OUT = "still_segments_left_out"
    POSES_ON_THE_WAY = "poses_on_the_way"
    POSE_LEFT_OUT = "pose_left_out"
    POSE_IN_DOUBT = "pose_in_doubt"
    POSE_OFF = "pose_off"
    TILT_IN_DOUBT = "tilt_in_doubt"
    DRIFT_IN_DOUBT = "drift_in_doubt"
    BIAS_STEPPED = "bias_stepped"
    BIAS_DRIFTED = "bias_drifted"
    BIAS_WANDERED = "bias_wandered"
    TWO_LEVELS = "two_levels"
    CREEP = "creep"
    FAILED_CHECK = "failed_check"
    GAIN = "gain"
    CABLE = "cable"
    ROBOT = "robot"
    SIGN_NOT_CONFIRMED = "sign_not_confirmed"
    MIRRORED_AXIS = "mirrored_axis"
    UNCERTAIN_PARAMETER = "uncertain_parameter"
    PAYLOAD_SUBTRACTED = "payload_subtracted"
    ADVICE = "advice"
    FEW_DEGREES_OF_FREEDOM = "few_degrees_of_freedom"
    UNEQUAL_NOISE = "unequal_noise"
    BEYOND_STATED_NOISE = "beyond_stated_noise"
    POOR_FIT = "poor_fit"
    FAR_CENTRE_OF_MASS = "far_centre_of_mass"
    IMPLAUSIBLE_TOOL = "implausible_tool"
    LEANING_BASE = "leaning_base"
    DEAD_CHANNEL = "dead_channel"
    CROSS_TALK = "cross_talk"
    CORRELATED_POSES = "correlated_poses"
    NO_HELD_OUT_ERROR = "no_held_out_error"
    UNCONFIRMED = "unconfirmed"
    WEIGHT_CHANGED = "weight_changed"
    CONTRADICTS_PRIOR = "contradicts_prior"
    RESTS_ON_PRIOR = "rests_on_prior"
    CONTRADICTS_KNOWN = "contradicts_known"
    CONTRADICTS_OTHERS = "contradicts_others"
    CONTRADICTS_MODEL = "contradicts_model"
    BIAS_SHIFTED = "bias_shifted"
    NEGATIVE_MASS = "negative_mass"
    CONTACT_IN_MOTION = "contact_in_motion"
    MOTION_USED = "motion_used"
    UNTOLD_BY_MOTION = "untold_by_motion"
    SLOW_SENSOR = "slow_sensor"
    NOT_RIGID = "not_rigid"
    POSITIONS_IN_DOUBT = "positions_in_doubt"
    SLOW_POSES = "slow_poses"
    DELAY_IN_DOUBT = "delay_in_doubt"
    CLOCKS_APART = "clocks_apart"
    DELAY_OF_MOTION = "delay_of_motion"
    ACCELEROMETER = "accelerometer"
    OTHER = "other"

    @classmethod
    def _missing_(cls, value: object) -> Kind:
        """A kind that a later version found."""
        return cls.OTHER


class Doubt(StrEnum):
    """Why a verdict is doubtful, and what to do."""

    MODEL = "the model does not explain the readings: compare the other models, look for a cable, a contact, a gain"
    ASSUMPTION = "an assumption decides the answer: confirm it, or record poses that tell"
    MOVED = "a moving bias or poses left out took much of what the poses tell: record more, warmed up, free of contact"
    CREEP = "the reading was still on its way to each new load: stop for longer, let the sensor warm up, load it less"


BIAS_MOVED = frozenset({Kind.BIAS_STEPPED, Kind.BIAS_DRIFTED, Kind.BIAS_WANDERED})
_ASSUMED = (
    *(Kind.SIGN_NOT_CONFIRMED, Kind.ANGLES_IN_DOUBT, Kind.POSE_IN_DOUBT, Kind.TILT_IN_DOUBT, Kind.DRIFT_IN_DOUBT),
    *(Kind.POSITIONS_IN_DOUBT, Kind.SLOW_POSES, Kind.IMPLAUSIBLE_TOOL, Kind.LEANING_BASE, Kind.DEAD_CHANNEL),
    *(Kind.RESTS_ON_PRIOR, Kind.CLOCKS_APART),
)
DOUBT_OF_KIND = {
    **dict.fromkeys(_ASSUMED, Doubt.ASSUMPTION),
    **dict.fromkeys((*BIAS_MOVED, Kind.POSE_LEFT_OUT, Kind.UNCONFIRMED, Kind.STILL_SEGMENTS_LEFT_OUT), Doubt.MOVED),
    Kind.CREEP: Doubt.CREEP,
}


@dataclass(frozen=True)
class Finding:
    """Something that calibrating found beside the numbers: its `text`, one sentence for people, begins with `weak` or
    `doubtful` where the severity is that.
    """

    kind: Kind
    severity: Severity
    text: str

    @property
    def label(self) -> str:
        """What a text for people puts before it."""
        return "Note" if self.severity is Severity.NOTE else "Warning"

    @property
    def said(self) -> str:
        """The text without the word of its severity."""
        return self.text.removeprefix(f"{self.severity}: ")

    @property
    def brief(self) -> str:
        """What was found, without what follows from it: a text has that after a colon."""
        return self.said.partition(": ")[0]

    @classmethod
    def weak(cls, kind: Kind, text: str) -> Finding:
        """A finding that says "weak" itself, for those who read warnings only."""
        return cls(kind, Severity.WEAK, f"weak: {text}")

    @classmethod
    def doubtful(cls, kind: Kind, text: str) -> Finding:
        """A finding that says "doubtful" itself."""
        return cls(kind, Severity.DOUBTFUL, f"doubtful: {text}")


class WithFindings:
    """A base of results that have `findings`."""

    findings: tuple[Finding, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The texts of the findings."""
        return tuple(finding.text for finding in self.findings)
