"""Answers about past builds: why a node is stale, where inputs came from, what a node read."""
