"""Several recordings of `calibrate` at once: which flags go together, where each result goes, how they print."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..errors import FileAccessError
from ..files import STDOUT, require_distinct

if TYPE_CHECKING:
    from ..calibration.calibration import Calibration


def shared_names(
    files: list[Path], shared: str | None, model: str, known: list[str], prior: Path | None, report: Path | None
) -> tuple[str, ...]:
    """What --shared names; nothing for one file without it. Raises `InputError`, and typer's error for flags that do
    not go together, by name.
    """
    if shared is None:
        if len(files) > 1:
            raise typer.BadParameter(f"found {len(files)} files, expected one, or --shared mount,gravity")
        return ()
    from ..estimation.shared_rotations import require_shareable

    for flag, value in (("--prior", prior), ("--report", report)):
        if value is not None:
            raise typer.BadParameter(f"{flag} is for one file, found --shared too: leave one of them out")
    names = tuple(name.strip() for name in shared.split(","))
    require_shareable(len(files), names, model, {flag.partition("=")[0].strip(): flag for flag in known})
    real: dict[str, Path] = {}
    for file in files:
        first = real.setdefault(os.path.realpath(file), file)
        if first is not file:
            raise typer.BadParameter(f"found {file} twice, expected a recording of each tool: leave one out")
    return names


def output_files(files: list[Path], folder: Path | None) -> list[Path | None]:
    """`folder`/NAME.json for each recording NAME.csv; Nones where nothing, or standard output, is named.

    Raises `FileAccessError` for a folder that is none, for two recordings of one name, and for an output that is read.
    """
    if folder is None or str(folder) == STDOUT:
        return [None] * len(files)
    if folder.exists() and not folder.is_dir():
        raise FileAccessError(f"{folder}: found a file, expected a folder for {len(files)} calibrations: name one")
    targets: list[Path | None] = [folder / f"{file.stem}.json" for file in files]
    for k, target in enumerate(targets):
        if target in targets[:k]:
            raise FileAccessError(
                f"{target}: found two recordings named {files[k].stem}, expected different names: rename one, or leave "
                "--output out"
            )
        require_distinct(target, {f"recording {file} that is read": file for file in files})
    return targets


def json_of(calibrations: tuple[Calibration, ...]) -> str:
    """The saved forms, a JSON array."""
    from ..calibration.file import to_json

    return "[\n" + ",\n".join(to_json(calibration).rstrip("\n") for calibration in calibrations) + "\n]\n"
