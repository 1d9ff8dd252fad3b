"""What can be set on the virtual rig: every field with its unit and where its default comes from.

Fields are what people speak: millimetres and degrees only where the name ends in `_mm` or `_deg`, SI elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal, TypeAlias

import msgspec
import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array
from ..geometry.ranges import ROWS, Range
from ..geometry.rotations import rotation_exp
from ..geometry.wrench import STANDARD_GRAVITY
from .tool_inertia import require_body, tool_inertia

Three: TypeAlias = tuple[float, float, float]
Six: TypeAlias = tuple[float, float, float, float, float, float]
Seven: TypeAlias = tuple[float, float, float, float, float, float, float]
SixBySix: TypeAlias = tuple[Six, Six, Six, Six, Six, Six]

NONE: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

UPRIGHT_OF: dict[str, Array] = {
    "table": np.eye(3),
    "wall": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
    "ceiling": np.diag([1.0, -1.0, -1.0]),
}
"""`R_world_base` of a base that stands exactly on a table, a wall (its z level) or a ceiling."""


def between(least: float, most: float, hint: str = "") -> dict[str, Any]:
    """Metadata of a setting: the least and the most that MuJoCo can compute and somebody could mean, each included, and
    what to ask of a number beyond them.
    """
    return {"bounds": Range(least, most, hint)}


def bounded_settings(settings: Any, path: str = "") -> Iterator[tuple[str, Any, Range]]:
    """Every number that can be set: its full name, its value, and its bounds."""
    for each in fields(settings):
        name, value = f"{path}{each.name}", getattr(settings, each.name)
        if is_dataclass(value):
            yield from bounded_settings(value, f"{name}.")
        elif "bounds" in each.metadata:
            yield name, value, each.metadata["bounds"]


@dataclass(frozen=True)
class Tool:
    """Everything on the tool side of the sensor. Defaults: the paper, Table V (weight 1.980 N)."""

    mass: float = field(default=1.980 / STANDARD_GRAVITY, metadata=between(1e-12, 1000.0))
    """kg."""
    com: Three = field(default=(-0.006, 0.006, 0.032), metadata=between(-1.0, 1.0, "(are these mm?)"))
    """Centre of mass, m, sensor axes."""
    hook: Three = field(default=(0.0, 0.0, 0.1), metadata=between(-1.0, 1.0, "(are these mm?)"))
    """Where a load hangs, m, sensor axes; assumed (the paper does not say)."""
    inertia: Six = field(default=NONE, metadata=between(-100.0, 100.0, "(is this kg mm^2?)"))
    """xx, xy, xz, yy, yz, zz about the centre of mass, kg m^2, sensor axes; 0: that of a ball with a radius of gyration
    of 30 mm (assumed)."""


@dataclass(frozen=True)
class Mounting:
    """How the sensor sits on the flange: `R_flange_sensor = exp(tilt) Rz(yaw)`."""

    yaw_deg: float = field(default=33.918, metadata=between(-360.0, 360.0))
    """About the flange's z. Default: the paper, Table V."""
    tilt_deg: tuple[float, float] = field(default=(0.0, 0.0), metadata=between(-360.0, 360.0))
    """Rotation vector about the flange's x and y; 180 about one of them is a sensor mounted upside down. Default: the
    parallel faces that the paper assumes."""
    height: float = field(default=0.03, metadata=between(0.0, 1.0, "(is this mm?)"))
    """From the flange to the sensor's origin along the flange's z, m; assumed. It moves no static wrench."""


@dataclass(frozen=True)
class Base:
    """What the robot stands on."""

    on: Literal["table", "wall", "ceiling"] = "table"
    tilt_deg: tuple[float, float] = field(default=(0.0, 0.0), metadata=between(-360.0, 360.0))
    """Rotation vector about the base's x and y on top of that. Default: level, as the paper assumes."""


@dataclass(frozen=True)
class Arm:
    """What the arm does beside the motion that its encoders see. Default: nothing."""

    vibration: tuple[float, float] = field(default=(0.0, 0.0), metadata=between(0.0, 10.0))
    """Of a motion: RMS of the tool's shaking, m/s^2 an axis, for each m/s^2 of the flange and for each rad/s of the
    fastest joint."""


@dataclass(frozen=True)
class Noise:
    """Standard deviation of the noise of one row, per axis. Default: white, 0.05 % of the ranges (assumed)."""

    force: Three = field(default=(0.035, 0.035, 0.035), metadata=between(0.0, 1e6))
    """N."""
    torque: Three = field(default=(0.0015, 0.0005, 0.0005), metadata=between(0.0, 1e6))
    """N m."""
    one_over_f: Six = field(default=NONE, metadata=between(0.0, 1e6))
    """Of 1/f noise beside it, within a minute at 1 kHz, N and N m."""


