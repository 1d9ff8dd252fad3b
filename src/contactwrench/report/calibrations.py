"""Recordings to calibrations as files: fitted, saved, reported, and held to the accuracy that is required."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..calibration.calibration import Calibration
from ..calibration.file import to_json
from ..calibration.findings import Kind
from ..calibration.text import describe, verdict_sentences
from ..errors import FileAccessError, InputError
from ..files import STDOUT, make_folder
from ..samples.samples import Samples
from ..statistics import meaningful_digits


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The calibrations of recordings, what each `missed` of the accuracy and of the mass that were required (an empty
    text: nothing), and what was `written` where, unless a bad fit was `held_back`: it says what would write it.
    """

    calibrations: tuple[Calibration, ...]
    missed: tuple[tuple[str, str], ...]
    written: tuple[tuple[str, Path], ...]
    held_back: str = ""

    @property
    def text(self) -> str:
        """For people: a sentence is one line."""
        return "\n\n".join(map(describe, self.calibrations, map(_joined, self.missed)))

    def failures(self, strict: bool) -> list[str]:
        """Why the check fails, a line each: a bad fit; an accuracy or a mass that is missed; with `strict`, a verdict
        that is not good.
        """
        badly: dict[str, list[str]] = {}
        for c in self.calibrations:
            for why in _bad_fit(c):
                badly.setdefault(why, []).append(str(c.provenance["source"]))
        lines = []
        for why, files in badly.items():
            where = f"{', '.join(files)}: " if len(self.calibrations) > 1 else ""
            lines.append(f"{where}The fit is bad: {why}{self.held_back}")
        for c, (accuracy, mass) in zip(self.calibrations, self.missed, strict=True):
            where = f"{c.provenance['source']}: " if len(self.calibrations) > 1 else ""
            lines += [f"{where}Required accuracy missed: at a new orientation, {accuracy}"] if accuracy else []
            lines += [f"{where}Requirement missed: {mass}; contactwrench diagnose lists other units"] if mass else []
            if strict and c.verdict != "good":
                reasons = "; ".join(verdict_sentences(c)[1:-1]) or "see its warnings"
                lines.append(f"{where}The verdict is {c.verdict}, --strict expects good: {reasons}")
        return lines

    @property
    def json(self) -> str:
        """The saved form; of several a JSON array."""
        forms = [to_json(calibration) for calibration in self.calibrations]
        return forms[0] if len(forms) == 1 else "[\n" + ",\n".join(form.rstrip("\n") for form in forms) + "\n]\n"


def calibrate_recordings(
    files: Sequence[Path],
    read: Callable[[Path], Samples],
    shared: tuple[str, ...],
    stated: Mapping[str, Any],
    *,
    output: Path | None,
    report: Path | None,
    required: tuple[float | None, float | None],
    required_mass: tuple[float, float] | None,
    force: bool,
) -> Calibrated:
    """Calibrate one recording, or one of each tool where they have something `shared` (mount, gravity), save it to the
    `output`, then a folder, and write a `report`. Where one fits badly none is saved without `force`, and with it never
    in place of a file that is there. `read` gives the samples of a file, `stated` are the arguments of `calibrate` or
    `calibrate_shared`; `required`: the most error of force, N, and torque, N m, to be expected at a new orientation,
    and between which two masses, kg, the mass is to lie by its std. Raises as reading, fitting and writing do.
    """
    paths = output_files(files, output, bool(shared))
    recordings = [read(file) for file in files]
    bases = list(dict.fromkeys(str(r.read_as["base_frame"]) for r in recordings if "base_frame" in r.read_as))
    if "gravity" in shared and len(bases) > 1:
        raise InputError(f"found orientations in {' and in '.join(bases)}, expected one base that the recordings share")
    if shared:
        from ..estimation.several_tools import calibrate_shared

        fitted = calibrate_shared(recordings, shared, **stated)
    else:
        from ..estimation.calibrate import calibrate

        fitted = (calibrate(recordings[0], **stated),)
    created = datetime.now(UTC).isoformat(timespec="seconds")
    calibrations = tuple(replace(c, provenance={**c.provenance, "created": created}) for c in fitted)
    held_back = _held_back(paths, force) if any(map(_bad_fit, calibrations)) else ""
    paths = [] if held_back else paths
    if shared and output is not None and paths:
        make_folder(output)
    for path, calibration in zip(paths, calibrations, strict=bool(paths)):
        calibration.save(path)
    written = [("calibration", path) for path in paths]
    missed = tuple((_missed(c, required), _mass_missed(c, required_mass)) for c in calibrations)
    if report is not None:
        from .html import write_calibration_report

        write_calibration_report(report, calibrations[0], recordings[0], _joined(missed[0]))
        written.append(("report", report))
    return Calibrated(calibrations, missed, tuple(written), held_back)


