"""The arm in a closed loop: stiff position servos in every joint, a controller that commands the flange's pose, and the
sensor, which it reads at the end of each of its periods.

The drives are those of an industrial arm that takes positions: 20 Hz, critically damped, with the arm's own dynamics
and the tool's weight fed forward; the rotors' inertia is assumed. A controller sees what it would see in a cell: a
reading, late, noisy and biased, and the orientation that the robot states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from contactwrench.geometry.arrays import Array, read_only
from contactwrench.simulate.arm import MAX_SPEED, MAX_TORQUE
from contactwrench.simulate.rig import JOINTS, Rig, build, import_mujoco
from contactwrench.simulate.sensor import SensorStream
from contactwrench.simulate.settings import Settings

ToContact: TypeAlias = Callable[[Array, Array], Array]
"""The sense of touch: from a reading (6,) and the flange's orientation (3, 3), both as the controller is told them, to
the contact wrench (6,), N and N m, sensor axes."""

STEP = 0.001
"""Of the physics, and one row of the sensor; s."""
ROWS = 8
"""Of the sensor in a period of the controller."""
PERIOD = ROWS * STEP
"""s: 125 commands a second, as many arms take them."""
WITHIN_PERIOD = STEP * np.arange(1.0, ROWS + 1.0)[:, None]
"""s after a period's beginning (rows, 1): the drives' commands go evenly from one of the controller's to the next."""

ROTORS = np.array([1.5, 1.5, 1.0, 1.0, 0.5, 0.3, 0.2])
"""Inertia of the drives' rotors through their gears, kg m^2; assumed."""
INERTIA = ROTORS + np.array([2.2, 3.5, 0.7, 0.8, 0.05, 0.05, 0.01])
"""What a drive moves with the flange down in front of the base, kg m^2."""
BANDWIDTH = 2.0 * np.pi * 20.0
"""Of the position servos, rad/s."""
LEAD = 2.0 / BANDWIDTH
"""s: critical damping holds a moving joint back by so much time, and the command is ahead by it."""
ROWS_AHEAD = LEAD + WITHIN_PERIOD
PER_SPEED = 1.0 / MAX_SPEED
DAMPED = 0.01
"""m or rad per unit: what keeps joint speeds finite near a singularity."""
DAMPING = DAMPED**2 * np.eye(6)


def servo_rig(settings: Settings, tool_shape: str, work: str) -> Rig:
    """The rig with drives, and with a sensor of the true contact force on the tool and of its place, world axes.

    `work` is XML beside the world: what the tool works on, with a mocap body `work`.
    """
    drives = "".join(
        f'<position joint="q{k + 1}" kp="{INERTIA[k] * BANDWIDTH**2:.6g}" kv="{2.0 * INERTIA[k] * BANDWIDTH:.6g}" '
        f'forcerange="{-MAX_TORQUE[k]} {MAX_TORQUE[k]}"/>'
        for k in range(JOINTS)
    )
    touch = '<contact name="touch" body2="tool" reduce="netforce" num="1" data="force pos"/>'
    rig = build(
        settings,
        tool_shape=tool_shape,
        scene='<geom type="plane" size="20 20 1" rgba="0.97 0.98 0.99 1"/>',
        option=f'timestep="{STEP}" integrator="implicitfast" cone="elliptic"',
        more=f"{work}<actuator>{drives}</actuator><sensor>{touch}</sensor>",
    )
    rig.model.dof_armature[:JOINTS] = ROTORS
    return rig


