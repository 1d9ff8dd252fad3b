"""The estimators, one file each, and `calibrate`, which chooses among them."""

from .ladder import calibrate

__all__ = ["calibrate"]
