"""A diagnosis as text for the terminal, the verdict in its first line, and as JSON."""

from __future__ import annotations

from textwrap import wrap
from typing import Any

import msgspec
import numpy as np

from ..assess.diagnose import Diagnosis, Explanation
from ..assess.interpretations import Interpretation

WIDTH = 100

LIKELY_CAUSES = (
    "Likely causes: poses that hardly tilt the tool, a pose in contact, a sensor that was zeroed during the recording, "
    "an arm that still moved, a cable that pulls, or a tool too light for the sensor."
)


def verdict(diagnosis: Diagnosis) -> str:
    """In one line: what is left as given, and what with the best interpretation."""
    given, best = diagnosis.given, diagnosis.best
    if given is None:
        as_given = "as given: cannot be read"
    else:
        torque_too = not diagnosis.read_rightly and given.force_left < 2.0 * best.force_left
        as_given = f"as given: {_left(given, torque_too)} left"
    if given is None or not diagnosis.read_rightly:
        better = f"{_how(best.interpretation, given)}: {_left(best, given is not None and torque_too)} left"
        doubt = "" if best.explained else f", still {_share(best)}"
        return f"{as_given}; {better}{doubt}"
    if not best.explained:
        return f"{as_given}, {_share(best)}; no other reading explains it better, and none explains it well"
    if diagnosis.likely:
        return f"{as_given}; other readings explain it as well, and free air cannot tell them apart"
    return f"{as_given}; no other reading explains it better: the file is read rightly"


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
        f"{d.n} poses, {d.tried} readings tried, {d.source}",
        "",
        f"  {'N left':>8}  {'mN m left':>9}  {'weight N':>8}  {'com mm':^22}  reading",
    ]
    lines += [_row(fit, "as given" if fit is d.given else _label(fit.interpretation)) for fit in rows]
    leaning = [fit for fit in rows if fit.lean > 0.0]
    lines += [
        f"  with --model mount+base gravity is {np.rad2deg(fit.lean):.1f} deg from the stated one" for fit in leaning
    ]
    if not d.best.explained:
        lines += ["", *wrap(LIKELY_CAUSES, WIDTH)]
    if d.likely:
        lines += ["", "Free air cannot tell these from the first:"]
        lines += [f"  {_label(interpretation)}" for interpretation in d.alike[: d.likely]]
        lines += ["To decide:"]
        lines += [
            line
            for observation in d.observations
            for line in wrap(observation, WIDTH, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)
        ]
    return "\n".join(lines)


def diagnosis_json(diagnosis: Diagnosis) -> str:
    """The fields of `Diagnosis` under their names, with `verdict`, `read_rightly` and `explained`."""
    d = diagnosis
    values = {
        "verdict": verdict(d),
        "read_rightly": d.read_rightly,
        "explained": d.best.explained,
        "source": d.source,
        "n": d.n,
        "tried": d.tried,
        "complaint": d.complaint,
        "given": None if d.given is None else _explanation(d.given),
        "best": _explanation(d.best),
        "ranked": [_explanation(fit) for fit in d.ranked],
        "alike": [_of_interpretation(interpretation) for interpretation in d.alike],
        "likely": d.likely,
        "observations": list(d.observations),
    }
    return msgspec.json.format(msgspec.json.encode(values), indent=2).decode()


def _of_interpretation(interpretation: Interpretation) -> dict[str, Any]:
    return {"flags": list(interpretation.flags), "mends": list(interpretation.mends), "cost": interpretation.cost}


def _explanation(fit: Explanation) -> dict[str, Any]:
    return {
        **_of_interpretation(fit.interpretation),
        "force_left": fit.force_left,
        "torque_left": fit.torque_left,
        "weight": fit.weight,
        "com": fit.com.tolist(),
        "lean": fit.lean,
        "odds": fit.odds,
    }


def _row(fit: Explanation, label: str) -> str:
    com = ", ".join(f"{1e3 * part:6.1f}" for part in fit.com)
    return f"  {_short(fit.force_left):>8}  {_short(1e3 * fit.torque_left):>9}  {fit.weight:8.3g}  {com:>22}  {label}"


def _label(interpretation: Interpretation) -> str:
    return (
        ", ".join([*([" ".join(interpretation.flags)] if interpretation.flags else []), *interpretation.mends])
        or "no flags"
    )


def _how(interpretation: Interpretation, given: Explanation | None) -> str:
    """How to make that interpretation, of one that was given otherwise."""
    kept = {flag.split()[0] for flag in interpretation.flags}
    dropped = [] if given is None else [flag for flag in given.interpretation.flags if flag.split()[0] not in kept]
    flags = [f"`{' '.join(interpretation.flags)}`"] if interpretation.flags else []
    parts = [f"with {', '.join([*flags, *interpretation.mends])}"] if flags or interpretation.mends else []
    parts += [f"without `{' '.join(dropped)}`"] if dropped else []
    return " and ".join(parts) or "with no flags"


def _left(fit: Explanation, torque_too: bool) -> str:
    force = f"{_short(fit.force_left)} N"
    return f"{force} and {_short(1e3 * fit.torque_left)} mN m" if torque_too else force


def _share(fit: Explanation) -> str:
    return (
        f"{100.0 * fit.force_left / fit.weight:.0f} % of the weight" if fit.weight > 0.0 else "and no weight is found"
    )


def _short(value: float) -> str:
    """Two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"
