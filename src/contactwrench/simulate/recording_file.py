"""A recording of the rig as files: the standard input CSV, and beside it what was true."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from ..files import write_text
from ..geometry.arrays import Array
from .recording import Recorded

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
COLUMNS = (
    *("t", *AXES, "qx", "qy", "qz", "qw", "x", "y", "z", "load_g"),
    *(f"q{k}" for k in range(1, 8)),
    *(f"tau{k}" for k in range(1, 8)),
    "saturated",
)
"""s; N and N m; the flange's orientation and position (m) in base axes; g; joints, rad; joint torques, N m; 1 where a
channel of the sensor stands at its limit."""
FORMAT = ",".join(["%.6f"] * 7 + ["%.12f"] * 4 + ["%.9f"] * 3 + ["%g"] + ["%.9f"] * 7 + ["%.6f"] * 7 + ["%d"]) + "\n"
TRUTH_SCHEMA = "contactwrench/truth/1"


def truth_path(path: Path) -> Path:
    """`OUT.truth.json` beside `OUT.csv`."""
    return path.with_suffix(".truth.json")


def write_recording(path: Path, recorded: Recorded, command: dict[str, object]) -> None:
    """Write the recording to `path`, and its truth beside it; `command` says how it was asked for.

    Same recording, same bytes. Raises `FileAccessError`.
    """
    write_truth(path, recorded, command)
    write_text(path, _rows(recorded))


def write_truth(path: Path, recorded: Recorded, command: dict[str, object]) -> None:
    """Write what was true beside the recording at `path`, under the names of a calibration file, with the settings.

    `bias` is the setting; where it drifts, `settings.sensor.drift` says how. `saturated` counts rows a channel;
    `pushes` are forces on the tool's hook, N, base axes. Raises `FileAccessError`.
    """
    settings, tool = recorded.settings, recorded.settings.tool
    values = {
        "schema": TRUTH_SCHEMA,
        "weight": tool.mass * settings.gravity,
        "mass": tool.mass,
        "com": tool.com,
        "bias": settings.sensor.bias,
        "R_flange_sensor": settings.R_flange_sensor.tolist(),
        "gravity_direction": (settings.gravity_direction + 0.0).tolist(),
        "saturated": dict(zip(AXES, recorded.saturated.sum(axis=0).tolist(), strict=True)),
        "pushes": [vars(push) | {"force": push.force.tolist()} for push in recorded.pushes],
        "command": command,
        "settings": msgspec.to_builtins(settings),
    }
    write_text(truth_path(path), msgspec.json.format(msgspec.json.encode(values), indent=2).decode() + "\n")


def _rows(recorded: Recorded) -> Iterator[str]:
    from scipy.spatial.transform import Rotation

    quat_xyzw: Array = Rotation.from_matrix(recorded.R_base_flange).as_quat(canonical=True)
    pose = [recorded.t, recorded.wrench, quat_xyzw, recorded.position, 1000.0 * recorded.load_mass]
    at_joints = [recorded.joints, recorded.joint_torque]
    table: Array = np.column_stack([*pose, *at_joints, recorded.saturated.any(axis=1)])
    yield ",".join(COLUMNS) + "\n"
    for row in (table + 0.0).tolist():
        yield FORMAT % tuple(row)
