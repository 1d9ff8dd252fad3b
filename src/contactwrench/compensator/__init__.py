"""Contact wrenches one sample at a time: compensation, filters, drift, contact, faults."""

from .compensator import Compensator

__all__ = ["Compensator"]
