"""Results as text for the terminal, and as JSON: verification, held object, difference, contents of a recording.

A sentence is one line of the text, however long; tables are at most 80 columns wide.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import msgspec
import numpy as np

from ..assess.verify import Verification
from ..assess.weigh import REFUSALS, HeldObject
from ..calibration.difference import Difference
from ..calibration.findings import Severity
from ..errors import visible
from ..geometry.arrays import Array
from ..model import AXES
from ..recording.contents import BagContents, FrameContent, Rhythm, TableContents, TopicContent
from ..recording.tables.columns import with_slices
from ..statistics import SPOKEN, counted, meaningful_digits, percent

NAME_AND_TYPE, TYPE_WIDTH = 34, 16
UNIX_TIMES = (946684800.0, 4102444800.0)
"""s: 2000 to 2100. Other stamps are of clocks that start elsewhere."""
NOTABLE_CLOCK = 0.5
"""s by which stamps in headers may differ from the bag's own before it is said."""
MOST_FRAMES, MOST_EPISODES = 60, 10
_MILLI = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])


def named(of: object, names: str) -> dict[str, Any]:
    """Attributes by their names, with blanks between, in that order."""
    return {name: getattr(of, name) for name in names.split()}


def json_text(values: Any) -> str:
    """Values as JSON for people: arrays as lists, dataclasses as objects, NaN as null."""
    return msgspec.json.format(msgspec.json.encode(values, enc_hook=np.ndarray.tolist), indent=2).decode()


UNTOLD = (
    "; nothing here tells why: see that the tool is free, then calibrate anew; contactwrench diff tells what changed"
)
"""After a check that failed without a finding."""


def verification_text(result: Verification) -> str:
    """What is left in the contact-free poses, the paper's Table IX for hung loads, and the verdict."""
    lines = []
    if len(result.residuals):
        lines += [
            f"Verification on {counted(len(result.residuals), 'contact-free pose')}",
            "",
            *_axes_lines({"residual rms": result.rms, "largest": np.abs(result.residuals).max(axis=0)}),
            f"  largest norms: {result.largest_force:.3g} N, {1e3 * result.largest_torque:.3g} mN m",
            "",
        ]
    if result.weighings:
        lines += ["  weighed g         actual g   error %           poses"]
        lines += [
            f"  {1e3 * w.weighed:7.1f} +- {1e3 * w.std:<6.1f} {1e3 * w.actual:8.1f}   "
            f"{100 * w.error:+6.2f} +- {100 * w.error_std:<5.2f}  {w.n:5d}"
            for w in result.weighings
        ]
        lines += [""]
    lines += [f"{finding.label:<7}  {finding.text}" for finding in result.findings]
    limited = result.limit_force is not None or result.limit_torque is not None
    told = any(finding.severity is not Severity.NOTE for finding in result.findings)
    untold = not (result.passed or limited or told or result.weighings)
    lines.append(f"{'PASSED' if result.passed else 'FAILED'}  {result.reason}{UNTOLD if untold else ''}")
    return "\n".join(map(visible, lines))


def _axes_lines(rows: dict[str, Array]) -> list[str]:
    """Wrenches (6,) by name, an axis a column."""
    lines = [f"  {name:<14}" + "".join(f"{value:9.3g}" for value in row * _MILLI) for name, row in rows.items()]
    return [f"  {'':<14}" + "".join(f"{axis:>9}" for axis in AXES) + "   N, mN m", *lines]


def verification_json(result: Verification) -> str:
    """The fields of `Verification` under their names; each weighing with its `error` and `error_std`."""
    weighings = [{**vars(w), "error": w.error, "error_std": w.error_std} for w in result.weighings]
    return json_text({**vars(result), "weighings": weighings, "warnings": result.warnings})


def held_object_text(held: HeldObject) -> str:
    """Mass, centre of mass in sensor and flange axes, unless they are refused, what a rigid object leaves, and the
    findings.
    """
    factor, unit = (1.0, "kg") if abs(held.mass) >= 1.0 else (1e3, "g")
    mass, std = meaningful_digits(factor * held.mass, factor * held.mass_std)
    answer = [] if held.refused else [f"  mass   {mass:>8} +- {std} {unit}", *_com_lines(held), ""]
    lines = [
        f"Held object, weighed in {counted(held.poses, 'pose')}, g {held.g:.6g} m/s^2",
        "",
        *answer,
        *_axes_lines({"residual rms": held.residual_rms}),
        f"  chi-square {held.chi2:.3g} per degree of freedom, probability {percent(held.probability)}",
        *(f"{'REFUSED' if f.kind in REFUSALS else f.label:<7}  {f.text}" for f in held.findings),
    ]
    return "\n".join(map(visible, lines))


