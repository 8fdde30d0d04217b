"""Worlds for a task besides the twin: reference worlds and perturbed twins; also settling of scenes."""
