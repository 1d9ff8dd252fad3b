"""Readings held against a calibration: what of their misfit a bias explains that moved since, or on the way, or a few
poses that are off.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind, Severity
from ..geometry.arrays import Array, Frozen
from ..geometry.wrench import cross_matrix
from ..model import affine_jacobian, gravity_in_flange
from ..statistics import SIGNIFICANCE, MisfitTest, force_and_torque, percent, products_of_readings, two_digits
from .outliers import MOST_SHARE

NEW_ZERO = "one pose gives the new zero: contactwrench calibrate FILE --prior CAL.json"
MORE_CHANGED = "more than the bias changed: calibrate anew"
SCATTERED = (
    "no tool, mounting and sensor explain that, poses differ {} times as much as when calibrating: look for contact, "
    "motion, a base that moved, or a file that is read otherwise (sign, units, orientation: contactwrench diagnose)"
)
OF_MEANS = (
    "rows scatter {} times as much as samples do: they are taken as means of many, and held to what the poses of the "
    "calibration differed by"
)
OF_PART = 2
"""Poses at least before and after a change of the bias: a single one may be in contact."""
FEWEST_IF_MOVED, MOST_OFF = 6, 12
"""Poses, from which on a bias that moved before is thought of, too; and how many at most are off, and named."""
LEAST_LEFT = 6
"""Readings more than another tool, mounting and bias have numbers: with fewer these explain anything."""
LEAST_OF_ROWS = 12
"""Readings more than numbers, from which on each row has enough of its own to tell how rows scatter."""
LITTLE, FAR_LESS = 1e-3, 0.5
"""Probability that samples scatter as little by chance; and of their variance, below which it makes a difference."""
SAME = 1e-9
"""Of the largest singular value: columns that say the same have less."""
LEAST_OF_NOISE, LEAST_OF_EARLIER = 0.01, 0.5
"""Of the variance of a reading, what is left to noise where the robot's errors seem to be all of it; and where these
are of an earlier calibration, whose poses, which its noise is of, are not known.
"""
TELLS_NOTHING = 1e200
"""Variance of a pose that is left out."""


@dataclass(frozen=True, eq=False)
class BiasShift(Frozen):
    """The part of the residuals that a bias explains which moved since the calibration.

    `shift` (6,), N and N m, the same in all poses, with its `std` (6,); `chi2` of it, its share of the whole, and the
    `probability` of as much by chance; `rest_chi2` and `rest_probability` of what it leaves; `other_probability` of as
    much of that as another tool or mounting explains beside it; `alone`: whether the rest is what the calibration
    explains, and no other tool or mounting would do as well; `with_other`: whether with one of these, near those of
    the calibration, it explains all; `with_any`: whether any matrix does, as model `affine` has it, be it of another
    sensor or of a mounting that turned far; `times_noise`: by how much, as a factor, poses differ more than when
    calibrating, whatever it is; 0: not known; `changed`: the test of what another tool and mounting explain with it.
    """

    shift: Array
    std: Array
    chi2: float
    probability: float
    rest_chi2: float
    rest_probability: float
    other_probability: float
    alone: bool
    with_other: bool
    with_any: bool
    times_noise: float
    changed: MisfitTest

    @property
    def finding(self) -> Finding | None:
        """That the bias moved, where it did beyond chance, and what to do."""
        if self.probability >= SIGNIFICANCE:
            return None
        remedy = "another tool or mounting would do as well: tilt the tool further"
        if self.alone:
            remedy = NEW_ZERO
        elif min(self.rest_probability, self.other_probability) < SIGNIFICANCE:
            scatters = self.times_noise > 0.0 and not (self.with_other or self.with_any)
            remedy = SCATTERED.format(two_digits(self.times_noise)) if scatters else MORE_CHANGED
        far = f"moved by {force_and_torque(self.shift)}"
        text = (
            f"{f'the bias {far}, which' if self.alone else f'a bias that {far}'} explains {self.chi2:.3g} of the "
            f"chi-square of {self.chi2 + self.rest_chi2:.3g}; the rest has a probability of "
            f"{percent(min(self.rest_probability, self.other_probability))}; {remedy}"
        )
        return Finding(Kind.BIAS_SHIFTED, Severity.WARNING, text)


def noise_beside_turns(calibration: Calibration, R_base_flange: Array, variance: Array) -> tuple[Array, Array]:
    """What is noise (n, 6) of the `variance` (n, 6) of readings; the rest is of a robot whose orientations are off, by
    as much as calibrating saw. And what a turn of 1 rad about each axis of the flange reads of the tool, (n, 6, 3); 0
    where the calibration knows of no such errors.
    """
    if calibration.orientation_std is None:
        return variance, np.zeros((*variance.shape, 3))

    def of_turns(R: Array) -> Array:
        return calibration.B[:, :3] @ cross_matrix(gravity_in_flange(R, calibration.gravity_direction))

    own = "prior" not in calibration.provenance
    fitted = [pose.R_base_flange for pose in calibration.fitted_poses] if own else []
    then = np.array(fitted) if fitted else R_base_flange
    share = calibration.orientation_std**2 * np.mean(np.sum(of_turns(then) ** 2, axis=2), axis=0)
    least = LEAST_OF_NOISE if own else LEAST_OF_EARLIER
    return np.maximum(variance - share, least * variance), of_turns(R_base_flange)


def whitening(noise: Array, turned: Array) -> Array:
    """Matrices (n, 6, 6) that make errors independent, of size one: of `noise` variances (n, 6), and what independent
    turns read, `turned` (n, 6, k).
    """
    total = noise[..., None] * np.eye(6) + turned @ turned.transpose(0, 2, 1)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


def held_against(
    calibration: Calibration,
    residuals: Array,
    R_base_flange: Array,
    variance: Array,
    dof: float,
    lag: Array | None = None,
) -> tuple[MisfitTest, BiasShift | None]:
    """The test of what poses (n, 3, 3) read beside what the calibration predicts, `residuals` (n, 6), whose noise has
    the `variance` (n, 6), known with `dof` degrees of freedom (0: exactly), and which one `lag` (10, 6) may turn
    (`RecordedPoses`); and what of their misfit a moved bias explains, None for a single pose.
    """
    n = len(residuals)
    noise, of_turns = noise_beside_turns(calibration, R_base_flange, variance)
    white = whitening(noise, (calibration.orientation_std or 0.0) * of_turns)
    J = calibration.error_jacobian(R_base_flange).reshape(6 * n, -1)
    of_bias = [name.startswith("bias_") or name.endswith("_1") for name in calibration.error_names]
    of_others, of_any = J[:, np.logical_not(of_bias)], _of_any_matrix(calibration, R_base_flange)
    columns = [residuals.reshape(-1, 1), np.tile(np.eye(6), (n, 1)), of_others, of_any]
    covariance = calibration.error_covariance
    if lag is not None:
        late = np.column_stack([R_base_flange.reshape(n, 9), np.ones(n)]) @ lag
        J, covariance = np.column_stack([J, late.ravel()]), np.pad(covariance, (0, 1))
        covariance[-1, -1] = 1.0
    told, of_errors = ((white @ each.reshape(n, 6, -1)).reshape(6 * n, -1) for each in (np.hstack(columns), J))
    products = products_of_readings(told, np.ones(6 * n), of_errors, covariance)
    whole = MisfitTest(float(products[0, 0]), 6 * n, dof)
    if n == 1:
        return whole, None
    inverse = np.linalg.inv(products[1:7, 1:7])
    shift = inverse @ products[1:7, 0]
    of_shift = MisfitTest(float(shift @ products[1:7, 0]), 6, dof)
    rest = MisfitTest(whole.misfit - of_shift.misfit, 6 * n - 6, dof)
    others = 7 + of_others.shape[1]
    left = 6 * n - others + 7
    spans = slice(7, others), slice(1, others), slice(1, None)
    by_others, by_all, by_any = (_explained(products[span, span], products[span, 0]) for span in spans)
    beside = MisfitTest(max(by_all[0] - of_shift.misfit, 0.0), max(by_all[1] - 6, 1), dof)
    without_bias = MisfitTest(whole.misfit - by_others[0], max(left, 1), dof)
    with_bias = MisfitTest(max(whole.misfit - by_all[0], 0.0), max(left - 6, 1), dof)
    left_by_any = 6 * n - by_any[1]
    with_any = MisfitTest(max(whole.misfit - by_any[0], 0.0), max(left_by_any, 1), dof)
    return whole, BiasShift(
        shift=shift,
        std=np.sqrt(np.diag(inverse)),
        chi2=of_shift.misfit,
        probability=of_shift.probability,
        rest_chi2=rest.misfit,
        rest_probability=rest.probability,
        other_probability=beside.probability,
        alone=min(rest.probability, beside.probability) >= SIGNIFICANCE
        and left > 0
        and without_bias.probability < SIGNIFICANCE,
        with_other=left - 6 >= LEAST_LEFT and with_bias.probability >= SIGNIFICANCE,
        with_any=left_by_any >= LEAST_LEFT and with_any.probability >= SIGNIFICANCE,
        times_noise=float(np.sqrt(with_any.chi2)) if left_by_any >= LEAST_LEFT else 0.0,
        changed=MisfitTest(by_all[0], by_all[1], min(dof, calibration.dof or dof)),  # what was fitted counts most
    )


def of_means(
    calibration: Calibration, residuals: Array, R_base_flange: Array, variance: Array, between: Array
) -> tuple[Array, float, Finding] | None:
    """The variance (n, 6) of single rows that are means of many samples, as they scatter so much less than samples with
    the `variance` (n, 6) would, whatever tool, sensor and bias are: as much as they do, and no less than poses differ
    by, `between` (n, 6). With the degrees of freedom behind it, and a note. None: they are samples, as far as that can
    be told, which model `paper` cannot, whose torques are no tool's.
    """
    n = len(residuals)
    of_errors = calibration.error_jacobian(R_base_flange).reshape(6 * n, -1)
    of_bias = np.tile(np.eye(6), (n, 1))
    std = np.sqrt(variance).reshape(-1, 1)
    whitened = np.hstack([of_bias, of_errors, _of_any_matrix(calibration, R_base_flange)]) / std
    U, size, _ = np.linalg.svd(whitened / np.linalg.norm(whitened, axis=0).clip(1e-300), full_matrices=False)
    U = U[:, size > SAME * size[0]]
    dof = 6 * n - U.shape[1]
    if dof < LEAST_OF_ROWS or calibration.model == "paper":
        return None
    from scipy.special import chdtr, chdtri

    left = residuals.reshape(-1, 1) / std
    squares = np.sum((left - U @ (U.T @ left)).reshape(n, 6) ** 2, axis=1)
    of_row = 6.0 - np.sum(U.reshape(n, -1) ** 2, axis=1)
    # the median, in which a row that is off counts little
    scatter = float(np.median(squares / np.maximum(chdtri(np.maximum(of_row, 1e-2), 0.5), 1e-6)))
    less = np.maximum(between, scatter * variance)
    share = float(np.mean(less / variance))
    if share > FAR_LESS or chdtr(dof, scatter * dof) > LITTLE:
        return None
    text = OF_MEANS.format(two_digits(float(np.sqrt(share))))
    return less, float(dof), Finding(Kind.ROWS_OF_MEANS, Severity.NOTE, text)


def _of_any_matrix(calibration: Calibration, R_base_flange: Array) -> Array:
    """The derivative (6 n, 18) of readings at orientations (n, 3, 3) with respect to the sensor's matrix, without its
    bias: any tool on any mounting is one.
    """
    of_B = affine_jacobian(gravity_in_flange(R_base_flange, calibration.gravity_direction))
    return np.asarray(of_B.reshape(-1, 6, 4)[:, :, :3].reshape(-1, 18))


def _explained(information: Array, along: Array) -> tuple[float, int]:
    """What parameters take off a misfit, and how many of them show."""
    unit = np.sqrt(np.maximum(np.diag(information), 1e-300))
    found, _, rank, _ = np.linalg.lstsq(information / np.outer(unit, unit), along / unit, rcond=None)
    return float(found @ (along / unit)), int(rank)


def apart(
    calibration: Calibration,
    residuals: Array,
    R_base_flange: Array,
    variance: Array,
    dof: float,
    names: list[str],
    lag: Array | None = None,
    one_at_most: bool = False,
) -> tuple[Finding, ...]:
    """Where `held_against` finds that poses with these `names` contradict the calibration, whatever the bias is: that a
    few are off, or that the bias changed between two of them, if the calibration explains all else. `one_at_most`: not
    several, as one cause explains these, too.
    """
    n = len(names)
    if n < 2 * OF_PART:
        return ()
    off = residuals - np.median(residuals, axis=0)
    distance, before = np.sum(off**2 / variance, axis=1), np.arange(1, n)
    far = np.argsort(-distance)[: int(MOST_SHARE * n)].tolist()
    far = [k for k in far if n * MisfitTest(float(distance[k]), 6, dof).probability < SIGNIFICANCE]
    # the bias changed where the means of the poses before and after lie furthest apart, for their number
    sums = np.cumsum((residuals - residuals.mean(axis=0)) / np.sqrt(variance), axis=0)[:-1]
    of_parts = np.sum(sums**2, axis=1) / (before * (n - before))
    first = OF_PART + int(np.argmax(of_parts[OF_PART - 1 : n - OF_PART]))
    change = residuals[first:].mean(axis=0) - residuals[:first].mean(axis=0)
    ways = (far[:1], [], *(far[:k] for k in range(2, 1 if one_at_most else min(len(far), MOST_OFF) + 1)))
    for moved, out in product((False, True) if n >= FEWEST_IF_MOVED else (False,), ways):
        told = np.where(np.isin(np.arange(n), out)[:, None], TELLS_NOTHING, variance)
        later = (np.arange(n) >= (n if out else first))[:, None]
        whole, bias = held_against(calibration, residuals - later * change, R_base_flange, told, dof, lag)
        left, bias_too = 6 * (n - max(len(out), 1)), ""
        test = MisfitTest(whole.misfit, left, dof)
        if moved and bias is not None:
            test = MisfitTest(bias.rest_chi2, left - 6, dof)
            bias_too = f" with a bias that moved by {force_and_torque(bias.shift)}"
        if test.probability < SIGNIFICANCE:
            continue
        agree = f"agree with the calibration{bias_too} (probability {percent(test.probability)})"
        if out:
            each = ", ".join(f"{names[k]} is off by {force_and_torque(off[k])}" for k in sorted(out))
            remedy = f"take {'it' if len(out) == 1 else 'them'} anew"
            text = f"{each}: in contact, bumped, or in the wrong row; the other {n - len(out)} {agree}; {remedy}"
            return (Finding(Kind.POSE_OFF, Severity.WARNING, text),)
        between = f"between {names[first - 1]} and {names[first]}, by a new zero or a drift"
        text = f"the bias changed by {force_and_torque(change)} {between}; but for that all {agree}; {NEW_ZERO}"
        return (Finding(Kind.BIAS_STEPPED, Severity.WARNING, text),)
    return ()


def noise_dof(calibration: Calibration) -> float:
    """Degrees of freedom behind the noise of all axes together, readings less parameters; of model `paper` that of one
    axis, as it estimates each alone, and where the robot errs, too, those of its least known parameter, as noise and
    turns are harder to tell apart. 0 for a known noise.
    """
    if calibration.model == "paper" or calibration.orientation_std is not None:
        return calibration.dof
    n = len(calibration.fitted_poses) if calibration.moments is None else calibration.moments.n
    return float(max(6 * n - len(calibration.parameters), 0)) if calibration.dof > 0.0 else 0.0