@dataclass(frozen=True)
class Drift:
    """How the bias moves. Default: not at all, as in the paper's model."""

    warm_up: Six = field(default=NONE, metadata=between(-1e6, 1e6))
    """What is added to the bias at t = 0 and decays, N and N m."""
    warm_up_time: float = field(default=1200.0, metadata=between(1e-3, 1e9))
    """Its time constant, s; assumed."""
    walk: Six = field(default=NONE, metadata=between(0.0, 1e6))
    """Random walk: standard deviation after one hour, N and N m."""


@dataclass(frozen=True)
class Sensor:
    """An SRI M8125 six-axis force/torque sensor."""

    ranges: Six = field(default=(70.0, 70.0, 70.0, 3.0, 1.0, 1.0), metadata=between(1e-6, 1e6))
    """Capacity, N and N m: the paper, Table II."""
    overload: float = field(default=1.2, metadata=between(1e-3, 1e6))
    """The reading stops at this multiple of the range. Not 1: in the paper's Table IV, row 5, the sensor reads 1.054
    N m on an axis with a range of 1."""
    bias: Six = field(default=(3.769, -6.903, 57.657, 2.228, 0.963, -0.002), metadata=between(-1e6, 1e6))
    """N and N m: the paper, Table V."""
    noise: Noise = Noise()
    quantum: float = field(default=0.001, metadata={"bounds": Range(1e-9, 1e6, or_zero=True)})
    """Step of the readings, N and N m: the digits of the paper's Table IV. 0: none."""
    gain: Six = field(default=(1.0, 1.0, 1.0, 1.0, 1.0, 1.0), metadata=between(-1e3, 1e3))
    """Reading over truth, axis by axis. Default: exact; Table IX of the paper shows 0.974."""
    crosstalk: SixBySix = field(default=(NONE, NONE, NONE, NONE, NONE, NONE), metadata=between(-1e3, 1e3))
    """What an axis (row) shows of the others (columns), N and N m each. Default: none."""
    low_pass: float = field(default=50.0, metadata=between(0.0, 1e6))
    """Cut-off of its first-order filter, Hz; 0: none. The paper filters, and does not say at what frequency."""
    delay: float = field(default=0.001, metadata=between(0.0, 10.0, "(is this ms?)"))
    """s; assumed: one sample at 1 kHz."""
    drift: Drift = Drift()


@dataclass(frozen=True)
class JointTorque:
    """The torque sensors in the joints, behind the gears.

    KUKA (LBR iiwa, product page) states their accuracy as 2 % of a joint's largest torque, and not what it consists of:
    half is taken for offset and half for gain. Defaults: a robot with half of both, signs alternating.
    """

    noise: float = field(default=0.05, metadata=between(0.0, 1e3))
    """Standard deviation of one row, N m; assumed."""
    offset: Seven = field(default=(0.88, -0.88, 0.55, -0.55, 0.55, -0.2, 0.2), metadata=between(-1e3, 1e3))
    """What they read at no torque, N m."""
    gain: Seven = field(default=(1.005, 0.995, 1.005, 0.995, 1.005, 0.995, 1.005), metadata=between(-1e3, 1e3))
    """Reading over truth."""
    friction: float = field(default=0.1, metadata=between(0.0, 1e3))
    """Coulomb friction on the link's side of the sensor, N m: at rest anything up to it, in motion all; assumed."""


@dataclass(frozen=True)
class Recording:
    """How the rig is recorded."""

    settle: float = field(default=2.0, metadata=between(0.0, 60.0))
    """From one static pose to the next, s: what drift sees."""
    rows: int = field(default=1, metadata=between(1, 10_000))
    """Rows in each static pose, 1 ms apart."""
    creep: float = field(default=0.0, metadata=between(0.0, 1.7))
    """Speed of the joints while a static pose is read, rad/s, each in a random direction: a reading in motion."""
    orientation_error_deg: float = field(default=0.0, metadata=between(0.0, 180.0))
    """Standard deviation, per axis, of the orientation that the robot states in a pose."""
    rate: float = field(default=1000.0, metadata=between(1.0, 1e5))
    """Rows per second of a trajectory."""
    duration: float = field(default=20.0, metadata=between(0.1, 1e5))
    """Of a trajectory that comes without times, s."""
    rest: float = field(default=1.5, metadata=between(0.0, 1e3))
    """At each stop of a trajectory that stops, s."""
    pose_rate: float = field(default=100.0, metadata=between(0.1, 1e5))
    """Poses per second in a bag, which has wrench and pose in streams of their own; in a table every row has both."""


