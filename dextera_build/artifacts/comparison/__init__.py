"""Differences between two stored values."""