def output_files(files: Sequence[Path], output: Path | None, several: bool) -> list[Path]:
    """`output`, or of several `output`/NAME.json for each recording NAME.csv; nothing for stdout.

    Raises `FileAccessError` for a folder that is none, and for two recordings of one name.
    """
    if output is None or str(output) == STDOUT:
        return []
    if not several:
        return [output]
    if os.path.lexists(output) and not os.path.isdir(output):
        raise FileAccessError(f"{output}: found a file, expected a folder for {len(files)} calibrations: name one")
    targets = [output / f"{file.stem}.json" for file in files]
    for k, target in enumerate(targets):
        if target in targets[:k]:
            raise FileAccessError(
                f"{target}: found two recordings named {files[k].stem}, expected different names: rename one, or leave "
                "--output out"
            )
    return targets


def _held_back(paths: Sequence[Path], force: bool) -> str:
    """Why bad fits are not written to `paths`, and what to do; nothing where they are. Of several none is."""
    several = len(paths) > 1
    if paths and not force:
        return f"; not written, --force writes {'all' if several else 'it'}"
    there = next((path for path in paths if path.is_file() and path.stat().st_size), None)
    if there is None:
        return ""
    if several:
        return f"; what is in {there.parent} stays as it was: with --force all are written to a new folder"
    return f"; {there} stays as it was: with --force it is written to a new name"


def _missed(calibration: Calibration, required: tuple[float | None, float | None]) -> str:
    """Which of the required accuracies is missed, and by how much."""
    judged = zip(("force", "torque"), calibration.expected_error, required, ("N", "N m"), strict=True)
    return " and ".join(
        f"{name} {value:.3g} {unit} over {limit:g}"
        for name, value, limit, unit in judged
        if limit is not None and not value <= limit
    )


def _mass_missed(c: Calibration, required: tuple[float, float] | None) -> str:
    """What the mass is, where it does not surely lie inside what is required."""
    if required is None or c.mass is None or c.std["weight"] is None:
        return ""
    (low, high), std = required, c.std["weight"] / c.g
    inside = low <= c.mass - std and c.mass + std <= high
    return "" if inside else f"mass {' +- '.join(meaningful_digits(c.mass, std))} kg, expected {low:g} to {high:g}"


def _joined(missed: tuple[str, str]) -> str:
    return " and ".join(filter(None, missed))


def _bad_fit(c: Calibration) -> list[str]:
    """Why a fit is bad: what was stated or recorded beside the readings comes before a file that is read wrongly."""
    of_kind = {finding.kind: finding for finding in reversed(c.findings)}
    if not (poor := of_kind.get(Kind.POOR_FIT)):
        return []
    if others := of_kind.get(Kind.CONTRADICTS_OTHERS):
        return [
            f"{others.said}; what fits badly apart too may be read wrongly: contactwrench diagnose tries the other ways"
        ]
    if known := of_kind.get(Kind.CONTRADICTS_KNOWN) or of_kind.get(Kind.CONTRADICTS_PRIOR):
        both = f"{poor.brief}: {known.said}"
        return [f"{both}; if it is the readings, contactwrench diagnose tries the other ways to read the file"]
    return [poor.said]
