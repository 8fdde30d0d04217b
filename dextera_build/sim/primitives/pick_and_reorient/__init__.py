"""Primitive `pick_and_reorient`."""
