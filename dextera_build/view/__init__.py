"""Artifacts in a viser scene."""
