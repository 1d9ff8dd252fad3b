"""What the tests of the experiment's parts share: a rig without noise, and a pool of one thread."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import contactwrench as cw
from contactwrench.geometry.arrays import Array
from contactwrench.simulate.settings import Noise, Settings
from reproduction import charts, force_chart, joint_torque_figure
from reproduction.part import Measured, Part
from reproduction.trials import DEFAULT, recordings

PRECISE = 1e-5
"""N and N m: what the sensor's filter leaves of the pose before, 50 ms later, is some 1e-6 of it."""


def noise_free(settings: Settings = DEFAULT) -> Settings:
    sensor = replace(settings.sensor, noise=Noise((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), quantum=0.0)
    return replace(settings, sensor=sensor)


def recorded(settings: Settings, joints: Array, seed: int = 1) -> cw.Samples:
    return next(recordings(settings, joints, [np.random.default_rng(seed)]))


def one_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)


@contextmanager
def undrawn() -> Iterator[None]:
    """A part's charts are made and not drawn: where only figures and words are looked at."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (charts, force_chart, joint_torque_figure):
            patch.setattr(module, "svg_text", lambda _: "<svg></svg>")
        yield


def figures(part: Part) -> list[float]:
    """Every figure of a part, in order."""
    return [
        number
        for table in part.tables
        for _, cells in table.rows
        for cell in cells
        if isinstance(cell, Measured)
        for number in (cell.value, cell.standard_error or 0.0)
    ]


def cell(part: Part, table: str, row: str, column: str) -> Measured:
    """One figure, by the names that the JSON has."""
    found = next(one for one in part.tables if one.key == table)
    value = dict(found.rows)[row][found.columns.index(column)]
    assert isinstance(value, Measured)
    return value
