"""TODO cameras."""