def _com_lines(held: HeldObject) -> list[str]:
    """The centre of mass in mm; of one that is known in part, the line on which it lies."""
    if held.com is None or held.com_covariance is None:
        return []
    if held.unknown_along is not None:
        std = 1e3 * np.sqrt(np.linalg.eigvalsh(held.com_covariance)[-1])
        point, along = 1e3 * held.com, held.unknown_along
        return [
            f"  com    on the line ({_triple(point, 1)}) + s ({_triple(along, 3)}) mm, +- {std:.2g} across, sensor axes"
        ]
    columns = [(held.com, held.com_std), (held.com_flange, held.com_flange_std)]
    texts = [
        [meaningful_digits(1e3 * v, 1e3 * s) for v, s in zip(com, std, strict=True)]
        for com, std in columns
        if com is not None and std is not None
    ]
    titles = ("sensor axes", "flange axes")[: len(texts)]
    lines = ["", f"  {'':<5}" + "".join(f"{title:>18}  " for title in titles) + "  mm, from the sensor's origin"]
    for k, axis in enumerate("xyz"):
        cells = "".join(f"{value:>10} +- {std:<6}" for value, std in (column[k] for column in texts))
        lines.append(f"  com_{axis}{cells}".rstrip())
    return lines


def _triple(values: Array, digits: int) -> str:
    return ", ".join(f"{round(value, digits) + 0.0:.{digits}f}" for value in values.tolist())


def held_object_json(held: HeldObject) -> str:
    """The fields of `HeldObject` under their names, `com_std`, `warnings`, `refused`; null where one is not known."""
    return json_text({**vars(held), **named(held, "com_std warnings refused")})


def difference_text(change: Difference) -> str:
    """What the changes mean; each with its standard deviation, in the units that people speak, * marking more than
    three of them.
    """
    lines = [*change.meaning, "", f"  {'':<10} {'change':>10}    {'std':<9} {'unit':<7} {'in std':>7}"]
    for name, unit, value, std, ratio in zip(
        change.names, change.units, change.change, change.std, change.in_std, strict=True
    ):
        factor, spoken = SPOKEN.get(unit, (1.0, unit))
        mark = "*" if name in change.significant else " "
        lines.append(f"{mark} {name:<10} {factor * value:>+10.4g} +- {factor * std:<9.2g} {spoken:<7} {ratio:>+7.1f}")
    if change.inertia_known in ((True, False), (False, True)):
        one = "earlier" if change.inertia_known[0] else "later"
        lines.append(f"  inertia and sensor offset are known of the {one} one only, and not compared")
    if change.gravity_angle > 0.0:
        lines.append(f"  gravity is {np.rad2deg(change.gravity_angle):.3g} deg apart in base axes")
    if change.mounting_angle is not None:
        lines.append(f"  the mountings are {np.rad2deg(change.mounting_angle):.3g} deg apart")
    lines += ["", *_axes_lines({"free wrench by": change.free_wrench}), ""]
    if change.significant:
        lines.append(f"* more than 3 standard deviations: {', '.join(change.significant)}")
    else:
        lines.append("no parameter changed by more than 3 standard deviations")
    return "\n".join(map(visible, lines))


def difference_json(change: Difference) -> str:
    """`change`, `std` and `in_std` by parameter, `free_wrench`, `mounting_angle`, `gravity_angle`, `inertia_known` of
    each, `significant`, the joint test of each group, and the `meaning` in words.
    """
    whole = "free_wrench mounting_angle gravity_angle inertia_known significant in_std groups meaning"
    values = named(change, f"change std units {whole}")
    for name in ("change", "std", "units", "in_std"):
        values[name] = dict(zip(change.names, np.asarray(values[name]).tolist(), strict=True))
    values["groups"] = {
        group.name: {
            "parameters": group.parameters,
            **named(group.test, "chi2 dof probability"),
            "significant": group.significant,
        }
        for group in change.groups
    }
    return json_text(values)


def contents_text(contents: BagContents | TableContents) -> str:
    """Topics or columns, how many, how often, the longest gap; times from the start of the recording."""
    lines = _bag(contents) if isinstance(contents, BagContents) else _table(contents)
    reading = (f"  {sentence}" for sentence in contents.reading)
    return "\n".join(map(visible, [*lines, "", "Read without options", *reading]))


