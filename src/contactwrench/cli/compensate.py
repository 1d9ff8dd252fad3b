"""`contactwrench compensate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..files import STDOUT
from ..geometry.ranges import CUTOFF, DELAY, DURATION, POINT, WALK, G
from . import options
from .outputs import NAMES_FOLDER, Writes, output_option
from .recordings import Recordings, with_reading_options
from .streams import progress

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration
    from ..compensate.filters import LowPass
    from ..geometry.arrays import Array


@with_reading_options
def compensate(
    *,
    calibration: Path = options.CALIBRATION,
    output: Path = output_option(
        "OUT",
        "Contact wrenches: .csv, .parquet, or, of a bag, a copy of it with a topic more; "
        f"{options.OUTPUT_HELP} CSV on stdout. [default: -]",
        Path(STDOUT),
    ),
    output_frame: str = options.text("sensor|flange|base", "Axes of the contact wrench.", default="sensor"),
    at: str | None = options.text("X,Y,Z", "Point of the torque, sensor axes, m (the TCP). [default: 0,0,0]"),
    contact: bool = options.switch("--contact", "Judge every sample: columns valid, contact and reason."),
    report: Path | None = options.text(
        "R.html", "Write a page with every contact, one HTML file; judges every sample.", mark=Writes(page=True)
    ),
    noise: str | None = options.text(
        "N|FX,..,TZ|FREE",
        "Judging: std of a free tool's reading, one or six, its motion's inertia included, or a recording of such "
        "motion. [default: the noise at rest]",
        mark=NAMES_FOLDER,
    ),
    drift: float | None = options.number(
        WALK, "N", "Judging: follow the bias in free space, a random walk of this std after an hour; 0.05 is typical."
    ),
    sensor_filter: str | None = options.text(
        "HZ[:ORDER]", "The sensor's own low-pass, done to the model too; judges every sample. First order unless said."
    ),
    lowpass: str | None = options.text(
        "HZ[:ORDER]", "Smooth the contact wrench both ways, Butterworth of order 1 to 4. [order: 2]"
    ),
    delay: float | None = options.number(
        DELAY, "S", "By how much later than the pose the wrench is stamped. [default: the calibration's]"
    ),
    zero: float | None = options.number(
        DURATION,
        "S",
        "Take the bias anew from the first S seconds, of a set those of each: the tool free, the arm at rest.",
    ),
    all_episodes: bool = options.switch("--all-episodes", "Of a set of recordings: every one, each by itself."),
    recording: Recordings,
    gravity: str | None = options.GRAVITY,
    g: float | None = options.number(G, "G", "Of no effect: it makes masses, and forces need none."),
) -> None:
    """Subtract weight and bias: one contact wrench, with its standard deviation, for each reading of FILE."""
    from ..calibration.calibration import Calibration
    from ..estimation.noise import with_torques
    from ..recording.compensate import Treatment
    from ..recording.compensate_set import one_of_set
    from ..report.contacts import compensate_recording, require_writable

    episodes, accept = _episodes(recording, report) if all_episodes else [], recording.options.accept_damaged
    if episodes:
        recording = replace(recording, options=one_of_set(recording.path, recording.options, episodes))
    require_writable(output, recording.path, recording.options)
    loaded, direction = Calibration.load(calibration), options.gravity_direction(gravity)
    alike = recording.as_calibrated(loaded, direction)
    judging = (noise, drift, sensor_filter, report)
    treatment = Treatment(
        output_frame=output_frame,
        point=options.point(at, "--at", POINT),
        gravity=direction,
        delay=delay,
        low_pass=_low_pass(lowpass, "--lowpass", 2),
        judged=contact or any(stated is not None for stated in judging),
        sensor_filter=_low_pass(sensor_filter, "--sensor-filter", 1),
        drift=None if drift is None else with_torques(drift),
        noise=None if noise is None else _noise(noise, recording, loaded, direction),
        zero=zero,
    )
    with progress(f"compensating {recording.path.name}") as advance:
        lines, notes = compensate_recording(
            recording.path,
            alike.options,
            alike.calibration,
            treatment,
            output,
            report,
            advance,
            episodes,
            accept_damaged=accept,
        )
    of_g = () if g is None else ("--g has no effect: it makes a weight a mass, and that is the calibration's",)
    options.note(*alike.notes, *of_g, *notes)
    for line in lines:
        options.say(line, err=STDOUT in map(str, (output, report)))


def _episodes(recording: Recordings, report: Path | None) -> list[int]:
    """Those of a set, in the order of their rows. Raises `InputError` for what goes with one recording alone."""
    from ..recording.tables.episodes import episodes_in
    from ..recording.tables.table import open_set

    one = {"--report": report, "--episode": recording.options.episode, "--pose": recording.options.pose_file}
    if named := next((option for option, value in one.items() if value is not None), None):
        raise InputError(f"found --all-episodes and {named}, which is for one recording: leave one of them out")
    return episodes_in(open_set(recording.path, recording.options))


def _low_pass(text: str | None, option: str, usual_order: int) -> LowPass | None:
    """`HZ` or `HZ:ORDER`. Raises `InputError` naming the option."""
    from ..compensate.filters import LowPass

    if text is None:
        return None
    cutoff, colon, order = text.partition(":")
    try:
        return LowPass(float(cutoff), int(order) if colon else usual_order)
    except InputError as error:
        raise InputError(f"{option} {text}: {error}") from None
    except ValueError:
        raise InputError(f"{option} is {text!r}, expected HZ or HZ:ORDER, {CUTOFF}, as in 20 or 20:4") from None


def _noise(text: str, recording: Recordings, calibration: Calibration, gravity: Array | None) -> Array:
    """Std (6,) of a sample, or what compensation leaves (n, 6) of a recording of a free tool."""
    from ..compensate.contact_wrenches import motion_of
    from ..estimation.in_motion import as_stamped

    stated = options.noise_or_file(text, "a free tool")
    if not isinstance(stated, Path):
        return stated
    beside = recording.beside(stated)
    alike = beside.as_calibrated(calibration, gravity)
    there = alike.calibration.with_gravity(gravity)
    free = as_stamped(replace(beside, options=alike.options).read(), there)
    motion = motion_of(there, free)
    left = there.compensate(free.wrench, free.R_base_flange, motion=motion)
    return left if motion is None else left[motion.inside]
