"""Scripted operators, and demonstrations synthesised from recorded ones."""
