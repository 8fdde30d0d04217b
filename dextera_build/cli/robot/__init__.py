"""Verbs that connect to robots."""
