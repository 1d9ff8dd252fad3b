"""What a person sees of a session at one moment, as JSON: the page, the terminal and `--events` show nothing else."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from .source import Four, Six, Three


class Phase(StrEnum):
    """Where a session is: the wizard's steps in their order, then running."""

    CONNECT = "connect"
    PUSH = "push"
    POSES = "poses"
    FIT = "fit"
    VERIFY = "verify"
    RUN = "run"


class Command(StrEnum):
    """What a person asks for, as `{"do": "retake", "pose": 3}`; which are possible now is in `Snapshot.commands`."""

    NEXT = "next"
    BACK = "back"
    SKIP = "skip"
    CAPTURE = "capture"
    RETAKE = "retake"
    SAVE = "save"
    ZERO = "zero"
    RECORD = "record"


class Event(msgspec.Struct, frozen=True):
    """Something that happened at `t` s since 1970. `kind`: `connected`, `silent`, `down`, `back`, `rate`, a kind of
    note of a source or the first word of a sample's flaw, `stuck`, `overload`, `stale`, `frozen`, `inertia`,
    `no_motion`, `contact`, `pose`, `pose_refused`, `push`, `fit`, `finding`, `verified`, `saved`, `zero`, `record`,
    `phase`, `sink`, `refusal`, and before a session `compiling`, `waiting`; `severity`: `note`, `warning` or `error`;
    `device`: its URI, or empty.
    """

    t: float
    kind: str
    severity: str
    text: str
    device: str = ""


class Device(msgspec.Struct, frozen=True):
    """A source. `role`: `sensor`, `robot` or `sensor and robot`; `state`: `connecting`, `streaming`, `silent` or
    `down`; `text`: what is wrong, or empty; `rate` Hz, measured, beside the one `asked` for; counts since the start;
    `age` s since its last sample; `jitter` s, by how much its samples come later than the quickest, on average.
    """

    uri: str
    role: str
    name: str
    state: str
    text: str
    rate: float | None
    asked: float | None
    samples: int
    lost: int
    repeated: int
    wrong: int
    age: float | None
    jitter: float | None


class Contact(msgspec.Struct, frozen=True):
    """The last contact wrench, N and N m, sensor axes, with its std; `contact` None where that cannot be judged."""

    wrench: tuple[float | None, ...]
    std: tuple[float | None, ...]
    valid: bool
    contact: bool | None
    reason: str


class PushStep(msgspec.Struct, frozen=True):
    """One push that is asked for: `ask` in words; `force` N so far, `needed` N; `seen`: in words what was felt, once it
    is done; `toward`: `down`, or the flange's axis (`+x`), for the sketch; empty: none is drawn.
    """

    ask: str
    needed: float
    force: float
    seen: str
    toward: str = ""


class TakenPose(msgspec.Struct, frozen=True):
    """A pose that was taken: its orientation of the flange in base axes; `doubt`: why it may not stand, or empty."""

    orientation: Four
    doubt: str


class Poses(msgspec.Struct, frozen=True):
    """The poses so far and to come. `targets`: orientations that are planned, the next one first; `turn` rad from here
    to it; `progress` 0 to 1 of the capture under way; `waiting`: in words why none is under way; `std_force` N and
    `std_torque` N m of the contact wrench from the poses so far, None while they cannot tell; `wanted` N; `enough`;
    `history`: `std_force` after the first pose, the second, ... as they were taken; `fewest` that are needed.
    """

    taken: tuple[TakenPose, ...]
    targets: tuple[Four, ...]
    turn: float | None
    progress: float
    waiting: str
    std_force: float | None
    std_torque: float | None
    wanted: float
    enough: bool
    history: tuple[float | None, ...] = ()
    fewest: int = 0


class Parameter(msgspec.Struct, frozen=True):
    """A row of the result: `name`, `value` and `std` as texts, `unit`."""

    name: str
    value: str
    std: str
    unit: str


class Fit(msgspec.Struct, frozen=True):
    """The calibration, or why there is none; `sign`: what the push test settled; `findings`: (severity, text)."""

    verdict: str
    refusal: str
    parameters: tuple[Parameter, ...]
    expected_force: float | None
    expected_torque: float | None
    sign: str
    delay: str
    findings: tuple[tuple[str, str], ...]


class Check(msgspec.Struct, frozen=True):
    """A pose of the verification: what is left of it, N and N m."""

    force: float
    torque: float
    passed: bool


class Running(msgspec.Struct, frozen=True):
    """While it runs: contacts that ended (onset s since 1970, duration s, largest force N), the latest last; `drift`
    (6,) N and N m of the bias since the calibration; `inertia`: whether the tool's is subtracted, None: the calibration
    has none, or no pose has come.
    """

    contacts: tuple[tuple[float, float, float], ...]
    drift: Six
    invalid: int
    calibration: str
    inertia: bool | None = None


class Output(msgspec.Struct, frozen=True):
    """A sink: rows written and dropped; `error` in words where it ended."""

    uri: str
    written: int
    dropped: int
    error: str


class Snapshot(msgspec.Struct, frozen=True):
    """A session at one moment.

    Attributes:
        t: s since 1970.
        phase: the wizard's step, or that it runs.
        devices: the sensor and the robot, or the one device that is both.
        reading: (6,) N and N m, sensor axes, as it comes; None: none has come, or the last is flawed.
        noise: (6,) N and N m, the reading's std over the last second; None: not known.
        orientation: of the flange in base axes, quaternion x, y, z, w.
        position: of the flange in base axes, m.
        still: whether arm and reading stand.
        moving: in words what does not stand.
        trace: rows `t, fx..tz, valid, contact` since the snapshot before, thinned: contact wrenches while it runs,
            before that readings.
        commands: what can be asked for now.
        events: the last 50.
        contact: the last contact wrench; None before it runs.
        push: the pushes that are asked for, while they are.
        poses: those taken and to come; None before.
        fit: the calibration that is to be judged; None before and after.
        checks: the poses of the verification.
        verified: what the verification says, in words.
        saved: where the calibration was written; empty: it is not.
        running: contacts and drift while it runs; None before.
        outputs: the sinks.
        recording: what is recorded to; empty: nothing is.
    """

    t: float
    phase: Phase
    devices: tuple[Device, ...]
    reading: Six | None
    noise: Six | None
    orientation: Four | None
    position: Three | None
    still: bool
    moving: str
    trace: tuple[tuple[float | None, ...], ...]
    commands: tuple[Command, ...]
    events: tuple[Event, ...]
    contact: Contact | None = None
    push: tuple[PushStep, ...] = ()
    poses: Poses | None = None
    fit: Fit | None = None
    checks: tuple[Check, ...] = ()
    verified: str = ""
    saved: str = ""
    running: Running | None = None
    outputs: tuple[Output, ...] = ()
    recording: str = ""
