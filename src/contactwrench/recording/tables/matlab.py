"""Arrays of MATLAB in HDF5, a MAT-file of version 7.3: their dimensions in the order of MATLAB, the other way round.

A matrix W(n, 6) of MATLAB is a dataset (6, n), and R(3, 3, n) one (n, 3, 3) of transposed rotations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

OLD = b"MATLAB 5.0"
"""How a MAT-file before version 7.3 begins."""
CLASSES = {
    b"double",
    b"single",
    b"logical",
    *(f"{sign}int{size}".encode() for sign in ("", "u") for size in (8, 16, 32, 64)),
}
"""Of numbers. Those of letters, cells and tables are numbers too that stand for something else."""


def is_of_matlab(item: Any) -> bool:
    """Whether MATLAB wrote a dataset."""
    return "MATLAB_class" in getattr(item, "attrs", ())


def holds_none(item: Any) -> bool:
    """Whether the numbers of a dataset of MATLAB stand for something else, as the size of an empty array does."""
    return is_of_matlab(item) and ("MATLAB_empty" in item.attrs or item.attrs["MATLAB_class"] not in CLASSES)


class OfMatlab:
    """A dataset of MATLAB as one of h5py whose rows come first, (n, ...): its longest dimension. `shape` is None where
    two are as long, and nobody can tell.
    """

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset
        sizes = dataset.shape[::-1]
        self._rows = sizes.index(max(sizes))
        chunks = dataset.chunks
        self.chunks = None if chunks is None else self._rows_first(chunks[::-1])
        self.shape = self._rows_first(sizes) if sizes.count(max(sizes)) == 1 else None

    def _rows_first(self, sizes: tuple[int, ...]) -> tuple[int, ...]:
        return sizes[self._rows], *sizes[: self._rows], *sizes[self._rows + 1 :]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._dataset, name)

    def __len__(self) -> int:
        return int(max(self._dataset.shape))

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        before = (slice(None),) * (self._dataset.ndim - 1 - self._rows)
        return np.moveaxis(np.asarray(self._dataset[(*before, rows)]).T, self._rows, 0)
