"""Verbs that ask one thing and print the answer, as text or JSON: of recordings, of calibrations, of devices."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..geometry.ranges import LEFT_FORCE, LEFT_TORQUE
from . import options
from .recordings import Recordings, calibration_and_samples, with_reading_options
from .streams import progress

if TYPE_CHECKING:
    from ..live.uri import Known


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording: a ROS bag or a table.")],
    json: options.Json = False,
) -> int:
    """Say what is in FILE: topics or columns, rates and gaps, what gives the wrench and what the pose."""
    from ..recording.contents import BagContents, contents
    from ..report.text import contents_text, json_text

    with progress(f"reading {file.name}") as advance:
        result = contents(file, advance)
    options.print_result(result, json, json_text, contents_text)
    options.note(*options.doubtful_ends(file))
    return 1 if isinstance(result, BagContents) and result.damage else 0


@with_reading_options
def diagnose(
    *,
    model: Annotated[str, options.text("M", "Of `calibrate`: auto, yaw, mount or mount+base.")] = "auto",
    json: options.Json = False,
    recording: Recordings,
    gravity: options.Gravity = None,
) -> None:
    """Find the interpretation of FILE that a rigid tool explains, and the options that make it so.

    Tries every orientation convention, inverse and unit, both signs, wrenches in base axes, exchanged axes, shifted
    rows and torques in N mm. The options of reading say how the file is read as given.
    """
    from ..assess.diagnose import diagnose as rank
    from ..recording.interpretations import interpretations
    from ..report.diagnosis import diagnosis_json, diagnosis_text

    ranked = rank(interpretations(recording.path, recording.options, options.gravity_direction(gravity)), model)
    options.print_result(ranked, json, diagnosis_json, diagnosis_text)


@with_reading_options
def verify(
    *,
    calibration: options.CalibrationFile,
    limit_force: Annotated[
        float | None, options.number(LEFT_FORCE, "N", "Largest contact force that may be left in a pose.")
    ] = None,
    limit_torque: Annotated[
        float | None, options.number(LEFT_TORQUE, "NM", "Largest contact torque that may be left in a pose.")
    ] = None,
    json: options.Json = False,
    recording: Recordings,
    gravity: options.Gravity = None,
    g: options.WeighingGravity = None,
) -> int:
    """Hold a second, contact-free recording against a calibration; weigh the loads in its column load_g.

    Exit status 1 if the recording contradicts the calibration.
    """
    from ..assess.verify import verify as check
    from ..report.text import verification_json, verification_text

    loaded, samples = calibration_and_samples(calibration, gravity, recording)
    result = check(loaded, samples, limit_force=limit_force, limit_torque=limit_torque, g=g)
    options.print_result(result, json, verification_json, verification_text)
    if loaded.dynamics is not None:
        options.note(
            "only the stops were verified: for inertia and offset compensate free motion, and see what is left"
        )
    return 0 if result.passed else 1


@with_reading_options
def weigh(
    *,
    calibration: options.CalibrationFile,
    json: options.Json = False,
    recording: Recordings,
    gravity: options.Gravity = None,
    g: options.WeighingGravity = None,
) -> int:
    """Mass and centre of mass of an object that the tool holds, from one or more poses.

    Exit status 1 where nothing that an arm holds explains the readings: the calibration is wrong.
    """
    from ..assess.weigh import weigh as weighed
    from ..report.text import held_object_json, held_object_text

    loaded, samples = calibration_and_samples(calibration, gravity, recording)
    held = weighed(loaded, samples, g=g)
    options.print_result(held, json, held_object_json, held_object_text)
    return int(held.refused)


def show(
    file: Annotated[Path, typer.Argument(metavar="CAL.json", help="Calibration that `calibrate` wrote.")],
    json: options.Json = False,
) -> None:
    """Print a calibration: every parameter with its standard deviation, the verdict, the warnings."""
    from ..calibration.calibration import Calibration
    from ..calibration.file import to_json
    from ..calibration.text import COLUMNS, describe

    options.print_result(Calibration.load(file), json, to_json, describe, elsewhere=COLUMNS)


def diff(
    a: Annotated[Path, typer.Argument(metavar="A.json", help="The earlier calibration.")],
    b: Annotated[Path, typer.Argument(metavar="B.json", help="The later calibration.")],
    json: options.Json = False,
) -> None:
    """What changed between two calibrations, each change with its standard deviation."""
    from ..calibration.calibration import Calibration
    from ..report.text import difference_json, difference_text

    change = Calibration.load(a).diff(Calibration.load(b))
    options.print_result(change, json, difference_json, difference_text)


NARROW = 76
"""Columns of a URI's form, in a terminal of 80."""


def devices(json: options.Json = False) -> None:
    """Say what `live` can be connected to: every source and sink, how its URI is written, its rate, and what it was
    tested against; those of other packages that are installed too.
    """
    from ..calibration.text import COLUMNS
    from ..live.uri import known_sinks, known_sources
    from ..report.text import json_text

    found = {"sources": known_sources(), "sinks": known_sinks()}
    options.print_result(found, json, json_text, _text, elsewhere=COLUMNS)


def _text(found: dict[str, list[Known]]) -> str:
    lines = []
    for title, what in (("Sources: --sensor and --robot", found["sources"]), ("Sinks: --out", found["sinks"])):
        lines += [title, ""]
        for each in what:
            said = {"": each.about, "Rate: ": each.rate, "Tested against: ": each.tested, "Error: ": each.error}
            lines += [f"  {_broken(each.form)}", *(f"    {label}{text}" for label, text in said.items() if text), ""]
    return "\n".join(lines[:-1])


def _broken(form: str) -> str:
    """The form of a URI that is wider than a terminal, gone on with before one of its options."""
    lines = [""]
    for part in re.split(r"(?=\[[?&])", form):
        if len(lines[-1] + part) > NARROW and lines[-1]:
            lines.append("  ")
        lines[-1] += part
    return "\n  ".join(lines)
