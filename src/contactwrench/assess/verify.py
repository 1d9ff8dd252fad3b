"""Is a calibration still right? A second, contact-free recording against it; and weighing known loads (Table IX).

A pose's residual has the covariance of its reading's noise plus that of the prediction, which all poses share: one
chi-square tests them. `compare` has beside it what people do without this package: Tables VI to VIII.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import BIAS_MOVED, Finding, WithFindings
from ..compensate.noise import reading_variance
from ..errors import InputError
from ..estimation.findings_of_recording import usable
from ..estimation.moved_bias import BiasShift, apart, held_against, noise_dof, of_means
from ..estimation.plausibility import dead_channels
from ..geometry.arrays import Array, Frozen
from ..geometry.ranges import LEFT_FORCE, LEFT_TORQUE, G
from ..samples.poses import Pose, names_of
from ..samples.recorded_poses import is_stream, recorded_poses, resting_poses
from ..samples.samples import Samples
from ..statistics import SIGNIFICANCE, MisfitTest, percent, products_of_readings, square_root
from .turned_load import gravity_in_sensor, of_gain

HIDDEN = 0.5 * SIGNIFICANCE
"""Probability of what another tool, mounting or bias makes, below which it counts where all that is left does not."""


@dataclass(frozen=True)
class Weighing:
    """One load: its `actual` mass (kg), how it was `weighed` on average over `n` poses, and the std of that."""

    actual: float
    weighed: float
    std: float
    n: int

    @property
    def error(self) -> float:
        """Relative error, (weighed - actual) / actual."""
        return (self.weighed - self.actual) / self.actual

    @property
    def error_std(self) -> float:
        """Standard deviation of `error`."""
        return self.std / self.actual


@dataclass(frozen=True, eq=False)
class Verification(Frozen, WithFindings):
    """How a recording agrees with a calibration.

    `residuals` (n, 6) of the contact-free poses, N and N m; `rms` (6,); `largest_force` N and `largest_torque` N m,
    norms; `chi2` per reading (1 expected) and the `probability` of one as large or larger if the calibration holds, of
    the residuals or of the weighings, whichever is the less probable, or of the part of the residuals that another
    tool, mounting or bias makes, where that alone is too large; the limits asked for, N and N m; `weighings`, one a
    load; `passed`, and the `reason` in words. `bias`: what of the residuals a moved bias explains, None for a single
    pose. `findings`: what was left out, a bias that moved, poses that are off.
    """

    residuals: Array
    rms: Array
    largest_force: float
    largest_torque: float
    chi2: float
    probability: float
    limit_force: float | None
    limit_torque: float | None
    weighings: tuple[Weighing, ...]
    passed: bool
    reason: str
    bias: BiasShift | None
    findings: tuple[Finding, ...]


@dataclass(frozen=True, eq=False)
class LeftOver(Frozen):
    """What one method of compensation leaves of a contact-free recording: `wrench` (n, 6), pose by pose, N and N m."""

    name: str
    wrench: Array

    @property
    def mean_abs(self) -> Array:
        """Mean of the absolute values (6,): the paper's average error, Tables VII and VIII."""
        return np.asarray(np.abs(self.wrench).mean(axis=0))

    @property
    def max_abs(self) -> Array:
        """Largest absolute values (6,): the paper's maximum error."""
        return np.asarray(np.abs(self.wrench).max(axis=0))

    @property
    def rms(self) -> tuple[float, float]:
        """Root mean square of the norms of force (N) and torque (N m)."""
        squares = self.wrench**2
        return float(np.sqrt(squares[:, :3].sum(axis=1).mean())), float(np.sqrt(squares[:, 3:].sum(axis=1).mean()))


