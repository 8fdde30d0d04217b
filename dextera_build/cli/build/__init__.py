"""Verbs that build, or show what a build would do."""
