"""Verbs that show what was built."""
