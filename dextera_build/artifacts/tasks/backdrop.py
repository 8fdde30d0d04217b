"""Other backgrounds for the pictures of a film, for policies that shall not depend on the background."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Array, Artifact


class Backdrop(Artifact):
    """Where the pictures of a film show the robot and the objects, and pictures of what is behind them.

    Arrays above 1 MiB are memory-mapped from the store: only what is used is read.
    """

    masks: dict[str, Annotated[np.ndarray, Array("* H B", "uint8")]]
    """Index -> rows (T, H, ceil(W / 8)) of bits, the first pixel highest: 1 shows the robot or an object; the keys are
    those of `Episodes.items`."""
    pictures: Annotated[np.ndarray, Array("N H W 3", "uint8")]
    """Pictures (N, H, W, 3) sRGB of the scene without them, of the size of the film."""

    @staticmethod
    def packed(masks: np.ndarray) -> np.ndarray:
        """The rows of bits of masks (..., W) bool."""
        return np.packbits(masks, axis=-1)

    @staticmethod
    def unpacked(rows: np.ndarray, width: int) -> np.ndarray:
        """The masks (..., W) bool of rows of bits."""
        return np.unpackbits(rows, axis=-1, count=width).astype(bool)
