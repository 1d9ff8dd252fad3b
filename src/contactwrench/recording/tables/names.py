"""How people name columns: what one header says, in any case and with anything between its words.

A header is words of a quantity ("force"), an axis or a number ("x", "[3]"), a unit ("(N)", "_nmm"), and words that say
nothing ("wrench", "measured"). With any other word it says nothing: `fx_std`, `target_x` and `cmd_fx` are no readings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import dropwhile

from .columns import NANOSECONDS, POSITION, WRENCH_COLUMNS
from .units import MEGANEWTON, SPELLED, in_ascii, plain, unit_of

_ANY_UNIT = {word for spelled in SPELLED.values() for word in spelled}
SECONDS = "sec"
_SECONDS = (SECONDS, "secs")
_NANOSECONDS = (NANOSECONDS, "nanosecs", "nsec", "nsecs")
"""Of a stamp in two columns, its fields in ROS 2 and 1."""

QUANTITIES = {
    **dict.fromkeys(WRENCH_COLUMNS[:3], "force"),
    **dict.fromkeys(WRENCH_COLUMNS[3:], "torque"),
    **dict.fromkeys(("a", "b", "c", "w", "p", "r", "o", "rx", "ry", "rz", "roll", "pitch", "yaw"), "angle"),
    **dict.fromkeys(POSITION, "length"),
    **dict.fromkeys(("t", SECONDS, NANOSECONDS), "time"),
    "load": "load",
}
"""Of a part, by its usual name; a part that is not here has no unit. `t` is Kawasaki's angle too: `orientations`."""

VECTORS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(
        ("wrench", "ft", "fts", "forcetorque", "ftsensor", "ftwrench", "forcetorquesensor"), WRENCH_COLUMNS
    ),
    "force": WRENCH_COLUMNS[:3],
    **dict.fromkeys(("torque", "moment"), WRENCH_COLUMNS[3:]),
    **dict.fromkeys(("position", "pos"), POSITION),
    "rpy": ("roll", "pitch", "yaw"),
    "rotvec": ("rx", "ry", "rz"),
    "quatxyzw": ("qx", "qy", "qz", "qw"),
    "quatwxyz": ("qw", "qx", "qy", "qz"),
    "tcppose": (*POSITION, "rx", "ry", "rz"),
    "otee": tuple(f"o_t_ee_{k}" for k in range(16)),
    "rot6d": tuple(f"rot6d_{k}" for k in range(6)),
}
"""Of numbered columns, and of the elements of a list: the parts in their order, by the words without their blanks.

`actual_TCP_pose` is metres and a rotation vector in rad: UR's guide to RTDE.
"""
ESTIMATES = {
    "actual_tcp_force": ("UR's controller", "record ft_raw_wrench", " --wrench-frame base"),
    "o_f_ext_hat_k": ("Franka's controller", "record a sensor of its own", " --wrench-frame base"),
    "k_f_ext_hat_k": ("Franka's controller", "record a sensor of its own", ""),
}
"""Numbered columns that hold what a controller takes for the contact wrench, its own payload subtracted already: whose,
what to record instead, and what says in which axes they are. Beside a sensor's readings they are left alone.
"""


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


_ANYWHERE = _set(
    "actual current measured measurement measurements meas act ist data field msg message state value values reading "
    "readings observation observations obs receive"
)
_OF_WRENCH = _ANYWHERE | _set(
    "wrench ft fts ftsensor sensor raw wrist ee eef netft ati axia robotiq bota onrobot optoforce resense ftc"
)
_OF_POSE = _ANYWHERE | _set(
    "pose position pos tcp ee eef flange tool robot cartesian cart rist end effector transform translation"
)
_OF_ANGLES = _OF_POSE | _set("orientation euler rpy angle angles rotation rot")
OTHER_CLOCKS = _set("sim simulation wall host controller monotonic recv")
"""Words of times that count where a row has no others."""
_OF_TIME = (
    OTHER_CLOCKS | _ANYWHERE | _set("header sensor ft wrench pose robot unix epoch ros system relative since start")
)
_OF_LISTS = _ANYWHERE | _set("raw robot ee eef")
NOT_MEASURED = _set(
    "target desired cmd command commanded ref reference setpoint error err std stddev var bias offset gravity virtual "
    "contact compensated estimated filtered external ext"
)
"""Words of a topic of something else than readings; before `/topic/wrench/force/x` any others are its name."""

