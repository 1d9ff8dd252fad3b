"""Devices before a session begins: that they are there, send as fast as was asked, and are those of the calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..calibration.calibration import Calibration
from ..errors import InputError
from .source import About, Source, now

PROBE = 0.7
"""s over which samples are counted before a session begins."""
OFF_RATE, STEADY = 0.2, 0.1
"""By which part the rate may differ from the one that was asked for, and from itself a moment later."""


def probed(source: Source, *, wrench: bool, orientation: bool) -> About:
    """Open a source, and make sure that it gives what is wanted as fast as it was asked to.

    Raises:
        DeviceError: it does not answer, or is another device.
        InputError: it gives something else, or at another rate.
    """
    about = source.open()
    try:
        for wanted, given, what in (
            (wrench, about.wrench, "wrench"),
            (orientation, about.orientation, "orientation of the flange"),
        ):
            if wanted and not given:
                raise InputError(f"{source.uri}: found no {what}, expected one: name another device for that")
        _require_rate(source, about)
    except BaseException:
        source.close()
        raise
    return about


def _require_rate(source: Source, about: About) -> None:
    if about.rate is None or about.replay:  # of a recording what is read is gone
        return
    rate = _rate_over_probe(source)
    if not _is_off(rate, about.rate, OFF_RATE):
        return
    again = _rate_over_probe(source)
    if _is_off(again, about.rate, OFF_RATE) and not _is_off(again, rate, STEADY):  # else it is a stall, not a rate
        raise InputError(
            f"{source.uri}: found {rate:.0f} samples a second, expected {about.rate:.0f}: set that rate in the device, "
            f"or ask for it, as in {source.uri.partition('?')[0]}?rate={rate:.0f}"
        )


def _rate_over_probe(source: Source) -> float:
    samples, begin = 0, now()
    while (passed := now() - begin) < PROBE:
        samples += len(source.read(PROBE - passed).samples)
    return samples / passed


def _is_off(rate: float, asked: float, by: float) -> bool:
    return rate > 0.0 and abs(rate - asked) > by * asked


def with_devices(calibration: Calibration, sensor: About, robot: About) -> Calibration:
    """The calibration with the names of its devices."""
    names = {"sensor": sensor.name, "robot": robot.name}
    return replace(calibration, provenance={**calibration.provenance, **names})


def require_devices(calibration: Calibration, name: str, sensor: About, robot: About) -> None:
    """Raise `InputError` where a calibration, called `name`, is of another sensor or robot, or exceeds what the sensor
    can read. A calibration that names none is believed.
    """
    for role, about in (("sensor", sensor), ("robot", robot)):
        known = calibration.provenance.get(role)
        if known is not None and known != about.name:
            raise InputError(f"{name}: found the calibration of {known}, expected one of {about.name}: name its own")
    if sensor.ranges is not None:
        free = np.abs(calibration.bias) + np.linalg.norm(calibration.B[:, :3], axis=1)
        over = np.flatnonzero(free > np.array(sensor.ranges))
        if len(over):
            axis = ("fx", "fy", "fz", "tx", "ty", "tz")[int(over[0])]
            raise InputError(
                f"{name}: found {axis} of a free tool up to {free[over[0]]:.3g}, expected at most the sensor's range, "
                f"{sensor.ranges[int(over[0])]:.3g}: it is of another sensor"
            )
