"""Mean and scale of channels, computed from training data only and stored in the contract."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.tasks.policy import Channel

FLOOR = 0.02
"""Smallest scale [m, rad, or 1], so that noise of a nearly constant component is not amplified."""


def fitted(channel: Channel, domains: Sequence[np.ndarray], weights: Sequence[float] | None = None) -> Channel:
    """`channel` with the mean and standard deviation of its training samples.

    Args:
        channel: A vector channel, or the action.
        domains: Encoded samples (N, ...) per domain: simulated, recorded on hardware.
        weights: Share of each domain in the training mixture, regardless of size; None: equal shares.
    """
    shares = np.full(len(domains), 1.0) if weights is None else np.array(weights, np.float64)
    shares = shares / shares.sum()
    flat = [samples.reshape(len(samples), -1).astype(np.float64) for samples in domains]
    mean = sum(share * part.mean(axis=0) for share, part in zip(shares, flat, strict=True))
    square = sum(share * np.square(part - mean).mean(axis=0) for share, part in zip(shares, flat, strict=True))
    scale = np.maximum(np.sqrt(square), FLOOR)
    return channel.model_copy(update={"mean": _plain(np.asarray(mean)), "scale": _plain(scale)})


def _plain(values: np.ndarray) -> tuple[float, ...]:
    """Numbers rounded to float32, which makes them the same in training and after loading."""
    return tuple(float(value) for value in values.astype(np.float32))
