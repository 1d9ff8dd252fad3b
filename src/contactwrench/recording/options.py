"""How a recording is written: what the reading flags say of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import FileFormatError, InputError
from .bags import open as bag_files
from .bags.open import SUFFIXES_OF_BAGS
from .tables.parquet import SUFFIXES as SUFFIXES_OF_PARQUET
from .tables.parquet import is_parquet

SUFFIXES_OF_TEXT = (".csv", ".tsv", ".txt", ".dat", "")


@dataclass(frozen=True)
class Layout:
    """How a recording is written.

    `orientation`: auto (by the columns' names) or `NAME[:COLUMNS]`, see orientation.py. `wrench_frame`: sensor, or base
    where the controller turns the wrench into base axes. `sign`: pull (what acts on the sensor), or reaction.
    `inverse_orientation`: the file holds `R_flange_base`. `pose_file`: the second of two tables, which has the
    orientations. Of a bag: `wrench_topic` and `pose_topic`; `frames`, (base, flange) in a tree of transforms; `robot`,
    whose joint angles it has: a known arm's name, or a URDF as PATH[:LINK]. Raises `InputError` for a `wrench_frame`
    and a `sign` that are none.
    """

    orientation: str = "auto"
    wrench_frame: str = "sensor"
    sign: str = "pull"
    inverse_orientation: bool = False
    wrench_topic: str | None = None
    pose_topic: str | None = None
    frames: tuple[str, str] | None = None
    robot: str | None = None
    pose_file: Path | None = None

    def __post_init__(self) -> None:
        for name, value, known in (
            ("wrench_frame", self.wrench_frame, ("sensor", "base")),
            ("sign", self.sign, ("pull", "reaction")),
        ):
            if value not in known:
                raise InputError(f"{name} is {value!r}, expected {' or '.join(known)}")


AS_USUAL = Layout()


def is_bag(path: str | Path, layout: Layout = AS_USUAL) -> bool:
    """Whether a recording is a bag: a file by its suffix, or a folder with metadata.yaml; else it is a table, or two.

    Raises `FileFormatError` for a suffix that is neither's, and `InputError` for what `layout` says of the other kind.
    """
    bag = _is_bag(Path(path))
    if layout.pose_file is not None and (bag or _is_bag(layout.pose_file)):
        raise InputError(
            f"{path if bag else layout.pose_file}: found a bag as one of two files, expected tables: give it alone"
        )
    of_the_other = (
        {"orientation": layout.orientation if layout.orientation != "auto" else None}
        if bag
        else {
            "wrench_topic": layout.wrench_topic,
            "pose_topic": layout.pose_topic,
            "frames": layout.frames,
            "robot": layout.robot,
        }
    )
    for name, value in of_the_other.items():
        if value is not None:
            kinds = ("a bag", "tables") if bag else ("a table", "bags")
            raise InputError(f"{path}: found {kinds[0]}, and {name} {value}, which is for {kinds[1]}: leave it out")
    return bag


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return not is_parquet(path) and bag_files.is_bag(path)
    suffix = path.suffix.lower()
    if suffix not in (*SUFFIXES_OF_TEXT, *SUFFIXES_OF_PARQUET, *SUFFIXES_OF_BAGS):
        raise FileFormatError(
            f"{path}: found the suffix {suffix}, expected .csv, .parquet, .bag, .db3 or .mcap: export the recording as "
            "one of them"
        )
    return bag_files.is_bag(path)
