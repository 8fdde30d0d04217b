"""Verbs that move results between stores, and maintain the store."""
