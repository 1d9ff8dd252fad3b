"""Data sets of LeRobot, version 2 or 3: `meta/info.json`, and an episode a file or many of them in
`data/chunk-*/*.parquet` (huggingface/lerobot, docs/source/lerobot-dataset-v3.mdx; the paths of version 2 are in
src/lerobot/datasets/v30/convert_dataset_v21_to_v30.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec

from ...files import read_bytes
from .batch import readable

INFO = Path("meta") / "info.json"


class _Info(msgspec.Struct):
    """Of `meta/info.json`, what each feature is."""

    features: dict[str, dict[str, Any]] = {}


def is_set(folder: Path) -> bool:
    """Whether a folder is such a set."""
    return (folder / INFO).is_file()


def in_set(folder: Path) -> Iterator[Path]:
    """The files in a set that may hold its rows."""
    return (folder / "data").glob("*/*")


def names_of_elements(folder: Path) -> dict[str, tuple[str, ...]]:
    """What the elements of each list in a set are, by the list's name; of a folder that is none, nothing. Raises
    `FileFormatError`.
    """
    if not is_set(folder):
        return {}
    with readable(str(folder / INFO), "JSON", (msgspec.DecodeError,)):
        features = msgspec.json.decode(read_bytes(folder / INFO), type=_Info).features
    found = {feature: _listed(described.get("names")) for feature, described in features.items()}
    return {feature: names for feature, names in found.items() if all(isinstance(name, str) for name in names)}


def _listed(names: Any) -> tuple[Any, ...]:
    """Names in their order, that are written as a list, as lists of several parts, or each with its place."""
    if isinstance(names, dict) and all(isinstance(place, int) for place in names.values()):
        return tuple(sorted(names, key=names.__getitem__))
    if isinstance(names, dict) and all(isinstance(part, list) for part in names.values()):
        return tuple(chain.from_iterable(names.values()))
    return tuple(names) if isinstance(names, list) else ()
