"""A calibration as a file for another program: the formats by name, and the parameters of one under a header that says
what they are worth.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from textwrap import wrap

import numpy as np

from ...calibration.calibration import Calibration
from ...calibration.findings import Severity
from ...calibration.text import headline, parameter_rows
from ...compensate.delay import delay_of
from ...errors import InputError
from ...statistics import meaningful_digits, three_digits, two_digits
from ...version import __version__
from . import code, research, robots, ros
from .target import ROUNDING, Parameters, Setup, Target, largest_error

TARGETS = {target.name: target for target in (*ros.TARGETS, *research.TARGETS, *robots.TARGETS, *code.TARGETS)}
"""Every format of parameters, by its name."""
OF_THE_RECORDING = (
    "the bias is the sensor's in the recording: once the sensor, or its driver, is zeroed anew, it is another"
)
COLUMNS = 100
COPIED = re.compile(r'\w\([^()]*\)|\[[^]]*\]|"[^"]*"')
"""What a person copies out of a sentence, in one piece: a call, a list, a quotation."""
OFFSET_STD = 2e-3
"""m, of where the sensor is: what is known worse is asked for."""
MASS_APART, MASS_SURELY_APART, STANDARD_DEVIATIONS = 0.2, 0.1, 5.0
"""In shares of the identified mass: so far off, a stated one is doubted; or less far, by so many of its std."""


def target_named(name: str) -> Target:
    """A format, its name in any case. Raises `InputError`, naming all, for a name that is none."""
    if name.lower() not in TARGETS:
        raise InputError(f"--to is {name!r}, expected one of {', '.join(TARGETS)}: contactwrench export --list")
    return TARGETS[name.lower()]


def list_text() -> str:
    """All formats, each with the program that reads it, and what it needs beside the calibration and loses of it."""
    lines = []
    for target in TARGETS.values():
        needs, loses = f"needs {target.needs}" if target.needs else "", f"loses {target.loses}" if target.loses else ""
        lines += [target.name, *(f"    {said}" for said in (target.program, needs, loses) if said)]
    return "\n".join(lines)


@dataclass(frozen=True)
class Exported:
    """The `text` of the file, and `notes` for the person who asked for it."""

    text: str
    notes: tuple[str, ...]


def exported(target: Target, calibration: Calibration, setup: Setup, source: str) -> Exported:
    """A calibration in the format of a program; its file, the `source`, is named in the header. Raises `InputError`
    where what the format needs is not stated, or the program could make nothing of the calibration.
    """
    setup, offset = _with_found_offset(calibration, setup, target)
    parameters = target.parameters(calibration, setup)
    weak = [finding.text for finding in calibration.findings if finding.severity is Severity.WEAK]
    mass, doubted = _stated_mass(calibration, setup)
    other = _other_readings(calibration, parameters)
    first = [*parameters.cautions, *weak, *(mass if doubted else []), *other]
    loss, matters = _loss(calibration, parameters)
    then = [
        *([] if doubted else mass),
        *parameters.remarks,
        *offset,
        *([] if parameters.B is None else [OF_THE_RECORDING]),
        *loss,
    ]
    if target.with_header is None:
        return Exported(parameters.body, (*first, *then))
    sentences = (*_origin(target, calibration, source), *first, *_identified(calibration), *then)
    header = [line for sentence in sentences for line in _wrapped(sentence)]
    return Exported(target.with_header(header, parameters.body), (*first, *(loss if matters else [])))


def _with_found_offset(c: Calibration, setup: Setup, target: Target) -> tuple[Setup, list[str]]:
    """The setup, with the sensor's place as the motion told it where nobody states it, and what is to be said."""
    d = c.dynamics
    told = d is not None and d.accelerometer is None and d.std[6:].max() < OFFSET_STD
    if d is None or not told or setup.sensor_offset is not None or "sensor_offset" not in target.uses:
        return setup, []
    each = zip(d.sensor_offset.tolist(), d.std[6:].tolist(), strict=True)
    place = ", ".join(f"{1e3 * value:.2f} +- {1e3 * std:.2g}" for value, std in each)
    said = f"the sensor's origin is where the motion told, [{place}] mm from the flange's; --sensor-offset states it"
    return replace(setup, sensor_offset=d.sensor_offset), [said]


