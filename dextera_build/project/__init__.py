"""A project: its folder, its settings, its lock file."""
