"""`rig://`: the virtual rig as a source, whose readings at rest are those of its true tool."""

from __future__ import annotations

from time import monotonic

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.live.uri import source_of
from contactwrench.simulate.settings import Settings
from tests.support.world import Rig, readings

pytest.importorskip("mujoco")


def true_rig() -> Rig:
    settings = Settings()
    tool, bias = settings.tool, np.array(settings.sensor.bias)
    weight = tool.mass * settings.gravity
    return Rig(weight, np.array(tool.com), bias, settings.R_flange_sensor, settings.gravity_direction)


def test_it_reads_its_tool_at_its_rate() -> None:
    with cw.live.open("rig://?seed=4") as stream:
        assert (stream.about.name, stream.about.rate) == ("virtual rig", 1000.0)
        batches = []
        begun = monotonic()
        for batch in stream:
            batches.append(batch)
            if monotonic() - begun > 1.0:
                break
    wrench = np.vstack([batch.wrench for batch in batches])
    device = np.concatenate([batch.device for batch in batches])
    assert np.diff(device) == pytest.approx(1e-3, abs=1e-9)
    assert len(device) > 700
    orientation = np.vstack([batch.orientation for batch in batches])
    known = np.isfinite(orientation).all(axis=1)
    assert 100 < known.sum() <= 260
    R = Rotation.from_quat(orientation[known]).as_matrix()
    off = wrench.mean(axis=0) - readings(true_rig(), R).mean(axis=0)
    assert np.abs(off[:3]).max() < 0.2
    assert np.abs(off[3:]).max() < 0.02


def test_another_seed_is_other_noise_and_a_closed_one_gives_nothing() -> None:
    one, other = source_of("rig://?seed=1"), source_of("rig://?seed=2")
    first = []
    for source in (one, other):
        source.open()
        while not (batch := source.read(0.1)).samples:
            pass
        first.append(batch.samples[0].wrench)
        source.close()
        assert source.read(10.0).samples == []
    assert first[0] != first[1]


def test_its_options_are_checked() -> None:
    with pytest.raises(InputError, match=r"^rig://\?seed=x: found seed=x, expected a whole number: correct the URI$"):
        source_of("rig://?seed=x")
    with pytest.raises(InputError, match="speed"):
        source_of("rig://?speed=2")
    message = r"^rig://here:1: found an address, expected none as the rig is in this program: rig://\[\?seed=N\]$"
    with pytest.raises(InputError, match=message):
        source_of("rig://here:1")
