"""Runs tasks: starts, steps, records, replays."""
