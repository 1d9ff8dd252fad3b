"""Mass and centre of mass of an object that the tool holds, from one or more poses (docs/weighing.md).

What is left after compensation is the object's own gravity, `[m g u; c x m g u]` with u the unit "down" in sensor axes:
linear in the mass m and in the first moment p = m c, estimated together with the calibration's errors, which all poses
share, and for which its covariance is the prior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity, WithFindings
from ..compensate.noise import reading_variance
from ..errors import InputError
from ..estimation.findings_of_recording import usable
from ..estimation.moved_bias import noise_dof
from ..estimation.plausibility import FURTHEST_COM
from ..geometry.arrays import Array, Frozen, read_only
from ..geometry.ranges import G
from ..geometry.wrench import cross_matrix
from ..model import mounting_turn
from ..samples.poses import SAME_POSE_ANGLE
from ..samples.recorded_poses import is_stream, resting_poses
from ..samples.samples import Samples
from ..statistics import SIGNIFICANCE, MisfitTest, meaningful_digits, percent, square_root, two_digits
from .turned_load import down_in_sensor, hidden_gain, largest_turn, of_gain, whitening_under_load

THREE_STD = 0.9973
"""Level of three standard deviations of a normal distribution: a mass nearer to zero is none."""

PASSES = 3
"""How often the object's weight, which turns with the calibration's errors, is taken from the pass before."""

ANY_ZERO, UNCONFIRMED, LEAST_UNCONFIRMED = 100.0, 2.0, 0.005
"""N and N m, by which a zero may be off that nobody knows; of the std, and of the mass, that poses may leave open."""

SHARES_OFF, BY_CHANCE = np.array([0.0, 0.25, 0.5, 1.0, 1.5]), 2.0
"""Of the largest error in orientation that calibrating leaves open: those that are tried; and the natural logarithm of
the odds up to which none is as likely, where calibrating has seen none.
"""

REFUSALS = (Kind.NEGATIVE_MASS, Kind.FAR_CENTRE_OF_MASS)
"""Findings that no object gives."""


@dataclass(frozen=True, eq=False)
class HeldObject(Frozen, WithFindings):
    """An object that the tool held in `poses` poses.

    `mass` kg and its `mass_std`; `moment` (3,) kg m, mass times com; `covariance` (4, 4) of both, in that order.
    `com` (3,) m, sensor frame, and `com_covariance` (3, 3); None where the mass is not above zero. Where gravity had
    one direction only, `unknown_along` (3,) is that direction, a unit vector in sensor axes: the centre of mass lies on
    a line along it (as well as the mounting is known), of which `com` is the point nearest to the sensor's origin.
    `com_flange`, `com_flange_std` (3,) m: the same in flange axes, still from the sensor's origin; None where com is
    not known in full or the model has no mounting. `residual_rms` (6,) N and N m that a rigid object leaves; `chi2` of
    it per degree of freedom (1 expected), and the `probability` of one as large or larger: below 1 % variances are
    `chi2` times as large (Birge 1932); their `dof`; `g` m/s^2. `findings`: what was left out, untold, or contradicts.
    """

    mass: float
    mass_std: float
    moment: Array
    covariance: Array
    com: Array | None
    com_covariance: Array | None
    unknown_along: Array | None
    com_flange: Array | None
    com_flange_std: Array | None
    poses: int
    residual_rms: Array
    chi2: float
    probability: float
    dof: float
    g: float
    findings: tuple[Finding, ...]

    @property
    def refused(self) -> bool:
        """Whether nothing that an arm holds gives such readings, so that mass and com are none."""
        return any(finding.kind in REFUSALS for finding in self.findings)

    @property
    def com_std(self) -> Array | None:
        """Standard deviation (3,) of `com`, m; None where it is not known in full."""
        if self.com_covariance is None or self.unknown_along is not None:
            return None
        return read_only(np.sqrt(np.diag(self.com_covariance)))


def weigh(calibration: Calibration, samples: Samples, *, g: float | None = None) -> HeldObject:
    """Weigh what the tool of `calibration` holds in `samples`, still and touching nothing else.

    Args:
        calibration: of the tool alone.
        samples: with the object. Those with a `load_mass` of 0 are left out where others have one above 0, and those
            with a saturated channel always.
        g: m/s^2; None: the calibration's.

    Returns:
        Its mass, kg, and centre of mass, m, each with its uncertainty.

    Raises:
        InputError: no samples, loads of several masses, or a `g` that is none.
    """
    g = float(G.require(calibration.g if g is None else g, "g"))
    held, left_out = _of_one_object(samples)
    poses = resting_poses(held, is_stream(samples))
    if not poses:
        raise InputError(f"{samples.source}: found no samples, expected poses in which the object is held")
    R = np.array([pose.R_base_flange for pose in poses])
    contact = calibration.compensate(np.array([pose.wrench for pose in poses]), R)[..., None]
    down, turned = down_in_sensor(calibration, R)
    across, unknown_along = _seen(down)
    # Wrenches (n, 6, 1 + k) of a unit mass at the origin, and of unit moments along the columns of `across`.
    gravity = np.zeros((len(R), 6, 1 + across.shape[1]))
    gravity[:, :3, 0], gravity[:, 3:, 1:] = g * down, -g * cross_matrix(down) @ across

    variance = np.maximum(reading_variance(calibration, poses), 1e-300)
    root = square_root(calibration.error_covariance)
    of_tool = calibration.error_jacobian(R)
    tried = []
    for off in SHARES_OFF * largest_turn(calibration):
        x = np.zeros(gravity.shape[2])
        for _ in range(PASSES):
            of_object = g * np.concatenate([x[0] * turned, cross_matrix(across @ x[1:]) @ turned], axis=1)
            errors = np.concatenate([(of_tool + of_object) @ root, of_gain(calibration, gravity @ x)], axis=2)
            white = whitening_under_load(calibration, R, variance, off, g * float(x[0]), g * across @ x[1:])
            x, x_covariance, misfit = _least_squares(white @ gravity, white @ errors, white @ contact)
        logs = 2.0 * float(np.sum(np.linalg.slogdet(white)[1])) + float(np.linalg.slogdet(x_covariance)[1])
        by_chance = BY_CHANCE if off > 0.0 and calibration.orientation_std is None else 0.0
        tried.append((0.5 * (logs - misfit) - by_chance, x, x_covariance, misfit, white, errors))
    _, x, x_covariance, misfit, white, errors = max(tried, key=lambda found: found[0])
    any_zero = np.broadcast_to(ANY_ZERO * np.eye(6), (len(R), 6, 6))
    of_all = np.concatenate([errors, any_zero], axis=2)
    by_poses, of_poses, less = _least_squares(white @ gravity, white @ of_all, white @ contact)
    mass, moment = float(x[0]), across @ x[1:]
    test = MisfitTest(misfit, contact.size - len(x), noise_dof(calibration))
    x_covariance *= test.chi2 if test.probability < SIGNIFICANCE else 1.0
    surely = calibration.t_quantile(THREE_STD) * float(np.sqrt(x_covariance[0, 0]))

    unfold = np.eye(4, len(x))
    unfold[1:, 1:] = across
    covariance = unfold @ x_covariance @ unfold.T
    mass_std = float(np.sqrt(covariance[0, 0]))
    com = com_covariance = com_flange = com_flange_std = None
    if mass > surely:
        com = moment / mass
        of_com = np.column_stack([-com, np.eye(3)]) @ unfold / mass
        com_covariance = of_com @ x_covariance @ of_com.T
        R_flange_sensor = calibration.R_flange_sensor
        if unknown_along is None and R_flange_sensor is not None:
            # Sensor-frame torques over sensor-frame forces give com whatever the mounting: the two errors add
            # (with two or three poses, to a std that is a few per cent too large).
            turn = cross_matrix(com) @ mounting_turn(calibration.error_names) @ root
            com_flange = R_flange_sensor @ com
            com_flange_std = np.sqrt(np.diag(R_flange_sensor @ (com_covariance + turn @ turn.T) @ R_flange_sensor.T))
    zero = MisfitTest(max(misfit - less, 0.0), 6, test.dof), MisfitTest(less, max(test.readings - 6, 1), test.dof)
    own = _ByPoses(float(by_poses[0]), float(np.sqrt(of_poses[0, 0])), *zero)
    return HeldObject(
        mass=mass,
        mass_std=mass_std,
        moment=moment,
        covariance=covariance,
        com=com,
        com_covariance=com_covariance,
        unknown_along=unknown_along,
        com_flange=com_flange,
        com_flange_std=com_flange_std,
        poses=len(poses),
        residual_rms=np.sqrt(np.mean((contact[..., 0] - gravity @ x) ** 2, axis=0)),
        chi2=test.chi2,
        probability=test.probability,
        dof=calibration.dof,
        g=g,
        findings=(
            *left_out,
            *_doubts(mass, mass_std, surely, own, com, unknown_along is not None, test),
            *hidden_gain(calibration, mass, mass_std, g),
        ),
    )


def _of_one_object(samples: Samples) -> tuple[Samples, tuple[Finding, ...]]:
    """The samples in which the object is held, and that others were left out."""
    samples, findings = usable(samples)
    if samples.load_mass is None or not (samples.load_mass > 0.0).any():
        return samples, findings
    loaded = samples.load_mass > 0.0
    masses = np.unique(samples.load_mass[loaded])
    if len(masses) > 1:
        found = ", ".join(f"{1e3 * mass:g} g" for mass in masses[:4]) + (", ..." if len(masses) > 4 else "")
        raise InputError(
            f"{samples.source}: found loads of {found}, expected one object: weigh several with verify, or split the "
            "recording"
        )
    if not loaded.all():
        text = f"{int(np.sum(~loaded))} rows without a load were left out"
        findings = (*findings, Finding(Kind.LOADED_ROWS, Severity.REFUSED, text))
    return samples.select(loaded), findings


def _seen(down: Array) -> tuple[Array, Array | None]:
    """Orthonormal columns (3, k) that span the moments which show in torques under gravity along `down` (n, 3), and
    the direction (3,) of those that do not, if any.
    """
    values, axes = np.linalg.eigh(np.eye(3) - down.T @ down / len(down))
    if values[0] > np.sin(SAME_POSE_ANGLE) ** 2:
        return np.eye(3), None
    along = axes[:, 0] * np.sign(down[0] @ axes[:, 0])
    return axes[:, 1:], along


def _least_squares(A: Array, J: Array, y: Array) -> tuple[Array, Array, float]:
    """Least squares of whitened readings y (n, 6, 1) in unknowns A (n, 6, q), with the calibration's errors J (n, 6, p)
    as further unknowns that have unit variance: the unknowns x (q,), their covariance (q, q), and the misfit.
    """
    q, p = A.shape[2], J.shape[2]
    design = np.concatenate([A, J], axis=2).reshape(-1, q + p)
    prior = np.hstack([np.zeros((p, q)), np.eye(p)])
    Q, triangle = np.linalg.qr(np.vstack([design, prior]))
    readings = np.r_[y.ravel(), np.zeros(p)]
    inverse = np.linalg.inv(triangle)
    along = Q.T @ readings
    left = readings - Q @ along
    return (inverse @ along)[:q], inverse[:q] @ inverse[:q].T, float(left @ left)


@dataclass(frozen=True)
class _ByPoses:
    """The mass (kg) that poses tell whatever the zero is, its std, and the tests that none moved, and of the rest."""

    mass: float
    std: float
    moved: MisfitTest
    rest: MisfitTest


def _doubts(
    mass: float, std: float, surely: float, own: _ByPoses, com: Array | None, one_direction: bool, test: MisfitTest
) -> Iterator[Finding]:
    """What the readings could not tell, or contradict; a mass is none unless it is `surely` kg from zero."""
    distance = 0.0 if com is None else float(np.linalg.norm(com))
    moved = own.moved.probability < 0.5 * SIGNIFICANCE
    by_zero = moved and test.readings > 6 and own.rest.probability >= SIGNIFICANCE
    below_with_any = by_zero and own.mass < -surely / std * own.std
    if mass < -surely or below_with_any:
        text = (
            f"the mass is below zero{'' if mass < -surely else ', whatever the zero is'}: the tool is lighter than "
            "when it was calibrated, the sign of the readings differs (--sign), or the calibration is another tool's"
        )
        yield Finding(Kind.NEGATIVE_MASS, Severity.REFUSED, text)
    elif mass <= surely:
        text = (
            "the mass is not above zero by three standard deviations: nothing is held, or too little for this "
            "calibration; no centre of mass"
        )
        yield Finding(Kind.UNCERTAIN_PARAMETER, Severity.WARNING, text)
    elif distance > FURTHEST_COM:
        text = (
            f"the centre of mass comes out {distance:.2g} m from the sensor, outside anything that an arm holds: the "
            "calibration is another tool's, its bias moved, or the torques are in N mm; contactwrench verify tells"
        )
        yield Finding(Kind.FAR_CENTRE_OF_MASS, Severity.REFUSED, text)
    elif one_direction:
        text = (
            "gravity had one direction in sensor axes, so the centre of mass is known across it only: tilt the tool to "
            "another pose for the rest"
        )
        yield Finding(Kind.ADVICE, Severity.NOTE, text)
    if mass > surely and own.std > max(UNCONFIRMED * std, LEAST_UNCONFIRMED * mass):
        tell = f"tell it within {two_digits(1e3 * own.std)} g" if own.std < mass else "do not tell it"
        text = (
            f"the mass counts from the calibration's zero: by themselves the poses {tell}; verify the empty tool just "
            "before, or tilt it further"
        )
        yield Finding(Kind.UNCONFIRMED, Severity.NOTE, text)
    if below_with_any:
        return
    if by_zero:
        told = f"tell {' +- '.join(meaningful_digits(1e3 * own.mass, 1e3 * own.std))} g"
        text = (
            f"the zero is another one than the calibration's (probability {percent(own.moved.probability)}): with any "
            f"zero the poses {told if own.std < mass else 'do not tell the mass'}; take the new zero of the empty tool "
            "(contactwrench calibrate FILE --prior CAL.json)"
        )
        yield Finding.doubtful(Kind.BIAS_SHIFTED, text)
    elif moved or test.probability < SIGNIFICANCE:
        text = (
            f"a rigid object that hangs free does not explain the readings (chi-square {test.chi2:.3g} per degree of "
            f"freedom, probability {percent(test.probability)}): it or the tool touched something, it moved between "
            "the poses, or the calibration no longer holds"
        )
        yield Finding.doubtful(Kind.POOR_FIT, text)
