"""Worlds to run a task in beside the twin: reference worlds, disturbed twins, and whether a scene rests."""
