"""What no fit can tell, tool and base can: units and signs that are mistaken alike in all poses, a pull that never
ends, a tool that weighs next to nothing as its payload is subtracted already, and channels that are dead.

Such readings leave nothing, yet the tool that explains them is absurd, or the base leans as nobody said. The limits are
those of things, not of the sets at hand; each is beyond what a robot carries, as whatever passes here is believed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..calibration.calibration import Calibration
from ..calibration.findings import Finding, Kind
from ..errors import refuse
from ..geometry.arrays import Array, Frozen, read_only
from ..geometry.wrench import STANDARD_GRAVITY
from ..model import AXES, GRAVITY, gravity_in_flange
from ..samples.samples import Samples
from .estimate import Estimate, RigidEstimate
from .priors import Question, rows_of

LIGHTEST, HEAVIEST = 0.005, 2300.0
"""kg: two M4 screws; the payload of the strongest arm, FANUC M-2000iA/2300."""

FURTHEST_COM = 2.0
"""m: no arm carries a tool that long."""

REACH = 0.76
"""m per cube root of a kg: the middle of a tube of carbon (1,600 kg/m^3) thirty times as long as thick, its wall a
twentieth of its diameter. A tool has a flange at its foot, and stays nearer.
"""

NEAREST, DEAD = 0.0005, 1e-9
"""m per cube root of a kg: a hundredth of the side of a cube of steel. A tool lies on its sensor; where the origin is
inside it, few stds are small enough to say so much. And m: even nearer only the zeros of channels that are dead put it.
"""

TYPICAL = 0.05
"""m per cube root of a kg: the middle of a cube of water that stands on the sensor."""

SENSOR = 0.01
"""m: so far a sensor's origin may lie before its face."""

UPRIGHT = float(np.cos(np.deg2rad(10.0)))
"""Of sensor's z and flange's: further apart, nobody knows which axis of the flange points to the tool."""

SURE = 3.0
"""Standard deviations."""

LEANS = float(np.deg2rad(5.0))
"""A floor or a table that leans further shows to the eye; a steady pull below it is a twelfth of the weight."""

TOO_HEAVY, TOO_LIGHT, BEHIND = "too heavy", "too light", "com behind the sensor"
TOO_FAR, TOO_NEAR = "com too far for the mass", "com too near for the mass"
TEXTS = {
    TOO_HEAVY: "the mass comes out as {mass:.3g} kg, more than any robot carries: are the forces in mN or gf",
    TOO_LIGHT: "the mass comes out as {mass:.2g} kg, less than any tool's: are the forces in kN",
    TOO_FAR: "the centre of mass comes out {distance:.2g} m from the sensor: are the torques in N mm? So far no tool "
    "of {mass:.2g} kg reaches: or are the forces in kgf or lbf",
    TOO_NEAR: "the centre of mass comes out {distance:.1g} m from the sensor's origin, where no tool of {mass:.3g} kg "
    "has it: are the forces in mN, or the torques in another unit",
    BEHIND: "the centre of mass comes out {behind:.0f} mm behind the sensor, on the robot's side: are tx, ty and tz "
    "reversed or about the tool's tip, or does the flange's z point to the robot",
}
SURELY = "? Weigh the tool; contactwrench diagnose lists other units and signs; if it is so: --known {}+-STD"
"""Of each oddity, what is found and the likeliest mistakes; then what decides."""

NOISIER = 1.5
"""By so much, as a factor, what is left of two tools on one sensor may differ."""

OF_TOOL, OF_SENSOR = (Kind.IMPLAUSIBLE_TOOL, Kind.LEANING_BASE), (Kind.CREEP, Kind.CROSS_TALK, Kind.UNEQUAL_NOISE)
INHERITED, OF_EARLIER = {*OF_TOOL, *OF_SENSOR, Kind.CONTRADICTS_MODEL}, "; so the earlier calibration"
"""What a new zero takes over with the tool, and how the text of that ends."""

