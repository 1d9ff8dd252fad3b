"""What a recording leaves in motion, with the inertia and without: over time, and by frequency."""

from __future__ import annotations

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.dynamics import Ellipsoid
from ..compensate.contact_wrenches import motion_of
from ..estimation.in_motion import as_stamped
from ..geometry.arrays import Array
from ..samples.samples import Samples
from ..samples.timestamps import spread_evenly
from ..statistics import meaningful_digits, two_digits
from .figures import METHODS, PARTS, WIDTH, drawing, svg_text
from .signals import envelope

WITHOUT, WITH = METHODS["gravity only"][0], METHODS["full"][0]
LONGEST_WINDOW = 4.0
"""s, of which spectra are averaged."""
LOWEST = 1e-6
"""Of a logarithmic scale."""


BODY = (
    " Brown: the uniform solid ellipsoid of the same mass and inertia, with its principal axes; the band is two std "
    "of its semi-axes, cut off where that is far more. Around the centre of mass its 95 % ellipse, where it "
    "is large enough to be seen."
)
PRINCIPAL = ("principal axis", "moment, kg cm²", "semi-axis, mm")


def principal_rows(body: Ellipsoid) -> list[tuple[str, str, str]]:
    """Of each principal axis, sensor axes, the moment with its std, and the semi-axis, or what two std make of it."""
    rows = []
    for k, axis in enumerate(body.axes.T):
        along = ", ".join(f"{part:.2f}" for part in axis * np.sign(axis[np.argmax(np.abs(axis))]))
        moment = " +- ".join(meaningful_digits(1e4 * float(body.moments[k]), 1e4 * float(body.moment_std[k])))
        low, high = (two_digits(1e3 * float(of[k])) for of in (body.low, body.high))
        rows.append((along, moment, low if low == high else f"{low} to {high}"))
    return rows


def left_in_motion(calibration: Calibration, samples: Samples) -> str:
    """The norm of force and torque left over time, the most in each moment, and the spectrum of the force."""
    samples = as_stamped(samples, calibration)
    motion = motion_of(calibration, samples)
    t = spread_evenly(np.asarray(samples.t)) - calibration.first_time
    known = np.ones(len(t), dtype=bool) if motion is None else motion.inside
    left = {
        "without inertia": calibration.compensate(samples.wrench, samples.R_base_flange),
        "with inertia": calibration.compensate(samples.wrench, samples.R_base_flange, motion=motion),
    }
    with drawing(3, (WIDTH, 3.2)) as (figure, axes):
        for (name, wrench), colour in zip(left.items(), (WITHOUT, WITH), strict=True):
            norms = [scale * np.linalg.norm(wrench[:, part : part + 3], axis=1) for part, _, scale in PARTS]
            most = envelope(t[known], np.stack(norms, axis=1)[known])
            for ax, values in zip(axes[:2], most.high.T, strict=True):
                ax.plot(most.t, np.maximum(values, LOWEST), color=colour, lw=0.7, label=name)
            frequency, density = _spectrum(t, wrench[:, :3])
            axes[2].plot(frequency, np.maximum(density, LOWEST), color=colour, lw=0.9, label=name)
        for ax, (_, name, _) in zip(axes[:2], PARTS, strict=True):
            ax.set_yscale("log")
            ax.set_xlabel("time, s")
            ax.set_ylabel(f"left over, {name}")
        axes[2].set_xscale("log")
        axes[2].set_yscale("log")
        axes[2].set_xlabel("frequency, Hz")
        axes[2].set_ylabel("force left, N/√Hz")
        for ax in axes:
            ax.yaxis.set_major_formatter("{x:g}")
        axes[2].xaxis.set_major_formatter("{x:g}")
        axes[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), handletextpad=0.3, columnspacing=1.2)
        return svg_text(figure)


def _spectrum(t: Array, force: Array) -> tuple[Array, Array]:
    """Frequencies, Hz, and the amplitude density of a force (n, 3), N/√Hz, all axes together."""
    from scipy.signal import welch

    rate = 1.0 / float(np.median(np.diff(t)))
    rows = min(len(t), round(LONGEST_WINDOW * rate))
    frequency, power = welch(force, rate, nperseg=rows, axis=0)
    return frequency[1:], np.sqrt(power.sum(axis=1))[1:]
