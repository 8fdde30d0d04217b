"""TODO gaussians."""
