"""Primitive `articulate`."""
