"""`contactwrench demo`: the main job on two measured sets that come with the package, and what the results mean."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..files import make_folder, write_text
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import gravity_in_flange
from . import options
from .outputs import Writes

if TYPE_CHECKING:
    from ..report.html import Section
    from ..samples.samples import Samples

SETS = ("panda_mini45", "paper_six_poses")
WRITTEN = ("report.html", *(f"{name}{end}" for name in SETS for end in (".csv", ".json", "_contact.csv")))
PANDA_MASS = 0.788
"""kg, as the set's authors found it (notebook of agimus-project/panda_ft_sensor_calibration, g = 9.81)."""
PRINTED_WEIGHT = 1.980
"""N, the paper's Table V."""


def demo(
    out: Path = options.text(
        "DIR",
        "Folder for calibrations, contact wrenches and report.",
        default=Path("contactwrench-demo"),
        mark=Writes(lambda folder, _: map(folder.joinpath, WRITTEN)),
    ),
) -> None:
    """Run the main job on two measured sets that come with the package, and say what the results mean."""
    from ..calibration.text import COLUMNS, describe
    from ..compensate.contact_wrenches import contact_wrenches
    from ..recording.read import read
    from ..recording.tables.write import write_contact_wrenches
    from ..report.html import write_report

    make_folder(out)
    sections = []
    for name, section_of in zip(SETS, (_panda, _paper), strict=True):
        recording = out / f"{name}.csv"
        write_text(recording, (files("contactwrench") / "data" / recording.name).read_text(encoding="utf-8"))
        samples = read(recording)
        section = section_of(samples)
        section.calibration.save(out / f"{name}.json")
        write_contact_wrenches(out / f"{name}_contact.csv", [contact_wrenches(section.calibration, samples)])
        title = f"{section.title}\n{'=' * len(section.title)}"
        for text in (title, describe(section.calibration), *section.paragraphs):
            options.say(f"{text}\n", elsewhere=COLUMNS)
        sections.append(section)
    write_report(
        out / "report.html",
        "From raw readings to contact wrenches: two measured sets",
        ("Both sets are contact-free: whatever is left after compensation is error.",),
        tuple(sections),
    )
    options.say(
        f"Wrote recordings (*.csv), calibrations (*.json), contact wrenches (*_contact.csv) and report.html to {out}"
    )


def _panda(samples: Samples) -> Section:
    from ..assess.verify import compare
    from ..estimation.calibrate import calibrate
    from ..report.html import Section

    calibration = calibrate(samples)
    full, tare, gravity_only, raw = (method.rms[0] for method in compare(calibration, calibration.fitted_poses))
    mass, std = calibration.mass or np.nan, calibration.std["weight"] / STANDARD_GRAVITY
    yaw = abs(np.rad2deg(calibration.yaw or np.nan))
    lean = np.rad2deg(np.arccos(-calibration.gravity_direction[2]))
    affine = next(other for other in calibration.alternatives if other.model == "affine")
    rigid = min(other.force_left for other in calibration.alternatives if other is not affine)
    heaviest, _, lightest = np.linalg.svd(affine.B[:3, :3], compute_uv=False)
    words = (
        f"A tool of {mass:.3f} +- {std:.3f} kg; the set's authors found {PANDA_MASS} kg by their own way. Nobody said "
        f"that the sensor is mounted flipped and turned by {yaw:.0f} deg, nor whether the base is level (it seems to "
        f"lean by about {lean:.0f} deg): the poses tell. What was assumed beforehand, and what other models make of "
        "the same poses, is listed with the result.",
        f"The warning is earned: along one axis this sensor shows the tool {100.0 * (1.0 - lightest / heaviest):.0f} % "
        "lighter than along another, which no rigid tool can. A force matrix of its own for each axis (affine) leaves "
        f"{affine.force_left:.2f} N in a pose, the best rigid model {rigid:.2f} N.",
        f"Nothing touches the tool, so the contact force should be zero. Left over, root mean square: {full:.2f} N "
        f"compensated, {tare:.1f} N with a tare in one pose, {gravity_only:.1f} N with gravity alone, {raw:.1f} N raw.",
    )
    return Section("Franka Panda with an ATI Mini45, 17 poses", words, calibration)


def _paper(samples: Samples) -> Section:
    from ..assess.verify import compare
    from ..estimation.calibrate import calibrate
    from ..report.html import Section

    calibration = calibrate(samples, "paper")
    by_model = {name: calibrate(samples, name) for name in ("auto", "yaw", "mount")}
    others = ", ".join(f"{name} {c.weight:.2f} +- {c.std['weight']:.2f} N" for name, c in by_model.items())
    tilt = np.rad2deg(calibration.observability.tilt_range)
    full, tare = (method.rms[0] for method in compare(calibration, calibration.fitted_poses)[:2])
    words = (
        f"The paper's six poses cannot fix the weight: gravity stays within {tilt[1]:.0f} deg of the flange's z, so "
        "the z rows hardly change, and weight and Fz bias trade off. The paper's estimator gives G_z = "
        f"{calibration.weight:.1f} +- {calibration.std['weight']:.1f} N from the z rows but G_xy = "
        f"{calibration.weight_xy:.2f} N from the others; its force regression has the condition number "
        f"{calibration.observability.condition:.0f}. Other models disagree: {others}.",
        f"Subtracting G_z on every axis, as Eq. 17 does, leaves {full:.1f} N in these very poses, more than a tare in "
        f"one pose does ({tare:.1f} N): with a weight that the data do not give, compensation does harm. The verdict "
        "says so before anyone pushes. Poses that tilt the tool by 90 deg would settle the weight.",
        "What holds of the printed tables: VII follows from VI, VIII from VI and V, Eq. 16 gives T0x and T0y of Table "
        f"V, and the error column of IX. What does not: Table V ({PRINTED_WEIGHT:.3f} N) does not follow from Tables "
        f"III and IV under any reading; the forces of poses 1 and 3 alone demand {_least_weight(samples):.2f} N or "
        "more. docs/reproduction.md has every figure, with the command that shows it.",
    )
    return Section("The paper's six poses, KUKA iiwa with an SRI M8125", words, calibration)


def _least_weight(samples: Samples) -> float:
    """The least weight (N) that poses 1 and 3 allow: forces differ by 2 G sin(phi / 2) at most, phi between downs."""
    r = gravity_in_flange(samples.R_base_flange, np.array([0.0, 0.0, -1.0]))
    return float(np.linalg.norm(samples.wrench[0, :3] - samples.wrench[2, :3]) / np.linalg.norm(r[0] - r[2]))