@dataclass(frozen=True)
class Settings:
    """The whole rig."""

    gravity: float = field(default=STANDARD_GRAVITY, metadata=between(0.1, 100.0))
    """m/s^2."""
    tool: Tool = Tool()
    mounting: Mounting = Mounting()
    base: Base = Base()
    arm: Arm = Arm()
    sensor: Sensor = Sensor()
    joint_torque: JointTorque = JointTorque()
    recording: Recording = Recording()

    def __post_init__(self) -> None:
        for name, value, within in bounded_settings(self):
            within.require(value, name, np.shape(value))
        require_body(self.inertia)
        rows = self.recording.duration * self.recording.rate
        if rows > ROWS.most:
            raise InputError(
                f"a motion would have {rows:.3g} rows, expected at most {ROWS.most:.0e}: shorten recording.duration or "
                "lower recording.rate"
            )

    @property
    def inertia(self) -> Array:
        """Of the tool (3, 3), kg m^2, about its centre of mass, sensor axes."""
        return tool_inertia(self.tool.mass, self.tool.inertia)

    @property
    def R_flange_sensor(self) -> Array:
        """The mounting (3, 3)."""
        tilt, yaw = [*self.mounting.tilt_deg, 0.0], [0.0, 0.0, self.mounting.yaw_deg]
        return rotation_exp(np.deg2rad(tilt)) @ rotation_exp(np.deg2rad(yaw))

    @property
    def R_world_base(self) -> Array:
        """How the base stands (3, 3); the world's z is up."""
        return UPRIGHT_OF[self.base.on] @ rotation_exp(np.deg2rad([*self.base.tilt_deg, 0.0]))

    @property
    def gravity_direction(self) -> Array:
        """Down in base axes (3,)."""
        return np.asarray(-self.R_world_base[2])


def changed(settings: Settings, assignments: Iterable[str]) -> Settings:
    """The settings after assignments such as `sensor.noise.force=0.05` or `tool.com=[0.01,0,0.05]`.

    One number for a list stands for all of its numbers. Raises `InputError` for a name that is not there, and for a
    value that does not fit, naming the form of the present one.
    """
    values: dict[str, Any] = msgspec.to_builtins(settings)
    for assignment in assignments:
        name, equals, text = (part.strip() for part in assignment.partition("="))
        if not equals:
            raise InputError(f"found {assignment!r}, expected NAME=VALUE, as in sensor.noise.force=0.05")
        holder, last = _place(values, name)
        before = holder[last]
        holder[last] = _value(text, before)
        try:
            settings = msgspec.convert(values, Settings)
        except msgspec.ValidationError as error:
            if isinstance(error.__cause__, InputError):
                raise error.__cause__ from None
            like = msgspec.json.encode(before).decode()
            expected = f"something like {like}: write numbers and lists as in JSON"
            if isinstance(before, str):
                expected = f"one of: {', '.join(UPRIGHT_OF)}"
            raise InputError(f"{name} is {text}, expected {expected}") from None
    return settings


def _place(values: dict[str, Any], name: str) -> tuple[dict[str, Any], str]:
    """The table that holds the setting of that name, and its key there."""
    *groups, last = name.split(".")
    holder: Any = values
    for depth, part in enumerate([*groups, last]):
        path = ".".join(groups[:depth])
        if not isinstance(holder, dict):
            raise InputError(f"there is no setting {name}, expected {path}: there is nothing below it")
        if part not in holder:
            within = f"{path} with " if path else ""
            raise InputError(f"there is no setting {name}, expected {within}one of: {', '.join(holder)}")
        group, holder = holder, holder[part]
    if isinstance(holder, dict):
        raise InputError(f"{name} is a group, expected one of its settings: {', '.join(holder)}")
    return group, last


def _value(text: str, like: Any) -> Any:
    """What a text says in JSON, else itself. One number where a list stands becomes that list; in a matrix it is every
    element off the diagonal.
    """
    try:
        value = msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError):
        return text
    if not isinstance(like, (list, tuple)) or not isinstance(value, (int, float)):
        return value
    if like and isinstance(like[0], (list, tuple)):
        return [[0.0 if row == column else value for column in range(len(like))] for row in range(len(like))]
    return [value] * len(like)
