"""Units of the quantities in a table, as people spell them."""

from __future__ import annotations

import re

from ...errors import InputError
from ...geometry.wrench import STANDARD_GRAVITY

LBF, INCH = 4.4482216152605, 0.0254
"""N and m, by the definitions of the international pound and inch."""


def _levers(forces: str, lengths: str) -> str:
    """How a torque is spelled: a force and a length, in either order, as lbf in and in-lb."""
    pairs = [(force, length) for force in forces.split() for length in lengths.split()]
    return " ".join(f"{force}{length} {length}{force}" for force, length in pairs)


_KGF, _DEGREES = 1.0 / STANDARD_GRAVITY, 180.0 / 3.141592653589793
UNITS: dict[str, dict[str, tuple[float, str]]] = {
    "force": {
        "N": (1.0, "n newton newtons"),
        "kN": (1e-3, "kn"),
        "mN": (1e3, "mn"),
        "kgf": (_KGF, "kgf kp"),
        "gf": (1e3 * _KGF, "gf"),
        "lbf": (1.0 / LBF, "lbf lb lbs"),
    },
    "torque": {
        "N m": (1.0, "nm newtonmeter newtonmeters newtonmetre newtonmetres"),
        "N mm": (1e3, "nmm"),
        "N cm": (1e2, "ncm"),
        "mN m": (1e3, "mnm"),
        "kN m": (1e-3, "knm"),
        "kgf m": (_KGF, _levers("kgf kp kg", "m")),
        "kgf cm": (1e2 * _KGF, _levers("kgf kp kg", "cm")),
        "kgf mm": (1e3 * _KGF, _levers("kgf kp kg", "mm")),
        "lbf in": (1.0 / (LBF * INCH), _levers("lbf lb lbs pound pounds", "in inch inches")),
        "lbf ft": (1.0 / (LBF * 12.0 * INCH), _levers("lbf lb lbs pound pounds", "ft foot feet")),
    },
    "time": {
        "s": (1.0, "s sec secs second seconds sek sekunden"),
        "ms": (1e3, "ms msec msecs millisec millisecs millisecond milliseconds"),
        "us": (1e6, "us usec usecs microsec microsecs microsecond microseconds"),
        "ns": (1e9, "ns nsec nsecs nanosec nanosecs nanosecond nanoseconds"),
    },
    "angle": {"deg": (_DEGREES, "deg degs degree degrees"), "rad": (1.0, "rad rads radian radians")},
    "length": {"m": (1.0, "m meter meters metre metres"), "mm": (1e3, "mm"), "cm": (1e2, "cm")},
    "load": {"g": (1e3, "g gram grams"), "kg": (1.0, "kg")},
    "": {},
}
"""Of a quantity: its units, how many make one of SI (a division rounds once, so that 300 ms are 0.3 s to the last
digit), and how they are spelled without what stands between their letters.
"""
SPELLED = {
    quantity: {word: unit for unit, (_, words) in units.items() for word in words.split()}
    for quantity, units in UNITS.items()
}
ANGLE = {unit: per_si for unit, (per_si, _) in UNITS["angle"].items()}
"""How many of a unit of angle make one radian."""
MEGANEWTON = "MN"
"""Capitals tell it from mN, the only place where they tell units apart: no unit of a sensor, nor is one guessed."""
UNREADABLE = "no UTF-8"
"""In place of a unit, where a name cannot be read, and so may state one."""
IN_ASCII = {code + 0xFEE0: code for code in range(0x21, 0x7F)} | str.maketrans("\u3000【】〔〕・･", " [][]··")
FOR_UNITS = ("force", "torque", "angle", "time", "length")
"""What --units takes."""


def unit_of(quantity: str, text: str) -> str | None:
    """The unit of a quantity that `text` spells, as `UNITS` names it; None where it is none."""
    compact = re.sub(r"[\s_.*·⋅•×^-]+", "", plain(in_ascii(text)))
    return None if MEGANEWTON in text else SPELLED[quantity].get(compact)


def per_si(quantity: str, unit: str) -> float:
    """How many of a unit make one of SI; 1 for none."""
    return UNITS[quantity][unit][0] if unit else 1.0


def stated_units(text: str | None) -> dict[str, str]:
    """The units of `force=kgf,torque=Nmm`, by their quantity. Raises `InputError`."""
    stated: dict[str, str] = {}
    for pair in text.split(",") if text is not None else ():
        quantity, equals, spelled = (word.strip() for word in pair.partition("="))
        if not equals or quantity not in FOR_UNITS or quantity in stated:
            raise InputError(f"--units is {text!r}, expected each of {', '.join(FOR_UNITS)} once at most, as force=kgf")
        unit = unit_of(quantity, spelled)
        if unit is None:
            raise InputError(f"--units: found {quantity}={spelled}, expected one of {', '.join(UNITS[quantity])}")
        stated[quantity] = unit
    return stated


def symbol(unit: str) -> str:
    """A unit as a suffix of a column's usual name spells it: `nmm`."""
    return unit.replace(" ", "").lower()


def in_ascii(text: str) -> str:
    """A text with signs of full width as those of ASCII, other brackets as `[ ]`, and the dot of Japanese as `·`."""
    return text.translate(IN_ASCII)


def plain(text: str) -> str:
    """Small letters, without signs that have a spelling in letters."""
    plain = text.lower()
    for sign, letters in (("µ", "u"), ("μ", "u"), ("°", "deg"), ("τ", "tau")):
        plain = plain.replace(sign, letters)
    return plain
