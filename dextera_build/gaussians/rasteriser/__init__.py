"""Pictures of 3D Gaussians and their gradients, in NVIDIA Warp: one source for CPU and GPU.

The method is that of Kerbl et al. 2023 (SIGGRAPH) with EWA projection (Zwicker et al. 2001); conventions are those of
the authors' renderer and of gsplat: a low-pass of 0.3 px^2, tiles of 16 x 16 pixels, a minimum opacity of 1/255, a
maximum of 0.99, and no further Gaussians once the transmittance would fall to 1e-4. Gradients are written by hand.
"""
