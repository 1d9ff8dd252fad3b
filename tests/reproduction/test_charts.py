"""Charts: what they are given is in the SVG, missing figures leave no dot, and the same figures are the same bytes."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from reproduction.charts import Panel, dots_by_group, lines_in_panels
from reproduction.part import Measured


@pytest.mark.slow
def test_lines_have_their_names_steps_and_units() -> None:
    panels = [
        Panel(
            title,
            "deg",
            ("0", "0.5", "2"),
            {"ours": [Measured(0.1, 0.05, 3), None, Measured(2.0, None, 3)], "tare": [None] * 3},
        )
        for title in ("base tilt", "mounting tilt", "pose error", "drift")
    ]
    svg = lines_in_panels(panels, "force error, N")
    ElementTree.fromstring(svg)
    for text in ("base tilt", "drift", "deg", "0.5", "force error, N", "ours", "tare"):
        assert f">{text}<" in svg
    assert svg == lines_in_panels(panels, "force error, N")


@pytest.mark.slow
def test_dots_have_their_values_and_groups() -> None:
    groups: dict[str, dict[str, Measured | None]] = {
        "paper": {"six paper": Measured(0.486, 0.02, 9), "six planned": Measured(0.0379, 0.02, 9)},
        "opposite": {"six paper": None, "six planned": Measured(0.03, None, 9)},
    }
    svg = dots_by_group(groups, "force error, N")
    ElementTree.fromstring(svg)
    for text in ("paper", "opposite", "six paper", "six planned", "0.486", "0.0379", "0.03", "force error, N"):
        assert f">{text}<" in svg
    assert "nan" not in svg.lower()
