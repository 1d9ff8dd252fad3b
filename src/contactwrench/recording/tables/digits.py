"""Numbers as text, many at once: as Python's `%.9g` writes them, by whole columns of digits.

A number between 1e-4 and 1e9 is `digits` 10^(exponent - 8) with nine digits, found by a multiplication with a power of
ten that a double holds exactly. Its rounding is off by 1e-7 of the last digit at the most: what lies closer than ten
times that to half a digit is left to Python, and so is what other numbers need.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...geometry.arrays import Array

Letters = NDArray[np.uint8]

POWERS = 10.0 ** np.arange(13)
WIDTH = 24
"""Letters of a number at the most, and places for a sign, `0.000`, and nine digits each with a point after it."""
TO_HALF = 1e-6

MINUS, POINT, ZERO = (np.uint8(ord(letter)) for letter in "-.0")
TEN = np.uint32(10)


def nine_digits(numbers: Array) -> Letters:
    """The letters (n, 24) of numbers (n,), in order, with zeros between them."""
    size = np.abs(numbers)
    with np.errstate(divide="ignore", invalid="ignore"):
        exponent = np.nan_to_num(np.floor(np.log10(size)), nan=0.0, posinf=9.0, neginf=0.0).astype(np.int64)
    by_python = ~((size < 999_999_999.0) & (size >= 1e-4) | (size == 0.0))
    exponent[by_python] = 0
    scaled = np.where(by_python, 0.0, size) * POWERS[8 - exponent]
    digits = np.rint(scaled)
    carried = digits >= 1e9
    by_python |= (np.abs(np.abs(scaled - digits) - 0.5) < TO_HALF) | (digits < 1e8) & (digits > 0.0)
    left = np.where(carried, 1e8, digits).astype(np.uint32)
    place = (exponent + carried).astype(np.int8)

    rows = np.empty((WIDTH, len(numbers)), np.uint8)
    rows[0] = MINUS * np.signbit(numbers).view(np.uint8)
    below_1 = (place < 0).view(np.uint8)
    rows[1], rows[2] = ZERO * below_1, POINT * below_1
    for k in range(3):
        rows[3 + k] = ZERO * (place < -1 - k).view(np.uint8)
    more = np.zeros(len(numbers), np.bool_)
    for k in range(8, -1, -1):
        rest = left // TEN
        digit = (left - rest * TEN).astype(np.uint8)
        left = rest
        rows[7 + 2 * k] = POINT * (more & (place == k)).view(np.uint8)
        more |= digit > 0
        rows[6 + 2 * k] = (digit + ZERO) * (more | (place >= k)).view(np.uint8)
    letters = np.ascontiguousarray(rows.T)
    if by_python.any():
        texts = np.array([b"%.9g" % number for number in numbers[by_python].tolist()], f"S{WIDTH}")
        letters[by_python] = texts.view(np.uint8).reshape(-1, WIDTH)
    return letters
