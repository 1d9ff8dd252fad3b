"""Universal Robots, CB3 and e-series, by RTDE: the flange's orientation, and the wrist's own sensor where there is one.

An own client: ur-rtde polls, so that it loses and doubles samples, and has no wheel for Python 3.13 and newer.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from struct import Struct, pack
from typing import Any

from ...errors import InputError
from ...geometry.quaternions import from_rotation_vector, inverse, product, rotated
from ..counter import Counter
from ..source import About, Batch, Note, NoteKind, Sample, Six, now
from ..uri import Uri
from .reader import Reader, note_garbage
from .transport import Deadline, Tcp

E_SERIES, CB3 = 500.0, 125.0
"""Hz, the controllers' own."""
NO_SENSOR = 5_000.0
"""N: an arm without a sensor at its wrist shows some 10,000 in `ft_raw_wrench`; no UR's sensor reaches this."""
STATES = ("safety_status", "robot_mode")
WANTED = ("timestamp", "actual_TCP_pose", "tcp_offset", "actual_q", *STATES)
NEEDED = ("timestamp", "actual_TCP_pose")
RAW, COMPENSATED = "ft_raw_wrench", "actual_TCP_force"
SAFETY = {
    3: "protective stop",
    5: "safeguard stop",
    6: "emergency stop",
    7: "emergency stop",
    8: "violation",
    9: "fault",
}
BROKEN = (8, 9)
MODES = {-1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "power off", 4: "power on"}
"""Those in which the joints' angles are not told."""
TORQUE = {
    "e": "about the flange, as an e-series says it; of a sensor that a URCap feeds in, it may be about the TCP",
    "moved": "moved from the TCP, about which a CB3 says it, to the flange",
    "told": "about the TCP, whose offset is not told",
}
"""Of `actual_TCP_force`, as Universal Robots' own driver has it."""
VERSION, CONTROLLER, OUTPUTS, START, PAUSE, DATA, TEXT = KINDS = b"VvOSPUM"
"""The kinds of RTDE's packages, which are a size, a kind and a payload (version 2 of the protocol)."""
HEADER, RELEASE = Struct(">HB"), Struct(">4I")
"""Of a package; and the payload that says the controller's version."""
FORMS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i"}
"""The types of all fields that are asked for."""
LONGEST = 2_048
"""Bytes of a package that is no data."""
EXPECTED, IN_USE = "an RTDE server", "IN_USE"


class Recipe:
    """What a data package holds: fields with these `names` and `types` of RTDE, under the `number` that the controller
    gave it. `places` are each field's numbers among all of a package.
    """

    def __init__(self, number: int, names: Sequence[str], types: Sequence[str]) -> None:
        self.struct = Struct(">" + "".join(FORMS[each] for each in types))
        self.header = HEADER.pack(HEADER.size + 1 + self.struct.size, DATA) + bytes([number])
        self.places: dict[str, slice] = {}
        at = 0
        for name, kind in zip(names, types, strict=True):
            width = int(FORMS[kind][:-1] or 1)
            self.places[name] = slice(at, at + width)
            at += width