def compare(calibration: Calibration, poses: tuple[Pose, ...]) -> tuple[LeftOver, ...]:
    """The contact wrench left over in contact-free poses: by full compensation, by a tare in the first pose, with the
    tool's gravity taken off and the bias left in (the paper's Table VIII), and raw.
    """
    raw = np.array([pose.wrench for pose in poses])
    full = calibration.compensate(raw, np.array([pose.R_base_flange for pose in poses]))
    return (
        LeftOver("full", full),
        LeftOver("tare", raw - raw[0]),
        LeftOver("gravity only", full + calibration.bias),
        LeftOver("raw", raw),
    )


def verify(
    calibration: Calibration,
    samples: Samples,
    *,
    limit_force: float | None = None,
    limit_torque: float | None = None,
    g: float | None = None,
) -> Verification:
    """Hold `samples` against `calibration`.

    Poses without a load must be explained: within the limits where those are stated, else by the calibration's
    covariance and noise at the 1 % level, and at half of that the part that another tool, mounting or bias makes, which
    the noise of many poses hides; less a bias that moved no further than calibrating has seen it move. Poses with a
    `load_mass` are weighed; without limits the weighings must agree with the loads at the 1 % level too.

    Args:
        calibration: that is held against them.
        samples: free of contact; those with a saturated channel are left out.
        limit_force: N, of what is left in every pose, a norm.
        limit_torque: N m, likewise.
        g: m/s^2; None: the calibration's.

    Returns:
        Whether it passed, why, and what is left of each pose.

    Raises:
        InputError: a limit or a `g` that is none, or nothing to judge by.
    """
    for limits, name, value in ((LEFT_FORCE, "limit_force", limit_force), (LEFT_TORQUE, "limit_torque", limit_torque)):
        if value is not None:
            limits.require(value, name)
    g = float(G.require(calibration.g if g is None else g, "g"))
    samples, left_out = usable(samples)
    findings = [*left_out]
    load = np.zeros(len(samples)) if samples.load_mass is None else samples.load_mass
    if not len(samples):
        raise InputError(f"{samples.source}: found no samples, expected contact-free poses")
    weighings, weighed = _weigh(calibration, samples, load, g)
    unloaded = samples.select(load == 0.0)
    free = recorded_poses(unloaded, 0, is_stream(samples))
    poses = free.poses
    residuals, bias = np.empty((0, 6)), None
    tests = {} if weighed is None else {"error of the weighings": weighed}
    if poses:
        no_readings = dead_channels(unloaded, calibration.gravity_direction)
        R = np.array([pose.R_base_flange for pose in poses])
        residuals = calibration.compensate(np.array([pose.wrench for pose in poses]), R)
        noise, dof = reading_variance(calibration, poses), noise_dof(calibration)
        between = reading_variance(calibration, poses, np.inf)
        if all(pose.n == 1 for pose in poses) and (rows := of_means(calibration, residuals, R, noise, between)):
            noise, known, note = rows
            dof = min(dof, known) if dof > 0.0 else known
            findings.append(note)
        whole, bias = held_against(calibration, residuals, R, noise, dof, free.lag)
        named: tuple[Finding, ...] = ()
        if (
            bias is not None
            and not no_readings
            and max(whole.probability, bias.rest_probability) < SIGNIFICANCE
            and not bias.with_other
        ):
            names = names_of(poses, 0.0 if samples.t is None else samples.t[0])
            named = apart(calibration, residuals, R, noise, whole.dof, names, free.lag, bias.with_any)
        findings += no_readings or named or ([] if bias is None or bias.finding is None else [bias.finding])
        if bias is not None and _moves_so(calibration, bias):
            rest = MisfitTest(bias.rest_chi2, whole.readings - 6, whole.dof)
            tests["residual less a bias that moves, as seen while calibrating,"] = rest
        else:
            tests["residual"] = whole
            if bias is not None and bias.changed.probability < HIDDEN and whole.probability >= SIGNIFICANCE:
                tests["part of the residual that another tool, mounting or bias makes"] = bias.changed
    force = float(np.linalg.norm(residuals[:, :3], axis=1).max(initial=0.0))
    torque = float(np.linalg.norm(residuals[:, 3:], axis=1).max(initial=0.0))
    judged = min(tests, key=lambda name: tests[name].probability)
    test = tests[judged]
    if limit_force is None and limit_torque is None:
        passed = test.probability >= SIGNIFICANCE
        reason = (
            f"the {judged} is {'no more' if passed else 'more'} than the calibration's covariance and noise explain "
            f"(chi-square {test.chi2:.3g} per reading, probability {percent(test.probability)}{test.caution})"
        )
    else:
        if not poses:
            raise InputError(f"{samples.source}: found poses with a load only, expected free ones to hold to a limit")
        passed, reason = _within(("force", force, limit_force, "N"), ("torque", torque, limit_torque, "N m"))
    return Verification(
        residuals=residuals,
        rms=np.sqrt(np.mean(residuals**2, axis=0)) if poses else np.zeros(6),
        largest_force=force,
        largest_torque=torque,
        chi2=test.chi2,
        probability=test.probability,
        limit_force=limit_force,
        limit_torque=limit_torque,
        weighings=weighings,
        passed=passed,
        reason=reason,
        bias=bias,
        findings=tuple(findings),
    )


