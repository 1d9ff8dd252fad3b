"""What parameters and a calibration's provenance both say: the same, or one line; and what the node's own remembers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import contactwrench as cw
from contactwrench.errors import InputError
from contactwrench.recording.options import remembered
from contactwrench_ros.session import Session
from tests.ros2.free_tool import WEIGHT, free, quat, save_calibration, second, settings


def another(frame: str, name: str, own: str) -> str:
    return (
        f"{frame} is {name}, expected {own} as for the calibration: set it so (where tf has no {own}, a static "
        "transform gives that name to the same place), or calibrate anew"
    )


@pytest.mark.parametrize(
    ("own", "stated", "sign"),
    [
        ("", "", "pull"),
        ("", "reaction", "reaction"),
        ("pull", "", "pull"),
        ("pull", "pull", "pull"),
        ("reaction", "", "reaction"),
        ("reaction", "reaction", "reaction"),
    ],
)
def test_the_sign_is_the_calibrations(own: str, stated: str, sign: str, tmp_path: Path) -> None:
    path = save_calibration(tmp_path / "tool.json", **({"sign": own} if own else {}))
    session = Session(settings(calibration=path, sign=stated))
    R = Rotation.random(random_state=2)
    session.orientations.hear(1.0, quat(R))
    found = session.read(1.0, free(R) * (-1.0 if sign == "reaction" else 1.0))
    assert found == pytest.approx(np.zeros(6), abs=1e-3)


@pytest.mark.parametrize(("own", "stated"), [("pull", "reaction"), ("reaction", "pull")])
def test_another_sign_is_taken_and_said(own: str, stated: str, tmp_path: Path) -> None:
    """The calibration may be of a file in which another program had turned the readings."""
    path = save_calibration(tmp_path / "tool.json", sign=own)
    session = Session(settings(calibration=path, sign=stated))
    assert session.note == f"sign is {stated}, and was {own} for the calibration"
    assert Session(settings(calibration=path, sign="")).note is None
    R = Rotation.random(random_state=2)
    session.orientations.hear(1.0, quat(R))
    found = session.read(1.0, free(R) * (-1.0 if stated == "reaction" else 1.0))
    assert found == pytest.approx(np.zeros(6), abs=1e-3)


def test_another_flange_is_refused(tmp_path: Path) -> None:
    path = save_calibration(tmp_path / "tool.json", frames="base_link,tool0")
    with pytest.raises(InputError) as refused:
        Session(settings(calibration=path, flange_frame="flange"))
    assert str(refused.value) == another("flange_frame", "flange", "tool0")


@pytest.mark.parametrize(
    ("frames", "changes"),
    [
        ("base_link,tool0", {"flange_frame": "tool0"}),
        ("/base_link,/tool0", {"flange_frame": "/tool0"}),
        ("base_link,tool0", {"flange_frame": "flange", "pose_source": "pose"}),
        ("base_link,tool0", {"flange_frame": "flange", "pose_source": "joints", "urdf": "ur5e"}),
        ("", {"flange_frame": "flange"}),
    ],
)
def test_the_same_flange_or_none_that_is_known_is_taken(frames: str, changes: dict[str, Any], tmp_path: Path) -> None:
    path = save_calibration(tmp_path / "tool.json", **({"frames": frames} if frames else {}))
    assert Session(settings(calibration=path, **changes)).note is None


def tilted(path: Path, base_frame: str) -> str:
    """A calibration whose base is no upright one."""
    made = cw.Calibration.load(save_calibration(path, base_frame=base_frame))
    tilted = made.with_gravity([0.0, 0.6, -0.8])
    tilted.save(path)
    return str(path)


def test_another_base_is_refused_turned_or_taken_for_the_same(tmp_path: Path) -> None:
    path = tilted(tmp_path / "tool.json", "base_link")
    assert Session(settings(calibration=path)).note is None
    with pytest.raises(InputError) as refused:
        Session(settings(calibration=path, base_frame="/table"))
    assert str(refused.value) == another("base_frame", "table", "base_link")
    nameless = Session(settings(calibration=tilted(tmp_path / "tool.json", ""), base_frame="table"))
    assert nameless.note == "the calibration does not name its base: taken to be table"
    turned = Session(settings(calibration=tilted(tmp_path / "tool.json", "ur5e base")))
    assert turned.note == (
        "orientations are in base_link, half a turn about z from the calibration's ur5e base: it was turned into that"
    )


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"sign": "reaction"}, {"sign": "reaction", "frames": ("base_link", "tool0")}),
        ({"flange_frame": "/flange"}, {"sign": "pull", "frames": ("base_link", "flange")}),
        ({"pose_source": "pose"}, {"sign": "pull", "pose_topic": "/pose"}),
        (
            {"pose_source": "joints", "urdf": "ur5e"},
            {"sign": "pull", "pose_topic": "/joint_states", "robot": "ur5e"},
        ),
    ],
)
def test_what_the_node_calibrates_remembers_how_it_was_read(
    changes: dict[str, Any], expected: dict[str, Any], tmp_path: Path
) -> None:
    """As `calibrate` has it of a bag, and the node takes it back."""
    stated = settings(save_to=str(tmp_path / "cal.json"), wrench_topic="/ft", **changes)
    session = Session(stated)
    session.start()
    turned = -1.0 if stated["sign"] == "reaction" else 1.0
    for seed in range(7):
        assert session.gather() is None
        second(session, Rotation.random(random_state=seed), 10.0 + 10.0 * seed, seed=seed, turned=turned)
        assert session.capture().success
    assert session.status(1.0).values["calibration"] == "none"
    assert session.finish().success
    assert session.status(1.0).values["calibration"] == str(tmp_path / "cal.json")
    made = cw.Calibration.load(tmp_path / "cal.json")
    assert made.weight == pytest.approx(WEIGHT, abs=0.01)
    assert made.provenance["base_frame"] == "base_link"
    usual = {"wrench_frame": "sensor", "inverse_orientation": False, "wrench_topic": "/ft"}
    assert remembered(made.provenance) == usual | expected
    again = Session({**stated, "sign": "", "calibration": str(tmp_path / "cal.json")})
    assert again.options.sign == expected["sign"]
