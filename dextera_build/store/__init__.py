"""Digest to bytes, key to result: the content-addressed store and what keeps it sound."""
