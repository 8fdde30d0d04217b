"""Whole scenes: descriptions, simulator models, rooms, reference worlds."""