_NAMES: tuple[tuple[frozenset[str], str, str], ...] = (
    (_OF_WRENCH, r"(?:(f)|forces?|kraft)(?P<axis>[xyz])|(?P<first>[xyz])(?:forces?|kraft)", "f{}"),
    (
        _OF_WRENCH,
        r"(?:([tm])|torques?|moments?|tau|drehmoment)(?P<axis>[xyz])|(?P<first>[xyz])(?:torques?|moments?|drehmoment)",
        "t{}",
    ),
    (_OF_POSE, r"(?:q|quat|quaternion|orientation|orient|ori|rotation|rot)+(?P<axis>[wxyz])", "q{}"),
    (_OF_POSE, r"(?:(r)|rv|rotvec|rotationvector|axisangle)(?P<axis>[xyz])", "r{}"),
    (_OF_POSE, r"(?:r|rot|rotation|rotmat|matrix)(?P<axis>[123][123])", "r{}"),
    (_OF_POSE, r"(?P<axis>[xyzabcwpro])", "{}"),
    (_OF_ANGLES, r"(?P<axis>roll|pitch|yaw)", "{}"),
    (_OF_TIME, r"(?P<axis>t|time|timestamps?|stamp|elapsed|elapsedtime|timeelapsed|zeit)", "t"),
    (frozenset(), r"(?P<axis>load|saturated)", "{}"),
)
"""Words that say nothing there, what is left of a header without them and without blanks, and the part that it is. The
first group: a letter alone, which needs company (see `header`).
"""
_RECORDERS = {"%time": "ns", "rosbagtimestamp": "ns", "__time": "s", "ipoc": "ms"}
"""Times of the program that wrote the file: `rostopic echo -p`, rosbag_to_csv, PlotJuggler; of a KUKA's RSI."""


@dataclass(frozen=True)
class Meaning:
    """What a header says.

    `part`: by its usual name, `fx`; of a numbered column its vector, as in `VECTORS`, and `index`. `unit`: a key of
    `UNITS`, "" where none is stated, or what stands in brackets and is none. `of`: the words, without axis and unit,
    alike for columns of one set; `sensor`: those without the quantity, alike for force and torque. `letter`: whether
    one letter is all that says so, as in `mx`.
    """

    part: str
    unit: str
    of: str = ""
    sensor: str = ""
    index: int | None = None
    letter: bool = False


@lru_cache(4096)
def meaning(header: str) -> Meaning | None:
    """What a header says; None where it says nothing that is known."""
    if (bare := header.strip().lower()) in _RECORDERS:
        return Meaning("t", _RECORDERS[bare], bare)
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", header)  # wrenchForceX
    return next((said for text in dict.fromkeys((header, apart)) if (said := _said(text))), None)


def stated_unit(quantity: str, header: str) -> str:
    """The unit that a header states for a quantity, whatever its other words are, as `Meaning.unit`."""
    words, bracket = _words(header)
    if bracket is not None:
        return unit_of(quantity, bracket) or bracket
    tails = (_suffix(quantity, "".join(words[-k:]), header) for k in (3, 2, 1) if k < len(words))
    return next(filter(None, tails), "")


def _said(header: str) -> Meaning | None:
    words, bracket = _words(header)
    if bracket is not None:
        found = _part(words, header)
        unit = None if found is None else unit_of(quantity_of(found), bracket)
        if found is None or (unit is None and words == ["t"]):  # T (°C) is no time
            return None
        return _with_unit(found, unit or bracket)
    if found := _part(words, header):
        return found
    for length in range(1, min(3, len(words)) + 1):
        spelled, rest = "".join(words[-length:]), words[:-length]
        if spelled in _SECONDS or spelled in _NANOSECONDS:
            part = SECONDS if spelled in _SECONDS else NANOSECONDS
            stamp = _part(rest, header)
            if not rest or (stamp is not None and stamp.part == "t"):
                return Meaning(part, SPELLED["time"][spelled], stamp.of if stamp is not None else "")
        found = _part(rest[:-1] if rest[-1:] == ["in"] else rest, header) if spelled in _ANY_UNIT else None
        unit = None if found is None else _suffix(quantity_of(found), spelled, header)
        if found is not None and unit is not None:
            return _with_unit(found, unit)
    return None


