"""Measured recordings: the one that the package carries, and those whose licences keep them out, where at hand."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import contactwrench as cw

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def measured_sets() -> dict[str, cw.Samples]:
    """The sets that are at hand, sensor axes, by robot and sensor."""
    sets = {"Panda, Mini45": cw.read(str(files("contactwrench") / "data" / "panda_mini45.csv"))}
    kuka, axia = SHARED / "kuka_atigamma" / "0-calibration_fts-accel.csv", SHARED / "axia80_7"
    if kuka.exists():
        sets["KUKA, Gamma"] = cw.read(kuka)
    if axia.exists():
        R = Rotation.from_quat(np.loadtxt(axia / "pose.txt", delimiter=",")[:, 3:]).as_matrix()
        in_base = np.loadtxt(axia / "wrench.txt", delimiter=",")
        wrench = np.hstack([np.einsum("nji,nj->ni", R, part) for part in (in_base[:, :3], in_base[:, 3:])])
        sets["Axia80"] = cw.Samples(wrench, R)
    return sets
