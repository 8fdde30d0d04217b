"""Serves policies to robots and evaluators, by openpi's protocol."""
