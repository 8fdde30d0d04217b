"""Fitting of 3D Gaussians to pictures and depth, with any differentiable renderer."""
