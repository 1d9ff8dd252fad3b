"""The flags that say what is known of a tool beside the recording, and which of them go together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import typer

from ..geometry.arrays import Array
from ..geometry.orientation import nearest_rotations

KNOWN_HELP = (
    "What is known, with its std; may be repeated. weight=N, mass=KG, com=X,Y,Z (m) or com_mm=X,Y,Z (sensor axes), "
    "mount=A,B,C (deg, Rz(A) Ry(B) Rx(C)) or nine numbers row by row (R_flange_sensor), gravity=X,Y,Z (base axes); the "
    "std of the last two in deg. Example: weight=12.3+-0.1"
)
FORMS = {
    "weight": (1,),
    "mass": (1,),
    "com": (3,),
    "com_mm": (3,),
    "mount": (3, 9),
    "gravity": (3,),
}


def known_values(flags: list[str], g: float) -> dict[str, tuple[Any, Any]]:
    """What `--known` flags say, as `calibrate` takes it: SI units, the mounting a matrix, std of angles in rad."""
    known: dict[str, tuple[Any, Any]] = {}
    for flag in flags:
        name, value, std = _parsed(flag)
        quantity, pair = _in_si(name, value, std, g)
        if quantity in known:
            raise typer.BadParameter(f"--known says {quantity} twice, expected once: leave one out")
        known[quantity] = pair
    return known


def require_compatible(
    model: str,
    gravity: str | None,
    known: list[str],
    prior: Path | None,
    mount_tilt_sd: float | None,
    base_tilt_sd: float | None,
) -> None:
    """Raise typer's error for flags that contradict each other, by name."""
    tilts = {"--mount-tilt-sd": mount_tilt_sd, "--base-tilt-sd": base_tilt_sd}
    for flag, value in tilts.items():
        if value is not None and model != "auto":
            raise typer.BadParameter(f"{flag} is for model auto, found --model {model}: leave one of them out")
        if value is not None and prior is not None:
            raise typer.BadParameter(
                f"--prior brings its own mounting and base, found {flag} too: leave one of them out"
            )
    gravity_known = any(flag.partition("=")[0].strip() == "gravity" for flag in known)
    if prior is not None and model != "auto":
        raise typer.BadParameter(f"--prior brings its model, found --model {model}: leave one of them out")
    if prior is not None and (gravity is not None or gravity_known):
        raise typer.BadParameter("--prior brings its gravity, found another one: leave one of them out")
    if gravity is not None and gravity_known:
        raise typer.BadParameter("--gravity and --known gravity both state it: leave one of them out")
    if known and model in ("paper", "affine"):
        raise typer.BadParameter(f"model {model} takes nothing as known, found --known: leave one of them out")
    if gravity_known and model in ("yaw", "mount"):
        raise typer.BadParameter(f"model {model} holds gravity, found --known gravity: take --model auto or mount+base")


def _parsed(flag: str) -> tuple[str, Array, Array]:
    name, _, rest = flag.partition("=")
    value, _, std = rest.partition("+-")
    name = name.strip()
    try:
        numbers, spread = (np.array([float(part) for part in text.split(",")]) for text in (value, std))
    except ValueError:
        numbers = spread = np.empty(0)
    finite = np.isfinite(numbers).all() and np.isfinite(spread).all()
    stds = (1, 3) if name in ("com", "com_mm", "mount") else (1,)
    whole = name in FORMS and len(numbers) in FORMS[name] and len(spread) in stds
    if not (whole and finite and (spread > 0.0).all()):
        raise typer.BadParameter(
            f"found --known {flag!r}, expected NAME=VALUE+-STD with a std above 0, as in weight=12.3+-0.1 or "
            f"com_mm=0,0,50+-2; names: {', '.join(FORMS)}"
        )
    return name, numbers, spread if len(spread) == 3 else np.full(3, spread[0])


def _in_si(name: str, value: Array, std: Array, g: float) -> tuple[str, tuple[Any, Any]]:
    """The quantity's name and its value and std in SI units."""
    if name == "weight":
        return name, (float(value[0]), float(std[0]))
    if name == "mass":
        return "weight", (g * float(value[0]), g * float(std[0]))
    if name in ("com", "com_mm"):
        per_metre = 1e3 if name == "com_mm" else 1.0
        return "com", (value / per_metre, std / per_metre)
    if name == "gravity":
        return name, (value, float(np.deg2rad(std[0])))
    if len(value) == 9:
        return name, (nearest_rotations(value.reshape(1, 3, 3))[0], np.deg2rad(std))
    from scipy.spatial.transform import Rotation

    return name, (Rotation.from_euler("ZYX", value, degrees=True).as_matrix(), np.deg2rad(std))