LIGHTEST_TOOL = 0.5
"""N: few tools weigh less, and what a controller leaves of one whose payload it subtracts mostly does."""

WIDE_TILT = 0.1
"""Standard deviation of gravity's direction, seen from the flange, along the second of its main axes: poses tilted by
some 10 deg to all sides show the weight of a tool.
"""

LIKELIEST_CAUSE = (
    "likeliest the controller or driver subtracts the payload, or zeroes at each pose: record the sensor's raw signal "
    "(of a UR ft_raw_wrench, not an external force)"
)

REVERSED = "tx, ty and tz reversed"
LEAST_COUNT = 300.0
"""N m, beyond what wrist sensors measure, and whole numbers at that."""
FIRST = 1_000
"""Readings that show most often that not all are alike, or whole."""
USUAL = 1.5
"""Of the logarithm of a centre of mass: by so much torques in N mm are forgiven, as they are commoner than the rest."""


def tilts_widely(R_base_flange: Array, gravity_direction: Array) -> bool:
    """Whether orientations (n, 3, 3) tilt a tool to all sides."""
    r = gravity_in_flange(R_base_flange, gravity_direction)
    spread = np.linalg.svd(r - r.mean(axis=0), compute_uv=False) / np.sqrt(len(r))
    return len(spread) > 1 and bool(spread[1] > WIDE_TILT)


def oddity(weight: float, com: Array, along: float, std: Array | float = 0.0) -> str:
    """In a word why no tool of `weight` N has its centre of mass at `com` (3,) m, `along` m of it to the side of tools
    (NaN: nobody knows), each part with a `std` (3,) m; nothing where one may.
    """
    distance, spread = float(np.linalg.norm(com)), SURE * float(np.max(std))
    mass, size = weight / STANDARD_GRAVITY, float(np.cbrt(weight / STANDARD_GRAVITY))
    holds = {
        TOO_HEAVY: mass > HEAVIEST,
        TOO_LIGHT: mass < LIGHTEST,
        TOO_FAR: distance - spread > min(REACH * size, FURTHEST_COM),
        TOO_NEAR: DEAD < distance + spread < NEAREST * size,
        BEHIND: along + spread < -SENSOR,
    }
    return next((word for word, is_so in holds.items() if is_so), "")


def strangeness(weight: float, com: Array) -> float:
    """How far, in factors, a centre of mass (3,) m lies from where tools of `weight` N have theirs."""
    usual = TYPICAL * np.cbrt(max(weight, 1e-12) / STANDARD_GRAVITY)
    return abs(float(np.log(max(float(np.linalg.norm(com)), 1e-12) / usual)))


def to_the_tool(B: Array, com: Array) -> float:
    """How far (m) a centre of mass `com` (3,), sensor axes, lies along the flange's z, by B (6, 4); NaN where that is
    not about the sensor's.
    """
    z = B[:3, 2] / max(float(np.linalg.norm(B[:3, 2])), 1e-300)
    return float(com @ z) if abs(z[2]) > UPRIGHT else np.nan


def implausible(estimate: Estimate, question: Question) -> Iterator[Finding]:
    """That no tool is as this one, unless what makes it so is known; of a model without a tool, by its B."""
    weight, known, spread = estimate.weight_scale, np.zeros(4), np.zeros(4)
    if not isinstance(estimate, RigidEstimate):
        com = _com_of(estimate.B)
    else:
        weight, com, spread = estimate.tool.weight, estimate.tool.com, np.sqrt(np.diag(estimate.covariance)[:4])
        rows = rows_of(question.knowledge, estimate.tool, estimate.names).jacobian
        known = np.abs(rows[:, :4]).sum(axis=0)
    mass, distance, along = weight / STANDARD_GRAVITY, float(np.linalg.norm(com)), to_the_tool(estimate.B, com)
    odd = oddity(weight, com, along, spread[1:]) if weight > SURE * spread[0] or distance > FURTHEST_COM else ""
    of_mass = odd in (TOO_HEAVY, TOO_LIGHT)
    if odd and not (known[0] if of_mass else known[1:].all()):
        decides = SURELY.format("mass=KG" if of_mass else "com_mm=X,Y,Z")
        text = TEXTS[odd].format(mass=mass, distance=distance, behind=-1e3 * along) + decides
        yield (Finding.weak if distance > FURTHEST_COM else Finding.doubtful)(Kind.IMPLAUSIBLE_TOOL, text)
    if isinstance(estimate, RigidEstimate):
        yield from _leaning(estimate, question)


