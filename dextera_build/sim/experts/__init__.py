"""Scripted operators, and demonstrations that are synthesised from recorded ones."""
