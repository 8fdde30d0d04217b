"""Worlds of a task other than the twin: reference worlds and perturbed twins; also settling of scenes."""
