"""Orientations, rotations and wrenches: the geometry that every layer shares."""
