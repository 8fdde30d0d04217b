"""Joints that are found, compared with those of generated objects: `python -m tests.benchmarks.joints`."""
