"""Twins and robots as MuJoCo models: names, MJCF, contact parameters."""
