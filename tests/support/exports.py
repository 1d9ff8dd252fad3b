"""An exported file as its header's sentences are said: each in one line."""

from __future__ import annotations

import re

HANGING = re.compile(r'(?: -->)?\n(?:[#;!%]|<!--| \*) {5}|",\n    " {4}')
"""Where a sentence goes on in the next line: of a comment, or of a list in JSON."""


def unwrapped(text: str) -> str:
    """A file with every sentence of its header in one line."""
    return HANGING.sub(" ", text)
