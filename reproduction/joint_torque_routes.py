"""Contact force from joint torques and from the sensor in the wrist, on the same contacts of one robot.

What the drives exert less than the gravity of arm and tool asks for is the contact's doing; the pseudo-inverse of the
transposed Jacobian makes a wrench of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from contactwrench.geometry.arrays import Array
from contactwrench.geometry.wrench import cross_matrix
from contactwrench.simulate.arm import BASE_TO_SHOULDER, ELBOW_TO_WRIST, SHOULDER_TO_ELBOW, WRIST_TO_FLANGE
from contactwrench.simulate.kinematics import joints_for, paper_joints, random_joints
from contactwrench.simulate.recording import Recorded, read_poses, record_poses
from contactwrench.simulate.rig import JOINTS, Physics, Rig, build, inverse_dynamics
from contactwrench.simulate.sensor import friction_torque
from contactwrench.simulate.settings import JointTorque, Settings, changed

from .joint_torque_sensors import any_robot, sensor_jacobians, torque_against
from .methods import Method, ours, paper

CONFIGURATIONS = 200
"""In each of which a robot is pushed once."""
PUSH = 10.0
"""N, at the hook, in any direction."""
MASS_ERROR, COM_ERROR = 0.03, 0.003
"""Standard deviations of what the controller's model has wrong in the links' masses (of the mass) and centres of mass
(m, per axis); assumed."""
GAIN_ERROR, CROSSTALK = 0.01, 0.005
"""Standard deviations of what the wrist sensor has wrong: in the gain of an axis, and in what an axis shows of each
other one, both at full range; assumed. No calibration in free air sees a gain.
"""
SHORT_OF_STRETCHED = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""m that the wrist has left to the end of its reach, on a level line out of the shoulder."""
SETTLE = 0.2
"""s: 60 time constants of the wrist sensor's filter."""
SINGULAR = 1e-10
"""Of the largest singular value: below it a direction is not felt at all."""
NO_MASS = 1e-9
"""kg: MuJoCo's bodies weigh something."""

SENSOR_OURS, SENSOR_PAPER = "wrist sensor, ours", "wrist sensor, paper"
WRENCH, FORCE = "joint torques, any wrench", "joint torques, a force at the hook"
ZEROED_WRENCH = "joint torques, zeroed, any wrench"
ZEROED_FORCE = "joint torques, zeroed, a force at the hook"
ROUTES = (SENSOR_OURS, SENSOR_PAPER, WRENCH, FORCE, ZEROED_WRENCH, ZEROED_FORCE)

OFFSET, GAIN = "offsets of the joint torque sensors", "gains of the joint torque sensors"
MASSES, COMS = "link masses in the arm's model", "centres of mass in the arm's model"
FRICTION, NOISE, TOOL = "friction at rest", "noise", "the tool, as we calibrate it"
SOURCES = (OFFSET, GAIN, MASSES, COMS, TOOL, FRICTION, NOISE)
BY_CHANCE = (FRICTION, NOISE)
"""What differs from one touch to the next, so that no correction can know it."""


@dataclass(frozen=True, eq=False)
class ModelError:
    """What a controller's model of the arm has wrong: `mass` (7,), of each link's mass; `com` (7, 3), m, link axes."""

    mass: Array
    com: Array


@dataclass(frozen=True, eq=False)
class Pushed:
    """An arm at rest and pushed at the hook, n times: the physics `without` the push and `under` it, the Jacobians
    (n, 6, 7) of `sensor_jacobians`, and the contact wrench (n, 6), sensor axes.
    """

    without: Physics
    under: Physics
    jacobians: Array
    contact: Array


@dataclass(frozen=True, eq=False)
class Robot:
    """One robot's squared errors of force, N^2: `workspace` (routes, n) in n configurations with smallest singular
    values `distance` (n,); `line` (routes, k) on the way into the stretched arm; `sources` (s + 2, 2, n) of both routes
    from the joints, with one source of error alone, then with those by chance, then with all.
    """

    distance: Array
    workspace: Array
    line: Array
    sources: Array


