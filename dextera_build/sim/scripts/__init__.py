"""Scripted operators: one file per primitive."""
