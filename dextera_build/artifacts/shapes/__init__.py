"""Surfaces: meshes and 3D Gaussians."""
