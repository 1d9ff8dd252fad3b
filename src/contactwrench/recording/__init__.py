"""Files to Samples and Streams and back, the format chosen by the file's suffix."""

from __future__ import annotations

from pathlib import Path

from ..samples import Samples
from .layout import Layout
from .streaming import batches, pairs_in_batches, read_samples, read_streams

__all__ = ["Layout", "batches", "pairs_in_batches", "read", "read_samples", "read_streams"]


def read(
    path: str | Path,
    orientation: str = "auto",
    wrench_frame: str = "sensor",
    sign: str = "pull",
    *,
    inverse_orientation: bool = False,
    pose_file: str | Path | None = None,
    wrench_topic: str | None = None,
    pose_topic: str | None = None,
    frames: tuple[str, str] | None = None,
    robot: str | None = None,
) -> Samples:
    """Read a recording: wrench in N and N m, sensor axes, pull sign; orientations of `R_base_flange`.

    `path`: a table (CSV, Parquet) of wrenches and orientations, or of wrenches alone where `pose_file` has the
    orientations, or a bag. `orientation`: auto (by the columns' names) or `NAME[:COLUMNS]`, see orientation.py.
    `wrench_frame`: sensor, or base where the controller turns the wrench into base axes; it is turned back by
    `R_base_flange`, so that it comes in the flange's axes. `sign`: pull (what acts on the sensor), or reaction (what
    the sensor exerts), which is negated. `inverse_orientation`: the file holds `R_flange_base`. Of a bag:
    `wrench_topic` and `pose_topic`; `frames` (base, flange); `robot`, whose joint angles it has: a known arm's name, or
    a URDF as PATH[:LINK].

    Where a wrench lacks an orientation of its own, one is interpolated, after the delay between the two was estimated.
    Raises `FileAccessError`, `FileFormatError`, `InputError` and `MissingExtraError`.
    """
    layout = Layout(
        orientation,
        wrench_frame,
        sign,
        inverse_orientation,
        wrench_topic,
        pose_topic,
        frames,
        robot,
        None if pose_file is None else Path(pose_file),
    )
    return read_samples(path, layout)