def on_one_sensor(calibrations: Sequence[Calibration]) -> tuple[Calibration, ...]:
    """Calibrations of tools on one sensor, less that one fits badly, as light ones may, of which no more is left than
    of another one that fits: it is the sensor's noise.
    """
    left = [float(np.linalg.norm(each.residual_rms[:3])) for each in calibrations]
    of_fit = [[finding for finding in each.findings if finding.kind is not Kind.POOR_FIT] for each in calibrations]
    fits = [len(said) == len(each.findings) for said, each in zip(of_fit, calibrations, strict=True)]
    of_sensor = max((of_one for of_one, fit in zip(left, fits, strict=True) if fit), default=0.0)
    return tuple(
        replace(each, findings=tuple(said)) if of_one < NOISIER * of_sensor else each
        for each, said, of_one in zip(calibrations, of_fit, left, strict=True)
    )


def inherited(prior: Calibration | None) -> tuple[Finding, ...]:
    """What is odd of an earlier calibration, and so of one that takes its tool and base as known."""
    odd = () if prior is None else (each for each in prior.findings if each.kind in INHERITED)
    return tuple(replace(each, text=each.text.removesuffix(OF_EARLIER) + OF_EARLIER) for each in odd)


def _leaning(estimate: RigidEstimate, question: Question) -> Iterator[Finding]:
    """That gravity is not where it is stated or usual: a steady pull in base axes is no different from a base that
    leans, and then it is in the weight.
    """
    found = estimate.gravity_direction
    tilts = [k for k, name in enumerate(estimate.names) if name in GRAVITY]
    if not tilts:
        return
    std, stated = float(np.sqrt(np.diag(estimate.covariance)[tilts].max())), question.priors.base
    if stated is None and question.knowledge:
        known = rows_of(question.knowledge, estimate.tool, estimate.names).jacobian
        stated = 1.0 / max(float(np.linalg.norm(known[:, tilts], 2)), 1e-300)
    angle = float(np.arccos(np.clip(found @ question.gravity_direction, -1.0, 1.0)))
    if angle - SURE * std > max(LEANS, SURE * (stated or 0.0)):
        direction = ",".join(f"{part:.3g}" for part in found.round(3) + 0.0)
        text = (
            f"gravity comes out {np.rad2deg(angle):.1f} deg off the direction that was stated or is usual: if the base "
            "does not lean so, something pulls steadily, a hose or a balancer, and the weight is wrong; if it does, "
            f"state gravity as {direction}"
        )
        yield Finding.doubtful(Kind.LEANING_BASE, text)


def _com_of(B: Array) -> Array:
    """The centre of mass (3,) m whose torques are nearest to those of B (6, 4)."""
    force, torque = np.split(B[:, :3] / max(float(np.abs(B[:3, :3]).max()), 1e-300), 2)
    turning = np.sum(force**2) * np.eye(3) - force @ force.T
    return np.asarray(np.linalg.lstsq(turning, np.cross(force.T, torque.T).sum(axis=0))[0])


@dataclass(frozen=True, eq=False)
class Unseen(Frozen):
    """Other units, or the torques reversed, by `label`, that make a tool of `mass` kg with its `com` (3,) m; in a
    word why no tool is so, `odd`.
    """

    label: str
    mass: float
    com: Array
    odd: str


