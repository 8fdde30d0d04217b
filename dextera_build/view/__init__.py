"""Artifacts to a viser scene."""
