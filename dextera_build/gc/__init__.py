"""Garbage collection and verification of the store."""
