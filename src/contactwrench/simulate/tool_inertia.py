"""The inertia of the rig's tool, which is felt in motion only: as it is set, or that of a ball."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..geometry.arrays import Array

GYRATION = 0.03
"""m: of a tool whose inertia is not set; assumed."""
ROUNDING = 1e-9


def tool_inertia(mass: float, elements: tuple[float, ...]) -> Array:
    """The matrix (3, 3), kg m^2, of xx, xy, xz, yy, yz, zz; all 0: of a ball of `mass`, kg."""
    if not any(elements):
        return np.eye(3) * (max(mass, 1e-3) * GYRATION**2)
    xx, xy, xz, yy, yz, zz = elements
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def require_body(inertia: Array) -> None:
    """Raise `InputError` where no body has this inertia (3, 3): the integrals of x^2, y^2, z^2 are none below 0, and
    each principal moment is the sum of two of them.
    """
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0.0 or moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        found = ", ".join(f"{moment:.3g}" for moment in moments)
        raise InputError(
            f"tool.inertia has the principal moments {found} kg m^2, expected those of a body: each more than 0, none "
            "more than the other two together"
        )
