"""What can be set on the rig: the defaults, turns that are known, and every message word for word."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.errors import InputError
from contactwrench.simulate.settings import UPRIGHT_OF, Base, Mounting, Settings, bounded_settings, changed
from tests.support.world import Array

DEFAULTS = {
    "gravity": 9.80665,
    "tool.mass": 1.980 / 9.80665,
    "tool.com": (-0.006, 0.006, 0.032),
    "tool.hook": (0.0, 0.0, 0.1),
    "tool.inertia": (0.0,) * 6,
    "mounting.yaw_deg": 33.918,
    "mounting.tilt_deg": (0.0, 0.0),
    "mounting.height": 0.03,
    "base.on": "table",
    "base.tilt_deg": (0.0, 0.0),
    "arm.vibration": (0.0, 0.0),
    "sensor.ranges": (70.0, 70.0, 70.0, 3.0, 1.0, 1.0),
    "sensor.overload": 1.2,
    "sensor.bias": (3.769, -6.903, 57.657, 2.228, 0.963, -0.002),
    "sensor.noise.force": (0.035, 0.035, 0.035),
    "sensor.noise.torque": (0.0015, 0.0005, 0.0005),
    "sensor.noise.one_over_f": (0.0,) * 6,
    "sensor.quantum": 0.001,
    "sensor.gain": (1.0,) * 6,
    "sensor.crosstalk": ((0.0,) * 6,) * 6,
    "sensor.low_pass": 50.0,
    "sensor.delay": 0.001,
    "sensor.drift.warm_up": (0.0,) * 6,
    "sensor.drift.warm_up_time": 1200.0,
    "sensor.drift.walk": (0.0,) * 6,
    "joint_torque.noise": 0.05,
    "joint_torque.offset": (0.88, -0.88, 0.55, -0.55, 0.55, -0.2, 0.2),
    "joint_torque.gain": (1.005, 0.995, 1.005, 0.995, 1.005, 0.995, 1.005),
    "joint_torque.friction": 0.1,
    "recording.settle": 2.0,
    "recording.rows": 1,
    "recording.creep": 0.0,
    "recording.orientation_error_deg": 0.0,
    "recording.rate": 1000.0,
    "recording.duration": 20.0,
    "recording.rest": 1.5,
    "recording.pose_rate": 100.0,
}

MESSAGES = {
    "gravity": "found 'gravity', expected NAME=VALUE, as in sensor.noise.force=0.05",
    "gravty=9.8": (
        "there is no setting gravty, expected one of: gravity, tool, mounting, base, arm, sensor, joint_torque, "
        "recording"
    ),
    "tool.weight=2": "there is no setting tool.weight, expected tool with one of: mass, com, hook, inertia",
    "sensor.nois.force=1": (
        "there is no setting sensor.nois.force, expected sensor with one of: ranges, overload, bias, noise, quantum, "
        "gain, crosstalk, low_pass, delay, drift"
    ),
    "sensor.noise.forc=1": (
        "there is no setting sensor.noise.forc, expected sensor.noise with one of: force, torque, one_over_f"
    ),
    "gravity.z=9.8": "there is no setting gravity.z, expected gravity: there is nothing below it",
    "tool.mass.x.y=1": "there is no setting tool.mass.x.y, expected tool.mass: there is nothing below it",
    "=1": "there is no setting , expected one of: gravity, tool, mounting, base, arm, sensor, joint_torque, recording",
    "sensor.noise=0.1": "sensor.noise is a group, expected one of its settings: force, torque, one_over_f",
    "gravity=much": "gravity is much, expected something like 9.80665: write numbers and lists as in JSON",
    "gravity=": "gravity is , expected something like 9.80665: write numbers and lists as in JSON",
    "gravity=NaN": "gravity is NaN, expected something like 9.80665: write numbers and lists as in JSON",
    "gravity=true": "gravity is true, expected something like 9.80665: write numbers and lists as in JSON",
    "tool.com=[0,0]": (
        "tool.com is [0,0], expected something like [-0.006,0.006,0.032]: write numbers and lists as in JSON"
    ),
    "recording.rows=1.5": "recording.rows is 1.5, expected something like 1: write numbers and lists as in JSON",
    "base.on=roof": "base.on is roof, expected one of: table, wall, ceiling",
    "gravity=0": "gravity is 0, expected 0.1 to 100",
    "tool.mass=-1": "tool.mass is -1, expected 1e-12 to 1000",
    "tool.mass=1e308": "tool.mass is 1e+308, expected 1e-12 to 1000",
    "tool.com=[10,0,60]": "tool.com is 10, expected -1 to 1 (are these mm?)",
    "tool.inertia=[4000,0,0,4000,0,1000]": "tool.inertia is 4000, expected -100 to 100 (is this kg mm^2?)",
    "tool.inertia=[0.001,0,0,0.001,0,0.003]": (
        "tool.inertia has the principal moments 0.001, 0.001, 0.003 kg m^2, expected those of a body: each more than "
        "0, none more than the other two together"
    ),
    "tool.inertia=[0.001,0.002,0,0.001,0,0.002]": (
        "tool.inertia has the principal moments -0.001, 0.002, 0.003 kg m^2, expected those of a body: each more than "
        "0, none more than the other two together"
    ),
    "arm.vibration=-1": "arm.vibration is -1, expected 0 to 10",
    "mounting.yaw_deg=1e300": "mounting.yaw_deg is 1e+300, expected -360 to 360",
    "mounting.height=30": "mounting.height is 30, expected 0 to 1 (is this mm?)",
    "sensor.overload=0": "sensor.overload is 0, expected 0.001 to 1e+06",
    "sensor.quantum=-0.001": "sensor.quantum is -0.001, expected 0 or 1e-09 to 1e+06",
    "sensor.low_pass=-5": "sensor.low_pass is -5, expected 0 to 1e+06",
    "sensor.delay=20": "sensor.delay is 20, expected 0 to 10 (is this ms?)",
    "sensor.drift.warm_up_time=0": "sensor.drift.warm_up_time is 0, expected 0.001 to 1e+09",
    "recording.rows=0": "recording.rows is 0, expected 1 to 10000",
    "recording.rate=0": "recording.rate is 0, expected 1 to 100000",
    "recording.creep=5": "recording.creep is 5, expected 0 to 1.7",
    "sensor.noise.force=-1": "sensor.noise.force is -1, expected 0 to 1e+06",
    "sensor.ranges=[70,70,70,3,0,1]": "sensor.ranges is 0, expected 1e-06 to 1e+06",
    "joint_torque.noise=-0.1": "joint_torque.noise is -0.1, expected 0 to 1000",
    "recording.settle=-1": "recording.settle is -1, expected 0 to 60",
    "recording.duration=5e4": "a motion would have 5e+07 rows, expected at most 1e+07: shorten recording.duration or "
    "lower recording.rate",
}


def _flat(settings: Any, path: str = "") -> dict[str, Any]:
    values: dict[str, Any] = {}
    for field in fields(settings):
        value = getattr(settings, field.name)
        name = f"{path}{field.name}"
        values |= _flat(value, f"{name}.") if is_dataclass(value) else {name: value}
    return values


def _turn(axis: str, degrees: float) -> Array:
    R: Array = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return R


def test_defaults_are_the_papers_and_those_that_are_said_to_be_assumed() -> None:
    assert _flat(Settings()) == DEFAULTS


@pytest.mark.parametrize("name", DEFAULTS)
def test_every_setting_can_be_set_to_what_it_is(name: str) -> None:
    value = DEFAULTS[name]
    text = value if isinstance(value, str) else repr(value).replace("(", "[").replace(")", "]")
    assert changed(Settings(), [f"{name}={text}"]) == Settings()


@pytest.mark.parametrize("assignment", MESSAGES)
def test_what_cannot_be_set_is_refused_word_for_word(assignment: str) -> None:
    with pytest.raises(InputError) as refused:
        changed(Settings(), [assignment])
    assert str(refused.value) == MESSAGES[assignment]


def test_one_number_stands_for_a_whole_list() -> None:
    settings = changed(Settings(), [" sensor.noise.force = 0.2", "sensor.gain=0.974", "base.tilt_deg=3", "tool.com=0"])
    assert settings.sensor.noise.force == (0.2, 0.2, 0.2)
    assert settings.sensor.gain == (0.974,) * 6
    assert settings.base.tilt_deg == (3.0, 3.0)
    assert settings.tool.com == (0.0, 0.0, 0.0)
    assert settings.sensor.noise.torque == Settings().sensor.noise.torque


def test_the_inertia_of_the_tool_is_what_is_set_or_a_balls() -> None:
    assert pytest.approx(0.7 * 0.03**2 * np.eye(3), rel=1e-12) == changed(Settings(), ["tool.mass=0.7"]).inertia
    stated = changed(Settings(), ["tool.inertia=[0.004,0.0001,-0.0002,0.003,0.0003,0.002]"])
    assert stated.inertia.tolist() == [[0.004, 0.0001, -0.0002], [0.0001, 0.003, 0.0003], [-0.0002, 0.0003, 0.002]]


def test_one_number_for_a_matrix_stands_off_its_diagonal() -> None:
    crosstalk = np.array(changed(Settings(), ["sensor.crosstalk=0.01"]).sensor.crosstalk)
    assert np.array_equal(crosstalk, 0.01 * (np.ones((6, 6)) - np.eye(6)))


def test_the_last_of_two_counts_and_what_was_given_stays() -> None:
    before = Settings()
    assert changed(before, ["tool.mass=1", "tool.mass=2"]).tool.mass == 2.0
    assert before == Settings()
    assert changed(before, []) == before


def test_a_base_stands_as_it_says() -> None:
    """`R_world_base`, column by column, is where the base's axes point; the world's z is up."""
    assert np.array_equal(UPRIGHT_OF["table"], np.eye(3))
    wall, ceiling = UPRIGHT_OF["wall"], UPRIGHT_OF["ceiling"]
    assert wall[2, 2] == 0.0
    assert wall[:, 2].tolist() == [1.0, 0.0, 0.0]
    assert ceiling[:, 2].tolist() == [0.0, 0.0, -1.0]
    for R in UPRIGHT_OF.values():
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert pytest.approx(np.eye(3)) == R.T @ R


def test_down_is_where_things_fall_in_base_axes() -> None:
    assert Settings().gravity_direction.tolist() == [0.0, 0.0, -1.0]
    assert Settings(base=Base("ceiling")).gravity_direction == pytest.approx([0.0, 0.0, 1.0])
    # on the wall the base's x axis points down
    assert Settings(base=Base("wall")).gravity_direction == pytest.approx([1.0, 0.0, 0.0])
    # a table raised at y: the base turned by +30 deg about its x sees down lean to -y
    assert Settings(base=Base("table", (30.0, 0.0))).gravity_direction == pytest.approx([0.0, -0.5, -np.sqrt(0.75)])
    assert Settings(base=Base("table", (0.0, 30.0))).gravity_direction == pytest.approx([0.5, 0.0, -np.sqrt(0.75)])


@pytest.mark.parametrize("on", ["table", "wall", "ceiling"])
def test_a_tilt_of_the_base_is_about_its_own_axes(on: Any) -> None:
    tilted = Settings(base=Base(on, (0.0, 20.0)))
    assert tilted.R_world_base == pytest.approx(UPRIGHT_OF[on] @ _turn("y", 20.0))
    assert tilted.gravity_direction == pytest.approx(tilted.R_world_base.T @ [0.0, 0.0, -1.0])


def test_the_mounting_is_a_yaw_and_then_a_tilt_about_the_flanges_axes() -> None:
    assert Settings(mounting=Mounting(90.0)).R_flange_sensor == pytest.approx(_turn("z", 90.0))
    tilted = Settings(mounting=Mounting(40.0, (10.0, 0.0))).R_flange_sensor
    assert tilted == pytest.approx(_turn("x", 10.0) @ _turn("z", 40.0))
    upside_down = Settings(mounting=Mounting(33.0, (0.0, 180.0))).R_flange_sensor
    assert upside_down == pytest.approx(np.diag([-1.0, 1.0, -1.0]) @ _turn("z", 33.0))
    both = Settings(mounting=Mounting(0.0, (3.0, 4.0))).R_flange_sensor
    assert np.rad2deg(np.arccos(both[2, 2])) == pytest.approx(5.0)


def test_every_number_has_bounds() -> None:
    def names(path: str, values: object) -> list[str]:
        if not isinstance(values, dict):
            return [] if isinstance(values, str) else [path]
        return [name for key, value in values.items() for name in names(f"{path}.{key}".strip("."), value)]

    assert names("", msgspec.to_builtins(Settings())) == [name for name, _, _ in bounded_settings(Settings())]
