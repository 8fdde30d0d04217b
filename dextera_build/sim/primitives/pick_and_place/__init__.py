"""Primitive `pick_and_place`."""
