"""A diagnosis as text for the terminal, the verdict in its first line, and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..assess.diagnose import Diagnosis, Explanation
from ..assess.interpretations import Interpretation
from ..calibration.text import COLUMNS
from ..errors import visible
from ..estimation.plausibility import REVERSED
from ..geometry.arrays import Array
from ..statistics import two_digits
from .text import json_text, named

LIKELY_CAUSES = (
    "Likely causes: poses that hardly tilt the tool, a pose in contact, a sensor that was zeroed during the recording, "
    "an arm that still moved, a cable that pulls, a tool too light for the sensor, or a controller that already "
    "subtracts its payload (record what the sensor itself reads)."
)


def verdict(diagnosis: Diagnosis) -> str:
    """In one line: what is left as given, and what with the best interpretation."""
    given, best = diagnosis.given, diagnosis.best
    no_tool = f"but no tool is so ({best.odd}): see the units and signs below"
    if given is None:
        torque_too, as_given = False, "as given: cannot be read"
    else:
        torque_too = not diagnosis.read_rightly and given.force_left < 2.0 * best.force_left
        as_given = f"as given: {_left(given, torque_too)} left"
    if given is None and best.explains_nothing:
        return f"{as_given}; no other interpretation explains it: the best leaves {_left(best, False)}, {_share(best)}"
    if not diagnosis.read_rightly:
        better = f"{_how(best.interpretation, given)}: {_left(best, torque_too)} left"
        doubt = f", {no_tool}" if best.odd else ""
        doubt = doubt if best.explained else f", still {_share(best)}"
        return f"{as_given}; {better}{doubt}"
    of_weight = "" if best.explained else f", {_share(best)}"
    if best.pose_off is not None:
        of_weight += f", {two_digits(best.force_without)} N without pose {best.pose_off}, which may be in contact"
    as_given += of_weight
    if not best.explained:
        return f"{as_given}; no other interpretation explains it better, and none explains it well"
    if best.odd:
        return f"{as_given}; no other interpretation explains it better, {no_tool}"
    if diagnosis.likely:
        return f"{as_given}; other interpretations explain it as well, and free air cannot tell them apart"
    return f"{as_given}; no other interpretation explains it better: it is read rightly, units apart"


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """The verdict, the best interpretation of each class with what a tool leaves of it, and what would decide."""
    d = diagnosis
    rows = list(d.ranked)
    if d.given is not None and d.given not in rows:
        rows.append(d.given)
    lines = [verdict(d), ""]
    if d.complaint is not None:
        lines += [f"As given: {d.complaint}", ""]
    lines += [
        f"{d.n} poses, {d.tried} interpretations tried, {d.source}",
        "",
        f"  {'N left':>8}  {'mN m left':>9}  {'weight N':>8}  {'com mm':^22}  interpretation",
    ]
    for fit in rows:
        leans = f", the base leaning {np.rad2deg(fit.lean):.1f} deg" if fit.lean > 0.0 else ""
        left = f"{two_digits(fit.force_left):>8}  {two_digits(1e3 * fit.torque_left):>9}"
        numbers = f"  {left}  {fit.weight:8.3g}  {_in_mm(fit.com):>22}"
        lines += _beside(numbers, ("as given" if fit is d.given else _label(fit.interpretation)) + leans)
    if not d.best.explained and d.best.pose_off is None:
        lines += ["", LIKELY_CAUSES]
    if d.likely:
        lines += ["", "Free air cannot tell these from the first:"]
        given = d.given and d.given.interpretation
        lines += [f"  {'as given' if each == given else _label(each)}" for each in d.alike[: d.likely]]
        lines += ["To decide:", *(f"- {observation}" for observation in d.observations)]
    lines += _unseen(d)
    return "\n".join(map(visible, lines))


def _unseen(d: Diagnosis) -> list[str]:
    """What the tool would be in other units, and with the torques as stated reversed, the most plausible first."""
    units = [each for each in d.unseen if not each.odd and not each.label.endswith(REVERSED)]
    shown = [*units, *(each for each in d.unseen if each.label == REVERSED)]
    if not shown:
        return []
    lines = ["", f"Free air cannot tell these from the first ({d.best.odd or 'plausible'}) either; weigh the tool:"]
    lines += [f"  {'mass kg':>8}  {'com mm':^22}  interpretation"]
    for each in shown:
        lines += _beside(f"  {each.mass:8.3g}  {_in_mm(each.com):>22}", f"{each.label} ({each.odd or 'plausible'})")
    return lines


def diagnosis_json(diagnosis: Diagnosis) -> str:
    """The fields of `Diagnosis` under their names, with `verdict`, `read_rightly` and `explained`."""
    d = diagnosis
    values = {
        "verdict": verdict(d),
        "read_rightly": d.read_rightly,
        "explained": d.best.explained,
        **named(d, "source model n tried complaint"),
        "given": None if d.given is None else _explanation(d.given),
        "best": _explanation(d.best),
        "ranked": [_explanation(fit) for fit in d.ranked],
        "alike": [_options_and_mends(interpretation) for interpretation in d.alike],
        **named(d, "likely observations"),
        "plausible": not d.best.odd,
        "unseen": [vars(each) for each in d.unseen],
    }
    return json_text(values)


def _options_and_mends(of: Interpretation) -> dict[str, Any]:
    return {"flags": of.options, "mends": of.mends, "cost": of.cost}


def _explanation(fit: Explanation) -> dict[str, Any]:
    return {**_options_and_mends(fit.interpretation), **named(fit, "force_left torque_left weight com lean odds")}


def _beside(numbers: str, label: str) -> list[str]:
    """A row; a long label stands below it."""
    return [f"{numbers}  {label}"] if len(numbers) + 2 + len(label) <= COLUMNS else [numbers, f"      {label}"]


def _in_mm(com: Array) -> str:
    return ", ".join(f"{1e3 * part:6.1f}" for part in com)


def _label(interpretation: Interpretation) -> str:
    return ", ".join([*filter(None, [" ".join(interpretation.options)]), *interpretation.mends]) or "no options"


def _how(interpretation: Interpretation, given: Explanation | None) -> str:
    """How to read a file so, if it was given otherwise."""
    kept = {option.split()[0] for option in interpretation.options}
    dropped = (
        [] if given is None else [option for option in given.interpretation.options if option.split()[0] not in kept]
    )
    changes = [*([f"`{' '.join(interpretation.options)}`"] if interpretation.options else []), *interpretation.mends]
    parts = [f"with {', '.join(changes)}"] if changes else []
    parts += [f"without `{' '.join(dropped)}`"] if dropped else []
    return " and ".join(parts) or "with no options"


def _left(fit: Explanation, torque_too: bool) -> str:
    force = f"{two_digits(fit.force_left)} N"
    return f"{force} and {two_digits(1e3 * fit.torque_left)} mN m" if torque_too else force


def _share(fit: Explanation) -> str:
    return (
        f"{100.0 * fit.force_left / fit.weight:.0f} % of the weight" if fit.weight > 0.0 else "and no weight is found"
    )
