"""Poses, poses and joint states over time, points."""
