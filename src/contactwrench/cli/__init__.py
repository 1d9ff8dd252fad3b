"""The command line: one file a verb, argument parsing only; each verb calls one function."""

from .main import main

__all__ = ["main"]
