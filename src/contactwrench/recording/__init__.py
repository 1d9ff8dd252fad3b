"""Files to Samples and back, the format chosen by the file's suffix."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..errors import FileFormatError, InputError
from ..samples import Samples
from .csv import read_csv

SUFFIXES_OF_TEXT = {".csv", ".tsv", ".txt", ".dat", ""}


def read(
    path: str | Path,
    orientation: str = "auto",
    wrench_frame: str = "sensor",
    sign: str = "pull",
    *,
    inverse_orientation: bool = False,
) -> Samples:
    """Read a recording: wrench in N and N m, sensor axes, pull sign; orientations of `R_base_flange`.

    `orientation`: auto (by the columns' names) or `NAME[:COLUMNS]`, see orientation.py. `wrench_frame`: sensor, or
    base where the controller turns the wrench into base axes; it is turned back by `R_base_flange`, so that it comes
    in the flange's axes. `sign`: pull (what acts on the sensor), or reaction (what the sensor exerts), which is
    negated. `inverse_orientation`: the file holds `R_flange_base`. Raises `FileAccessError`, `FileFormatError` and
    `InputError`.
    """
    require_readable(path, wrench_frame, sign)
    table = read_csv(path, orientation)
    R = table.orientation.transpose(0, 2, 1) if inverse_orientation else table.orientation
    wrench = -table.wrench if sign == "reaction" else table.wrench
    if wrench_frame == "base":
        wrench = np.concatenate(
            [np.einsum("nij,ni->nj", R, wrench[:, :3]), np.einsum("nij,ni->nj", R, wrench[:, 3:])], axis=1
        )
    source = os.fsencode(path).decode(errors="replace")
    try:
        return Samples(wrench, R, table.t, table.position, table.load_mass, source)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None


def require_readable(path: str | Path, wrench_frame: str, sign: str) -> None:
    """Raise `InputError` for arguments that `read` does not know, `FileFormatError` for a suffix that it does not."""
    for name, value, known in (
        ("wrench_frame", wrench_frame, ("sensor", "base")),
        ("sign", sign, ("pull", "reaction")),
    ):
        if value not in known:
            raise InputError(f"{name} is {value!r}, expected {' or '.join(known)}")
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES_OF_TEXT:
        raise FileFormatError(f"{path}: found the suffix {suffix}, expected .csv: export the recording as CSV")
