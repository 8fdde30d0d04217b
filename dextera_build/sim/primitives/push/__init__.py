"""Primitive `push`."""
