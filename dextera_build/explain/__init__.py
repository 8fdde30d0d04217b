"""Answers about what was built: why a node is stale, who made what, what was read."""