def one_robot(seed: np.random.SeedSequence) -> Robot:
    """A robot with joint sensors, a model of its arm and a wrist sensor of its own, both sensors as one recording of
    the paper's six postures in free air leaves them. May raise what `calibrate` raises.
    """
    rng = np.random.default_rng(seed)
    settings = any_wrist_sensor(Settings(joint_torque=any_robot(JointTorque(), rng)), rng)
    settings = replace(settings, recording=replace(settings.recording, settle=SETTLE))
    rig = build(settings)
    postures, into_stretched = _fixed_joints()
    unloaded = record_poses(settings, postures, rng=rng)
    methods = (ours(unloaded.samples), paper(unloaded.samples))
    error = ModelError(MASS_ERROR * rng.normal(size=JOINTS), COM_ERROR * rng.normal(size=(JOINTS, 3)))
    zero = zeroed(rig, methods[0], error, unloaded)
    workspace = pushed(rig, random_joints(rig, CONFIGURATIONS, rng), rng)
    line = pushed(rig, into_stretched, rng)
    return Robot(
        smallest_singular_value(workspace.jacobians, settings.tool.hook),
        squared_errors(rig, methods, error, zero, workspace, rng),
        squared_errors(rig, methods, error, zero, line, rng),
        _by_source(rig, methods[0], error, workspace, rng),
    )


def any_wrist_sensor(settings: Settings, rng: np.random.Generator) -> Settings:
    """The rig with a wrist sensor at random: gains and cross-talk off by `GAIN_ERROR` and `CROSSTALK`."""
    ranges = np.array(settings.sensor.ranges)
    gain = 1.0 + GAIN_ERROR * rng.normal(size=6)
    crosstalk = CROSSTALK * rng.normal(size=(6, 6)) * ranges[:, None] / ranges
    np.fill_diagonal(crosstalk, 0.0)
    return changed(settings, [f"sensor.gain={gain.tolist()}", f"sensor.crosstalk={crosstalk.tolist()}"])


@cache
def _fixed_joints() -> tuple[Array, Array]:
    """The joints that are the same for all robots: the paper's six postures, and the line into the stretched arm."""
    rig = build(Settings())
    return paper_joints(rig), stretching(rig)


def pushed(rig: Rig, joints: Array, rng: np.random.Generator) -> Pushed:
    """The arm at joints (n, 7), rad, pushed with `PUSH` at the hook, each time in a direction of its own."""
    without, jacobians = inverse_dynamics(rig, joints), sensor_jacobians(rig, joints)
    direction = rng.normal(size=(len(joints), 3))
    force: Array = PUSH * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    contact = np.hstack([force, np.cross(rig.settings.tool.hook, force)])
    torque = without.joint_torque + torque_against(jacobians, contact)
    return Pushed(without, replace(without, wrench=without.wrench + contact, joint_torque=torque), jacobians, contact)


def stretching(rig: Rig) -> Array:
    """Joints (k, 7), rad, with the wrist `SHORT_OF_STRETCHED`, level with the shoulder, and the flange down."""
    joints, near = [], np.deg2rad([0.0, 50.0, 0.0, -80.0, 0.0, 50.0, 0.0])
    for short in SHORT_OF_STRETCHED:
        place = np.array([SHOULDER_TO_ELBOW + ELBOW_TO_WRIST - short, 0.0, BASE_TO_SHOULDER - WRIST_TO_FLANGE])
        near = joints_for(rig, np.diag([1.0, -1.0, -1.0]), place, near)
        joints.append(near)
    return np.array(joints)


def squared_errors(
    rig: Rig, methods: tuple[Method, Method], error: ModelError, zero: Array, push: Pushed, rng: np.random.Generator
) -> Array:
    """The squared errors of force (routes, n), N^2, from one reading of all sensors in each configuration; `zero` (7,),
    N m, is what the zeroed routes take off the joints' readings.
    """
    read, at = read_poses(rig.settings, [push.under], (0.0,), rng), rig.settings.tool.hook
    external = torque_of_model(rig.settings, methods[0], error, push.jacobians, read) - read.joint_torque
    forces = [method.contact(read.wrench, read.R_base_flange)[:, :3] for method in methods]
    for felt in (external, external + zero):
        forces.append(wrench_from_torques(push.jacobians, felt)[:, :3])
        forces.append(force_from_torques(push.jacobians, at, felt))
    squared: Array = np.sum((np.array(forces) - push.contact[:, :3]) ** 2, axis=2)
    return squared


def zeroed(rig: Rig, method: Method, error: ModelError, unloaded: Recorded) -> Array:
    """What the joints read (7,), N m, over what the model of arm and tool says: the mean over poses in free air."""
    modelled = torque_of_model(rig.settings, method, error, sensor_jacobians(rig, unloaded.joints), unloaded)
    zero: Array = np.mean(unloaded.joint_torque - modelled, axis=0)
    return zero


