"""Verbs that move results between stores, and keep the store."""
