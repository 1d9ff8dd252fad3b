"""Units beside the names, in a row below the header or in an HDF5 attribute; options find the names without them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import contactwrench as cw
from tests.recording.test_hdf5 import QUAT, stored
from tests.recording.test_tables import Motion
from tests.support.recordings import written

IN_NMM = Motion.wrench * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3]


@pytest.mark.parametrize("options", [{}, {"wrench_columns": "Fx,fy,Fz,Mx,My,Mz", "time_column": "Time"}])
def test_a_row_of_units_says_what_the_numbers_are(tmp_path: Path, options: dict[str, str]) -> None:
    numbers = np.column_stack([1e3 * Motion.t, IN_NMM, QUAT])
    head = ["Time;Fx;Fy;Fz;Mx;My;Mz;qx;qy;qz;qw", "[ms];[N];[N];[N];[Nmm];[N mm];[Nmm];[-];[-];[-];[-]"]
    rows = [";".join(f"{number:.12g}".replace(".", ",") for number in row) for row in numbers]
    found = cw.read(written(tmp_path, "\n".join([*head, *rows])), **options)  # type: ignore[arg-type]
    assert found.wrench == pytest.approx(Motion.wrench, rel=1e-11)
    assert found.t == pytest.approx(Motion.t, rel=1e-11)


@pytest.mark.parametrize(
    "options",
    [
        {"hdf5": "wrench=ft,pose=q,time=clock", "orientation": "quat_xyzw"},
        {"wrench_columns": "ft[0:6]", "orientation": "quat_xyzw:q[0:4]", "time_column": "clock"},
        {"wrench_columns": "ft[0] [N],ft[1],ft[2],ft[3],ft[4],ft[5] [nmm]", "orientation": "quat_xyzw:q[0:4]"},
    ],
)
def test_an_attribute_says_what_a_dataset_holds(tmp_path: Path, options: dict[str, str]) -> None:
    datasets = {"ft": (IN_NMM, {"units": "N, Nmm"}), "clock": (1e3 * Motion.t, {"units": "ms"}), "q": QUAT}
    found = cw.read(stored(tmp_path, datasets), **options)  # type: ignore[arg-type]
    assert found.wrench == pytest.approx(Motion.wrench, rel=1e-12)
    if "time_column" in options or "hdf5" in options:
        assert found.t == pytest.approx(Motion.t, rel=1e-12)
