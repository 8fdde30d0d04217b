"""Verbs that set up a project, inspect the machine, or help."""
