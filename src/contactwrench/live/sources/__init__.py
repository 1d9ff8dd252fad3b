"""Sensors and robots, one file a device: a decoder of bytes, tested without a device, and a thin source around it."""