def torque_of_model(settings: Settings, method: Method, error: ModelError, jacobians: Array, read: Recorded) -> Array:
    """The torques (n, 7), N m, that a controller expects of an arm that touches nothing: by its model of the arm, and
    for the tool by what a method of compensation found.
    """
    tool = torque_against(jacobians, tool_wrench(method, read.R_base_flange))
    return arm_gravity(settings, error, read.joints) + tool


def arm_gravity(settings: Settings, error: ModelError, joints: Array) -> Array:
    """The torques (n, 7), N m, that hold the arm alone, without a tool, at joints (n, 7), rad, by a model that errs."""
    rig = build(replace(settings, tool=replace(settings.tool, mass=NO_MASS)))
    links = [rig.model.body(f"link{number}").id for number in range(1, JOINTS + 1)]
    rig.model.body_mass[links] *= 1.0 + error.mass
    rig.model.body_ipos[links] += error.com
    # a link that was compiled with its centre of mass at its origin would never be asked for it
    rig.model.body_sameframe[links] = 0
    return inverse_dynamics(rig, joints).joint_torque


def tool_wrench(method: Method, R_base_flange: Array) -> Array:
    """The tool's own wrench (n, 6) at flange orientations, as a method has it: what it subtracts, without its bias."""
    gravity_alone = replace(method, B=np.column_stack([method.B[:, :3], np.zeros(6)]))
    return -gravity_alone.contact(np.zeros((len(R_base_flange), 6)), R_base_flange)


def wrench_from_torques(jacobians: Array, external: Array) -> Array:
    """The contact wrenches (n, 6), sensor axes, that explain what the joints feel of them (n, 7), N m, best in least
    squares: `(J^T)^+ tau`, at Jacobians (n, 6, 7). Unbounded on the way into a singularity; in it, the shortest.
    """
    wrench: Array = np.einsum("nij,nj->ni", np.linalg.pinv(jacobians.swapaxes(1, 2), rcond=SINGULAR), external)
    return wrench


def force_from_torques(jacobians: Array, at: ArrayLike, external: Array) -> Array:
    """The forces (n, 3), sensor axes, that do so if they act at one known point (3,), m, with no torque about it."""
    force: Array = np.einsum(
        "nij,nj->ni", np.linalg.pinv(_moved(jacobians, at)[:, :3].swapaxes(1, 2), rcond=SINGULAR), external
    )
    return force


def smallest_singular_value(jacobians: Array, at: ArrayLike) -> Array:
    """Of the Jacobians (n, 6, 7) at a point (3,), with lengths in m and angles in rad: 0 in a singularity (n,)."""
    return np.asarray(np.linalg.svd(_moved(jacobians, at), compute_uv=False)[:, -1], dtype=np.float64)


def _moved(jacobians: Array, at: ArrayLike) -> Array:
    """The Jacobians of a point (3,), m, sensor axes, that moves with the sensor."""
    moved = jacobians.copy()
    moved[:, :3] -= cross_matrix(np.asarray(at, dtype=np.float64)) @ jacobians[:, 3:]
    return moved


def _by_source(rig: Rig, method: Method, error: ModelError, push: Pushed, rng: np.random.Generator) -> Array:
    """The squared errors of force (sources + 2, 2, n), N^2. Both routes are linear, so that what a source makes wrong
    in the torques makes the error of the force, whatever the contact.
    """
    settings, sensors = rig.settings, rig.settings.joint_torque
    joints, torque = push.under.joints, push.under.joint_torque
    none, nowhere = np.zeros(JOINTS), np.zeros((JOINTS, 3))
    arm = arm_gravity(settings, ModelError(none, nowhere), joints)
    wrong = {
        OFFSET: np.broadcast_to(sensors.offset, torque.shape),
        GAIN: torque * (np.array(sensors.gain) - 1.0),
        MASSES: arm - arm_gravity(settings, ModelError(error.mass, nowhere), joints),
        COMS: arm - arm_gravity(settings, ModelError(none, error.com), joints),
        TOOL: torque_against(push.jacobians, push.without.wrench - tool_wrench(method, push.under.R_base_flange)),
        FRICTION: friction_torque(sensors, np.zeros(torque.shape), rng),
        NOISE: sensors.noise * rng.normal(size=torque.shape),
    }
    together = [np.sum([wrong[source] for source in sources], axis=0) for sources in (BY_CHANCE, SOURCES)]
    return np.array(
        [
            (
                np.sum(wrench_from_torques(push.jacobians, one)[:, :3] ** 2, axis=1),
                np.sum(force_from_torques(push.jacobians, settings.tool.hook, one) ** 2, axis=1),
            )
            for one in (*(wrong[source] for source in SOURCES), *together)
        ]
    )
