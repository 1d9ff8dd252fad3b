"""A calibration as a file for another program: the parameters under a header that says what they are worth."""

from __future__ import annotations

from dataclasses import dataclass

from ...calibration.calibration import Calibration
from ...calibration.findings import Severity
from ...calibration.text import headline, parameter_rows
from ...statistics import two_digits
from ...version import __version__
from .losses import ROUNDING, largest_error
from .target import Parameters, Setup, Target

OF_THE_RECORDING = (
    "the bias is the sensor's in the recording: once the sensor, or its driver, is zeroed anew, it is another"
)


@dataclass(frozen=True)
class Exported:
    """The `text` of the file, and `notes` for the person who asked for it."""

    text: str
    notes: tuple[str, ...]


def exported(target: Target, calibration: Calibration, setup: Setup, source: str) -> Exported:
    """A calibration in the format of a program.

    Args:
        target: the format.
        calibration: what is to be written.
        setup: what the calibration does not hold.
        source: the calibration's file, for the header.

    Raises:
        InputError: what the format needs is not stated, or the program could make nothing of the calibration.
    """
    parameters = target.parameters(calibration, setup)
    weak = [finding.text for finding in calibration.findings if finding.severity is Severity.WEAK]
    other = _other_readings(calibration, parameters)
    loss, matters = _loss(calibration, parameters)
    said = [*weak, *parameters.remarks, *([] if parameters.B is None else [OF_THE_RECORDING]), *other, *loss]
    if target.with_header is None:
        return Exported(parameters.body, tuple(said))
    header = [" ".join(line.splitlines()) for line in (*_origin(target, calibration, source), *said)]
    notes = [*weak, *other, *(loss if matters else [])]
    return Exported(target.with_header(header, parameters.body), tuple(notes))


def _origin(target: Target, c: Calibration, source: str) -> list[str]:
    """Who made it, of what, and every identified number with its standard deviation."""
    created, recording = (str(c.provenance.get(name, "")) for name in ("created", "source"))
    of = "".join([f", of {recording}" if recording else "", f", {created}" if created else ""])
    rows = parameter_rows(c)
    return [
        f"parameters of {target.program}, made by contactwrench {__version__} from {source}",
        f"{headline(c)}{of}",
        f"verdict {'; '.join([c.verdict, *c.doubts])}",
        *(f"  {name} {value} {'+- ' + std + ' ' if std else ''}{unit}" for name, value, std, unit in rows),
    ]


def _other_readings(c: Calibration, parameters: Parameters) -> list[str]:
    """What the program must be told of readings that the calibration has turned round."""
    cautions: list[str] = []
    if parameters.B is None:
        return cautions
    if c.provenance.get("sign") == "reaction" and not parameters.takes_reaction:
        cautions.append(
            "the sensor gives the reaction (--sign reaction): negate force and torque before this program reads them"
        )
    if c.provenance.get("wrench_frame") == "base":
        cautions.append(
            "the recording's wrench was in base axes (--wrench-frame base): turn it into sensor axes before this "
            "program reads it"
        )
    return cautions


def _loss(c: Calibration, parameters: Parameters) -> tuple[list[str], bool]:
    """By how much the contact wrench is off with these parameters, nothing where it is not; and whether that is more
    than the calibration's own uncertainty.
    """
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
