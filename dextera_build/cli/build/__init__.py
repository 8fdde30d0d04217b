"""Verbs that build, or show the effect of a build."""
