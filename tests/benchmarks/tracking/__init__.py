"""Tracked poses, compared with those of rendered sequences: `python -m tests.benchmarks.tracking`."""
