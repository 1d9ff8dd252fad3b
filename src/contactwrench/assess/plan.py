"""Which orientations to record next, so that the contact wrench comes out best, whatever the orientation it is used at.

A calibration whose parameters have the covariance C adds the variance `J C J^T` to a contact wrench, J the derivative
of a reading; its mean over all orientations is the `trace(C M)` that experiment_design.py makes least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.observability import LEVER, natural_jacobian, require_separable
from ..errors import AmbiguityError, InputError, UnobservableError
from ..estimation.calibrate import calibrate
from ..estimation.findings_of_recording import contact_free
from ..estimation.priors import BASE_TILT_SD, MOUNT_TILT_SD, tool_of
from ..estimation.rigid import RIGID_MODELS
from ..geometry.arrays import Array, Frozen, read_only
from ..geometry.ranges import POSES
from ..geometry.rotations import spread_rotations
from ..geometry.wrench import unit_direction
from ..model import GRAVITY, PARAMETERS, RigidTool, wrench_jacobian
from ..samples.recorded_poses import is_stream, resting_poses
from ..samples.samples import Samples
from ..samples.still_noise import StillNoise
from .experiment_design import chosen_experiments, short_order
from .robot_arms import Reach

TILTS = {"mount_x": MOUNT_TILT_SD, "mount_y": MOUNT_TILT_SD, **dict.fromkeys(GRAVITY, BASE_TILT_SD)}
"""Standard deviations that `auto` expects of the tilts, rad."""

WEIGHT, COM = 10.0, (0.0, 0.0, 0.05)
NOISE = (0.05, 0.05, 0.05, 0.002, 0.002, 0.002)
"""N, m, and N and N m: a tool of 1 kg on a decent sensor, where nothing is known yet. Which poses are best hardly
depends on it: it cancels but for the tilts of `auto`, which are known beforehand as well as they are.
"""

READINGS = 1000.0
"""Hz, of a sensor in motion."""
AS_SLOW = 0.1
"""s: of means of readings at rest, which show the noise at the frequencies of a motion."""

UNKNOWN = 10.0
"""Times the weight, `LEVER` or 1 rad: how well any parameter is known before the first pose. It keeps the covariance
finite while there are too few poses, and is far too vague to be felt once there are enough.
"""

APART = np.deg2rad(10.0)
"""Between any two poses: one beside another repeats the errors of arm and cables, and tells nothing new."""

CANDIDATES, EVERYWHERE = (72, 14), (288, 24)
"""Directions and turns of `spread_rotations`: to choose from, and to average over. Choosing from the second set takes
seven times as long and gains less than one per cent in the standard deviation.
"""


@dataclass(frozen=True, eq=False)
class Expected(Frozen):
    """What the poses are planned for: the tool, the standard deviations (6,) of a pose's reading, the recording that
    both were fitted to (None: assumed), and why a recording could not be (None: it could, or there is none).
    `reading_noise` (6,) is that of each of `READINGS` in motion; None: no less than a pose's.
    """

    tool: RigidTool
    noise: Array
    fitted_to: str | None = None
    refusal: str | None = None
    reading_noise: Array | None = None

    @property
    def in_motion(self) -> Array:
        """Standard deviations (6,) of each reading in motion."""
        return self.noise if self.reading_noise is None else self.reading_noise


@dataclass(frozen=True)
class Accuracy:
    """Standard deviation of the contact force (N) and torque (N m) from the calibration: each the root of the summed
    variances of its three axes, root mean square over all orientations, and largest.
    """

    force: float
    torque: float
    largest_force: float
    largest_torque: float


@dataclass(frozen=True, eq=False)
class Plan(Frozen):
    """The next poses, in order.

    `recorded` is how many poses come before. `R_base_flange` (n, 3, 3); `joints` (n, k) rad or None; `turn` (n,) rad,
    the rotation from the pose before (from the last one recorded, or where the robot stands, to the first; NaN where
    there is neither). `before` and `after`: the accuracy of a calibration without and with these poses, None where they
    leave a parameter open. `anywhere`: that of a plan which no joint limits, None without a robot. `arm` and `around`
    (k,) rad say how the joints were found.
    """

    model: str
    expected: Expected
    recorded: int
    R_base_flange: Array
    turn: Array
    before: Accuracy | None
    after: Accuracy | None
    joints: Array | None = None
    arm: str | None = None
    around: Array | None = None
    anywhere: Accuracy | None = None

    def __len__(self) -> int:
        return len(self.R_base_flange)


def expected_tool(samples: Samples | None = None, model: str = "auto", gravity: ArrayLike | None = None) -> Expected:
    """The tool and noise to plan for.

    Args:
        samples: free of contact; None, or too few to tell: the tool is assumed.
        model: that is fitted to them.
        gravity: direction (3,), base axes; None: down.

    Returns:
        The tool, the noise of a pose's reading (6,), N and N m, and why it is assumed, where that is so.

    Raises:
        InputError: unusable arguments.
    """
    _require_model(model)
    d = unit_direction((0.0, 0.0, -1.0) if gravity is None else gravity)
    assumed = Expected(RigidTool(WEIGHT, np.array(COM), np.zeros(6), np.eye(3), d), read_only(NOISE))
    if samples is None:
        return assumed
    try:
        cal = calibrate(samples, model, gravity=d)
    except (UnobservableError, AmbiguityError) as refusal:
        return replace(assumed, refusal=str(refusal))
    return Expected(tool_of(cal), cal.noise, samples.source, None, _noise_of_readings(cal.still_noise))


def _noise_of_readings(still: StillNoise | None) -> Array | None:
    """The std (6,) of white noise at `READINGS` that is as strong at 5 Hz and below as that of readings at rest."""
    if still is None or still.duration[0] > AS_SLOW:
        return None
    k = int(np.searchsorted(still.duration, AS_SLOW, "right")) - 1
    return np.asarray(still.std[k] * np.sqrt(still.duration[k] * READINGS))


def recorded_orientations(samples: Samples) -> Array:
    """The orientations of the contact-free poses in a recording.

    Args:
        samples: the recording.

    Returns:
        `R_base_flange` (m, 3, 3), in the order of their first rows.
    """
    free, _ = contact_free(samples)
    return np.array([pose.R_base_flange for pose in resting_poses(free, is_stream(samples))]).reshape(-1, 3, 3)


def plan(
    n: int,
    expected: Expected | None = None,
    *,
    model: str = "auto",
    recorded: Array | None = None,
    reach: Reach | None = None,
) -> Plan:
    """The `n` orientations that, after those `recorded`, make the contact wrench most certain.

    "Most certain": least variance from the calibration, of the force and of the torque at a lever of 50 mm, on average
    over all orientations. Poses are `APART`, and in an order in which the flange (or, with a robot, the joint that
    turns most) turns little in all.

    Args:
        n: how many.
        expected: tool and noise; None: assumed.
        model: that will be fitted: yaw, mount, mount+base, or auto, which expects small tilts of mounting and base.
        recorded: orientations (m, 3, 3) of the poses that come before; None: none.
        reach: what a robot's wrist reaches, to choose only from that.

    Returns:
        The orientations (n, 3, 3) in order, and how certain a calibration is without and with them.

    Raises:
        InputError: a model or a number that cannot be planned for, or no orientation is left.
    """
    _require_model(model)
    POSES.require(n, "number of poses")
    expected = expected_tool(None, model) if expected is None else expected
    recorded = np.empty((0, 3, 3)) if recorded is None else recorded
    free = spread_rotations(*CANDIDATES)
    R = free if reach is None else reach.R_base_flange
    chosen = _chosen(n, expected, model, recorded, R)
    order, turn = _in_order(R[chosen], recorded, reach, chosen)
    chosen = [chosen[k] for k in order]
    before = _accuracy(expected, model, recorded)
    after = _accuracy(expected, model, np.concatenate([recorded, R[chosen]]))
    planned = Plan(model, expected, len(recorded), R[chosen], turn, before, after)
    if reach is None:
        return planned
    best = free[_chosen(n, expected, model, recorded, free)]
    anywhere = _accuracy(expected, model, np.concatenate([recorded, best]))
    return replace(planned, joints=reach.joints[chosen], arm=reach.arm, around=reach.around, anywhere=anywhere)


def _require_model(model: str) -> None:
    if model not in RIGID_MODELS:
        raise InputError(f"model {model!r} cannot be planned for, expected one of {', '.join(RIGID_MODELS)}")


def fitted_names(model: str) -> tuple[str, ...]:
    """The parameters of the model; of `auto` all that it may fit."""
    return PARAMETERS["mount+base" if model == "auto" else model]


def _chosen(n: int, expected: Expected, model: str, recorded: Array, R: Array) -> list[int]:
    """The `n` of the candidates `R` (m, 3, 3) that tell most after the recorded poses."""
    usable = np.flatnonzero((_angles(R, recorded) > APART).all(axis=1))
    R = R[usable]
    names, tool = fitted_names(model), expected.tool
    J = wrench_jacobian(tool, R, names) / expected.noise[:, None]
    anywhere = wrench_jacobian(tool, spread_rotations(*EVERYWHERE), names)
    anywhere[:, 3:] /= LEVER
    M = np.einsum("nip,niq->pq", anywhere, anywhere, optimize=True) / len(anywhere)
    chosen = chosen_experiments(n, J, information_of(expected, model, recorded), M, _angles(R, R) > APART)
    if len(chosen) < n:
        raise InputError(
            f"found {len(chosen)} orientations {np.rad2deg(APART):.0f} deg apart and from the {len(recorded)} poses "
            f"recorded, expected {n}: plan fewer poses"
        )
    return [int(usable[k]) for k in chosen]


def information_of(expected: Expected, model: str, R_base_flange: Array) -> Array:
    """What is known (p, p) of the parameters from poses (m, 3, 3), and before the first one."""
    names, tool = fitted_names(model), expected.tool
    unit = np.r_[tool.weight, [LEVER] * 3, [tool.weight] * 3, [tool.weight * LEVER] * 3, np.ones(len(names) - 10)]
    std = UNKNOWN * unit
    if model == "auto":
        std = np.array([TILTS.get(name, value) for name, value in zip(names, std, strict=True)])
    J = wrench_jacobian(tool, R_base_flange, names) / expected.noise[:, None]
    return np.asarray(np.diag(std**-2.0) + np.einsum("nip,niq->pq", J, J, optimize=True))


def _accuracy(expected: Expected, model: str, R_base_flange: Array) -> Accuracy | None:
    """The accuracy of a calibration on poses (m, 3, 3), or None where they do not separate the parameters."""
    if not len(R_base_flange):
        return None
    names, tool = fitted_names(model), expected.tool
    J = natural_jacobian(tool, R_base_flange, names)
    if model == "auto":
        J = np.vstack([J, np.eye(len(names))[[names.index(tilt) for tilt in TILTS]]])
    try:
        require_separable(J, names, R_base_flange, tool.gravity_direction)
    except UnobservableError:
        return None
    anywhere = wrench_jacobian(tool, spread_rotations(*EVERYWHERE), names)
    C = np.linalg.inv(information_of(expected, model, R_base_flange))
    variance = np.sum((anywhere @ C) * anywhere, axis=2)
    force, torque = variance[:, :3].sum(axis=1), variance[:, 3:].sum(axis=1)
    return Accuracy(*(float(np.sqrt(value)) for value in (force.mean(), torque.mean(), force.max(), torque.max())))


def _in_order(R: Array, recorded: Array, reach: Reach | None, chosen: list[int]) -> tuple[list[int], Array]:
    """The order of the poses (n, 3, 3), and the rotation from each to the one before it (n,), rad."""
    start = recorded[-1:] if reach is None else reach.R_base_flange[:1]
    between, from_start = _angles(R, R), _angles(start, R)
    if reach is None:
        order = short_order(between, from_start[0] if len(start) else None)
    else:
        joints = reach.joints[chosen]
        order = short_order(_largest_move(joints, joints), _largest_move(reach.around[None], joints)[0])
    first = from_start[0, order[0]] if len(start) else np.nan
    return order, np.r_[first, between[order[:-1], order[1:]]]


def _angles(R_a: Array, R_b: Array) -> Array:
    """Angles (a, b), rad, between rotations (a, 3, 3) and (b, 3, 3)."""
    trace = R_a.reshape(-1, 9) @ R_b.reshape(-1, 9).T
    return np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))


def _largest_move(joints_a: Array, joints_b: Array) -> Array:
    """The turn (a, b), rad, of the joint that turns most: joints move together, and it takes longest."""
    return np.asarray(np.abs(joints_a[:, None] - joints_b[None]).max(axis=2))
