"""Cameras, what they record, and their calibration."""