@dataclass(frozen=True, eq=False)
class Trace:
    """A motion as it was: `t` (n,) s, `qpos` (n, q) of the whole scene, `force` (n, 3) N the true contact force on the
    tool and `point` (n, 3) m where it acts, both in world axes; `work_position` and `work_quat_wxyz` of the work;
    `saturated` the share of the controller's readings in which a channel stood at its limit.
    """

    t: Array
    qpos: Array
    force: Array
    point: Array
    work_position: Array
    work_quat_wxyz: Array
    saturated: float

    def __post_init__(self) -> None:
        for name in ("t", "qpos", "force", "point", "work_position", "work_quat_wxyz"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


class ClosedLoop:
    """A `servo_rig` at rest at `joints` (7,), rad, with its work at a place in base axes.

    After each `advance`: `reading` (6,) and `R_base_flange` (3, 3), what the controller is told; `contact_force`
    (rows, 3), the truth, N, world axes.
    """

    def __init__(
        self, rig: Rig, joints: Array, R_base_work: Array, work_position: Array, rng: np.random.Generator
    ) -> None:
        mujoco = import_mujoco()
        self._mujoco, self._model, self._flange = mujoco, rig.model, rig.flange
        self._R_world_base = rig.settings.R_world_base
        self._R_base_world = np.ascontiguousarray(self._R_world_base.T)
        self._data, self._plan = mujoco.MjData(rig.model), mujoco.MjData(rig.model)
        self._data.mocap_pos[0] = self._R_world_base @ work_position
        mujoco.mju_mat2Quat(self._data.mocap_quat[0], (self._R_world_base @ R_base_work).ravel())
        self._applied, self._needed = self._data.qfrc_applied[:JOINTS], self._data.qfrc_bias[:JOINTS]
        self._command = np.array(joints, dtype=np.float64)
        self._data.qpos[:JOINTS] = self._data.ctrl[:] = self._command
        mujoco.mj_forward(self._model, self._data)
        self._feed_forward()
        mujoco.mj_forward(self._model, self._data)
        self._stream = SensorStream(rig.settings.sensor, 1.0 / STEP, rng)
        touch = rig.model.sensor("touch").adr[0]
        self._sensed, self._drive = self._data.sensordata, self._data.ctrl
        self._qpos = self._data.qpos
        self._R_world_flange = self._data.site_xmat[self._flange].reshape(3, 3)
        self._flange_in_world = self._data.site_xpos[self._flange]
        # MuJoCo numbers a body's only child next after it
        work = rig.model.body("work").id + 1
        self._R_world_work, self._work_in_world = self._data.xmat[work].reshape(3, 3), self._data.xpos[work]
        self._rows = np.tile(self._sensed, (ROWS, 1))
        self._wrench, self._touch = self._rows[:, :6], self._sensed[touch : touch + 6]
        self.contact_force = self._rows[:, touch : touch + 3]
        self._jacobian = np.zeros((6, rig.model.nv))
        self._planned, self._planned_in_world = self._plan.qpos[:JOINTS], self._plan.site_xpos[self._flange]
        self._R_world_planned = self._plan.site_xmat[self._flange].reshape(3, 3)
        self._seen: list[tuple[float, Array, Array]] = []
        self._saturated = 0
        self._look()

    @property
    def position(self) -> Array:
        """Of the flange (3,), m, base axes, as it is."""
        here: Array = self._R_base_world @ self._flange_in_world
        return here

    @property
    def largest_force(self) -> float:
        """The largest contact force in the last period, N."""
        return float(np.einsum("ij,ij->i", self.contact_force, self.contact_force).max() ** 0.5)

    def in_work(self, place: Array) -> Array:
        """A place (3,), m, base axes, in the axes of the work as it is now, sunk and tilted on its springs."""
        there: Array = (self._R_world_base @ place - self._work_in_world) @ self._R_world_work
        return there

    def advance(self, R_base_flange: Array, position: Array) -> None:
        """One period, at the end of which the flange is commanded to be at an orientation (3, 3) and position (3,)."""
        speed = self._joint_speed(self._R_world_base @ R_base_flange, self._R_world_base @ position)
        data, step, model, drive, sensed = self._data, self._mujoco.mj_step, self._model, self._drive, self._sensed
        for drives, row in zip(self._command + ROWS_AHEAD * speed, self._rows, strict=True):
            drive[:] = drives
            step(model, data)
            row[:] = sensed
        self._command += PERIOD * speed
        self._feed_forward()
        self._look()

    def trace(self) -> Trace:
        """Everything since the beginning, one row a period."""
        t, qpos, touch = (np.array(part) for part in zip(*self._seen, strict=True))
        work_position, work_quat_wxyz = self._data.mocap_pos[0].copy(), self._data.mocap_quat[0].copy()
        return Trace(t, qpos, touch[:, :3], touch[:, 3:], work_position, work_quat_wxyz, self._saturated / len(t))

    def _feed_forward(self) -> None:
        self._applied[:] = self._needed

    def _look(self) -> None:
        """What the controller is told at the end of a period."""
        readings = self._stream.read(-self._wrench)
        self.reading = readings.wrench[-1]
        self._saturated += int(readings.saturated[-1].any())
        self.R_base_flange = self._R_base_world @ self._R_world_flange
        self._seen.append((self._data.time, self._qpos.copy(), self._touch.copy()))

    def _joint_speed(self, R: Array, position: Array) -> Array:
        """Joint speeds (7,) that bring the commanded flange to a pose in world axes within one period: one step of
        damped least squares a period, which stays on the pose because every step begins with what the last one left.
        """
        plan, mujoco, model = self._plan, self._mujoco, self._model
        self._planned[:] = self._command
        mujoco.mj_kinematics(model, plan)
        mujoco.mj_comPos(model, plan)
        mujoco.mj_jacSite(model, plan, self._jacobian[:3], self._jacobian[3:], self._flange)
        jacobian = self._jacobian[:, :JOINTS]
        (_, xy, xz), (yx, _, yz), (zx, zy, _) = (R @ self._R_world_planned.T).tolist()
        x, y, z = (position - self._planned_in_world).tolist()
        error = np.array([x, y, z, 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)])
        gram = jacobian @ jacobian.T + DAMPING
        mujoco.mju_cholFactor(gram, 0.0)
        mujoco.mju_cholSolve(error, gram, error.copy())
        speed: Array = (error @ jacobian) / PERIOD
        return speed / max(1.0, float((np.abs(speed) * PER_SPEED).max()))
