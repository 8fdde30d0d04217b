"""TODO spatial."""
