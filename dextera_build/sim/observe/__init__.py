"""Simulator-only quantities: privileged observations, contacts, progress."""
