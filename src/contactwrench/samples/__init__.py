"""Readings and orientations: as samples, as two streams on two clocks, as still segments and poses."""