def package(kind: int, payload: bytes = b"") -> bytes:
    """As it is sent."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def first(buffer: bytes) -> tuple[int, bytes, bytes] | None:
    """The kind and the payload of the package that a buffer begins with, and what is behind it; None: it is not whole.

    Raises `ValueError` where the buffer begins with none.
    """
    if len(buffer) < HEADER.size:
        return None
    size, kind = HEADER.unpack_from(buffer)
    if not HEADER.size <= size <= LONGEST or kind not in KINDS:
        raise ValueError
    return (kind, buffer[HEADER.size : size], buffer[size:]) if len(buffer) >= size else None


def text_of(payload: bytes) -> str | None:
    """What a text message says; None where it is none: a length, the text, a length, who says it, how grave."""
    end = 1 + payload[0] if payload else 0
    if not payload or len(payload) <= end or len(payload) != end + payload[end] + 2:
        return None
    return payload[1:end].decode("utf-8", "replace")


class UrDecoder:
    """Bytes to samples; the flange is where the TCP is, without the TCP's offset. `rate` Hz was asked for; `wrench` is
    the field of the wrench, or an empty text, and `at_tcp` that its torque is about the TCP, and is moved.
    """

    def __init__(self, recipe: Recipe, rate: float, wrench: str, at_tcp: bool = False) -> None:
        self._recipe, self._buffer = recipe, b""
        self._size = len(recipe.header) + recipe.struct.size
        self._counter = Counter(1e-6, step=round(1e6 / rate), learns=True)
        self._wrench = recipe.places.get(wrench)
        self._to_flange, self._at_tcp = wrench == COMPENSATED, at_tcp
        self._states = {name: recipe.places[name].start for name in STATES if name in recipe.places}
        self._state: tuple[float, ...] = ()
        self._flaw, self._said = "", False
        self._offset, self._back = tuple[float, ...](), (0.0, 0.0, 0.0, 1.0)

    def without_wrench(self) -> None:
        """Give no wrench from now on."""
        self._wrench = None

    def feed(self, data: bytes, arrival: float, batch: Batch) -> None:
        """Put what is whole into the batch, and keep the rest."""
        buffer, size = self._buffer + data, self._size
        header, unpack = self._recipe.header, self._recipe.struct.unpack_from
        at = 0
        while at < len(buffer):
            start = buffer.find(header, at)
            if start == at and len(buffer) - at >= size:
                self._sample(unpack(buffer, at + len(header)), arrival, batch)
                at += size
                continue
            taken = 0 if start == at else self._between(buffer[at:start] if start > 0 else buffer[at:], start, batch)
            if not taken:
                break
            at += taken
        self._buffer = buffer[at:]

    def _between(self, piece: bytes, start: int, batch: Batch) -> int:
        """How many bytes of what stands before the next data package, at `start` if it has come, are done with."""
        if len(piece) >= HEADER.size:
            size, kind = HEADER.unpack_from(piece)
            if kind == TEXT and size <= LONGEST:
                if (text := text_of(piece[HEADER.size : size])) is not None and len(piece) >= size:
                    batch.notes.append(Note(NoteKind.STATUS, f"the robot says {text!r}"))
                    return int(size)
                if start < 0 and len(piece) < size:
                    return 0
        elif start < 0:
            return 0
        keep = next(k for k in (3, 2, 1, 0) if piece.endswith(self._recipe.header[:k])) if start < 0 else 0
        note_garbage(garbage := len(piece) - keep, "package", batch)
        return garbage

    def _sample(self, values: tuple[Any, ...], arrival: float, batch: Batch) -> None:
        places = self._recipe.places
        if not isfinite(sum((values[0], *values[places["actual_TCP_pose"]]))):
            batch.notes.append(Note(NoteKind.GARBAGE, "a package with a pose, or a time, that is no number"))
            return
        device = self._counter.take(round(1e6 * values[0]), arrival, batch)
        if device is None:
            return
        x, y, z, *vector = values[places["actual_TCP_pose"]]
        turn, (dx, dy, dz) = from_rotation_vector(*vector), (0.0, 0.0, 0.0)  # from the flange to the TCP, base axes
        if "tcp_offset" in places and any(offset := values[places["tcp_offset"]]):
            if offset != self._offset:
                self._offset, self._back = offset, inverse(from_rotation_vector(*offset[3:]))
            turn = product(turn, self._back)
            dx, dy, dz = rotated(turn, offset[:3])
        position = x - dx, y - dy, z - dz
        joints = values[places["actual_q"]] if "actual_q" in places else None
        wrench: Six | None = None
        if self._wrench is not None:
            fx, fy, fz, tx, ty, tz = wrench = values[self._wrench]
            if self._at_tcp:
                tx, ty, tz = tx + dy * fz - dz * fy, ty + dz * fx - dx * fz, tz + dx * fy - dy * fx
            if self._to_flange:
                back = inverse(turn)
                wrench = *rotated(back, (fx, fy, fz)), *rotated(back, (tx, ty, tz))
        if (state := tuple([values[place] for place in self._states.values()])) != self._state:
            self._change(state, batch)
        batch.samples.append(Sample(arrival, device, wrench, turn, position, joints, flaw=self._flaw))

    def _change(self, state: tuple[float, ...], batch: Batch) -> None:
        """Another state of the robot: said, and whether its samples can be used in it."""
        told = dict(zip(self._states, state, strict=True))
        self._state = state
        safety, mode = SAFETY.get(int(told.get("safety_status", 1))), MODES.get(int(told.get("robot_mode", 7)))
        broken = told.get("safety_status") in BROKEN
        self._flaw = f"broken: {safety}" if broken else f"off: {mode}" if mode else ""
        said = ", ".join(filter(None, (safety, mode))) or "the robot is well again"
        if safety or mode or self._said:
            batch.notes.append(Note(NoteKind.STATUS, said))
        self._said = True


class Ur(Reader[Tcp]):
    """The controller."""

    FORM = "ur://HOST[:30004][?rate=HZ][&force=compensated]"
    ABOUT = (
        "Universal Robots CB3 and e-series: orientation, position, joints, and in flange axes the raw wrench of an "
        "e-series (5.9 and newer); force=compensated: the wrench about the flange with the payload subtracted by it"
    )
    RATE = "as asked for, else 500 Hz (CB3: 125 Hz)"
    TESTED = "its fake in the lab, written from the RTDE guide; no robot"
    PORT, OPTIONS = 30_004, ("rate", "force")

    def __init__(self, uri: Uri) -> None:
        super().__init__(uri, Tcp(uri.text, "robot's controller, RTDE switched on"), package(PAUSE))
        self._rate = uri.rate()
        self._force = RAW
        if "force" in uri.options:
            if uri.options["force"] != "compensated":
                raise InputError(f"{uri}: found force={uri.options['force']}, expected compensated, or no such option")
            self._force = COMPENSATED

    def open(self) -> About:
        """As `Source`."""
        deadline = self._link.deadline()
        self._link.connect(*self._at, deadline)
        self._answers = b""
        if self._ask(VERSION, b"\x00\x02", deadline) != b"\x01":
            raise self._link.error("an RTDE of version 1", "version 2", "update PolyScope to 3.3 or newer")
        said = self._ask(CONTROLLER, b"", deadline)
        if len(said) != RELEASE.size:
            raise self._link.another(said, EXPECTED)
        version = RELEASE.unpack(said)
        rate = self._rate or (E_SERIES if version[0] >= 5 else CB3)
        recipe = self._recipe(rate, deadline)
        wrench = self._force if self._force in recipe.places else ""
        if self._ask(START, b"", deadline) != b"\x01":
            raise self._link.error("a refusal to start", "data", "end another program that uses RTDE's outputs")
        at_tcp = wrench == COMPENSATED and version[0] < 5
        self._begin(decoder := UrDecoder(recipe, rate, wrench, at_tcp))
        decoder.feed(self._answers, now(), self._early)
        seen = self._first(deadline, lambda: self._link.silent("data packages")).samples[0].wrench
        if wrench == RAW and seen is not None and max(map(abs, seen[:3])) > NO_SENSOR:
            wrench = ""
            decoder.without_wrench()
            self._early.samples = [sample._replace(wrench=None) for sample in self._early.samples]
        return _about(version, rate, wrench, recipe)

    def _recipe(self, rate: float, deadline: Deadline) -> Recipe:
        """The fields that this controller has."""
        names = [*WANTED, self._force]
        while True:
            answer = self._ask(OUTPUTS, pack(">d", rate) + ",".join(names).encode(), deadline)
            types = answer[1:].decode("ascii", "replace").split(",")
            if len(types) != len(names):
                raise self._link.another(answer, EXPECTED)
            if IN_USE in types:
                name = names[types.index(IN_USE)]
                raise self._link.error(
                    f"{name} in use by another client of RTDE", "it free", "end that one, or its input"
                )
            missing = [name for name, kind in zip(names, types, strict=True) if kind not in FORMS]
            if not missing:
                return Recipe(answer[0], names, types)
            if lacking := set(missing) & {*NEEDED, COMPENSATED}:
                raise self._link.error(f"no {lacking.pop()}", "that field of RTDE", "update PolyScope to 3.3 or newer")
            names = [name for name in names if name not in missing]

    def _ask(self, kind: int, payload: bytes, deadline: Deadline) -> bytes:
        """The payload of the answer of this kind; text messages before it are left out. Raises `DeviceError`."""
        self._link.send(package(kind, payload))
        while True:
            try:
                found = first(self._answers)
            except ValueError:
                raise self._link.another(self._answers, EXPECTED) from None
            if found is None:
                if not deadline.left:
                    raise self._link.silent(EXPECTED)
                self._answers += b"".join(self._link.receive(deadline.left))
                continue
            answered, answer, self._answers = found
            if answered == kind:
                return answer


def _about(version: tuple[int, ...], rate: float, wrench: str, recipe: Recipe) -> About:
    series = "e-series" if version[0] >= 5 else "CB3"
    settings = {
        "wrench": wrench or "none: this arm has no sensor at its wrist, or its PolyScope is older than 5.9",
        "tcp": "its offset is subtracted" if "tcp_offset" in recipe.places else "not told: taken as the flange itself",
    }
    if wrench == COMPENSATED:
        settings["compensated"] = "the robot has subtracted its payload and its zero: not what the sensor reads"
        settings["torque"] = TORQUE["e" if version[0] >= 5 else "moved" if "tcp_offset" in recipe.places else "told"]
    name = f"Universal Robots {series}, PolyScope {'.'.join(map(str, version[:3]))}"
    return About(name, bool(wrench), True, rate, settings=settings)
