"""Digest to bytes, key to result: the content-addressed store, with its locks and checks."""
