"""Primitive `lift`."""
