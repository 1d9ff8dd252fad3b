"""What `auto` took for granted and what the readings overruled, a sentence each."""

from __future__ import annotations

import numpy as np

from ..model import RigidTool
from .auto import AutoFit
from .estimate import Question


def assumptions_in_words(auto: AutoFit, question: Question) -> tuple[str, ...]:
    """One sentence on the mounting, one on the base."""
    tool = auto.fit.tool
    if tool is None:
        raise TypeError("auto fits a rigid tool")
    side = "along" if tool.R_flange_sensor[2, 2] >= 0.0 else "against"
    tilt, lean = _tilt_of_mounting(tool), _angle(float(tool.gravity_direction @ question.gravity_direction))
    priors = question.priors
    if priors.mount is None:
        of_mounting = f"mounting: as known; sensor's z is found {tilt:.2f} deg off the flange's"
    elif auto.mounting_exact is None:
        of_mounting = f"mounting: sensor's z is {tilt:.1f} deg off the flange's, {_overruled(auto, priors.mount)}"
    else:
        of_mounting = (
            f"mounting: sensor's z {side} the flange's, {_an_axis(priors.mount)}; found {tilt:.2f} deg off, exactly "
            f"parallel has a probability of {_percent(auto.mounting_exact)}"
        )
    if priors.base is None:
        of_base = f"base: as known; gravity is found {lean:.2f} deg off that direction"
    elif auto.base_exact is None:
        of_base = f"base: gravity is {lean:.1f} deg off the stated direction, {_overruled(auto, priors.base)}"
    else:
        of_base = (
            f"base: gravity in the stated direction, {_an_axis(priors.base)}; found {lean:.2f} deg off, exactly "
            f"level has a probability of {_percent(auto.base_exact)}"
        )
    return of_mounting, of_base


def _an_axis(sd: float) -> str:
    return f"+- {np.rad2deg(sd):.3g} deg an axis"


def _overruled(auto: AutoFit, sd: float) -> str:
    odds = auto.log_odds / np.log(10.0)
    return f"which the readings favour 10^{odds:.0f} : 1 over a tilt of {np.rad2deg(sd):.3g} deg an axis"


def _tilt_of_mounting(tool: RigidTool) -> float:
    return min(_angle(float(tool.R_flange_sensor[2, 2])), _angle(-float(tool.R_flange_sensor[2, 2])))


def _angle(cosine: float) -> float:
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _percent(probability: float) -> str:
    return f"{100.0 * probability:.0f} %"
