"""What is in a recording, as text for the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from textwrap import wrap

import msgspec

from ..recording.contents import BagContents, FrameContent, Rhythm, TableContents, TopicContent

WIDTH = 100
NAME_WIDTH, TYPE_WIDTH = 34, 30
UNIX_TIMES = (946684800.0, 4102444800.0)
"""s: 2000 to 2100. Other stamps are of clocks that start elsewhere."""
NOTABLE_CLOCK = 0.5
"""s by which stamps in headers may differ from the bag's own before it is said."""
MOST_FRAMES = 60


def contents_text(contents: BagContents | TableContents) -> str:
    """At most 100 columns, times from the start of the recording."""
    return "\n".join(_bag(contents) if isinstance(contents, BagContents) else _table(contents))


def contents_json(contents: BagContents | TableContents) -> str:
    """The fields of the contents under their names."""
    return msgspec.json.format(msgspec.json.encode(asdict(contents)), indent=2).decode()


def _bag(contents: BagContents) -> Iterator[str]:
    count = sum(topic.rhythm.count for topic in contents.topics)
    yield f"{contents.path}"
    yield f"{contents.kind}, {count:,} messages in {contents.duration:.6g} s{_since(contents.start)}"
    name = max([5, *(min(len(topic.name), NAME_WIDTH) for topic in contents.topics)])
    kind = max([4, *(min(len(topic.type), TYPE_WIDTH) for topic in contents.topics)])
    yield ""
    yield f"  {'topic':<{name}}  {'type':<{kind}}{'messages':>11}{'rate Hz':>9}  longest gap"
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
    yield ""
    yield "Read without flags"
    for sentence in contents.reading:
        yield from wrap(sentence, WIDTH, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)


def _topic(topic: TopicContent, name: int, kind: int) -> Iterator[str]:
    head = f"  {_cut(topic.name, name):<{name}}  {_cut(topic.type, kind):<{kind}}"
    yield f"{head}{topic.rhythm.count:>11,}{_rate(topic.rhythm):>9}  {_gap(topic.rhythm)}".rstrip()
    if topic.clock is not None and abs(topic.clock) > NOTABLE_CLOCK:
        way = "behind" if topic.clock > 0.0 else "ahead of"
        yield f"    stamps in its headers are {abs(topic.clock):.6g} s {way} the bag's own"


def _frames(frames: tuple[FrameContent, ...]) -> Iterator[str]:
    children: dict[str, list[FrameContent]] = {}
    for frame in frames:
        children.setdefault(frame.parent, []).append(frame)
    below = {frame.name for frame in frames}
    lines: list[str] = []

    def down(name: str, depth: int, sign: str, above: tuple[str, ...]) -> None:
        lines.append(f"  {'  ' * depth}{sign}{name}")
        for child in children.get(name, ()):
            if child.name not in above:
                down(child.name, depth + 1, "" if child.moves else "= ", (*above, name))

    for root in dict.fromkeys(frame.parent for frame in frames):
        if root not in below:
            down(root, 0, "", ())
    yield from lines[:MOST_FRAMES]
    if len(lines) > MOST_FRAMES:
        yield f"  and {len(lines) - MOST_FRAMES} more"


def _table(contents: TableContents) -> Iterator[str]:
    yield contents.path
    yield f"Table, {contents.rows:,} rows of {len(contents.columns)} columns"
    yield from wrap(_listed(contents.columns), WIDTH, initial_indent="  ", subsequent_indent="  ")
    if contents.rhythm is None or contents.rhythm.last is None or contents.start is None:
        yield "  no times: a column t would tell rate and gaps"
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


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 2]}.."


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)
