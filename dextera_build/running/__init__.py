"""Runs one node in a worker: decodes its inputs, calls its rule, stores its result."""
