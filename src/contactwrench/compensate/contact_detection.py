"""Is something touching? Chi-square of a contact wrench against its own covariance, at a stated false-alarm rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array

RELEASE_RATE = 0.01
"""A contact is over when the statistic falls to what this share of free samples exceeds."""
_LOG_DOF = np.linspace(np.log(0.5), np.log(1e6), 400)


@dataclass(frozen=True, eq=False)
class Thresholds:
    """Of the statistic, over the logarithm of the degrees of freedom behind its covariance: above `contact` a sample
    is taken for a contact, below `release` for free.
    """

    contact: Array
    release: Array

    def at(self, dof: float) -> tuple[float, float]:
        """Both at `dof`; 0: the covariance is known."""
        if dof == 0.0:
            return float(self.contact[-1]), float(self.release[-1])
        x = np.log(dof)
        return float(np.interp(x, _LOG_DOF, self.contact)), float(np.interp(x, _LOG_DOF, self.release))


def thresholds(false_alarm_rate: float) -> Thresholds:
    """For 6 axes: 6 F(6, dof), which is chi-square where the covariance is known.

    Raises `InputError` unless the rate lies between 1e-9 and `RELEASE_RATE`.
    """
    from scipy.special import fdtri

    if not 1e-9 <= false_alarm_rate <= RELEASE_RATE:
        raise InputError(f"false-alarm rate is {false_alarm_rate:g}, expected 1e-9 to {RELEASE_RATE:g} per sample")
    contact, release = (6.0 * fdtri(6.0, np.exp(_LOG_DOF), 1.0 - rate) for rate in (false_alarm_rate, RELEASE_RATE))
    return Thresholds(contact, release)


def whitening(covariance: Array) -> Array:
    """The lower triangular W (6, 6) with `W S W^T = 1`: the statistic is `|W f|^2`.

    By LAPACK itself, as this is on the way of a sample: numpy's checks take longer than the work. Raises numpy's
    `LinAlgError` where the covariance is none.
    """
    from scipy.linalg.lapack import dpotrf, dtrtri

    root, wrong = dpotrf(covariance, lower=1, clean=1)
    if wrong:
        raise np.linalg.LinAlgError("the covariance of a contact wrench is not positive definite")
    W: Array = dtrtri(root, lower=1)[0]
    return W


def satterthwaite(W: Array, estimated: Array, dof: float) -> float:
    """Degrees of freedom behind a covariance of which the part `estimated` (6, 6) rests on `dof` (0: all is known) and
    the rest is known, by its mean share of the variance (Satterthwaite, 1946).
    """
    share = min(float(np.vdot(W @ estimated, W)) / 6.0, 1.0)
    return dof / max(share * share, 1e-12) if dof > 0.0 else 0.0
