"""Strict YAML, the recipe schema, and the plan that the engine builds."""