def _suffix(quantity: str, spelled: str, header: str) -> str | None:
    """The unit that the last words of a header spell; None where they spell none."""
    unit = SPELLED[quantity].get(spelled)
    return MEGANEWTON if unit in ("mN", "mN m") and MEGANEWTON in header else unit


def quantity_of(said: Meaning) -> str:
    """What a part is a kind of, a key of `UNITS`; of a vector, of its element."""
    part = said.part
    if said.index is not None and part in VECTORS:
        part = VECTORS[part][min(said.index, len(VECTORS[part]) - 1)]
    return QUANTITIES.get(part, "")


def _with_unit(found: Meaning, unit: str) -> Meaning:
    """With its unit, which tells `tx` in N m from a translation."""
    return replace(found, unit=unit, letter=found.letter and found.part not in WRENCH_COLUMNS[3:])


def _part(words: list[str], header: str) -> Meaning | None:
    """What the words of a header say, but for its unit."""
    if words and words[-1].isdecimal() and (numbered := _numbered(words[:-1], int(words[-1]))):
        return numbered
    topic, words = _without_topic(words, header)
    for nothing, pattern, part in _NAMES:
        left, others = _split(words, nothing)
        match = re.fullmatch(pattern, left)
        if match is None:
            continue
        axis = match.groupdict().get("first") or match["axis"]
        if part == "t":
            unit = "ns" if others[:1] == ["field"] and axis == "stamp" else ""  # rostopic echo -p: one integer
            return Meaning("t", unit, " ".join([*topic, *others, axis]))
        letter = match.re.groups > len(match.re.groupindex) and match[1] is not None
        explicit = {"wrench", "ft", "fts", "ftsensor"} & set(others)
        sensor = " ".join([*topic, *others])
        of = f"{sensor} {left.removesuffix(axis).removeprefix(axis)}"
        return Meaning(part.format(axis), "", of, sensor, None, letter and not explicit)
    return None


def _numbered(words: list[str], index: int) -> Meaning | None:
    """A numbered column, or an element of a list."""
    of = "_".join(words)
    if of in ESTIMATES:
        return Meaning(of, "", of, of, index)
    named, others = _split(words, _OF_LISTS)
    after_others = "".join(dropwhile(_OF_LISTS.__contains__, words))  # O_T_EE: EE is one of them, too
    for left in ("".join(words), after_others, named):
        if left in VECTORS and (left != "tcppose" or "actual" in words):
            return Meaning(left, "", of, " ".join(others), index)
    return None


def _split(words: list[str], nothing: frozenset[str]) -> tuple[str, list[str]]:
    """The words that say what a column is, as one, and the others, with the number that follows one of them."""
    left: list[str] = []
    others: list[str] = []
    for k, word in enumerate(words):
        numbers_one = word.isdecimal() and k > 0 and words[k - 1] in nothing and k + 1 < len(words)
        (others if word in nothing or numbers_one else left).append(word)
    return "".join(left), others


def _without_topic(words: list[str], header: str) -> tuple[list[str], list[str]]:
    """Of a path such as `/topic/wrench/force/x` the topic, unless it tells of no readings, and the message's field."""
    if header.lstrip().startswith("/") and not NOT_MEASURED & set(words):
        for k, word in enumerate(words):
            if k > 0 and word in ("wrench", "orientation", "position", "header"):
                return words[:k], words[k:]
    return [], words


def _words(header: str) -> tuple[list[str], str | None]:
    """The words of a header in small letters, numbers apart, and what stands in brackets where that is no number and no
    axis. No words where it has signs that do more than stand between words.
    """
    unit: str | None = None
    header = in_ascii(header)

    def within(match: re.Match[str]) -> str:
        nonlocal unit
        content = match[1].strip()
        if content in ("", "-") or (content.isdecimal() and header[match.end() :][:1] == "."):  # no unit; a[3].fx
            return " "
        if content.isdecimal() or content.lower() in POSITION:
            return f" {content} "
        unit = content if unit is None else f"{unit} {content}"
        return " "

    rest = plain(re.sub(r"[\[({<]([^\[\](){}<>]*)[\])}>]", within, header)).strip()
    if rest.startswith("-") or re.search(r"[^\w\s./:$,;#'\"·*-]", rest):
        return [], unit
    return re.findall(r"[^\W\d_]+|\d+", rest), unit