def _bag(contents: BagContents) -> Iterator[str]:
    count = sum(topic.rhythm.count for topic in contents.topics)
    yield f"{contents.path}"
    if contents.damage:
        yield f"Damaged: {contents.damage}"
    if contents.left_open:
        yield f"Note: {contents.left_open}"
    yield f"{contents.kind}, {count:,} messages in {contents.duration:.6g} s{_since(contents.start)}"
    kind = max([4, *(len(_type(topic)) for topic in contents.topics)])
    name = max([5, *(len(topic.name) for topic in contents.topics if len(topic.name) <= NAME_AND_TYPE - kind)])
    yield ""
    yield f"  {'topic':<{name}}  {'type':<{kind}}{'messages':>10}{'rate Hz':>8}  longest gap"
    for gives in dict.fromkeys(["wrench", "pose", *sorted({t.gives for t in contents.topics}, reverse=True)]):
        topics = [topic for topic in contents.topics if topic.gives == gives]
        if topics:
            yield f"{gives[0].upper()}{gives[1:]}" if gives else "Other"
        for topic in topics:
            yield from _topic(topic, name, kind)
    if contents.frames:
        yield ""
        yield "Frames (= never moves against the one above)"
        yield from _frames(contents.frames)


def _topic(topic: TopicContent, name: int, kind: int) -> Iterator[str]:
    if len(topic.name) > name:  # whole, so that it can be copied
        yield f"  {topic.name}"
    shown = topic.name if len(topic.name) <= name else ""
    head = f"  {shown:<{name}}  {_type(topic):<{kind}}"
    yield f"{head}{topic.rhythm.count:>10,}{_rate(topic.rhythm):>8}  {_gap(topic.rhythm)}".rstrip()
    if topic.clock is not None and abs(topic.clock) > NOTABLE_CLOCK:
        way = "behind" if topic.clock > 0.0 else "ahead of"
        yield f"    stamps in its headers are {abs(topic.clock):.6g} s {way} the bag's own"


def _frames(frames: tuple[FrameContent, ...]) -> Iterator[str]:
    children: dict[str, list[FrameContent]] = {}
    for frame in frames:
        children.setdefault(frame.parent, []).append(frame)
    below = {frame.name for frame in frames}
    lines: list[str] = []
    for root in sorted(children, key=below.__contains__):  # what is left behind the roots goes round in a circle
        left = [(root, 0, "")] if root in children else []
        while left:
            name, depth, sign = left.pop()
            lines.append(f"  {'  ' * depth}{sign}{name}")
            hang = reversed(children.pop(name, []))
            left += [(child.name, depth + 1, "" if child.moves else "= ") for child in hang]
    yield from lines[:MOST_FRAMES]
    if len(lines) > MOST_FRAMES:
        yield f"  and {len(lines) - MOST_FRAMES} more"


def _table(contents: TableContents) -> Iterator[str]:
    yield contents.path
    yield f"Table, {contents.rows:,} rows of {len(contents.columns)} columns"
    yield f"  {', '.join(with_slices(contents.columns))}"
    if len(contents.episodes) > 1:
        few = ", ".join(map(str, contents.episodes[:MOST_EPISODES]))
        more = ", ..." if len(contents.episodes) > MOST_EPISODES else ""
        yield f"  {len(contents.episodes)} episodes, {few}{more}: --episode N chooses one; times of the first:"
    yield from _times(contents)


def _times(contents: TableContents) -> Iterator[str]:
    if contents.rhythm is None or contents.rhythm.last is None or contents.start is None:
        yield "  no times, so no rate and no gaps"
        return
    rhythm = contents.rhythm
    yield f"  times: {rhythm.last:.6g} s{_since(contents.start)}"
    yield f"  rate: {_rate(rhythm)} Hz, longest gap {_gap(rhythm)}" if rhythm.rate else "  rate: not known"


def _rate(rhythm: Rhythm) -> str:
    return f"{rhythm.rate:.4g}" if rhythm.rate is not None else ""


def _gap(rhythm: Rhythm) -> str:
    if rhythm.longest_gap is None or rhythm.gap_at is None:
        return "" if rhythm.first is None else f"at {rhythm.first:.3f} s"
    return f"{rhythm.longest_gap:.3g} s at {rhythm.gap_at:.3f} s"


def _since(start: float) -> str:
    if not UNIX_TIMES[0] < start < UNIX_TIMES[1]:
        return ""
    return f" from {datetime.fromtimestamp(start, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _type(topic: TopicContent) -> str:
    """The type without its package: JSON has the whole."""
    name = topic.type.rpartition("/")[2]
    return name if len(name) <= TYPE_WIDTH else f"{name[: TYPE_WIDTH - 2]}.."
