"""docs/live-session.md: its table of devices is that of the program, its pictures are small."""

from __future__ import annotations

from pathlib import Path

import pytest

from contactwrench.live.uri import SINKS, SOURCES, Known, known_sinks, known_sources

DOCS = Path(__file__).resolve().parents[2] / "docs"
OWN = [each for each in known_sources() if each.scheme in SOURCES] + [
    each for each in known_sinks() if each.scheme in SINKS
]


@pytest.mark.parametrize("known", OWN, ids=lambda known: known.form)
def test_every_device_has_its_row(known: Known) -> None:
    row = f"| `{known.form}` | {known.about} | {known.rate} | {known.tested} |"
    assert row in (DOCS / "live-session.md").read_text(encoding="utf-8").splitlines(), row


def test_pictures_are_small_and_shown() -> None:
    page = (DOCS / "live-session.md").read_text(encoding="utf-8")
    pictures = list((DOCS / "images" / "live").iterdir())
    assert pictures
    for picture in pictures:
        assert picture.stat().st_size < 80_000
        assert f"images/live/{picture.name}" in page
