"""Devices before a session begins: that they are there, send as fast as was asked, and are those of the calibration."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..calibration.calibration import Calibration
from ..errors import InputError
from ..model import AXES
from .arrivals import Windows
from .source import About, Batch, DeviceError, EndOfStreamError, NobodyYetError, Six, Source, now

PROBE, COUNTED = (0.7, 0.2), 2
"""s of a window, and the part by which two of them are to be off, and how often that is to be counted: what is held up
at opening is no rate. What is less, the session says when it runs.
"""
LEAST_RATE, SILENCE = 10.0, 1.5
"""Hz: what comes more rarely takes too long to count before a session; and s without a sample, which is no rate."""
LOOK = 0.1
"""s that a read waits."""
SAME = 0.01
"""Part by which a rate is another one."""


def probed(
    source: Source, *, wrench: bool, orientation: bool, say: Callable[[str], None] | None = None
) -> tuple[About, Batch]:
    """Open a source, and make sure that it gives what is wanted as fast as it was asked to: what it says of itself, and
    what came meanwhile. One to which nobody sends yet is waited for where there is somebody to `say` that to, once.

    Raises `DeviceError`: it does not answer, or is another device; `InputError`: it gives something else, or at another
    rate.
    """
    about = _opened(source, say)
    try:
        asked = (wrench, about.wrench, "wrench"), (orientation, about.orientation, "orientation of the flange")
        for wanted, given, what in asked:
            if wanted and not given:
                usual = f"found no {what}, expected one: name another device for that"
                raise InputError(f"{source.uri}: {about.settings.get(f'no {what.split()[0]}', usual)}")
        return about, _at_its_rate(source, about)
    except BaseException:
        source.close()
        raise


def _opened(source: Source, say: Callable[[str], None] | None) -> About:
    said = False
    while True:
        try:
            return source.open()
        except NobodyYetError as error:
            source.close()
            if say is None:
                raise
            if not said:
                say(str(error))
            said = True


def _at_its_rate(source: Source, about: About) -> Batch:
    """What comes while the samples are counted."""
    came = Batch()
    if about.rate is None or about.rate < LEAST_RATE or about.replay:
        return came
    windows = Windows(about.rate, *PROBE)
    with suppress(EndOfStreamError):
        for _ in range(COUNTED):
            windows, heard = Windows(about.rate, *PROBE), now()
            while not windows.right and windows.counted < 2 and now() - heard < SILENCE:
                batch = source.read(LOOK)
                came.add(batch)
                if batch.samples:
                    heard = batch.samples[-1].arrival
                    windows.look(len(came.samples), heard)
            if not windows.off:
                break
    if windows.off:
        place, _, query = source.uri.partition("?")
        others = [option for option in query.split("&") if option and not option.startswith("rate=")]
        asked = "&".join([*others, f"rate={windows.rate:.0f}"])
        takes_one = "rate=" in getattr(source, "FORM", "rate=")
        raise InputError(
            f"{source.uri}: found {windows.rate:.0f} samples a second, expected {about.rate:.0f}: set that rate in the "
            "device" + f", or ask for it, as in {place}?{asked}" * takes_one
        )
    return came


def with_devices(calibration: Calibration, sensor: About, robot: About) -> Calibration:
    """The calibration with the names of its devices."""
    names = {"live_sensor": sensor.name, "live_robot": robot.name}
    return replace(calibration, provenance={**calibration.provenance, **names})


def _kind(name: str) -> str:
    """Of a device, without the version of its program, and without the port at which lines come."""
    return name.partition(", ")[0].partition("://")[0]


def require_same(uri: str, before: About, about: About) -> None:
    """Raise `DeviceError` where a device that is connected to again is of another kind, or has another rate."""
    found, expected = "", ""
    if _kind(about.name) != _kind(before.name):
        found, expected = about.name, before.name
    elif about.wrench and about.rate and before.rate and abs(about.rate / before.rate - 1.0) > SAME:
        found, expected = f"{about.rate:.4g} samples a second", f"{before.rate:.4g}"
    if found:
        do = "connect that again, or begin a new session"
        raise DeviceError(f"{uri}: found {found}, expected {expected}, as when the session began: {do}")


def require_devices(
    calibration: Calibration, name: str, sensor: About, robot: About, stated: Six | None = None
) -> None:
    """Raise `InputError` where a calibration, called `name`, is of another kind of sensor or robot, or exceeds what the
    sensor can read: its ranges as `stated`, else as it states them. A calibration that names none is believed.
    """
    for name_of, about in (("live_sensor", sensor), ("live_robot", robot)):
        known = calibration.provenance.get(name_of)
        if known is not None and _kind(str(known)) != _kind(about.name):
            raise InputError(f"{name}: found the calibration of {known}, expected one of {about.name}: name its own")
    if (ranges := stated or sensor.ranges) is not None:
        free = np.abs(calibration.bias) + np.linalg.norm(calibration.B[:, :3], axis=1)
        over = np.flatnonzero(free > np.array(ranges))
        if len(over):
            least = f"{ranges[int(over[0])]:.3g}"
            expected, do = f"the sensor's range, {least}", "it is of another sensor"
            if stated:
                expected, do = f"{least}, as in --ranges", "it, or --ranges, is of another sensor"
            found = f"{AXES[over[0]]} of a free tool up to {free[over[0]]:.3g}"
            raise InputError(f"{name}: found {found}, expected at most {expected}: {do}")