def likelier(factor: float, units: Iterable[tuple[str, float, float]], weight: float, com: Array) -> bool:
    """Whether torques by a `factor` make a tool of `weight` N likelier than its `com` (3,) m does as it stands, and no
    other `units` one that is likelier by far.
    """
    so = strangeness(weight, factor * com)
    least = min((strangeness(force * weight, torque / force * com) for _, force, torque in units), default=so)
    return so < strangeness(weight, com) and so < least + USUAL


def unseen(
    units: Iterable[tuple[str, float, float]], own: float, weight: float, com: Array, to_the_tool: float
) -> tuple[Unseen, ...]:
    """All `units`, each with the torques as they stand and reversed, but for those of the tool itself, whose torques
    are the stated ones by a factor `own`. It is of `weight` N, its `com` (3,) m `to_the_tool` m on the side of tools.
    """
    found = []
    for label, force, torque in units:
        same = bool(np.isclose(force, 1.0) and np.isclose(torque, own))
        for sign, words in ((1.0, []), (-1.0, [REVERSED])):
            lever, all_words = sign * torque / own / force, [*([] if same else [label]), *words]
            made = Unseen(
                ", ".join(all_words),
                force * weight / STANDARD_GRAVITY,
                read_only(lever * com),
                oddity(force * weight, lever * com, lever * to_the_tool),
            )
            rank = bool(made.odd), strangeness(force * weight, made.com) + USUAL * len(words)
            found += [(rank, made)] if all_words else []
    return tuple(made for _, made in sorted(found, key=lambda ranked: ranked[0]))


def require_alive(wrench: Array, source: str) -> None:
    """Raise `InputError` for readings (n, 6) that are all zero, and for six channels that are one."""
    first, expected = wrench[:, :1], "expected what a six-axis sensor reads: check its columns, cable and driver"
    refuse(
        (not wrench.any(), f"{source}: found 0 in all six channels of every row, {expected}"),
        ((wrench == first).all() and np.ptp(first) > 0.0, f"{source}: found six equal channels, {expected}"),
    )


def _counts(samples: Samples) -> tuple[Finding, ...]:
    """That all readings are whole numbers and torques large: a converter's counts, which a rigid tool fits as well."""
    most = float(np.abs(samples.wrench[:, 3:]).max(initial=0.0))
    if most < LEAST_COUNT or any((some != np.rint(some)).any() for some in (samples.wrench[:FIRST], samples.wrench)):
        return ()
    text = (
        f"all readings are whole numbers, of torque up to {most:.0f}: a converter's counts, not N and N m? divide them "
        "by the sensor's counts per N and per N m"
    )
    return (Finding.doubtful(Kind.IMPLAUSIBLE_TOOL, text),)


def dead_channels(samples: Samples, gravity_direction: Array) -> tuple[Finding, ...]:
    """That channels read one value in all rows, though these tilt the tool, or that all are a converter's counts.
    Raises `InputError` where none is alive.
    """
    require_alive(samples.wrench, samples.source)
    dead = np.ptp(samples.wrench[:FIRST], axis=0) == 0.0
    dead = np.ptp(samples.wrench, axis=0) == 0.0 if dead.any() else dead
    if not dead.any() or not tilts_widely(samples.R_base_flange, gravity_direction):
        return _counts(samples)
    named = ", ".join(f"{axis} = {samples.wrench[0, k]:g}" for k, axis in enumerate(AXES) if dead[k])
    text = f"{named} in all {len(samples)} rows, though these tilt the tool"
    frozen = f"{samples.source}: found {text}, expected readings that change: check the sensor's cable and driver"
    refuse((dead.all(), frozen))
    return (Finding.doubtful(Kind.DEAD_CHANNEL, f"{text}: a dead channel, or one that was not recorded?"),)
