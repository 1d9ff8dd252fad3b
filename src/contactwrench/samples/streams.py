"""The streams of a recording, under their former path."""

from .samples import OrientationStream, Streams, WrenchStream

__all__ = ["OrientationStream", "Streams", "WrenchStream"]
