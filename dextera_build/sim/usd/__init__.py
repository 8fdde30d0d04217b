"""Twins as USD."""
