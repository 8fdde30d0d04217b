"""Primitive `handover`."""
