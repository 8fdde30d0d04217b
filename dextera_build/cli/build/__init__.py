"""Verbs that build, or say what a build would do."""