def _within(*held_to: tuple[str, float, float | None, str]) -> tuple[bool, str]:
    """Whether each (name, value, limit, unit) is within its limit, and so in words."""
    exceeded = [
        f"{name} {value:.3g} {unit} over {limit:g}"
        for name, value, limit, unit in held_to
        if limit is not None and value > limit
    ]
    return not exceeded, f"largest {' and '.join(exceeded)}" if exceeded else "every pose is within the limits"


def _moves_so(calibration: Calibration, bias: BiasShift) -> bool:
    """Whether the bias alone moved, and no further, within three of its std, than calibrating has seen it move."""
    said = any(finding.kind in BIAS_MOVED for finding in calibration.findings)
    if bias.finding is None or not (bias.alone and said and calibration.fitted_poses):
        return False
    seen = compare(calibration, calibration.fitted_poses)[0].wrench  # off the last bias
    far = [np.linalg.norm(part.reshape(-1, 2, 3), axis=2).max(axis=0) for part in (bias.shift, seen, 3.0 * bias.std)]
    return bool((far[0] <= far[1] + far[2]).all())


def _weigh(
    calibration: Calibration, samples: Samples, load: Array, g: float
) -> tuple[tuple[Weighing, ...], MisfitTest | None]:
    """Each load's weighing, and the joint test of all of them."""
    masses, stream = np.unique(load[load > 0.0]), is_stream(samples)
    held = [resting_poses(samples.select(load == mass), stream) for mass in masses]
    poses = tuple(chain.from_iterable(held))
    if not poses:
        return (), None
    R = np.array([pose.R_base_flange for pose in poses])
    contact = calibration.compensate(np.array([pose.wrench for pose in poses]), R)
    down = gravity_in_sensor(calibration, R)
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    each = np.einsum("ni,ni->n", contact[:, :3], down) / g
    noise = np.sum(down**2 * reading_variance(calibration, poses)[:, :3], axis=1) / g**2
    actual = np.repeat(masses, [len(each) for each in held])
    of_load = of_gain(calibration, contact)
    of_tool = calibration.error_jacobian(R) @ square_root(calibration.error_covariance)
    J = np.einsum("ni,nip->np", down, np.concatenate([of_tool, of_load], axis=2)[:, :3]) / g
    weighings = []
    for mass in masses:
        rows = actual == mass
        n = int(np.sum(rows))
        of_mean = J[rows].mean(axis=0)
        variance = noise[rows].mean() / n + of_mean @ of_mean
        weighings.append(Weighing(float(mass), float(each[rows].mean()), float(np.sqrt(variance)), n))
    misfit = float(products_of_readings((each - actual)[:, None], noise, J, np.eye(J.shape[1]))[0, 0])
    return tuple(weighings), MisfitTest(misfit, len(poses), noise_dof(calibration))
