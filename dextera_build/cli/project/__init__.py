"""Verbs that begin a project or look at the machine."""
