"""The code of rules: where it lies, what of it enters a key, and how a worker runs it."""
