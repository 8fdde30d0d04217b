"""Robots, their recordings, and the cells that they work in."""
