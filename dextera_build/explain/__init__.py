"""Answers about past builds: causes of staleness, origins of inputs, discovered reads."""
