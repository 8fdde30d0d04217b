"""Garbage collection of the store, and its verification."""
