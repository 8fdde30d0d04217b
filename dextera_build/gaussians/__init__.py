"""3D Gaussians: arrays, motion, merging, spherical harmonics, rasterisation and their fit to pictures."""
