"""The rig as time passes, against MuJoCo's own answer for the same moment, and against statics worked out by hand."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactwrench.errors import InputError
from contactwrench.lab.control import Control
from contactwrench.lab.rig import STIFFNESS, WORKPIECE, Lab
from contactwrench.simulate.kinematics import HOME
from contactwrench.simulate.rig import build, inverse_dynamics
from contactwrench.simulate.settings import Settings, changed
from tests.lab.clients import ask, connected, nothing_left
from tests.support.world import Array

EXACT = changed(
    Settings(),
    [
        *("sensor.noise.force=0", "sensor.noise.torque=0", "sensor.quantum=0", "sensor.delay=0", "sensor.low_pass=0"),
        *("tool.hook=[0.02,-0.01,0.1]", "mounting.tilt_deg=[3,-2]"),
    ],
)
AWAY = np.array([0.5, -0.3, 0.4, 0.2, -0.5, -0.6, 1.0])


@pytest.fixture(scope="module")
def lab() -> Lab:
    return Lab(EXACT, speed=1.0)


def arrived(lab: Lab, target: Array, **more: Any) -> None:
    lab.move_to(target, **more)
    while lab.moving:
        time.sleep(0.02)
    time.sleep(0.02)


def reads(lab: Lab) -> Array:
    mean: Array = lab.wrench_rows(time.monotonic() - 0.01, 10, 1000.0).mean(axis=0)
    return mean


def test_at_rest_it_reads_weight_and_bias(lab: Lab) -> None:
    R = Rotation.from_euler("xyz", [150, 20, 40], degrees=True).as_matrix()
    arrived(lab, R)
    truth, pose = lab.truth, lab.pose_at(time.monotonic())
    assert np.allclose(pose.R_base_flange, R, atol=1e-9)
    assert (Rotation.from_rotvec(pose.rotation_vector).inv() * Rotation.from_matrix(R)).magnitude() < 1e-9
    force = truth.weight * (R @ truth.R_flange_sensor).T @ truth.gravity_direction
    expected = truth.bias + np.concatenate([force, np.cross(truth.com, force)])
    assert np.allclose(reads(lab), expected, atol=1e-9)
    assert truth.mass * EXACT.gravity == truth.weight


def test_in_motion_it_reads_what_mujoco_says(lab: Lab) -> None:
    rig = build(EXACT)
    lab.move_to(HOME + AWAY)
    time.sleep(0.3)
    lab.move_to(HOME)  # elsewhere on its way
    t: Array = np.linspace(0.0, 1.0, 1400) + time.monotonic()
    states = np.array([lab.move_at(moment).state(moment) for moment in t])
    physics = inverse_dynamics(rig, *states.swapaxes(0, 1))
    shown = np.concatenate([lab.true_wrench(t[k : k + 7]) for k in range(0, len(t), 7)])
    assert np.abs(states[:, 1]).max() > 0.5  # it moves
    assert np.abs(shown - physics.wrench).max() < 2e-4
    poses = [lab.pose_at(moment) for moment in t]
    assert np.abs([pose.R_base_flange for pose in poses] - physics.R_base_flange).max() < 1e-5
    assert np.abs([pose.position for pose in poses] - physics.position).max() < 1e-5
    assert np.abs(np.diff(states, axis=0)).max(axis=(0, 2))[1] < 0.02  # no speed jumps where it turned round
    arrived(lab, HOME)


@pytest.mark.parametrize("frame", ["sensor", "flange", "base"])
def test_a_push_is_what_mujoco_makes_of_it(lab: Lab, frame: Any) -> None:
    free, pose, R_flange_sensor = reads(lab), lab.pose_at(time.monotonic()), lab.truth.R_flange_sensor
    R = {"sensor": pose.R_base_flange @ R_flange_sensor, "flange": pose.R_base_flange, "base": np.eye(3)}[frame]
    force = np.array([3.0, -4.0, 5.0])
    lab.push(force, frame)
    time.sleep(0.1)
    at, on_hook = pose.joints[None], (R @ force)[None]
    rig, still = build(EXACT), np.zeros((1, 7))
    pushed = inverse_dynamics(rig, at, still, still, on_hook).wrench - inverse_dynamics(rig, at).wrench
    assert np.allclose(reads(lab) - free, pushed[0], atol=1e-9)
    assert np.allclose(lab.true_contact(time.monotonic()), pushed[0], atol=1e-9)
    lab.release()
    time.sleep(0.1)
    assert np.allclose(reads(lab), free, atol=1e-9)


def test_a_push_on_the_axis_ends_by_itself(lab: Lab) -> None:
    lab.push((0.0, 0.0, -10.0), duration=0.2, at="axis")
    time.sleep(0.1)
    assert np.allclose(lab.true_contact(time.monotonic()), [0, 0, -10, 0, 0, 0], atol=1e-12)
    time.sleep(0.15)
    assert not lab.true_contact(time.monotonic()).any()


def test_the_workpiece_pushes_back(lab: Lab) -> None:
    arrived(lab, HOME)
    pose = lab.pose_at(time.monotonic())
    hook = pose.position + pose.R_base_flange @ (
        [0.0, 0.0, EXACT.mounting.height] + lab.truth.R_flange_sensor @ EXACT.tool.hook
    )
    down = np.array([0.0, 0.0, WORKPIECE - 0.004 - hook[2]])
    arrived(lab, pose.R_base_flange, position=(pose.position + down).tolist())
    contact = lab.true_contact(time.monotonic())
    R = lab.pose_at(time.monotonic()).R_base_flange @ lab.truth.R_flange_sensor
    assert np.allclose(R @ contact[:3], [0, 0, 0.004 * STIFFNESS], atol=1e-6)
    assert np.allclose(contact[3:], np.cross(EXACT.tool.hook, contact[:3]), atol=1e-9)
    arrived(lab, HOME)


def test_what_cannot_be_done_is_refused(lab: Lab) -> None:
    for target, said in (
        (HOME + 3.0, "q1 of iiwa7 is"),
        (np.zeros(6), "found 6 joint angles"),
        (np.eye(3) * 2, "rotation"),
    ):
        with pytest.raises(InputError, match=said):
            lab.move_to(target)
    with pytest.raises(InputError, match=r"^position is \(0.5, 0.5\), expected numbers \(3,\)"):
        lab.move_to(np.eye(3), (0.5, 0.5))
    with pytest.raises(InputError, match="three numbers"):
        lab.push([1.0, np.nan, 0.0])
    with pytest.raises(InputError, match="axes"):
        lab.push([1.0, 0.0, 0.0], "tool")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="found a push for nan s, expected a time above 0"):
        lab.push([1.0, 0.0, 0.0], duration=np.nan)
    with pytest.raises(InputError, match="share"):
        Lab(speed=0.0)


def test_two_sensors_have_noise_of_their_own() -> None:
    noisy = Lab(Settings(), seed=3)
    one, other = (signal.wrench_rows(time.monotonic(), 1000, 1000.0) for signal in (noisy, noisy.sensor()))
    assert np.allclose(one.std(axis=0), [0.035, 0.035, 0.035, 0.0015, 0.0005, 0.0005], rtol=0.2)
    assert abs(np.corrcoef(one[:, 0], other[:, 0])[0, 1]) < 0.15


@pytest.fixture
def control(lab: Lab) -> Iterator[socket.socket]:
    with nothing_left(), Control(lab) as port, connected(port.port) as connection:
        yield connection


def test_the_control_port_moves_pushes_and_tells(lab: Lab, control: socket.socket) -> None:
    assert ask(control, {"push": [0, 0, -5], "frame": "sensor", "seconds": 5}) == {"done": True}
    time.sleep(0.1)
    state = ask(control, {"state": True})
    assert state["contact"][:3] == pytest.approx([0, 0, -5])
    assert state["truth"]["weight"] == pytest.approx(lab.truth.weight)
    assert state["joints"] == pytest.approx(lab.joints_now().tolist())
    assert ask(control, {"release": True}) == {"done": True}
    assert ask(control, {"move": (HOME + 0.1).tolist()})["seconds"] > 0.1
    assert ask(control, {"state": True})["moving"] is True


@pytest.mark.parametrize("order", [{"jump": 1}, {"move": [1, 2]}, {"push": "hard"}, [], {"move": {"a": 1}}, 7])
def test_an_order_that_makes_no_sense_is_answered(control: socket.socket, order: Any) -> None:
    assert list(ask(control, order)) == ["error"]
