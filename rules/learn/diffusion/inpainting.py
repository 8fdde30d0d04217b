"""Denoising a window of which some steps are known: real-time chunking for policies that tell the sample.

Black et al. 2025 (arXiv 2506.07339) correct what is told in every pass towards the known steps Y with weights W,
through the Jacobian of the network (pseudoinverse guidance, Song et al. 2023). In the levels of noise of `schedule`,
where r^2 = 1 - a_k, and without their limit of its strength, this is

    clean' = clean + (1 / sqrt(a_k)) (d clean / d mixed)^T W (Y - clean).

The derivative of a network that tells the actions falls towards 0 in the last passes, where hardly any noise is left,
so that even steps of weight 1 come out otherwise (measured, in the page of benchmarks). Here the Jacobian is that of a
sample with unit variance, sqrt(a_k), which leaves

    clean' = clean + W (Y - clean):

the known steps are put into what the next pass sees, as in inpainting (Lugmayr et al. 2022), here with weights. Steps
of weight 1 come out as they are, and a pass needs no derivative.
"""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor

Told = Callable[[Tensor, int], Tensor]


def kept(told: Told, what: str, share: Tensor, known: Tensor, weights: Tensor) -> Told:
    """What is told of the samples, for `schedule.denoised` with `what="sample"`, corrected towards known steps.

    Args:
        told: See `schedule.denoised`.
        what: `noise` or `sample`: which of the two `told` returns.
        share: a_k (K,).
        known: The known steps (1, T, A), in -1 to 1.
        weights: How firmly each is kept (1, T, 1), 0 to 1.
    """

    def corrected(samples: Tensor, level: int) -> Tensor:
        found = told(samples, level)
        if what == "noise":
            found = (samples - (1 - share[level]).sqrt() * found) / share[level].sqrt()
        return found.lerp(known, weights.expand_as(known))

    return corrected
