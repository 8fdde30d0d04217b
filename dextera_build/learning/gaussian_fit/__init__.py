"""3D Gaussians fitted to pictures and depth, with whatever renders them and their gradients."""
