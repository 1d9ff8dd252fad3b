"""What happens while the arm runs."""

from __future__ import annotations


class Session:
    """Phases, events in and out."""
