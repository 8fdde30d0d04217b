"""Pose tracking of known objects in RGB-D frames."""