def _wrapped(sentence: str) -> list[str]:
    """A sentence in lines of a header, which hang; what is copied from it is not broken."""
    whole = COPIED.sub(lambda found: found.group().replace(" ", "\xa0"), " ".join(sentence.splitlines()))
    lines = wrap(whole, COLUMNS, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return [line.replace("\xa0", " ") for line in lines]


def _origin(target: Target, c: Calibration, source: str) -> list[str]:
    """Who made it, and of what."""
    created, recording = (str(c.provenance.get(name, "")) for name in ("created", "source"))
    of = "".join([f", of {recording}" if recording else "", f", {created}" if created else ""])
    return [
        f"parameters of {target.program}, made by contactwrench {__version__} from {source}",
        f"{headline(c)}{of}",
        f"verdict {'; '.join([c.verdict, *c.doubts])}",
    ]


def _identified(c: Calibration) -> list[str]:
    """Every identified number with its standard deviation; of a delay not that it is applied, which no file does."""
    rows = parameter_rows(c)
    return [
        f"  {name} {value} {'+- ' + std + ' ' if std else ''}{unit.partition(';')[0] if name == 'delay' else unit}"
        for name, value, std, unit in rows
    ]


def _stated_mass(c: Calibration, setup: Setup) -> tuple[list[str], bool]:
    """What the mass as weighed changes, nothing where none was stated; and whether it can hardly be the same tool's."""
    if setup.tool_mass is None or c.mass is None or c.com is None:
        return [], False
    std, apart = c.std["weight"] / c.g, abs(setup.tool_mass - c.mass)
    doubted = apart > MASS_APART * c.mass or apart > max(MASS_SURELY_APART * c.mass, STANDARD_DEVIATIONS * std)
    force, torque = (three_digits(apart * c.g * arm) for arm in (1.0, float(np.linalg.norm(c.com))))
    text = (
        f"the tool's mass is as stated (--tool-mass), {setup.tool_mass:g} kg, the identified one "
        f"{' +- '.join(meaningful_digits(c.mass, std))} kg: its weight changes by {force} N, its torque about the "
        f"sensor by up to {torque} N m"
    )
    return [f"{text}: another tool, another unit, or a calibration that is wrong" if doubted else text], doubted


def _other_readings(c: Calibration, parameters: Parameters) -> list[str]:
    """What the program must be told of readings that the calibration has turned round."""
    cautions: list[str] = []
    if parameters.B is None:
        return cautions
    delay = 1e3 * delay_of(c)
    if delay != 0.0:
        later, earlier = ("later", "earlier") if delay > 0.0 else ("earlier", "later")
        cautions.append(
            f"the wrench is stamped {abs(delay):.4g} ms {later} than the orientation: look the orientation up that "
            f"much {earlier}, this file does not do it"
        )
    if c.dynamics is not None:
        subtracted = np.maximum(c.dynamics.static_rms**2 - c.dynamics.residual_rms**2, 0.0)
        felt = float(np.sqrt(np.sum(subtracted[:3])))
        cautions.append(
            f"this file does not subtract what a moving tool exerts: {felt:.2g} N RMS were felt of that in the motion "
            "of the calibration"
        )
    if c.provenance.get("sign") == "reaction" and not parameters.takes_reaction:
        cautions.append(
            "the sensor gives the reaction (--sign reaction): negate force and torque before this program reads them"
        )
    if c.provenance.get("wrench_frame") == "base":
        cautions.append(
            "the recording's wrench was in base axes (--wrench-frame base): turn it into flange axes, by R_base_flange "
            "transposed, before this program reads it; what is called sensor axes here are the flange's"
        )
    return cautions


def _loss(c: Calibration, parameters: Parameters) -> tuple[list[str], bool]:
    """By how much the contact wrench is off, nothing where it is not; and whether by more than its own std."""
    if parameters.B is None or parameters.gravity_direction is None:
        return [], False
    force, torque = largest_error(c, parameters.B, parameters.gravity_direction)
    if max(force, torque) < ROUNDING:
        return [], False
    own_force, own_torque = c.largest_std
    text = (
        f"with these parameters the contact force is off by up to {force:.4g} N and the torque by up to {torque:.4g} "
        "N m over all orientations; the calibration's own std is up to "
        f"{two_digits(own_force)} N and {two_digits(own_torque)} N m"
    )
    return [text], force > own_force or torque > own_torque
