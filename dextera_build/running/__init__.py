"""Runs one node in a worker: decodes its inputs, calls its rule, stores what it returns."""
